# SPDX-License-Identifier: MIT
"""The constants and sums of docs/accuracy.md."""

import re
from fractions import Fraction

import numpy as np
from conftest import ROOT
from mpmath import mp, mpf

mp.prec = 220
THEOREM = ROOT / "docs" / "accuracy.md"
ONE = 2**62
LEAST_TRAVEL = mpf(2) ** -30


def constants() -> dict[str, mpf]:
    """The constants in the tables, such as 2^-31, 1/6 or 2.02."""
    rows = re.findall(r"^\| (\w+) \| ([\d.^/-]+) \|", THEOREM.read_text(), re.MULTILINE)
    return {name: value_of(value) for name, value in rows}


def value_of(text: str) -> mpf:
    if "^" in text:
        base, exponent = text.split("^")
        return mpf(int(base)) ** int(exponent)
    return mpf(Fraction(text).numerator) / Fraction(text).denominator


def float32(x: float) -> float:
    return float(np.float32(x))


def travel_error(k: dict[str, mpf], u: mpf) -> mpf:
    """The k of the theorem."""
    least = k["first_entry_units"] * mpf(2) ** -64 / u + k["series"] * u * u
    return least * (1 + mpf(2) ** -15)


def ulps(k: dict[str, mpf], e: mpf) -> mpf:
    """The error in ulp of Fc, which is less than 2^24 ulp."""
    return k["output"] + e * 2**24


def assert_just_below(bound: mpf, said: float, slack: float) -> None:
    assert said * (1 - slack) <= bound <= said
