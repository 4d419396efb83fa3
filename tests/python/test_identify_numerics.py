# SPDX-License-Identifier: MIT
"""The numbers inside an identification, each function by itself against least squares on the rows,
brute force or a closed form: an error that a later step would make up for shows here.

References have no code of the package in them: the torque is identify_tools.dahl_torque, speeds
are numpy's gradient, fits are numpy's lstsq and scipy's minimisers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from dahl.identify import (
    elements,
    path,
)
from dahl.identify.log import Log
from identify_tools import FC, SIGMA0, dahl_torque, noise_of, sine
from scipy.ndimage import uniform_filter1d
from scipy.optimize import minimize_scalar

pytestmark = pytest.mark.usefixtures("library")

A = SIGMA0 / FC
RNG = np.random.default_rng(12)
ROWS = 1500


def log_of(seed: int = 1, part: float = 0.05, rows: int = ROWS, cycled: float = 6.0, **more) -> Log:
    """A smooth angle without an encoder, its torque with noise and an offset, 1 kHz."""
    theta = sine(seed, rows=rows, cycles=cycled)
    torque = dahl_torque(theta) + 0.1 + part * FC * noise_of(seed, rows)
    return Log(f"seed {seed}", theta, torque, np.arange(rows) * 1e-3, **more)


def speeds(log: Log) -> tuple[np.ndarray, np.ndarray]:
    def smooth(x: np.ndarray) -> np.ndarray:
        return uniform_filter1d(np.gradient(x, log.time), 9, mode="nearest")

    speed = smooth(log.theta)
    return speed, smooth(speed)


def columns(log: Log, a: float) -> np.ndarray:
    """w, what is left of the first torque, the terms, the torque: (rows, 7)."""
    start = np.exp(-a * np.cumsum(np.abs(np.diff(log.theta, prepend=log.theta[0]))))
    w, one = dahl_torque(log.theta, a, 1.0), np.ones(log.rows)
    return np.column_stack((w, start, one, log.theta - log.zero, *speeds(log), log.torque))


def rows_of(logs: Sequence[Log], a: float, terms: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """w, the terms, the first torque of each log; the torque: all weighed by row."""
    names = ("offset", "spring", "viscous", "inertia")
    used = [0, *(2 + names.index(term) for term in terms)]
    parts, first = [], []
    for i, log in enumerate(logs):
        root = np.sqrt(np.ones(log.rows) if log.weight is None else log.weight)
        all_ = columns(log, a) * root[:, None]
        own = np.zeros((log.rows, len(logs)))
        own[:, i] = all_[:, 1]
        parts.append(all_[:, [*used, -1]])
        first.append(own)
    whole = np.concatenate(parts)
    return np.column_stack((whole[:, :-1], np.concatenate(first))), whole[:, -1]


def solved(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, float]:
    """Coefficients and the sum of squares that they leave."""
    best = np.linalg.lstsq(x, y, rcond=None)[0]
    return best, float(np.sum((y - x @ best) ** 2))


def best_a(cost: Callable[[float], float], around: float = A, wide: float = 0.3) -> float:
    ends = (np.log(around) - wide, np.log(around) + wide)
    found = minimize_scalar(
        lambda x: cost(np.exp(x)), bounds=ends, method="bounded", options={"xatol": 1e-7}
    )
    return float(np.exp(found.x))


# --- paths and elements ---------------------------------------------------------------------------


def stepped(moves: np.ndarray, a: float, start: float) -> np.ndarray:
    """A spring that slips, row by row."""
    drawn = []
    for move in moves:
        start = min(max(start + a * move, -1.0), 1.0)
        drawn.append(start)
    return np.array(drawn)


@pytest.mark.parametrize("rows", [1, 63, 64, 65, 200])
@pytest.mark.parametrize("start", [0.0, 0.7, -1.0])
def test_paths_of_any_length_from_any_start(rows, start):
    moves = RNG.normal(scale=0.4, size=rows)
    assert path.bilinear(moves, 0.9, start) == pytest.approx(stepped(moves, 0.9, start))
    F, drawn = start, []  # noqa: N806
    for move in moves:
        F = np.sign(move) - (np.sign(move) - F) * np.exp(-0.9 * abs(move))  # noqa: N806
        drawn.append(F)
    assert path.dahl(moves, 0.9, start) == pytest.approx(np.array(drawn), abs=1e-6)


def test_the_sign_of_the_last_move():
    moves = np.array([0.0, 0.0, 2.0, 0.0, -0.1, 0.0, 0.0, 3.0])
    assert path.coulomb(moves, 5.0, 0.3).tolist() == [0.3, 0.3, 1, 1, -1, -1, -1, 1]
    assert path.coulomb(-moves, 5.0).tolist() == [0, 0, -1, -1, 1, 1, 1, -1]


@pytest.mark.parametrize(
    ("theta", "least", "turns"),
    [
        ([0, 1, 2, 1, 0], 1.5, [2]),
        ([0, 1, 2, 1, 0], 2.0, []),  # a turn is more than that
        ([0, 1, 2, 1.5, 3, 2.6, 4, 0], 1.0, [6]),
        ([0, 0, 1, 3, 3, 3, 0, 0, 3], 1.0, [3, 6]),  # where the motion rests, its first row
        ([5, 4, 3, 2, 8, 8, 1], 1.0, [3, 4]),
        ([0, 1, 3, 2.5, 3, 0], 1.0, [4]),  # of two that are as far, the later one
        ([0, 0.5, 0.9, -0.9, 0.9, -0.9], 1.0, [3, 4]),  # strokes to either side of the start
        ([0, 0.4, 0, -0.4, 0, 3, -3], 1.0, [5]),  # what is before the first large move
        ([1, 1, 1], 1.0, []),
        ([1], 1.0, []),
        ([0, 2, 0, 2, 0, 2], 1.9, [3, 4]),  # one move alone is no stroke, nor what follows it
    ],
)
def test_turns_of_a_path(theta, least, turns):
    assert path.reversals(np.array(theta, dtype=float), least).tolist() == turns
    assert path.reversals(-np.array(theta, dtype=float), least).tolist() == turns


def test_elements_at_rest_and_from_a_state():
    moves = np.array([0.0, 0.0, 0.3, 0.0, -0.5, 0.2])
    for exponent in (0, 0.5, 1, 2.0):
        w = elements.of_exponent(exponent)(moves, 0.8)
        assert w[:2].tolist() == [0, 0] and w[3] == pytest.approx(w[2])
    assert elements.general(np.zeros(3), 1.0, 0.5).tolist() == [0, 0, 0]
    assert elements.of_exponent(0)(moves, 0.8) == pytest.approx(stepped(moves, 0.8, 0.0))
    u = np.array([0.24, 0, 0.4, 0.16])  # travels times a; exponent 2: the inverse gap grows by it
    gap = [1 / (1 + u[0])]
    gap += [gap[0], 1 / (1 / (2 - gap[0]) + u[2])]
    gap.append(1 / (1 / (2 - gap[2]) + u[3]))
    wanted = np.array([0, 0, 1 - gap[0], 1 - gap[1], gap[2] - 1, 1 - gap[3]])
    assert elements.of_exponent(2.0)(moves, 0.8) == pytest.approx(wanted)
    w, before = [], -0.2  # Fc+ = 1.2, Fc- = 0.8, in h; F = 0.2 + w
    for move in moves:
        limit = 1.2 if move > 0 else 0.8
        F, side = 0.2 + before, np.sign(move)  # noqa: N806
        F = side * limit - (side * limit - F) * np.exp(-0.8 * abs(move) / limit)  # noqa: N806
        w.append(before := F - 0.2)
    drawn = elements.asymmetric(moves, 0.8, 0.2, before=-0.2)
    assert drawn == pytest.approx(np.array(w), abs=1e-6)
