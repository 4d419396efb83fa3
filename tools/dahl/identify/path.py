# SPDX-License-Identifier: MIT
"""What each model makes of a path of angles: numbers F/Fc after each move. Time does not appear.

Dahl's model is the C library's. The bilinear element, with which it is compared, is a chain of
clipped shifts; these close under composition, so a long path is cut into rows, all rows run side by
side, and one short pass joins them.
"""

from __future__ import annotations

import numpy as np

from dahl.core import Throughput

ROW = 64  # samples that run one after another; the rest run side by side


def dahl(moves: np.ndarray, a: float, start: float = 0.0) -> np.ndarray:
    """F/Fc of Dahl's model after each move: shape (n,), rad or m; a in 1/rad; from F/Fc = start."""
    return Throughput(a, 1.0, 0.0).run(moves, start)


def bilinear(moves: np.ndarray, a: float, start: float = 0.0) -> np.ndarray:
    """F/Fc of a spring that slips at once (exponent 0 in place of Dahl's 1), clipped at +-1."""
    total = _rows(a * moves)
    low, high = np.full_like(total, -1.0), np.full_like(total, 1.0)
    for i in range(1, total.shape[0]):  # x -> min(high, max(low, x + total))
        for edge in (low, high):
            np.add(edge[i - 1], total[i], out=edge[i])
            np.minimum(np.maximum(edge[i], -1, out=edge[i]), 1, out=edge[i])
        total[i] += total[i - 1]
    before = np.empty(total.shape[1])
    for j, (shift, least, most) in enumerate(
        zip(total[-1].tolist(), low[-1].tolist(), high[-1].tolist(), strict=True)
    ):
        before[j] = start
        start = min(max(start + shift, least), most)
    ratios: np.ndarray = np.clip(before + total, low, high).T.ravel()
    return ratios[: len(moves)]


def loaded(moves: np.ndarray, a: float, share: np.ndarray) -> np.ndarray:
    """F/Fc of Dahl's model from rest under a load that makes Fc and sigma0 `share` times as large
    at each row, (n,): where the load falls F falls with it, where it grows F is kept
    (dahl_parts.h). Each row is an affine map of F, so that those of a long path are composed side
    by side.
    """
    left = np.exp(-a * np.abs(moves))
    fallen = np.minimum(share / np.concatenate((share[:1], share[:-1])), 1.0)
    kept, drawn = _rows(left * fallen), _rows(share * np.sign(moves) * (1 - left))
    for i in range(1, kept.shape[0]):  # F -> drawn + kept F
        drawn[i] += kept[i] * drawn[i - 1]
        kept[i] *= kept[i - 1]
    before, ratio = np.empty(kept.shape[1]), 0.0
    for j, (rest, more) in enumerate(zip(kept[-1].tolist(), drawn[-1].tolist(), strict=True)):
        before[j] = ratio
        ratio = more + rest * ratio
    ratios: np.ndarray = (drawn + kept * before).T.ravel()
    return ratios[: len(moves)]


def coulomb(moves: np.ndarray, _: float, start: float = 0.0) -> np.ndarray:
    """The sign of the last move that was one, `start` before the first."""
    sign = np.sign(moves)
    last = np.maximum.accumulate(np.where(sign != 0, np.arange(1, len(sign) + 1), 0))
    signs: np.ndarray = np.concatenate(([start], sign))
    return signs[last]


def reversals(theta: np.ndarray, least: float) -> np.ndarray:
    """Rows at which the motion turns by more than `least` (rad or m) before it turns again. One
    move alone at the beginning is no stroke that could turn.
    """
    moving = np.flatnonzero(np.diff(theta, prepend=theta[:1]))
    turns = moving[np.flatnonzero(np.diff(np.sign(np.diff(theta[moving])))) + 1]
    kept, direction = [], 0
    low = high = 0  # rows of the lowest and the highest angle since the last turn
    for row in [*turns.tolist(), len(theta) - 1]:  # a zigzag filter over turning points
        low = row if theta[row] <= theta[low] else low
        high = row if theta[row] >= theta[high] else high
        place = high if direction > 0 else low
        if direction == 0 and theta[high] - theta[low] > least:
            direction = 1 if row == high else -1
            low = high = row
        elif direction and abs(theta[row] - theta[place]) > least:
            kept.append(place)
            direction, low, high = -direction, row, row
    return np.array(kept, dtype=int)


def _rows(values: np.ndarray) -> np.ndarray:
    """Shape (n,) -> (ROW, columns): column j holds samples j*ROW ...; the last is filled up."""
    columns = -(-len(values) // ROW)
    whole = np.zeros(columns * ROW)
    whole[: len(values)] = values
    return np.ascontiguousarray(whole.reshape(columns, ROW).T)
