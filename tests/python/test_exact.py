# SPDX-License-Identifier: MIT
"""The library against 50 digits: every entry of a plan, single moves, long mixed motions, the kernel's polynomial."""

from __future__ import annotations

import math
import re
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mpmath import mp, mpf

from dahl.core import Friction, Plan

ROOT = Path(__file__).resolve().parents[2]
HEADER = (ROOT / "lib/dahl.h").read_text()
KERNEL = (ROOT / "lib/kernel.h").read_text()
mp.dps = 50


def stated(name: str) -> float:
    """A bound as the header states it."""
    return float(re.search(rf"#define {name} ([0-9.e-]+)", HEADER)[1])


ULP_COUNTS, ULP_ANGLE = stated("DAHL_ULP_COUNTS"), stated("DAHL_ULP_ANGLE")


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
    st.one_of(st.integers(-9, 9), st.integers(-5000, 5000), st.integers(-(2**31), 2**31 - 1)), max_size=40
)


@given(plans)
def test_every_entry_of_a_plan(plan: Plan) -> None:
    """g of 1 .. 8, 16 .. 2^31 counts in Q64: relative error below 2^-32, as prepare.c states."""
    words = np.frombuffer(plan._words, dtype=np.uint32)[: 2 * 37].astype(object)
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



def test_kernel_polynomial() -> None:
    """R of kernel.h, read from the file: relative error of x - x^2 R(x) on [0, ln 2] as the file states, 2^-31.6."""
    body = re.search(r"dahl_kernel_tail.*?\n}", KERNEL, re.S)[0]
    c = [mpf(int(n)) / 2**32 for n in re.findall(r"(\d+)u", body)][::-1]
    assert len(c) == 6 and "below 2^-31.6" in KERNEL

    def error(x: mpf) -> mpf:
        r = mpf(0)
        for coefficient in reversed(c):
            r = coefficient - x * r
        return abs((x - x * x * r) / -mp.expm1(-x) - 1)

    worst = max(error(mp.log(2) * k / 4000) for k in range(1, 4001))
    assert mpf(2) ** -32.5 < worst < mpf(2) ** -31.6


@pytest.mark.parametrize(
    "name, value", [("LOG2E_Q31", mp.floor(2**31 / mp.log(2))), ("LN2_Q32", mp.nint(mp.log(2) * 2**32))]
)
def test_kernel_constants(name: str, value: mpf) -> None:
    assert int(re.search(rf"{name} (\d+)u", KERNEL)[1]) == int(value)
