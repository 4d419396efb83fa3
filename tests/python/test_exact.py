# SPDX-License-Identifier: MIT
"""The library against 50 digits: every entry of a plan, single moves, long mixed motions."""

from __future__ import annotations

import math
from fractions import Fraction
from pathlib import Path

import numpy as np
from dahl.core import Friction, Plan
from hypothesis import given
from hypothesis import strategies as st
from mpmath import mp, mpf
from sources import number

ROOT = Path(__file__).resolve().parents[2]
mp.dps = 50


ULP_COUNTS, ULP_ANGLE = number("DAHL_ULP_COUNTS"), number("DAHL_ULP_ANGLE")


def float32(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(float(np.float32(low)), float(np.float32(high)), width=32)


def exact_travel(plan: Plan) -> mpf:
    """sigma0/Fc theta_per_count of the floats, exactly, then to 50 digits."""
    u = Fraction(plan.sigma0) / Fraction(plan.Fc) * Fraction(plan.theta_per_count)
    return mpf(u.numerator) / u.denominator


def solve(w: mpf, u: mpf, direction: int) -> mpf:
    """Eq. 1 for one travel u: the gap to the limit shrinks by exp(-u)."""
    return direction - (direction - w) * mp.exp(-u)


plans = st.builds(
    lambda travel, Fc, theta: Plan(travel * Fc / theta, Fc, theta),
    st.floats(math.log(1.1e-9), math.log(900)).map(math.exp),
    float32(1e-3, 1e3),
    float32(1e-7, 1e-1),
)
moves = st.lists(
    st.one_of(st.integers(-9, 9), st.integers(-5000, 5000), st.integers(-(2**31), 2**31 - 1)),
    max_size=40,
)


@given(plans)
def test_every_entry_of_a_plan(plan: Plan) -> None:
    """g of 1 .. 8, 16 .. 2^31 counts in Q64: relative error below 2^-32, as prepare.c states."""
    after_a_and_Fc = slice(4, 4 + 2 * 37)
    words = np.frombuffer(plan._words, dtype=np.uint32)[after_a_and_Fc].astype(object)
    counts = [*range(9), *(2**k for k in range(4, 32))]
    u = exact_travel(plan)
    assert words[0] == words[1] == 0
    for n, hi, lo in zip(counts[1:], words[2::2], words[3::2], strict=True):
        g = mpf(int(hi) << 32 | int(lo)) / mpf(2) ** 64
        assert abs(g / -mp.expm1(-u * n) - 1) < mpf(2) ** -32


@given(plans, moves)
def test_by_counts(plan: Plan, moves: list[int]) -> None:
    bearing, w, u = Friction(plan), mpf(0), exact_travel(plan)
    for n in moves:
        w = solve(w, u * abs(n), 1 if n > 0 else -1) if n else w
        assert abs(bearing.step_counts(n) - w * plan.Fc) <= ULP_COUNTS * plan.ulp


@given(plans, st.lists(float32(-1e3, 1e3), max_size=40))
def test_by_angle(plan: Plan, moves: list[float]) -> None:
    """Angles scaled so that travels from 1e-12 to 1e3 presliding lengths occur."""
    bearing, w = Friction(plan), mpf(0)
    a = mpf(plan.sigma0) / plan.Fc
    for n, move in enumerate(moves):
        dtheta = float(np.float32(move * 10.0 ** -(n % 12) / float(a)))
        w = solve(w, a * abs(mpf(dtheta)), 1 if dtheta > 0 else -1)
        assert abs(bearing.step(dtheta) - w * plan.Fc) <= ULP_ANGLE * plan.ulp
