# SPDX-License-Identifier: MIT
"""A torque that went through a low pass: a filter makes each reversal rounder and later, which a
fit takes for a softer bearing or for a delay.

Dahl's torque is filtered with many lengths, as by a first-order low pass, a running mean and a bare
delay, and fitted anew with each. Where one explains the log clearly better than the fit did, or the
fit had to take a delay, all filters that explain it as well as the best one are asked: parameters
on which they disagree with the fit are not claimed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.signal import lfilter

from dahl.identify import path, recording
from dahl.identify.finding import Finding
from dahl.identify.result import Result
from dahl.identify.terms import columns_of, places_of

LOOKED_AT = 20_000  # rows of each log
LENGTHS = (1, 2, 3, 5, 7, 10, 14, 20, 35, 60)  # rows
GLANCES = (2, 7, 20)  # rows: whether a filter helps at all
NODES = np.geomspace(0.7, 2.8, 15)  # of a
CLOSER = np.exp(np.linspace(-0.06, 0.06, 5))  # of a best a
BLOCKS, SURELY = 40, 4.0  # of rows; standard errors of the mean gain of a block
MUCH = 0.8  # of a cost
LATE = 0.3  # rows
FEW = 8  # reversals of a log without a clock

Filter = Callable[[np.ndarray], np.ndarray]
Kind = Callable[[int, np.ndarray], np.ndarray]  # with its rows


@dataclass
class Fit:
    """The best parameters with one filter."""

    words: str
    filtered: Filter
    a: float
    Fc: float
    cost: float
    squares: np.ndarray  # (rows,) squared residuals, weighed

    @property
    def sigma0(self) -> float:
        return self.a * self.Fc


def finding(result: Result) -> list[Finding]:
    """Whether a filter explains the torque as well, and which parameters then are others."""
    unclocked = [log for log in result.logs if log.time is None]
    if any(map(recording.by_event, unclocked)) or (unclocked and result.reversals < FEW):
        return []  # nobody knows how long a row is, or too little turns round to tell it
    squares, measured, nodes = squares_of(result), Measured(result), result.estimate.a * NODES
    looks = measured.fits(_filters((_first_order,), GLANCES), nodes)
    late = result.delay > LATE or any(is_better(squares, one.squares) for one in looks)
    if not late or _bent_otherwise(result, min(one.cost for one in looks)):
        return []
    fits = measured.fits(_filters(), nodes)
    best = min(fits, key=lambda one: one.cost)
    if _bent_otherwise(result, best.cost):
        return []
    near = [
        measured.fits([(one.words, one.filtered)], one.a * CLOSER)[0]
        for one in fits
        if not is_better(one.squares, best.squares)
    ]
    return _told(result, best, near)


def _told(result: Result, best: Fit, near: list[Fit]) -> list[Finding]:
    """What the filters that explain the torque best say of the parameters."""
    doubts = tuple(name for name in ("sigma0", "Fc") if _disagrees(result, near, name))
    if not doubts:
        return []
    values = {name: [getattr(one, name) for one in near] for name in doubts + ("sigma0",)}
    reach = {name: (min(some), max(some)) for name, some in values.items()}
    low, high = reach["sigma0"]
    words = f"torque looks late or low-passed ({best.words}): sigma0 is then"
    text = f"{words} {low:.4g} to {high:.4g} {result.logs[0].slope_unit}"
    return [Finding(text, doubts, reach)]


def _disagrees(result: Result, fits: list[Fit], name: str) -> bool:
    """Whether one of the fits puts a parameter outside its interval."""
    ends = result.estimate.ci95[name]
    return any(not ends.low <= getattr(one, name) <= ends.high for one in fits)


def is_better(before: np.ndarray, after: np.ndarray) -> bool:
    """Whether the squared residuals fall by much, or in most parts of the log, beyond chance."""
    gains = np.array([part.sum() for part in np.array_split(before - after, BLOCKS)])
    error = float(gains.std(ddof=1)) / np.sqrt(BLOCKS)
    return bool(after.sum() < MUCH * before.sum() or gains.mean() > SURELY * error)


def _bent_otherwise(result: Result, cost: float) -> bool:
    """Whether the bilinear element, which a filter resembles, explains the log better than that."""
    rows = sum(min(log.rows, LOOKED_AT) for log in result.logs)
    return result.models.rmse["bilinear"] ** 2 < cost / rows


def squares_of(result: Result) -> np.ndarray:
    """Of the fit's residuals, on the rows looked at."""
    parts = []
    for log, drawn in zip(result.logs, result.predicted, strict=True):
        rows = slice(0, LOOKED_AT)
        weight = 1.0 if log.weight is None else log.weight[rows]
        parts.append(weight * (log.torque - drawn)[rows] ** 2)
    return np.concatenate(parts)


