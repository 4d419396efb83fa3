# SPDX-License-Identifier: MIT
"""Parts against a solver of their differential equations, event by event: what they should do is
stated here as dF/dtheta and as what a load does, and in no closed form.
"""

from __future__ import annotations

import random
from collections.abc import Callable

import dahl
import numpy as np
import pytest
from scipy.integrate import solve_ivp

pytestmark = pytest.mark.usefixtures("library")

SIGMA0, FC, THETA = (float(np.float32(x)) for x in (100.0, 0.7, 1e-3))
ULP = float(np.spacing(np.float32(FC)))
SOLVER = 2e-9 * FC  # what the solver itself may err by

Slope = Callable[[float, int], float]


def moved(
    slope: Slope, F: float, counts: int, stop: float | None = None, below: Slope | None = None
) -> float:
    """F after a move. Where the slope has a corner at F = stop, it is `below` up to there, and the
    solver, which no corner may meet inside a step, begins anew.
    """
    s, left = (1 if counts > 0 else -1), abs(counts) * THETA

    def corner(_: float, y: np.ndarray) -> float:
        return float(y[0]) - s * (stop or 0.0)

    corner.terminal = True  # type: ignore[attr-defined]
    while left > 0:
        events = corner if stop is not None and s * F < stop else None
        here = below if events and below else slope
        done = solve_ivp(
            lambda _, y, here=here: [s * here(y[0], s)],
            (0, left),
            [F],
            method="DOP853",
            rtol=1e-11,
            atol=1e-13,
            events=events,
        )
        left -= float(done.t[-1])
        hit = events is not None and done.status == 1
        F = s * stop if hit and stop is not None else float(done.y[0][-1])
        left = left if hit else 0.0
    return F


def walk(seed: int) -> list[int]:
    """Counts of moves that slide, that do not, and of one count."""
    random.seed(seed)
    return [random.choice((-1, 1)) * random.choice((1, 2, 5, 7, 12, 40, 300)) for _ in range(300)]


def test_asymmetric() -> None:
    backward, F = float(np.float32(0.3)), 0.0
    part = dahl.Asymmetric(SIGMA0, FC, backward, THETA)

    def slope(F: float, s: int) -> float:
        return SIGMA0 * (1 - F / FC) if s > 0 else SIGMA0 * (1 + F / backward)

    for counts in walk(1):
        F = moved(slope, F, counts)
        assert abs(part.step_counts(counts) - F) <= 0.55 * ULP + SOLVER
        assert abs(part.state.w * 2.0**-62 - F / FC) <= 1.5e-9 + SOLVER


@pytest.mark.parametrize("b", [0.1, 0.5, 0.95])
def test_elastoplastic(b: float) -> None:
    b, F = float(np.float32(b)), 0.0
    part = dahl.ElastoPlastic(SIGMA0, FC, THETA, b)

    def slope(F: float, s: int) -> float:
        return SIGMA0 * (1 - s * F / FC) / (1 - b)

    for counts in walk(2):
        F = moved(slope, F, counts, b * FC, below=lambda *_: SIGMA0)
        assert abs(part.step_counts(counts) - F) <= 0.55 * ULP + SOLVER


def test_loaded() -> None:
    """A falling load takes F with it; a growing one leaves it."""
    part, F, before = dahl.Loaded(dahl.Plan(SIGMA0, FC, THETA)), 0.0, 0.0
    for counts in walk(3):
        c = random.randrange(1 << 31) / 2**30
        F *= min(1.0, c / before) if before > 0 else 1.0

        def slope(F: float, s: int, c: float = c) -> float:
            return c * SIGMA0 * (1 - s * F / (c * FC))

        F, before = moved(slope, F, counts), c
        assert abs(part.step_counts(counts, c) - F) <= 0.55 * 2 * ULP + SOLVER
        assert part.load == c


def test_work() -> None:
    """The integral of F dtheta by a solver, beside F itself."""
    part, F, work = dahl.Work(dahl.Plan(SIGMA0, FC, THETA)), 0.0, 0.0
    for counts in walk(4):
        s = 1 if counts > 0 else -1
        done = solve_ivp(
            lambda _, y, s=s: [s * SIGMA0 * (1 - s * y[0] / FC), s * y[0]],
            (0, abs(counts) * THETA),
            [F, 0.0],
            method="DOP853",
            rtol=1e-11,
            atol=1e-13,
        )
        F, work = float(done.y[0][-1]), work + float(done.y[1][-1])
        assert abs(part.step_counts(counts) - F) <= 0.55 * ULP + SOLVER
        assert part.work == pytest.approx(work, rel=2e-7, abs=1e-9)
