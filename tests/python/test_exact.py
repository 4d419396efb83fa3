# SPDX-License-Identifier: MIT
"""The library against 50 digits: every entry of a plan, single moves, long mixed motions, the
kernel's constants.
"""

from __future__ import annotations

import math
import re
import shutil
import subprocess
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from dahl.core import Friction, Plan
from hypothesis import given
from hypothesis import strategies as st
from mpmath import mp, mpf

ROOT = Path(__file__).resolve().parents[2]
HEADER = (ROOT / "lib/include/dahl.h").read_text()
KERNEL = (ROOT / "lib/model/kernel.h").read_text()
PREPARE = (ROOT / "lib/model/prepare.c").read_text()
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


def numbers(name: str) -> list[int]:
    """The unsigned constants of a function or table of kernel.h, in order, zeros too."""
    body = re.search(rf"{name}(?:\(|\[\]).*?\n}}", KERNEL, re.S)[0]
    return [int(n) for n in re.findall(r"\b(0(?=,)|\d{4,})u?\b", body)]


@pytest.mark.parametrize(
    "name, steps, degree", [("dahl_kernel_small", 4, 4), ("dahl_kernel_large", 16, 3)]
)
def test_kernel_polynomial(name: str, steps: int, degree: int) -> None:
    """1 - 2^-v = v P(Y), Y = v steps, P read from kernel.h: relative error as the file states."""
    first, last, *others = numbers(name)
    c = [mpf(n) / 2**32 for n in [*others[::-1], first, last]]
    assert len(c) == degree + 1 and "below 2^-30.6" in KERNEL

    def error(Y: mpf) -> mpf:  # noqa: N803 (the file's name)
        v = Y / steps
        P = sum((-Y) ** k * c[k] for k in range(degree + 1))
        return abs(v * P / -mp.expm1(-v * mp.log(2)) - 1)

    worst = max(error(mpf(k) / 4000) for k in range(1, 4001))
    assert mpf(2) ** -32.5 < worst < mpf(2) ** -30.6


def test_kernel_table() -> None:
    """1 - 2^(-j/16) in Q33, rounded up."""
    exact = [(1 - mpf(2) ** (-mpf(j) / 16)) * 2**33 for j in range(16)]
    assert numbers("dahl_kernel_table") == [int(mp.ceil(h)) for h in exact]


def test_kernel_constants() -> None:
    """ln 2 in Q32, below as above 2^-30; log2(e) in Q31, rounded up."""
    ln2 = int(mp.floor(mp.log(2) * 2**32))
    assert numbers("dahl_kernel_tiny")[-1] == ln2 == numbers("dahl_kernel_small")[-1]
    assert f"LOG2_E_Q31 {int(mp.ceil(2**31 / mp.log(2)))}u" in PREPARE


@pytest.mark.skipif(shutil.which("sollya") is None, reason="sollya is absent")
def test_kernel_constants_are_those_of_the_script() -> None:
    command = ["sollya", str(ROOT / "tools/generators/kernel.sollya")]
    printed = subprocess.run(command, check=True, capture_output=True, text=True, timeout=120)
    values = {
        label: [int(n) for n in re.findall(rf"^{label} \d+ = (\d+) u", printed.stdout, re.M)]
        for label in ("small", "part", "H")
    }
    for name, label in (("small", "small"), ("large", "part")):
        *head, almost, last = values[label]
        assert numbers(f"dahl_kernel_{name}") == [almost, last, *head[::-1]]
    assert numbers("dahl_kernel_table") == values["H"]
