# SPDX-License-Identifier: MIT
"""docs/accuracy.md: constants against measured worst cases, sums against the header."""

import math
import random
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
import theorem
from dahl.binding.library import c
from mpmath import mp, mpf
from sources import number
from theorem import LEAST_TRAVEL, ONE, assert_just_below, float32, travel_error, ulps

pytestmark = pytest.mark.usefixtures("library")

COUNTS = [*range(1, 9), *(2**k for k in range(4, 32))]  # of each entry of the table


def prepare(sigma0: float, Fc: float, theta: float) -> Any:  # noqa: N803
    plan = c.new("dahl_plan_t *")
    assert c.dahl_prepare(plan, c.new("dahl_params_t *", [sigma0, Fc, theta])) == 0
    return plan


def entry(plan: Any, index: int) -> int:
    """g in Q64."""
    return int(plan.g[index].hi) << 32 | int(plan.g[index].lo)


def moved(plan: Any, w: int, counts: int) -> int:
    state = c.new("dahl_state_t *", [w])
    c.dahl_step_counts_q30(plan, state, counts)
    return int(state.w)


def torque(plan: Any, w: int) -> Fraction:
    return Fraction(c.dahl_torque(plan, c.new("dahl_state_t *", [w])))


@pytest.fixture(scope="module")
def k() -> dict[str, mpf]:
    """The constants of the page."""
    return theorem.constants()


def random_plan(low: float, high: float) -> tuple[Any, mpf]:
    """A plan whose count travels 2^low .. 2^high, and the exact travel."""
    exponent, Fc = random.uniform(low, high), float32(random.uniform(0.1, 10))  # noqa: N806
    theta = float32(2.0**exponent)
    sigma0 = float32(Fc * 2.0**exponent / theta)
    u = mpf(sigma0) * mpf(theta) / mpf(Fc)
    if u < mpf(2) ** low:
        return random_plan(low, high)
    return prepare(sigma0, Fc, theta), u


def test_each_step_is_within_its_roundings(k: dict[str, mpf]) -> None:
    """Each step follows (*): the gap is within gap_rounding, the product loses less than cut."""
    random.seed(1)
    most_d, most_t = 0, mpf(0)
    for _ in range(300):
        plan, _ = random_plan(-30, 4)
        for _ in range(30):
            w, n = random.randint(-ONE, ONE), random.randint(1, 8)
            w = w >> random.choice((0, 0, 10, 40)) | random.choice((0, 2**31 - 1, 2**31))
            s, g = random.choice((-1, 1)), entry(plan, n)
            d = (w + 2**31) % 2**32 - 2**31  # w - q, q the nearest of Q30
            exact = Fraction((ONE - s * (w - d)) * g, 2**64)
            t = exact - s * (moved(plan, w, s * n) - w)
            assert abs(d) <= k["gap_rounding"] * ONE
            assert 0 <= t < 1 == k["cut"] * ONE
            most_d, most_t = max(most_d, abs(d)), max(most_t, mpf(t.numerator) / t.denominator)
    assert most_d > 0.99 * k["gap_rounding"] * ONE
    assert most_t > 0.99


def test_the_fine_table_is_within_its_constants(k: dict[str, mpf]) -> None:
    """u < 2^-20: the first entry, the joins, the travel of the table."""
    random.seed(2)
    most_first = most_join = mpf(0)
    for _ in range(150):
        plan, u = random_plan(-30, random.choice((-29.9, -20.1)))
        entries = [1 - mpf(entry(plan, i + 1)) / 2**64 for i in range(36)]
        first = (entries[0] - mp.exp(-u)) * 2**64
        assert abs(first) <= k["first_entry_units"] + k["series"] * u**3 * 2**64
        U = -mp.log(entries[0])  # noqa: N806
        assert abs(U / u - 1) <= travel_error(k, u)
        most_first = max(most_first, abs(first) - k["series"] * u**3 * 2**64)
        for n, found in zip(COUNTS, entries, strict=True):
            joins = (found - mp.exp(-n * U)) * 2**64
            limit = k["join_units"] * mp.expm1(-(n - 1) * U) / mp.expm1(-U)
            assert abs(joins) <= limit + mpf(2) ** -30
            most_join = max(most_join, abs(joins) / limit if n > 1 else mpf(0))
    assert most_first > 0.85 * k["first_entry_units"]
    assert most_join > 0.85


def test_the_coarse_table_is_within_its_constant(k: dict[str, mpf]) -> None:
    """u >= 2^-20: the relative error of each entry."""
    random.seed(3)
    worst = mpf(0)
    for _ in range(150):
        plan, u = random_plan(-20, random.choice((-19, 0, 15)))
        for index, n in enumerate(COUNTS):
            g = -mp.expm1(-n * u)
            error = abs(mpf(entry(plan, index + 1)) / 2**64 - g) / g
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


def test_the_rounding_to_a_float_is_within_its_constant(k: dict[str, mpf]) -> None:
    """The rounding from w to a float, in ulp of Fc."""
    random.seed(4)
    worst = Fraction(0)
    limit = Fraction(str(k["output"]))
    for _ in range(200):
        mantissa = random.randint(2**24 - random.choice((2**8, 2**23)), 2**24 - 1)
        Fc = math.ldexp(mantissa, random.randint(-80, 30))  # noqa: N806
        plan = prepare(Fc, Fc, 0.0)
        ulp = Fraction(float(np.spacing(np.float32(Fc))))
        for _ in range(100):
            near = random.random() < 0.8
            w = near_a_tie(mantissa * 256) if near else random.randint(-ONE, ONE)
            error = abs(torque(plan, w) - Fraction(w, ONE) * Fraction(Fc)) / ulp
            assert error <= limit
            worst = max(worst, error)
    assert worst > limit - Fraction(5, 10000)


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


def test_sums_lead_to_the_header(k: dict[str, mpf]) -> None:
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


def test_no_travel_errs_more_than_the_least(k: dict[str, mpf]) -> None:
    """E(u) over all travels; 9.4e-10 from 4e-8 on; and the form that test_accuracy.c reads."""
    bound = number("DAHL_ERROR_Q30")
    for i in range(1000):
        u = LEAST_TRAVEL * mpf(2) ** (mpf(i) / 20)
        total = error(k, u) + k["gap_rounding"]
        assert total <= bound
        assert total <= 9.4e-10 or u < 4e-8
        assert total <= mpf(2) ** -30 + 5 * mpf(2) ** -64 / u + mpf(2) ** -38


def test_sensitivity_is_the_integral(k: dict[str, mpf]) -> None:
    """|1 - T| exp(-T) over all travel."""
    integral = mp.quad(lambda t: abs(1 - t) * mp.exp(-t), [0, 1, 4, 20, 200])
    assert_just_below(integral, float(k["sensitivity"]), 1e-4)
