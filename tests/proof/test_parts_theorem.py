# SPDX-License-Identifier: MIT
"""docs/accuracy.md on asymmetric, loaded and elasto-plastic friction: constants against measured
worst cases, sums against the header.
"""

from __future__ import annotations

import ctypes
import random
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from mpmath import mp, mpf
from sources import number
from test_error_theorem import LEAST_TRAVEL, THEOREM, read_constants, travel_error, ulps

mp.prec = 220
ONE = 2**62
PARTS = "dahl_parts.h"


class DahlPlan(ctypes.Structure):
    """dahl_plan_t"""

    _fields_ = [("words", ctypes.c_uint32 * 78)]


class AsymmetricPlan(ctypes.Structure):
    """dahl_asymmetric_plan_t"""

    _fields_ = [
        ("end_forward", ctypes.c_uint64),
        ("end_backward", ctypes.c_uint64),
        ("rest", ctypes.c_uint32 * 94),
    ]


class ElastoplasticPlan(ctypes.Structure):
    """dahl_elastoplastic_plan_t"""

    _fields_ = [
        ("plastic", DahlPlan),
        ("breakaway", ctypes.c_int64),
        ("travel", ctypes.c_uint64 * 9),
        ("gap_q31", ctypes.c_uint32),
        ("direct_counts", ctypes.c_uint32),
        ("counts_max", ctypes.c_uint32),
    ]


class LoadedState(ctypes.Structure):
    """dahl_loaded_state_t"""

    _fields_ = [("w", ctypes.c_int64), ("load_q30", ctypes.c_uint32)]


@pytest.fixture(scope="module")
def lib(library: Path) -> ctypes.CDLL:
    return ctypes.CDLL(str(library))


@pytest.fixture(scope="module")
def constants() -> dict[str, mpf]:
    return read_constants(THEOREM.read_text())


def float32(x: float) -> float:
    return float(np.float32(x))


def floats(*values: float) -> ctypes.Array[ctypes.c_float]:
    return (ctypes.c_float * len(values))(*values)


def test_ends(lib: ctypes.CDLL, constants: dict[str, mpf]) -> None:
    random.seed(1)
    worst = mpf(0)
    for _ in range(300):
        plan = AsymmetricPlan()
        forward, backward = float32(random.uniform(1, 2)), float32(random.uniform(0.01, 2))
        params = floats(1.0, forward, backward, 0.001)
        assert lib.dahl_asymmetric_prepare(ctypes.byref(plan), params) == 0
        larger = max(forward, backward)
        for end, Fc in ((plan.end_forward, forward), (plan.end_backward, backward)):
            worst = max(worst, abs(mpf(end) / ONE - mpf(Fc) / larger))
    assert 0.9 * constants["end_rounding"] < worst <= constants["end_rounding"]


def test_growth_of_a_load(lib: ctypes.CDLL, constants: dict[str, mpf]) -> None:
    """w falls by its factor, never less, and by growth_units more at most."""
    random.seed(2)
    plan, worst = DahlPlan(), Fraction(0)
    assert lib.dahl_prepare(ctypes.byref(plan), floats(1.0, 1.0, 0.001)) == 0
    for _ in range(20000):
        now = random.randint(1, 2**31 - 1) >> random.choice((0, 0, 1, 10, 25)) | 1
        before = now - 1 if random.random() < 0.3 else random.randrange(now)
        state = LoadedState(random.randint(-ONE, ONE) >> random.choice((0, 0, 5, 40)), before)
        exact = Fraction(state.w * before, now)
        lib.dahl_loaded_step_counts_q30(
            ctypes.byref(plan), ctypes.byref(state), 0, ctypes.c_uint32(now)
        )
        lost = abs(exact) - abs(state.w)
        assert 0 <= lost and (state.w == 0 or (state.w > 0) == (exact > 0))
        worst = max(worst, lost)
    assert 0.6 * constants["growth_units"] < worst < constants["growth_units"]


def crossed(lib: ctypes.CDLL, plan: ElastoplasticPlan, start: int) -> int:
    """x after one count from x = start."""
    state = ctypes.c_int64(start)
    lib.dahl_elastoplastic_step_counts_q30(ctypes.byref(plan), ctypes.byref(state), 1)
    return state.value


def test_elastoplastic(lib: ctypes.CDLL, constants: dict[str, mpf]) -> None:
    random.seed(3)
    k = constants
    most_count = most_breakaway = most_crossing = mpf(0)
    for _ in range(300):
        sigma0, theta = float32(random.uniform(0.5, 1)), float32(2.0 ** random.uniform(-28.9, 0.9))
        b = float32(random.choice((random.uniform(0.01, 0.999), 2.0 ** random.uniform(-30, -8))))
        plan = ElastoplasticPlan()
        prepare = lib.dahl_elastoplastic_prepare
        params = floats(sigma0, float32(0.9), theta)
        assert prepare(ctypes.byref(plan), params, ctypes.c_float(b)) == 0
        u, breakaway = mpf(plan.travel[1]) / ONE, mpf(plan.breakaway) / ONE
        count_error = abs(u - mpf(sigma0) * theta / float32(0.9)) * ONE
        assert count_error <= u * 2**-60 * ONE + 0.5
        most_count = max(most_count, count_error if u < 2**-9 else mpf(0))
        most_breakaway = max(most_breakaway, abs(breakaway - mpf(b)))
        assert plan.breakaway == b * ONE or b < 2**-8
        for _ in range(30):
            before = plan.breakaway - random.randrange(plan.travel[1])
            rest = u - mpf(plan.breakaway - before) / ONE
            g = -mp.expm1(-rest / (1 - breakaway))
            error = mpf(crossed(lib, plan, before)) / ONE - breakaway - (1 - breakaway) * g
            error = max(abs(error) - 2 * k["cut"], mpf(0)) / ((1 - breakaway) * g)
            most_crossing = max(most_crossing, error)
    assert 0.9 * k["count_units"] < most_count <= k["count_units"]
    assert 0.9 * k["breakaway_rounding"] < most_breakaway <= k["breakaway_rounding"]
    assert 0.4 * k["kernel"] < most_crossing <= k["kernel"] + k["crossing"]


def assert_below(bound: mpf, said: float, slack: float) -> None:
    assert said * (1 - slack) <= bound <= said


def test_sums_lead_to_the_header(constants: dict[str, mpf]) -> None:
    k = constants
    u, travel, half = LEAST_TRAVEL, travel_error(k, LEAST_TRAVEL), k["gap_rounding"]
    tick = half + k["cut"] / u
    asymmetric = tick + k["end_rounding"] + 4 * travel
    assert_below(asymmetric + half, number("DAHL_ASYMMETRIC_ERROR_Q30", PARTS), 0.01)
    growth = k["growth_units"] / mpf(2) ** 31
    loaded = max(tick, growth) + 2 * travel
    assert_below(2 * (loaded + half) + half, number("DAHL_LOADED_ERROR_Q30", PARTS), 0.01)
    assert_below(max(tick, growth / 2) + 2 * travel + 2 * half, 1.85e-9, 0.03)
    elastoplastic = max(k["kernel"] + k["crossing"], tick)
    elastoplastic += 2 * k["count_units"] / ONE / u + travel + k["breakaway_rounding"]
    assert_below(elastoplastic + half, number("DAHL_ELASTOPLASTIC_ERROR_Q30", PARTS), 0.02)
    for most in (ulps(k, asymmetric), ulps(k, loaded) + mpf(1) / 128, ulps(k, elastoplastic)):
        assert most <= number("DAHL_ULP_PARTS", PARTS)
