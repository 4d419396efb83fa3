# SPDX-License-Identifier: MIT
"""Start values for the fits: a coarse grid over stiffness and delay, and over pairs of elements."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from dahl.identify import models
from dahl.identify.fit import Fitter, Hypothesis
from dahl.identify.laws import LAWS, SLIPS, Law, Sum
from dahl.identify.least_squares import cost_of, solve
from dahl.identify.models import DAHL_ELEMENT, SLIP_ELEMENT
from dahl.identify.samples import Samples

DELAYS = (0.0, -60.0, -25.0, -10.0, 10.0, 25.0, 60.0)  # samples
MIN_DELAY_GAIN = 0.8  # of the robust cost, that a delay must reach to be a start value
STIFFNESS_RATIO = 1.45  # from one grid point of a to the next
MAX_STROKE_LENGTHS = 4000  # presliding lengths in a stroke, that a grid of a covers
MAX_LIKE_DRY_FRICTION = 0.97  # correlation of speed and direction; a sine has .9
WORK_PARTS = 12  # of a log, whose spread shows how well the work of friction is known
CLEAR_WORK = 2.0  # standard errors
ROBUST = 6.0  # medians beyond which a residual counts no more
GRID_SAMPLES = 3000  # that the coarse grid is scored on
PAIR_GRID = np.geomspace(0.15, 7, 8)  # of a, for pairs of elements
SLIP_GRID = np.geomspace(0.2, 12, 11)  # of a, for sums of slip elements
MIN_ELEMENT = 0.01  # of Fc in all; a smaller element is noise


@dataclass(frozen=True)
class Start:
    """A point of the coarse grid."""

    cost: float  # robust mean of the residual, over the range of the torque
    a: float
    delay: float  # samples
    sign: float  # of the torque


def coarse_start(fitter: Fitter) -> Start:
    """Return the point of the least robust cost on a grid of stiffness and delay.

    The usual sign is the one with which friction takes energy from the motion, and the usual delay
    is 0. Another sign or delay must explain much more, since a motion that repeats itself looks the
    same with the torque late by whole strokes.
    """
    best: dict[bool, Start] = {}
    resists = sign_by_work(fitter.samples, slice(None))
    for point in _grid(fitter):
        is_usual = point.delay == 0 and point.sign * resists >= 0
        if is_usual not in best or point.cost < best[is_usual].cost:
            best[is_usual] = point
    if not best:
        return Start(np.inf, 1.0, 0.0, resists or 1.0)
    usual, other = best.get(True), best.get(False)
    if usual is None or (other is not None and other.cost < MIN_DELAY_GAIN * usual.cost):
        assert other is not None  # one of both is there
        return other
    return usual


def _grid(fitter: Fitter) -> Iterator[Start]:
    """Yield the points whose friction is not larger than the torque allows."""
    s = fitter.samples
    rows = _grid_samples(fitter)
    weight, torque = s.weight[rows], s.torque[rows]
    with np.errstate(invalid="ignore", divide="ignore"):  # of a shaft that turns one way
        like_dry = np.corrcoef(s.speed[rows], s.direction[rows])[0, 1] > MAX_LIKE_DRY_FRICTION
    names = ("offset", "spring", *(["viscous"] if not like_dry else []))
    names += ("inertia",) if s.timed else ()
    terms = [s.terms[name][rows] for name in names]
    for a in _stiffnesses(fitter).tolist():
        w = models.dahl(fitter.moves["between counts"], s.pieces, a)
        for delay in (one for one in DELAYS if abs(one) <= fitter.max_delay):
            columns = np.column_stack((s.delayed(w, delay)[rows], *terms, torque))
            c = solve((columns * weight[:, None]).T @ columns, range(columns.shape[1] - 1))
            if abs(c[0]) * np.abs(w).max() > fitter.max_friction:
                continue
            left = np.abs(torque - columns[:, :-1] @ c) * np.sqrt(weight)
            cost = float(np.mean(np.minimum(left, ROBUST * np.median(left))))
            yield Start(cost / fitter.max_friction, a, delay, float(np.sign(c[0])) or 1.0)


def sign_by_work(s: Samples, rows: slice) -> float:
    """Return the sign of the torque with which friction takes energy from the motion; 0 if unclear.

    Offset, springs and inertia are taken out of the torque and of the moves first.
    """
    names = ("offset", "spring", "cubic", *(["inertia"] if s.timed else []))
    known = s.weight[rows] > 0
    table = np.column_stack([s.terms[name][rows] for name in names])[known]
    moves = s.moves(s.angles["between counts"])
    both = np.column_stack((s.torque[rows], moves[rows]))[known]
    free = both - table @ np.linalg.lstsq(table, both, rcond=None)[0]
    work = np.array([part.sum() for part in np.array_split(free.prod(axis=1), WORK_PARTS)])
    error = float(work.std(ddof=1)) / np.sqrt(WORK_PARTS)
    mean = float(work.mean())
    return float(np.sign(mean)) if abs(mean) > CLEAR_WORK * error else 0.0


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


def pair_starts(fitter: Fitter, h: Hypothesis, a: float) -> dict[Law, np.ndarray]:
    """ln a of both elements of each law of two elements: the best pair on a grid."""
    grid = a * PAIR_GRID
    n, moves, pieces = len(grid), fitter.moves[h.angle], fitter.samples.pieces
    first = {DAHL_ELEMENT: 0, SLIP_ELEMENT: n}  # column of each kind
    w = [element.run(moves, pieces, x) for element in first for x in grid]
    table = np.column_stack((*w, *fitter.term_columns(h.terms)))
    gram = fitter.samples.grams(table).sum(axis=0)
    columns = table.shape[1]
    found: dict[Law, np.ndarray] = {}
    for law in (law for law in LAWS.values() if isinstance(law, Sum) and law.elements == 2):
        one, other = (first[kind] for kind in law.kinds)
        both = [(one + i, other + j) for i in range(n) for j in range(i if one == other else n)]
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
    while len(groups) > max(SLIPS):
        groups.pop(int(np.argmin([c[group].sum() for group in groups])))
    p = [float(np.log(c[group] @ grid[group] / c[group].sum())) for group in groups]
    return replace(h, law=SLIPS[len(groups)]), np.array(p)
