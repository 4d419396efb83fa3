# SPDX-License-Identifier: MIT
"""Start values for the fits: a coarse grid over stiffness and delay, and over pairs of elements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import nnls

from dahl.identify import models
from dahl.identify.fit import Fitter, Hypothesis, cost_of, solve

DELAYS = (0.0, -60.0, -25.0, -10.0, 10.0, 25.0, 60.0)  # samples
MIN_DELAY_GAIN = 0.8  # of the robust cost, that a delay must reach to be a start value
STIFFNESS_RATIO = 1.45  # from one grid point of a to the next
MAX_STROKE_LENGTHS = 4000  # presliding lengths in a stroke, that a grid of a covers
MAX_LIKE_DRY_FRICTION = 0.97  # correlation of speed and direction; a sine has .9
ROBUST = 6.0  # medians beyond which a residual counts no more
GRID_SAMPLES = 3000  # that the coarse grid is scored on
PAIR_GRID = np.geomspace(0.15, 7, 8)  # of a, for pairs of elements
SLIP_GRID = np.geomspace(0.2, 12, 11)  # of a, for sums of slip elements
MIN_ELEMENT = 0.01  # of Fc in all; a smaller element is noise
MAX_SLIPS = 4  # as the library's tables and pictures show them


def coarse_start(fitter: Fitter) -> tuple[float, float, float]:
    """(a, delay in samples, sign of the torque) of the least robust cost on a grid."""
    s = fitter.samples
    rows = _grid_samples(fitter)
    weight, torque = s.weight[rows], s.torque[rows]
    like_dry = np.corrcoef(s.speed[rows], s.direction[rows])[0, 1] > MAX_LIKE_DRY_FRICTION
    names = ("offset", "spring", *(["viscous"] if not like_dry else []))
    names += ("inertia",) if s.timed else ()
    terms = [s.terms[name][rows] for name in names]
    moves = fitter.moves["between counts"]
    best, found = np.inf, (1.0, 0.0, 1.0)
    for a in _stiffnesses(fitter):
        w = models.dahl(moves, s.pieces, a)
        for delay in DELAYS:
            columns = np.column_stack((s.delayed(w, delay)[rows], *terms, torque))
            c = solve((columns * weight[:, None]).T @ columns, range(columns.shape[1] - 1))
            left = np.abs(torque - columns[:, :-1] @ c) * np.sqrt(weight)
            cost = float(np.mean(np.minimum(left, ROBUST * np.median(left))))
            if cost < best * (1.0 if delay == 0 or found[1] != 0 else MIN_DELAY_GAIN):
                best, found = cost, (float(a), delay, float(np.sign(c[0])) or 1.0)
    return found


def _grid_samples(fitter: Fitter) -> np.ndarray:
    """Samples away from the ends of pieces, evenly spread."""
    s = fitter.samples
    inside = np.zeros(s.rows, dtype=bool)
    for rows in s.pieces:
        edge = min(100, (rows.stop - rows.start) // 10)
        inside[rows.start + edge : rows.stop - edge] = True
    kept = np.flatnonzero(inside & (s.weight > 0))
    return kept[:: max(len(kept) // GRID_SAMPLES, 1)]


def _stiffnesses(fitter: Fitter) -> np.ndarray:
    """From a stroke of .7 presliding lengths to one count of three."""
    s = fitter.samples
    moves = np.abs(fitter.moves["between counts"])
    span = float(np.ptp(s.angles["between counts"]))
    usual = float(np.median(moves[moves != 0])) / 3 if moves.any() else span
    low, high = 0.7 / span, max(3 / max(s.count, usual), 100 / span)
    high = min(high, MAX_STROKE_LENGTHS / span)
    return np.geomspace(low, high, round(np.log(high / low) / np.log(STIFFNESS_RATIO)) + 1)


def pair_starts(fitter: Fitter, h: Hypothesis, a: float) -> dict[str, np.ndarray]:
    """ln a of both elements of each law of two elements: the best pair on a grid."""
    grid = a * PAIR_GRID
    n, moves, pieces = len(grid), fitter.moves[h.angle], fitter.samples.pieces
    w = [law(moves, pieces, x) for law in (models.dahl, models.slip) for x in grid]
    table = np.column_stack((*w, *fitter.term_columns(h.terms)))
    gram = fitter.samples.grams(table).sum(axis=0)
    columns = table.shape[1]
    pairs = {
        "2 dahl": [(i, j) for i in range(n) for j in range(i)],
        "mixed": [(i, n + j) for i in range(n) for j in range(n)],
        "2 slip": [(n + i, n + j) for i in range(n) for j in range(i)],
    }
    found = {}
    for law, both in pairs.items():
        chosen = np.array([[*pair, *range(2 * n, columns), columns] for pair in both])
        grams = gram[chosen[:, :, None], chosen[:, None, :]]
        c = solve(grams, range(grams.shape[-1] - 1))
        cost = cost_of(grams, range(grams.shape[-1] - 1), c)
        cost = np.where((c[:, :2] > 0).all(axis=1), cost, np.inf)
        k = int(np.argmin(cost))
        if np.isfinite(cost[k]):
            found[law] = np.log(grid[[x % n for x in both[k]]])
    return found


def slip_start(fitter: Fitter, h: Hypothesis, a: float) -> tuple[Hypothesis, np.ndarray] | None:
    """A sum of slip elements: non-negative least squares on a grid, with neighbours joined.

    None for fewer than three, since pair_starts() has the best pair.
    """
    grid, s = a * SLIP_GRID, fitter.samples
    w = [models.slip(fitter.moves[h.angle], s.pieces, x) for x in grid]
    terms = fitter.term_columns(h.terms)
    both_signs = np.column_stack((*w, *terms, *(-x for x in terms)))
    root = np.sqrt(s.used)
    c = nnls(both_signs * root[:, None], s.torque * root)[0][: len(grid)]
    groups: list[list[int]] = []
    for k in np.flatnonzero(c > MIN_ELEMENT * c.sum()).tolist():
        if groups and k - groups[-1][-1] == 1:
            groups[-1].append(k)
        else:
            groups.append([k])
    if len(groups) < 3:
        return None
    while len(groups) > MAX_SLIPS:
        groups.pop(int(np.argmin([c[group].sum() for group in groups])))
    p = [float(np.log(c[group] @ grid[group] / c[group].sum())) for group in groups]
    return replace(h, law=f"{len(groups)} slip"), np.array(p)
