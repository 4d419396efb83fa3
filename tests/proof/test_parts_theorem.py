# SPDX-License-Identifier: MIT
"""docs/accuracy.md on the parts: constants against measured worst cases in exact fractions, sums
against the header.
"""

import random
from fractions import Fraction
from typing import Any

import pytest
import theorem
from dahl.binding.library import c
from mpmath import mp, mpf
from sources import number
from theorem import LEAST_TRAVEL, ONE, assert_just_below, float32, travel_error, ulps

PARTS = "dahl_parts.h"
MOST = 8  # slip elements


pytestmark = pytest.mark.usefixtures("library")


@pytest.fixture(scope="module")
def constants() -> dict[str, mpf]:
    return theorem.constants()


def random_slip_params() -> Any:
    """A count travels 2^-29 to 2; shares are equal or differ by up to 2^60."""
    params = c.new("dahl_slip_params_t *")
    params.elements, params.theta_per_count = random.randint(1, MOST), random.uniform(0.5, 1)
    spread = random.choice((0, 1, 4, 60))
    for k in range(params.elements):
        params.Fc[k] = random.uniform(1, 2) * 2.0 ** (30 - random.uniform(0, spread))
        params.sigma0[k] = params.Fc[k] * 2.0 ** random.uniform(-28, 0)
    return params


def test_slip_elements(constants: dict[str, mpf]) -> None:
    k = {name: Fraction(float(value)) for name, value in constants.items()}
    random.seed(1)
    worst_limit = worst_weight = Fraction(0)
    for _ in range(4000):
        params, plan = random_slip_params(), c.new("dahl_slip_plan_t *")
        assert c.dahl_slip_prepare(plan, params) == 0
        total = sum(Fraction(params.Fc[i]) for i in range(params.elements))
        elements = plan.element[0 : params.elements]
        weights = Fraction(0)
        for i in range(params.elements):
            element, Fc = plan.element[i], Fraction(params.Fc[i])  # noqa: N806
            travel = Fraction(params.sigma0[i]) * Fraction(params.theta_per_count)
            limit_error = abs(element.limit - Fc / travel * 2 ** plan.shift[i])
            assert 2**30 <= element.limit < 2**31 and limit_error <= k["limit_units"]
            worst_limit = max(worst_limit, limit_error)
            weights += abs(element.weight * element.limit - Fc / total * ONE)
        limits = sum(element.limit for element in elements)
        assert weights <= k["weight_units"] * limits
        worst_weight = max(worst_weight, weights / limits)
        assert plan.full == sum(each.weight * each.limit for each in elements)
        assert abs(plan.full - ONE) <= k["full_excess"] * ONE
        excess = plan.Fc_mantissa - total / Fraction(2) ** plan.Fc_exponent
        assert 0 <= excess <= 1 and 2**31 <= plan.Fc_mantissa
    assert worst_limit > Fraction(99, 100) * k["limit_units"]
    assert worst_weight > Fraction(9, 10) * k["weight_units"]


def test_ends(constants: dict[str, mpf]) -> None:
    random.seed(1)
    worst = mpf(0)
    for _ in range(300):
        plan = c.new("dahl_asymmetric_plan_t *")
        forward, backward = float32(random.uniform(1, 2)), float32(random.uniform(0.01, 2))
        params = c.new("dahl_asymmetric_params_t *", [1.0, forward, backward, 0.001])
        assert c.dahl_asymmetric_prepare(plan, params) == 0
        larger = max(forward, backward)
        for end, Fc in ((plan.end_forward, forward), (plan.end_backward, backward)):
            worst = max(worst, abs(mpf(end) / ONE - mpf(Fc) / larger))
    assert 0.9 * constants["end_rounding"] < worst <= constants["end_rounding"]


def test_growth_of_a_load(constants: dict[str, mpf]) -> None:
    """w falls by at least its factor, and by at most growth_units more."""
    random.seed(2)
    plan, worst = c.new("dahl_plan_t *"), Fraction(0)
    assert c.dahl_prepare(plan, c.new("dahl_params_t *", [1.0, 1.0, 0.001])) == 0
    for _ in range(20000):
        now = random.randint(1, 2**31 - 1) >> random.choice((0, 0, 1, 10, 25)) | 1
        before = now - 1 if random.random() < 0.3 else random.randrange(now)
        w = random.randint(-ONE, ONE) >> random.choice((0, 0, 5, 40))
        state = c.new("dahl_loaded_state_t *", [[w], before])
        exact = Fraction(w * before, now)
        c.dahl_loaded_step_counts_q30(plan, state, 0, now)
        lost = abs(exact) - abs(state.bristle.w)
        assert 0 <= lost and (state.bristle.w == 0 or (state.bristle.w > 0) == (exact > 0))
        worst = max(worst, lost)
    assert 0.6 * constants["growth_units"] < worst < constants["growth_units"]


def crossed(plan: Any, start: int) -> int:
    state = c.new("dahl_state_t *", [start])
    c.dahl_elastoplastic_step_counts_q30(plan, state, 1)
    return int(state.w)


def test_elastoplastic(constants: dict[str, mpf]) -> None:
    random.seed(3)
    k = constants
    most_count = most_breakaway = most_crossing = mpf(0)
    for _ in range(300):
        sigma0, theta = float32(random.uniform(0.5, 1)), float32(2.0 ** random.uniform(-28.9, 0.9))
        b = float32(random.choice((random.uniform(0.01, 0.999), 2.0 ** random.uniform(-30, -8))))
        plan = c.new("dahl_elastoplastic_plan_t *")
        params = c.new("dahl_params_t *", [sigma0, 0.9, theta])
        assert c.dahl_elastoplastic_prepare(plan, params, b) == 0
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
            error = mpf(crossed(plan, before)) / ONE - breakaway - (1 - breakaway) * g
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
