# SPDX-License-Identifier: MIT
"""Scores and errors by what repeats: whole cycles between reversals, or whole logs, are left out of
a fit and then predicted. Neighbouring rows share their errors and each part of a loop is needed to
fit it, so that leaving out rows or parts of a cycle says little.

All rows, or at most LOOKED_AT of them, are averaged into a few thousand bins. The bins of each
cycle give a Gram matrix of the columns of a linear model, as in sweep.py.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dahl.identify import path
from dahl.identify.log import Log
from dahl.identify.terms import columns_of

LOOKED_AT = 100_000  # rows of all logs together, from the beginning of each
BINS = 5_000
MOST, LEAST = 24, 6  # cycles that are told apart; fewer: strokes
FORGOTTEN = 6.0  # presliding lengths after which the torque at the first row no longer shows
FORGOTTEN_PART = 0.25  # of all travel, that is given for this at most

Model = Callable[[np.ndarray, float], np.ndarray]  # moves, a -> F/Fc after each


@dataclass
class Part:
    """One log in bins."""

    moves: np.ndarray  # (rows,) rad (m)
    terms: np.ndarray  # (bins, len(TERMS))
    torque: np.ndarray  # (bins,) N m (N)
    weight: np.ndarray  # (bins,) 0 where it does not count
    unit: np.ndarray  # (bins,) index of the cycle, within the log


class Cut:
    """Logs in bins, cut into cycles."""

    def __init__(self, logs: Sequence[Log], a: float, least_turn: float, reach: int) -> None:
        """Cut where the angle turns by more than `least_turn` rad (m); `reach` is by how many rows
        a torque may be moved, so that as many at the ends of a log do not count.
        """
        most = max(LOOKED_AT // len(logs), 1)
        logs = [log.head(most) for log in logs]
        self.rows = max(-(-sum(log.rows for log in logs) // BINS), 1)  # of a bin
        parts = [self._part(log, a, least_turn, reach) for log in logs]
        self.moves = [part.moves for part in parts]
        self.ends = np.cumsum([0, *(len(part.torque) for part in parts)])
        self.terms = np.concatenate([part.terms for part in parts])
        self.torque = np.concatenate([part.torque for part in parts])
        self.root = np.sqrt(np.concatenate([part.weight for part in parts]))
        self.spans = self._spans(parts)
        names = [log.name for log in logs]
        owner = np.searchsorted(self.ends, [span.start for span in self.spans], side="right") - 1
        several = len(dict.fromkeys(names)) > 1
        self.fold = np.array([names.index(names[i]) for i in owner]) if several else None

    def _part(self, log: Log, a: float, least_turn: float, reach: int) -> Part:
        moves = log.moves_of(slice(0, log.rows))
        columns = self.mean(columns_of(log))
        weight = np.ones(log.rows) if log.weight is None else log.weight
        torque = self.mean(weight * log.torque) / np.maximum(self.mean(weight), 1e-9)
        counted = self._counted(moves, a, min(reach, log.rows // 20))
        unit = units_of(log, least_turn)[:: self.rows][: len(torque)]
        return Part(moves, columns[:, :-1], torque, self.mean(weight) * counted, unit)

    def _counted(self, moves: np.ndarray, a: float, reach: int) -> np.ndarray:
        """Which bins count: (bins,) 0 or 1."""
        travel = np.cumsum(np.abs(moves))
        counted = travel > min(FORGOTTEN / a, FORGOTTEN_PART * travel[-1])
        counted[:reach] = False
        counted[len(counted) - reach :] = False
        bins: np.ndarray = np.floor(self.mean(counted.astype(float)))
        return bins

    def _spans(self, parts: Sequence[Part]) -> list[slice]:
        """The bins of each cycle that counts, at most MOST of them (one at least of each log):
        neighbours are put together.
        """
        spans = []
        for part, start in zip(parts, self.ends, strict=False):
            count = int(part.unit.max()) + 1
            share = -(-count * len(parts) // MOST)
            together = np.minimum(part.unit // share, max(count // share - 1, 0))
            edges = np.flatnonzero(np.diff(together, prepend=-1))
            for i, j in zip(edges, [*edges[1:], len(together)], strict=True):
                if part.weight[i:j].sum() > 0.1 * (j - i):
                    spans.append(slice(int(start + i), int(start + j)))
        return spans

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Means over the rows of each bin; what is left at the end goes."""
        bins = len(values) // self.rows
        shaped = values[: bins * self.rows].reshape(bins, self.rows, *values.shape[1:])
        averaged: np.ndarray = shaped.mean(axis=1)
        return averaged

    def drawn(self, model: Model, a: float) -> np.ndarray:
        """F/Fc of a model from rest, (bins,)."""
        return np.concatenate([self.mean(model(moves, a)) for moves in self.moves])

    def moved(self, columns: np.ndarray, rows: float) -> np.ndarray:
        """Columns, (bins, k), as many rows later."""
        if rows == 0:
            return columns
        bins = rows / self.rows
        whole = int(np.floor(bins))
        share = bins - whole
        cut = zip(self.ends, self.ends[1:], strict=False)
        return np.concatenate(
            [
                (1 - share) * _later(columns[i:j], whole) + share * _later(columns[i:j], whole + 1)
                for i, j in cut
            ]
        )

    def grams(self, columns: np.ndarray) -> np.ndarray:
        """Products of the columns, the torque the last, by cycle: (cycles, k + 1, k + 1)."""
        weighed = np.column_stack((columns, self.torque)) * self.root[:, None]
        parts = [weighed[span] for span in self.spans]
        return np.array([part.T @ part for part in parts])

    @property
    def spread(self) -> float:
        """Sum of squares of the torque around its mean."""
        weight = self.root**2
        mean = float(weight @ self.torque / weight.sum())
        return float(weight @ (self.torque - mean) ** 2)


