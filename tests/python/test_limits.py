# SPDX-License-Identifier: MIT
"""What the C accepts and computes at its limits, against exact fractions."""

from __future__ import annotations

import ctypes
import math
import struct
from collections.abc import Iterator
from fractions import Fraction
from random import Random
from typing import Any

import pytest
from dahl import core

OK, RANGE = 0, -2
ONE = 1 << 62
# Every call leaves -STATE_END <= w < STATE_END (dahl.h).
STATE_END = ONE + (1 << 31)


@pytest.fixture(scope="module")
def library() -> ctypes.CDLL:
    return core.library()


def prepared(library: ctypes.CDLL, sigma0: float, Fc: float, theta: float) -> tuple[int, Any]:
    plan = (ctypes.c_uint64 * core.PLAN_ROOM)()
    return library.dahl_prepare(plan, core._Params(sigma0, Fc, theta)), plan


def throughput(library: ctypes.CDLL, sigma0: float, Fc: float, theta: float) -> int:
    params = ctypes.byref(core._ThroughputParams(sigma0, Fc, theta))
    return int(library.dahl_throughput_counts(params, None, None, None, 0))


def as_float(x: float) -> float:
    return float(struct.unpack("f", struct.pack("f", x))[0])


def next_floats(x: float, by: int) -> float:
    (bits,) = struct.unpack("i", struct.pack("f", x))
    return float(struct.unpack("f", struct.pack("i", bits + by))[0])


def near_a_limit(seed: int, count: int) -> Iterator[tuple[float, float, float, bool]]:
    """Parameters whose travel is at a limit, just beside it, or on it; and whether it is within."""
    random = Random(seed)
    for _ in range(count):
        limit = random.choice([2.0**-30, 2.0**20])
        # Few bits make products that are exactly on the limit; many bits make those beside it.
        bits = random.choice([1, 2, 3, 12, 24])
        sigma0 = as_float(random.randint(1, 2**bits) * 2.0 ** random.randint(-10, 10))
        Fc = as_float(random.randint(1, 2**bits) * 2.0 ** random.randint(-10, 10))
        theta = next_floats(as_float(limit * Fc / sigma0), random.randint(-1, 1))
        travel = Fraction(sigma0) * Fraction(theta) / Fraction(Fc)
        yield sigma0, Fc, theta, Fraction(1, 2**30) <= travel < 2**20


@pytest.mark.parametrize(
    "params, code", [((1.0, 3.0, 3 * 2.0**-30), OK), ((2.0**20, 3.0, 3.0), RANGE)]
)
def test_a_travel_on_the_limit(library, params: tuple[float, float, float], code: int) -> None:
    """2^-30 is in, 2^20 is out, also where sigma0/Fc has no end in binary."""
    assert prepared(library, *params)[0] == code
    assert throughput(library, *params) == code


def test_limits_are_decided_exactly(library) -> None:
    for sigma0, Fc, theta, within in near_a_limit(1, 20000):
        wanted = OK if within else RANGE
        assert prepared(library, sigma0, Fc, theta)[0] == wanted, (sigma0, Fc, theta)
        assert throughput(library, sigma0, Fc, theta) == wanted, (sigma0, Fc, theta)


def test_limits_of_doubles_are_decided_exactly(library) -> None:
    random = Random(2)
    for _ in range(20000):
        limit = random.choice([2.0**-30, 2.0**20])
        sigma0, Fc = random.uniform(1e-3, 1e3), random.uniform(1e-3, 1e3)
        theta = limit * Fc / sigma0
        theta = math.nextafter(theta, random.choice([0.0, math.inf]))
        travel = Fraction(sigma0) * Fraction(theta) / Fraction(Fc)
        within = Fraction(1, 2**30) <= travel < 2**20
        assert throughput(library, sigma0, Fc, theta) == (OK if within else RANGE)


def changed(library: ctypes.CDLL, before: Any, after: Any, w: int) -> int:
    state = core.State(w)
    library.dahl_change_plan(before, after, state)
    return state.w


def exact_change(before: tuple[float, float], after: tuple[float, float], w: int) -> Fraction:
    """F in N m as dahl.h says it."""
    sigma0, Fc = map(Fraction, before)
    new_sigma0, new_Fc = map(Fraction, after)
    F = Fraction(w, ONE) * Fc
    F *= min(Fraction(1), new_sigma0 / sigma0)
    return max(-new_Fc, min(new_Fc, F))


def test_change_of_plan_keeps_what_it_promises(library) -> None:
    """Any ratio of Fc and sigma0, up to the ends of what a plan takes, and any state."""
    random = Random(3)

    def torque() -> float:
        return as_float(random.uniform(1, 1.9999) * 2.0 ** random.randint(-64, 63))

    for _ in range(20000):
        one, other = (torque(), torque()), (torque(), torque())
        if random.random() < 0.5:  # the same stiffness: F is kept, or clamped
            other = (one[0], other[1])
        w = random.choice([1, -1]) * random.randint(0, ONE) >> random.randint(0, 61)
        (code, before), (code_too, after) = (prepared(library, *p, 0.0) for p in (one, other))
        assert code == code_too == OK
        F = Fraction(changed(library, before, after, w), ONE) * Fraction(other[1])
        wanted = exact_change(one, other, w)
        allowed = abs(wanted) / 2**30 + Fraction(other[1]) / ONE
        assert abs(F - wanted) <= allowed, (one, other, w)


WHOLE = (100.0, 0.5, 1e-3)


def test_states_stay_where_the_header_says(library) -> None:
    """From both ends of the range, by every call."""
    code, plan = prepared(library, *WHOLE)
    assert code == OK
    for w in (STATE_END - 1, ONE, ONE - 1, -ONE, -STATE_END, 1 - STATE_END):
        for count in (0, 1, -1, 8, -8, 9, -9, 1000, -1000, 2**31 - 1, -(2**31)):
            state = core.State(w)
            q30 = library.dahl_step_counts_q30(plan, state, count)
            assert -(2**30) <= q30 <= 2**30 and -STATE_END <= state.w < STATE_END
            assert abs(library.dahl_torque(plan, state)) <= WHOLE[1]
        for angle in (0.0, 1e-20, 1e-3, -1e-3, 10.0, -10.0, math.inf, -math.inf, math.nan):
            state = core.State(w)
            F = library.dahl_step(plan, state, angle)
            assert abs(F) <= WHOLE[1] and -STATE_END <= state.w < STATE_END
        assert -ONE <= changed(library, plan, plan, w) <= ONE
