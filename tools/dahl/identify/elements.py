# SPDX-License-Identifier: MIT
"""Elements that a model may be made of, and general exponents between them: F/Fc after each move,
for a path of angles (see path.py).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from dahl.identify import path

Element = Callable[[np.ndarray, float], np.ndarray]  # moves, a -> F/Fc after each
CLOSED = 1e-12  # of a gap 1 - s w: what is left of it counts as nothing


def general(moves: np.ndarray, a: float, exponent: float) -> np.ndarray:
    """Dahl's model of 1968, dw/du = |1 - s w|^exponent for an exponent other than 1, from rest: in
    one direction the gap 1 - s w to the power of 1 - exponent falls in proportion to the travel.
    """
    power = 1 - exponent
    sign = path.coulomb(moves, 0.0)
    starts = np.flatnonzero(np.diff(sign, prepend=0.0))
    if len(starts) == 0:
        return np.zeros(len(moves))
    travel = np.concatenate(([0.0], np.cumsum(np.abs(a * moves))))
    sides = sign[starts]
    lengths = np.diff(travel[np.append(starts, len(moves))])
    gaps, gap = [], 1.0
    for length in lengths.tolist():
        gaps.append(gap**power)
        gap = 2 - _closed(gap**power - power * length, 1 / power)
    run = np.cumsum(np.isin(np.arange(len(moves)), starts)) - 1
    going = np.maximum(run, 0)
    left = np.array(gaps)[going] - power * (travel[1:] - travel[starts][going])
    ratio = sides[going] * (1 - np.maximum(left, CLOSED) ** (1 / power))
    return np.where(run < 0, 0.0, ratio)


def _closed(left: float, power: float) -> float:
    """The gap again, once it was raised; what is used up is closed."""
    return float(max(left, CLOSED) ** power)


def asymmetric(moves: np.ndarray, a: float, part: float, before: float = 0.0) -> np.ndarray:
    """Dahl's with Fc+ = h (1 + part) and Fc- = h (1 - part), one sigma0 for both, as F = m + h w:
    w alone, from `before` on; a = sigma0/h. Relaxed is w = -part.
    """
    forward = moves > 0
    return path.dahl(np.where(forward, moves / (1 + part), moves / (1 - part)), a, before)


def of_exponent(exponent: float) -> Element:
    """One of the family, in which slip has exponent 0 and Dahl's model 1."""
    if exponent == 1:
        return path.dahl
    return path.bilinear if exponent == 0 else partial(general, exponent=exponent)
