# SPDX-License-Identifier: MIT
"""Friction along a path of angles, as the laws of laws.py need it.

A function returns F/Fc after each move, from rest at the first row of each piece. Moves have shape
(n,) in rad (m); `a` = sigma0/Fc in 1/rad (1/m). sigma0 is the slope dF/dtheta at rest and Fc the
torque at full slip.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dtbtrs

from dahl.binding.throughput import Throughput

Pieces = Sequence[slice]  # rows of each uninterrupted recording


def dahl(moves: np.ndarray, pieces: Pieces, a: float) -> np.ndarray:
    """Dahl's law by the exact step of the C library."""
    step = Throughput(a, 1.0, 0.0)
    return np.concatenate([step.run(moves[rows], 0.0) for rows in pieces]).astype(float)


def dahl_with_limits(moves: np.ndarray, pieces: Pieces, a: float, limits: np.ndarray) -> np.ndarray:
    """Dahl's law with Fc `limits` times as large at each row (n,) and a constant sigma0."""
    kept = np.exp(-a * np.abs(moves) / limits)
    return _affine_steps(kept, np.sign(moves) * limits * (1 - kept), pieces)


def dahl_under_load(moves: np.ndarray, pieces: Pieces, a: float, share: np.ndarray) -> np.ndarray:
    """Dahl's law with Fc and sigma0 both `share` times as large at each row (n,).

    F falls with a falling load and is kept when the load grows, as in dahl_loaded_step_counts().
    """
    left = np.exp(-a * np.abs(moves))
    before = np.concatenate((share[:1], share[:-1]))
    kept = left * np.minimum(share / before, 1.0)
    return _affine_steps(kept, share * np.sign(moves) * (1 - left), pieces)


def asymmetric(moves: np.ndarray, pieces: Pieces, a: float, skew: float) -> np.ndarray:
    """Dahl's law with Fc (1 + skew) forward and Fc (1 - skew) backward and one sigma0.

    Returns the symmetric part w of F = Fc (skew + w). The constant part belongs to the offset.
    """
    return dahl(np.where(moves > 0, moves / (1 + skew), moves / (1 - skew)), pieces, a)


def _affine_steps(kept: np.ndarray, added: np.ndarray, pieces: Pieces) -> np.ndarray:
    """Solve F_i = kept_i F_(i-1) + added_i from F = 0, as one bidiagonal system."""
    band = np.ones((2, len(kept)))
    band[1, :-1] = -kept[1:]
    for rows in pieces:
        if rows.start:
            band[1, rows.start - 1] = 0.0
    solved: np.ndarray = dtbtrs(band, added[:, None], uplo="L", diag="U")[0][:, 0]
    return solved


def strokes(moves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first row of each stroke, and its direction (+1 or -1)."""
    moving = np.flatnonzero(moves)
    if len(moving) == 0:
        return np.zeros(1, dtype=int), np.ones(1)
    direction = np.sign(moves[moving])
    turns = np.flatnonzero(np.diff(direction)) + 1
    return np.append(0, moving[turns]), direction[np.append(0, turns)]


def slip(moves: np.ndarray, pieces: Pieces, a: float) -> np.ndarray:
    """A spring that slips at Fc: within one stroke it is a line from -1 to 1."""
    return by_strokes(moves, pieces, a, np.array([-1.0, 1.0]), np.array([0.0, 2.0]))


def behind_play(theta: np.ndarray, pieces: Pieces, width: float) -> np.ndarray:
    """The angle behind a play of `width` rad (m), which starts in the middle of the play."""
    half = max(width, 1e-12) / 2
    moves = np.diff(theta, prepend=theta[:1])
    moves[[rows.start for rows in pieces]] = 0.0
    followed: np.ndarray = theta - half * slip(moves, pieces, 1 / half)
    return followed


_GAP = np.concatenate((np.linspace(2.0, 0.05, 300)[:-1], np.geomspace(0.05, 1e-8, 400)))


def travel_table(slope: Callable[[np.ndarray], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """y = s w and the travel u from y = -1, by Simpson's rule; slope(1 - y) is dy/du."""
    y = 1 - _GAP
    ends = 1 / np.maximum(slope(_GAP), 1e-12)
    middle = 1 / np.maximum(slope((_GAP[1:] + _GAP[:-1]) / 2), 1e-12)
    steps = np.diff(y) * (ends[1:] + 4 * middle + ends[:-1]) / 6
    return y, np.concatenate(([0.0], np.cumsum(steps)))


def by_strokes(
    moves: np.ndarray, pieces: Pieces, a: float, y: np.ndarray, u: np.ndarray
) -> np.ndarray:
    """A law by its curve y(u) from -1 to 1, with the travel u in presliding lengths."""
    ratio = np.zeros(len(moves))
    for rows in pieces:
        part, w = moves[rows], 0.0
        starts, directions = strokes(part)
        for i, j, s in zip(starts, [*starts[1:], len(part)], directions, strict=True):
            travel = a * np.cumsum(np.abs(part[i:j]))
            reached = np.interp(np.interp(s * w, y, u) + travel, u, y)
            ratio[rows.start + i : rows.start + j] = s * reached
            w = float(s * reached[-1])
    return ratio


@dataclass(frozen=True)
class Element:
    """A part of a sum of elements in parallel, which the library runs."""

    name: str  # in scenes and JSON
    run: Callable[[np.ndarray, Pieces, float], np.ndarray]


DAHL_ELEMENT, SLIP_ELEMENT = Element("dahl", dahl), Element("slip", slip)


def turning_points(theta: np.ndarray, min_turn: float) -> np.ndarray:
    """Rows at which the motion turns back by more than `min_turn` rad (m)."""
    moving = np.append(0, np.flatnonzero(np.diff(theta)) + 1)
    turns = moving[np.flatnonzero(np.diff(np.sign(np.diff(theta[moving])))) + 1]
    kept, direction = [], 0
    low = high = 0  # rows of the lowest and the highest angle since the last turn
    for row in [*turns.tolist(), len(theta) - 1]:
        low = row if theta[row] <= theta[low] else low
        high = row if theta[row] >= theta[high] else high
        extreme = high if direction > 0 else low
        if direction == 0 and theta[high] - theta[low] > min_turn:
            direction = 1 if row == high else -1
            low = high = row
        elif direction and abs(theta[row] - theta[extreme]) > min_turn:
            kept.append(extreme)
            direction, low, high = -direction, row, row
    return np.array(kept, dtype=int)
