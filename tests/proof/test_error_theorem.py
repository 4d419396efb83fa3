# SPDX-License-Identifier: MIT
"""docs/accuracy.md: the sums of its constants against the headers."""

from __future__ import annotations

import re
from fractions import Fraction

import pytest
from conftest import ROOT
from mpmath import mp, mpf
from sources import number

mp.prec = 220
PAGE = ROOT / "docs" / "accuracy.md"
ONE = 2**62
LEAST_TRAVEL = mpf(2) ** -30
PARTS = "dahl_parts.h"
SLIP_ELEMENTS_MAX = 8


def value_of(text: str) -> mpf:
    if "^" in text:
        base, exponent = text.split("^")
        return mpf(int(base)) ** int(exponent)
    return mpf(Fraction(text).numerator) / Fraction(text).denominator


def travel_error(k: dict[str, mpf], u: mpf) -> mpf:
    """The k of the theorem."""
    least = k["first_entry_units"] * mpf(2) ** -64 / u + k["series"] * u * u
    return least * (1 + mpf(2) ** -15)


def ulps(k: dict[str, mpf], e: mpf) -> mpf:
    """The error in ulp of Fc, which is less than 2^24 ulp."""
    return k["output"] + e * 2**24


def assert_just_below(bound: mpf, said: float, slack: float) -> None:
    assert said * (1 - slack) <= bound <= said


@pytest.fixture(scope="module")
def constants() -> dict[str, mpf]:
    """The constants in the tables, such as 2^-31, 1/6 or 2.02."""
    rows = re.findall(r"^\| (\w+) \| ([\d.^/-]+) \|", PAGE.read_text(), re.MULTILINE)
    return {name: value_of(value) for name, value in rows}


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


def test_sums_lead_to_the_header_of_the_parts(constants: dict[str, mpf]) -> None:
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
    for elements in (1, SLIP_ELEMENTS_MAX):
        slip = 4 * k["limit_units"] / mpf(2) ** 31
        slip += k["weight_units"] * (2 * elements - 1) / mpf(2) ** 32
        assert slip + half <= number("DAHL_SLIP_ERROR_Q30", PARTS)
        assert ulps(k, slip) <= number("DAHL_ULP_PARTS", PARTS)


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
