# SPDX-License-Identifier: MIT
"""Parts against a solver of their differential equations, event by event: what they should do is
stated here as dF/dtheta and as what a load does, and in no closed form.
"""

from __future__ import annotations

import ctypes
import random
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

SIGMA0, FC, THETA = (float(np.float32(x)) for x in (100.0, 0.7, 1e-3))
ULP = float(np.spacing(np.float32(FC)))
SOLVER = 2e-9 * FC  # what the solver itself may err by
PLAN = ctypes.c_uint64 * 80  # room for any plan

Slope = Callable[[float, int], float]


def moved(slope: Slope, F: float, counts: int, stop: float | None = None) -> float:
    """F after a move; integrated up to F = stop and on from there, where the slope has a corner."""
    s, left = (1 if counts > 0 else -1), abs(counts) * THETA

    def corner(_: float, y: np.ndarray) -> float:
        return float(y[0]) - s * (stop or 0.0)

    corner.terminal = True  # type: ignore[attr-defined]
    while left > 0:
        events = corner if stop is not None and s * F < stop else None
        done = solve_ivp(
            lambda _, y: [s * slope(y[0], s)],
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


def params(*values: float) -> ctypes.Array[ctypes.c_float]:
    return (ctypes.c_float * len(values))(*values)


@pytest.fixture(scope="module")
def lib(library: Path) -> ctypes.CDLL:
    loaded = ctypes.CDLL(str(library))
    for name in ("asymmetric", "loaded", "elastoplastic"):
        getattr(loaded, f"dahl_{name}_step_counts").restype = ctypes.c_float
    return loaded


def test_asymmetric(lib: ctypes.CDLL) -> None:
    plan, state, F = PLAN(), ctypes.c_int64(), 0.0
    backward = float(np.float32(0.3))
    assert lib.dahl_asymmetric_prepare(plan, params(SIGMA0, FC, backward, THETA)) == 0

    def slope(F: float, s: int) -> float:
        return SIGMA0 * (1 - F / FC) if s > 0 else SIGMA0 * (1 + F / backward)

    for counts in walk(1):
        F = moved(slope, F, counts)
        got = lib.dahl_asymmetric_step_counts(plan, ctypes.byref(state), counts)
        assert abs(got - F) <= 0.55 * ULP + SOLVER


@pytest.mark.parametrize("b", [0.1, 0.5, 0.95])
def test_elastoplastic(lib: ctypes.CDLL, b: float) -> None:
    plan, state, F = PLAN(), ctypes.c_int64(), 0.0
    b = float(np.float32(b))
    assert lib.dahl_elastoplastic_prepare(plan, params(SIGMA0, FC, THETA), ctypes.c_float(b)) == 0

    def slope(F: float, s: int) -> float:
        return SIGMA0 * min(1.0, (1 - s * F / FC) / (1 - b))

    for counts in walk(2):
        F = moved(slope, F, counts, b * FC)
        got = lib.dahl_elastoplastic_step_counts(plan, ctypes.byref(state), counts)
        assert abs(got - F) <= 0.55 * ULP + SOLVER


def test_loaded(lib: ctypes.CDLL) -> None:
    """A falling load takes F with it; a growing one leaves it."""
    plan, state, F, before = PLAN(), (ctypes.c_uint32 * 4)(), 0.0, 0.0
    assert lib.dahl_prepare(plan, params(SIGMA0, FC, THETA)) == 0
    for counts in walk(3):
        load = random.randrange(1 << 31)
        c = load / 2**30
        F *= min(1.0, c / before) if before > 0 else 1.0

        def slope(F: float, s: int, c: float = c) -> float:
            return c * SIGMA0 * (1 - s * F / (c * FC))

        F, before = moved(slope, F, counts), c
        got = lib.dahl_loaded_step_counts(plan, ctypes.byref(state), counts, ctypes.c_uint32(load))
        assert abs(got - F) <= 0.55 * 2 * ULP + SOLVER