def _first_order(rows: int, x: np.ndarray) -> np.ndarray:
    keep = np.exp(-1 / rows)
    return np.asarray(lfilter([1 - keep], [1, -keep], x, axis=0, zi=keep * x[:1])[0])


def _mean(rows: int, x: np.ndarray) -> np.ndarray:
    total = np.cumsum(np.concatenate((np.repeat(x[:1], rows, axis=0), x)), axis=0)
    return np.asarray((total[rows:] - total[:-rows]) / rows)


def _delay(rows: int, x: np.ndarray) -> np.ndarray:
    return np.concatenate((np.repeat(x[:1], rows, axis=0), x))[: len(x)]


KINDS: dict[Kind, str] = {
    _first_order: "time constant of {} rows",
    _mean: "mean of {} rows",
    _delay: "delay of {} rows",
}


def _filters(
    kinds: Iterable[Kind] = KINDS,
    lengths: Sequence[int] = LENGTHS,
) -> list[tuple[str, Filter]]:
    """Each kind with each length, and how it is called."""
    return [(KINDS[kind].format(rows), partial(kind, rows)) for kind in kinds for rows in lengths]


class Measured:
    """The rows looked at, as they came: torque before any shift, terms, weights."""

    def __init__(self, result: Result) -> None:
        used = places_of(result.estimate.terms)
        terms, torques, weights, self.moves = [], [], [], []
        for log, raw in zip(result.logs, result.eased, strict=True):
            rows = slice(0, min(LOOKED_AT, log.rows))
            terms.append(columns_of(log, rows)[:, used])
            torques.append(result.sign * raw.torque[rows])
            weights.append(np.ones(rows.stop) if log.weight is None else log.weight[rows])
            self.moves.append(log.moves_of(rows))
        self.root = np.sqrt(np.concatenate(weights))
        self.terms = np.concatenate(terms) * self.root[:, None]
        self.torque = np.concatenate(torques) * self.root

    def fits(self, filters: list[tuple[str, Filter]], nodes: np.ndarray) -> list[Fit]:
        """The best fit with each filter, with a among the nodes or between them."""
        drawn = [self._drawn(a) for a in nodes]
        return [self._best(words, filtered, nodes, drawn) for words, filtered in filters]

    def _drawn(self, a: float) -> list[np.ndarray]:
        """w and the torque at the first row, as it is forgotten, of each log: (rows, 2)."""
        columns = []
        for moves in self.moves:
            start = np.exp(-np.minimum(a * np.cumsum(np.abs(moves)), 700.0))
            columns.append(np.column_stack((path.dahl(moves, a), start)))
        return columns

    def _best(
        self, words: str, filtered: Filter, nodes: np.ndarray, drawn: list[list[np.ndarray]]
    ) -> Fit:
        rest, Fc = [], []  # noqa: N806
        for parts in drawn:
            friction = np.concatenate([filtered(x) for x in parts]) * self.root[:, None]
            columns = np.hstack((friction, self.terms))
            best = np.linalg.lstsq(columns.T @ columns, columns.T @ self.torque, rcond=None)[0]
            rest.append(self.torque - columns @ best)
            Fc.append(float(best[0]))
        costs = np.array([float(left @ left) for left in rest])
        a, least = _vertex(nodes, costs), int(np.argmin(costs))
        here = float(np.interp(np.log(a), np.log(nodes), Fc))
        return Fit(words, filtered, a, here, float(costs[least]), rest[least] ** 2)


def _vertex(nodes: np.ndarray, costs: np.ndarray) -> float:
    """Where a parabola in log a through the lowest cost and its neighbours is lowest."""
    i = int(np.clip(np.argmin(costs), 1, len(nodes) - 2))
    around = slice(i - 1, i + 2)
    x = np.log(nodes[around] / nodes[i])
    bend, slope, _ = np.polyfit(x, costs[around], 2)
    place = -slope / (2 * bend) if bend > 0 else x[np.argmin(costs[around])]
    return float(nodes[i] * np.exp(np.clip(place, x[0], x[-1])))