def _later(columns: np.ndarray, by: int) -> np.ndarray:
    """Whole bins later; the ends are drawn out."""
    index = np.clip(np.arange(len(columns)) - by, 0, len(columns) - 1)
    return columns[index]


def units_of(log: Log, least_turn: float) -> np.ndarray:
    """The number of its cycle for each row: between every second reversal, or between all of them
    where these are few, with what is before the first and behind the last where there are hardly
    any (one log of several that are short).
    """
    turns = path.reversals(log.theta, least_turn)
    if 2 * len(turns) <= LEAST:
        return np.searchsorted(turns, np.arange(log.rows), side="right")
    starts = turns[::2] if len(turns) > 2 * LEAST else turns
    cycle = np.searchsorted(starts, np.arange(log.rows), side="right") - 1
    return np.clip(cycle, 0, max(len(starts) - 2, 0))


Solve = Callable[[np.ndarray], np.ndarray]  # Gram matrix, the torque last -> coefficients


def least_squares(gram: np.ndarray) -> np.ndarray:
    """Coefficients of the columns; columns of zeros get 0."""
    matrix = gram[:-1, :-1]
    ridge = 1e-10 * np.diag(matrix) + 1e-30
    solution: np.ndarray = np.linalg.solve(matrix + np.diag(ridge), gram[:-1, -1])
    return solution


@dataclass
class LeftOut:
    """What fits without one cycle (one log) say."""

    cost: np.ndarray  # (cycles,) squares on each when it is not fitted
    found: np.ndarray  # (cycles, columns) coefficients without that cycle


def left_out(grams: np.ndarray, fold: np.ndarray | None, solve: Solve = least_squares) -> LeftOut:
    """Leave out each cycle for the errors; for the costs each cycle, or where there are several
    logs, whose number is in `fold`, each log.
    """
    whole = grams.sum(axis=0)
    found = np.array([solve(whole - one) for one in grams])
    used = found
    if fold is not None:
        by_log = {log: solve(whole - grams[fold == log].sum(axis=0)) for log in np.unique(fold)}
        used = np.array([by_log[log] for log in fold])
    return LeftOut(np.array(list(map(cost_of, grams, used))), found)


def cost_of(gram: np.ndarray, coefficient: np.ndarray) -> float:
    """Sum of squares of what these coefficients leave."""
    with_torque = np.append(-coefficient, 1.0)
    return float(with_torque @ gram @ with_torque)


def jackknife(values: np.ndarray) -> float:
    """Standard error of a number from its values without one cycle each."""
    count = len(values)
    return float(np.sqrt((count - 1) / count * np.sum((values - values.mean()) ** 2)))


def excess(cost: np.ndarray, best: np.ndarray) -> tuple[float, float]:
    """By how much a cost is above the best one, and the standard error of that, from cycles."""
    apart = cost - best
    return float(apart.sum()), float(apart.std(ddof=1) * np.sqrt(len(apart)))
