# SPDX-License-Identifier: MIT
"""docs/accuracy.md: constants against measured worst cases, sums against the header."""

from __future__ import annotations

import ctypes
import math
import random
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import theorem
from mpmath import mp, mpf
from sources import number
from theorem import LEAST_TRAVEL, ONE, assert_just_below, float32, floats, travel_error, ulps

COUNTS = [*range(1, 9), *(2**k for k in range(4, 32))]  # of each entry of the table


@dataclass(frozen=True)
class Plan:
    lib: ctypes.CDLL
    words: ctypes.Array[ctypes.c_uint32]

    def entry(self, index: int) -> int:
        """g in Q64, after 4 words of scales."""
        return int(self.words[4 + 2 * index]) << 32 | int(self.words[5 + 2 * index])

    def step(self, w: int, counts: int) -> int:
        state = ctypes.c_int64(w)
        self.lib.dahl_step_counts_q30(self.words, ctypes.byref(state), counts)
        return state.value

    def torque(self, w: int) -> float:
        value: float = self.lib.dahl_torque(self.words, ctypes.byref(ctypes.c_int64(w)))
        return value


def prepare(lib: ctypes.CDLL, sigma0: float, Fc: float, theta: float) -> Plan:  # noqa: N803
    lib.dahl_torque.restype = ctypes.c_float
    words = (ctypes.c_uint32 * 78)()
    assert lib.dahl_prepare(words, floats(sigma0, Fc, theta)) == 0
    return Plan(lib, words)


@pytest.fixture(scope="module")
def lib(library: Path) -> ctypes.CDLL:
    return ctypes.CDLL(str(library))


@pytest.fixture(scope="module")
def constants() -> dict[str, mpf]:
    return theorem.constants()


def random_plan(lib: ctypes.CDLL, low: float, high: float) -> tuple[Plan, mpf]:
    """A plan whose count travels 2^low .. 2^high, and the exact travel."""
    exponent, Fc = random.uniform(low, high), float32(random.uniform(0.1, 10))  # noqa: N806
    theta = float32(2.0**exponent)
    sigma0 = float32(Fc * 2.0**exponent / theta)
    u = mpf(sigma0) * mpf(theta) / mpf(Fc)
    if u < mpf(2) ** low:
        return random_plan(lib, low, high)
    return prepare(lib, sigma0, Fc, theta), u


def check_steps(lib: ctypes.CDLL, k: dict[str, mpf]) -> None:
    """Each step follows (*): the gap is within gap_rounding, the product loses less than cut."""
    random.seed(1)
    most_d, most_t = 0, mpf(0)
    for _ in range(300):
        plan, _ = random_plan(lib, -30, 4)
        for _ in range(30):
            w, n = random.randint(-ONE, ONE), random.randint(1, 8)
            w = w >> random.choice((0, 0, 10, 40)) | random.choice((0, 2**31 - 1, 2**31))
            s, g = random.choice((-1, 1)), plan.entry(n)
            d = (w + 2**31) % 2**32 - 2**31  # w - q, q the nearest of Q30
            exact = Fraction((ONE - s * (w - d)) * g, 2**64)
            t = exact - s * (plan.step(w, s * n) - w)
            assert abs(d) <= k["gap_rounding"] * ONE
            assert 0 <= t < 1 == k["cut"] * ONE
            most_d, most_t = max(most_d, abs(d)), max(most_t, mpf(t.numerator) / t.denominator)
    assert most_d > 0.99 * k["gap_rounding"] * ONE
    assert most_t > 0.99


def check_fine_table(lib: ctypes.CDLL, k: dict[str, mpf]) -> None:
    """u < 2^-20: the first entry, the joins, the travel of the table."""
    random.seed(2)
    most_first = most_join = mpf(0)
    for _ in range(150):
        plan, u = random_plan(lib, -30, random.choice((-29.9, -20.1)))
        entries = [1 - mpf(plan.entry(i + 1)) / 2**64 for i in range(36)]
        first = (entries[0] - mp.exp(-u)) * 2**64
        assert abs(first) <= k["first_entry_units"] + k["series"] * u**3 * 2**64
        U = -mp.log(entries[0])  # noqa: N806
        assert abs(U / u - 1) <= travel_error(k, u)
        most_first = max(most_first, abs(first) - k["series"] * u**3 * 2**64)
        for n, entry in zip(COUNTS, entries, strict=True):
            joins = (entry - mp.exp(-n * U)) * 2**64
            limit = k["join_units"] * mp.expm1(-(n - 1) * U) / mp.expm1(-U)
            assert abs(joins) <= limit + mpf(2) ** -30
            most_join = max(most_join, abs(joins) / limit if n > 1 else mpf(0))
    assert most_first > 0.85 * k["first_entry_units"]
    assert most_join > 0.85


def check_coarse_table(lib: ctypes.CDLL, k: dict[str, mpf]) -> None:
    """u >= 2^-20: the relative error of each entry."""
    random.seed(3)
    worst = mpf(0)
    for _ in range(150):
        plan, u = random_plan(lib, -20, random.choice((-19, 0, 15)))
        for index, n in enumerate(COUNTS):
            g = -mp.expm1(-n * u)
            error = abs(mpf(plan.entry(index + 1)) / 2**64 - g) / g
            assert error <= k["coarse_entry"]
            worst = max(worst, error)
    assert worst > 0.15 * k["coarse_entry"]


