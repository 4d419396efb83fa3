# SPDX-License-Identifier: MIT
"""docs/accuracy.md on the parts: constants against measured worst cases in exact fractions, sums
against the header.
"""

from __future__ import annotations

import ctypes
import random
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import theorem
from mpmath import mp, mpf
from sources import number
from theorem import LEAST_TRAVEL, ONE, assert_just_below, float32, floats, travel_error, ulps

PARTS = "dahl_parts.h"
MOST = 8  # slip elements


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


class SlipParams(ctypes.Structure):
    """dahl_slip_params_t"""

    _fields_ = [
        ("elements", ctypes.c_uint32),
        ("theta_per_count", ctypes.c_float),
        ("sigma0", ctypes.c_float * MOST),
        ("Fc", ctypes.c_float * MOST),
    ]


class SlipElement(ctypes.Structure):
    """dahl_slip_element_t"""

    _fields_ = [("limit", ctypes.c_uint32), ("weight", ctypes.c_uint32)]


class SlipPlan(ctypes.Structure):
    """dahl_slip_plan_t"""

    _fields_ = [
        ("full", ctypes.c_uint64),
        ("Fc_mantissa", ctypes.c_uint32),
        ("Fc_exponent", ctypes.c_int32),
        ("elements", ctypes.c_uint32),
        ("element", SlipElement * MOST),
        ("shift", ctypes.c_uint8 * MOST),
    ]


@pytest.fixture(scope="module")
def lib(library: Path) -> ctypes.CDLL:
    return ctypes.CDLL(str(library))


@pytest.fixture(scope="module")
def constants() -> dict[str, mpf]:
    return theorem.constants()


def random_slip_params() -> SlipParams:
    """A count travels 2^-29 to 2; shares are equal or differ by up to 2^60."""
    params = SlipParams(random.randint(1, MOST), np.float32(random.uniform(0.5, 1)))
    spread = random.choice((0, 1, 4, 60))
    for k in range(params.elements):
        params.Fc[k] = random.uniform(1, 2) * 2.0 ** (30 - random.uniform(0, spread))
        params.sigma0[k] = params.Fc[k] * 2.0 ** random.uniform(-28, 0)
    return params


def test_slip_elements(lib: ctypes.CDLL, constants: dict[str, mpf]) -> None:
    k = {name: Fraction(float(value)) for name, value in constants.items()}
    random.seed(1)
    worst_limit = worst_weight = Fraction(0)
    for _ in range(4000):
        params, plan = random_slip_params(), SlipPlan()
        assert lib.dahl_slip_prepare(ctypes.byref(plan), ctypes.byref(params)) == 0
        total = sum(Fraction(params.Fc[i]) for i in range(params.elements))
        weights = Fraction(0)
        for i in range(params.elements):
            element, Fc = plan.element[i], Fraction(params.Fc[i])  # noqa: N806
            travel = Fraction(params.sigma0[i]) * Fraction(params.theta_per_count)
            limit_error = abs(element.limit - Fc / travel * 2 ** plan.shift[i])
            assert 2**30 <= element.limit < 2**31 and limit_error <= k["limit_units"]
            worst_limit = max(worst_limit, limit_error)
            weights += abs(element.weight * element.limit - Fc / total * ONE)
        limits = sum(element.limit for element in plan.element[: params.elements])
        assert weights <= k["weight_units"] * limits
        worst_weight = max(worst_weight, weights / limits)
        assert plan.full == sum(e.weight * e.limit for e in plan.element[: params.elements])
        assert abs(plan.full - ONE) <= k["full_excess"] * ONE
        excess = plan.Fc_mantissa - total / Fraction(2) ** plan.Fc_exponent
        assert 0 <= excess <= 1 and 2**31 <= plan.Fc_mantissa
    assert worst_limit > Fraction(99, 100) * k["limit_units"]
    assert worst_weight > Fraction(9, 10) * k["weight_units"]


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
    """w falls by at least its factor, and by at most growth_units more."""
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
            before = plan.breakaway - random.randrange(min(plan.travel[1], plan.breakaway + ONE))
            rest = u - mpf(plan.breakaway - before) / ONE
            g = -mp.expm1(-rest / (1 - breakaway))
            error = mpf(crossed(lib, plan, before)) / ONE - breakaway - (1 - breakaway) * g
            error = max(abs(error) - 2 * k["cut"], mpf(0)) / ((1 - breakaway) * g)
            most_crossing = max(most_crossing, error)
    assert 0.9 * k["count_units"] < most_count <= k["count_units"]
    assert 0.9 * k["breakaway_rounding"] < most_breakaway <= k["breakaway_rounding"]
    assert 0.4 * k["kernel"] < most_crossing <= k["kernel"] + k["crossing"]


def test_sums_lead_to_the_header(constants: dict[str, mpf]) -> None:
    k = constants
    u, travel, half = LEAST_TRAVEL, travel_error(k, LEAST_TRAVEL), k["gap_rounding"]
    tick = half + k["cut"] / u
    asymmetric = tick + k["end_rounding"] + 4 * travel
    assert_just_below(asymmetric + half, number("DAHL_ASYMMETRIC_ERROR_Q30", PARTS), 0.01)
    growth = k["growth_units"] / mpf(2) ** 31
    loaded = max(tick, growth) + 2 * travel
    assert_just_below(2 * (loaded + half) + half, number("DAHL_LOADED_ERROR_Q30", PARTS), 0.01)
    assert_just_below(max(tick, growth / 2) + 2 * travel + 2 * half, 1.85e-9, 0.03)
    elastoplastic = max(k["kernel"] + k["crossing"], tick)
    elastoplastic += 2 * k["count_units"] / ONE / u + travel + k["breakaway_rounding"]
    assert_just_below(elastoplastic + half, number("DAHL_ELASTOPLASTIC_ERROR_Q30", PARTS), 0.02)
    for most in (ulps(k, asymmetric), ulps(k, loaded) + mpf(1) / 128, ulps(k, elastoplastic)):
        assert most <= number("DAHL_ULP_PARTS", PARTS)
    for elements in (1, MOST):
        slip = 4 * k["limit_units"] / mpf(2) ** 31
        slip += k["weight_units"] * (2 * elements - 1) / mpf(2) ** 32
        assert slip + half <= number("DAHL_SLIP_ERROR_Q30", PARTS)
        assert ulps(k, slip) <= number("DAHL_ULP_PARTS", PARTS)
