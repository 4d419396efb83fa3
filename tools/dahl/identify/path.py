# SPDX-License-Identifier: MIT
"""What each model makes of a path of angles: numbers F/Fc after each move, from a relaxed start.

All three models are chains of maps that close under composition (affine for Dahl, clipped shifts for
the bilinear element), so a long path is cut into rows, all rows run side by side, and one short
pass joins them: no loop over samples. Time does not appear.
"""

from __future__ import annotations

import numpy as np

ROW = 512  # samples that run one after another; the rest run side by side


def dahl(moves: np.ndarray, a: float) -> np.ndarray:
    """F/Fc of Dahl's model (Eqs. 7, 18, 27) after each move: shape (n,), rad or m; a in 1/rad."""
    travel = a * np.abs(moves)
    keep, push = _rows(np.exp(-travel), 1.0), _rows(np.copysign(np.expm1(-travel), moves), 0.0)
    for i in range(1, keep.shape[0]):  # composition of the row's maps so far
        push[i] += push[i - 1] * keep[i]
        keep[i] *= keep[i - 1]
    start = np.zeros(keep.shape[1])
    for j in range(1, keep.shape[1]):
        start[j] = keep[-1, j - 1] * start[j - 1] + push[-1, j - 1]
    return (keep * start + push).T.ravel()[: len(moves)]


def bilinear(moves: np.ndarray, a: float) -> np.ndarray:
    """F/Fc of a spring that slips at once (exponent 0 in place of Dahl's 1), clipped at +-1."""
    total = _rows(a * moves, 0.0)
    low, high = np.full_like(total, -1.0), np.full_like(total, 1.0)
    for i in range(1, total.shape[0]):  # x -> min(high, max(low, x + total))
        np.clip(low[i - 1] + total[i], -1, 1, out=low[i])
        np.clip(high[i - 1] + total[i], -1, 1, out=high[i])
        total[i] += total[i - 1]
    start = np.zeros(total.shape[1])
    for j in range(1, total.shape[1]):
        start[j] = np.clip(start[j - 1] + total[-1, j - 1], low[-1, j - 1], high[-1, j - 1])
    return np.clip(start + total, low, high).T.ravel()[: len(moves)]


def coulomb(moves: np.ndarray) -> np.ndarray:
    """The sign of the last move that was one; 0 before the first."""
    sign = np.sign(moves)
    last = np.maximum.accumulate(np.where(sign != 0, np.arange(len(sign)), 0))
    return sign[last]


def reversals(theta: np.ndarray, least: float) -> np.ndarray:
    """Rows at which the motion turns by more than `least` (rad or m) before it turns again."""
    moving = np.flatnonzero(np.diff(theta, prepend=theta[:1]))
    turns = moving[np.flatnonzero(np.diff(np.sign(np.diff(theta[moving])))) + 1]
    kept, direction, place = [], 0, 0
    for row in [*turns.tolist(), len(theta) - 1]:  # a zigzag filter over turning points
        step = theta[row] - theta[place]
        if direction == 0:
            direction, place = (np.sign(step), row) if abs(step) > least else (0, place)
        elif direction * step >= 0:
            place = row
        elif abs(step) > least:
            kept.append(place)
            direction, place = -direction, row
    return np.array(kept, dtype=int)


def _rows(values: np.ndarray, fill: float) -> np.ndarray:
    """Shape (n,) -> (ROW, columns): column j holds samples j*ROW ...; the last is filled up."""
    columns = -(-len(values) // ROW)
    whole = np.full(columns * ROW, fill)
    whole[: len(values)] = values
    return np.ascontiguousarray(whole.reshape(columns, ROW).T)