def near_a_tie(mantissa: int) -> int:
    """A w in [1/2, 1) whose torque is nearly half way between two floats.

    The unit is that of w times the 32-bit mantissa of Fc; 256 units are one float.
    """
    most = min(mantissa // 256 - 1, random.choice((2**24, 2**23 + 2**18)))
    product = random.randint(2**23, max(most, 2**23)) * 256 + 128
    beside = random.uniform(-1.1, 0.6)
    return int((product * 2**20 + int(beside * 2**20)) * 2**42 // mantissa)


def check_output(lib: ctypes.CDLL, k: dict[str, mpf]) -> None:
    """The rounding from w to a float, in ulp of Fc."""
    random.seed(4)
    worst = Fraction(0)
    limit = Fraction(str(k["output"]))
    for _ in range(200):
        mantissa = random.randint(2**24 - random.choice((2**8, 2**23)), 2**24 - 1)
        Fc = math.ldexp(mantissa, random.randint(-80, 30))  # noqa: N806
        plan = prepare(lib, Fc, Fc, 0.0)
        ulp = Fraction(float(np.spacing(np.float32(Fc))))
        for _ in range(100):
            near = random.random() < 0.8
            w = near_a_tie(mantissa * 256) if near else random.randint(-ONE, ONE)
            error = abs(Fraction(plan.torque(w)) - Fraction(w, ONE) * Fraction(Fc)) / ulp
            assert error <= limit
            worst = max(worst, error)
    assert worst > limit - Fraction(5, 10000)


CHECKS: dict[str, Callable[[ctypes.CDLL, dict[str, mpf]], None]] = {
    "steps": check_steps,
    "fine table": check_fine_table,
    "coarse table": check_coarse_table,
    "output": check_output,
}


@pytest.mark.parametrize("check", CHECKS)
def test_constants_against_the_worst_measured(
    check: str, lib: ctypes.CDLL, constants: dict[str, mpf]
) -> None:
    CHECKS[check](lib, constants)


def error(k: dict[str, mpf], u: mpf) -> mpf:
    """E(u) by counts."""
    if u < mpf(2) ** -20:
        cut = k["cut"] / u * (1 + mpf(2) ** -18)
        return k["gap_rounding"] * (1 + mpf(2) ** -32) + cut + k["sensitivity"] * travel_error(k, u)
    always = (k["gap_rounding"] + 2 * k["coarse_entry"]) * (1 + mpf(2) ** -32)
    return always - k["cut"] / mp.expm1(-u)


def error_by_angle(k: dict[str, mpf], ticks: float) -> mpf:
    """With u = 2^-30, and `ticks` ticks of less travel."""
    always = k["gap_rounding"] * (1 + k["kernel"]) + 2 * k["kernel"] * (1 + mpf(2) ** -31)
    cut = k["cut"] * (1 + mpf(2) ** -31)
    return always - cut / mp.expm1(-LEAST_TRAVEL) + ticks * (cut + k["kernel_units"] / 2**64)


def test_sums_lead_to_the_header(constants: dict[str, mpf]) -> None:
    k = constants
    worst = error(k, LEAST_TRAVEL)
    assert_just_below(worst, 7.43e-10, 0.002)
    assert_just_below(worst + k["gap_rounding"], number("DAHL_ERROR_Q30"), 0.01)
    assert_just_below(ulps(k, worst), number("DAHL_ULP_COUNTS"), 0.01)
    mixed = error_by_angle(k, 2.0**31) + 2 * travel_error(k, LEAST_TRAVEL)
    assert_just_below(ulps(k, mixed), number("DAHL_ULP_ANGLE"), 0.02)
    assert_just_below(mixed + k["gap_rounding"], 5.8e-9, 0.03)
    inverse = 2 * (k["gap_rounding"] + k["cut"] / LEAST_TRAVEL) * (1 + mpf(2) ** -32)
    assert_just_below(inverse, number("DAHL_INVERSE_ERROR", "dahl_parts.h"), 0.1)
    assert k["kernel"] == number("DAHL_KERNEL_ERROR", "kernel.h")


def test_no_travel_errs_more_than_the_least(constants: dict[str, mpf]) -> None:
    """E(u) over all travels; 9.4e-10 from 4e-8 on; and the form that test_accuracy.c reads."""
    bound = number("DAHL_ERROR_Q30")
    for i in range(1000):
        u = LEAST_TRAVEL * mpf(2) ** (mpf(i) / 20)
        total = error(constants, u) + constants["gap_rounding"]
        assert total <= bound
        assert total <= 9.4e-10 or u < 4e-8
        assert total <= mpf(2) ** -30 + 5 * mpf(2) ** -64 / u + mpf(2) ** -38


def test_sensitivity_is_the_integral(constants: dict[str, mpf]) -> None:
    """|1 - T| exp(-T) over all travel."""
    integral = mp.quad(lambda t: abs(1 - t) * mp.exp(-t), [0, 1, 4, 20, 200])
    assert_just_below(integral, float(constants["sensitivity"]), 1e-4)
