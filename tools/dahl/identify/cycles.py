# SPDX-License-Identifier: MIT
"""Scores and errors by what repeats: whole cycles between reversals, or whole logs, are left out of
a fit and then predicted. Neighbouring rows share their errors and each part of a loop is needed to
fit it, so that leaving out rows or parts of a cycle says little.

All rows, or at most LOOKED_AT of them, are averaged into a few thousand bins. The bins of each
cycle give a Gram matrix of the columns of a linear model, as in sweep.py.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
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

    def __init__(
        self,
        logs: Sequence[Log],
        a: float,
        least_turn: float,
        reach: int,
        rows: int = LOOKED_AT,
        strokes: bool = False,
    ) -> None:
        """Cut where the angle turns by more than `least_turn` rad (m); `reach` is by how many rows
        a torque may be moved, so that as many at the ends of a log do not count. Use `rows` of all
        logs together; with `strokes` cut at each reversal even if there are many cycles.
        """
        most = max(rows // len(logs), 1)
        logs = [log.head(most) for log in logs]
        usual = max(-(-sum(log.rows for log in logs) // BINS), 1)
        self.rows = rows_of_a_bin(usual, logs)
        self.shares = [self._shares(log) for log in logs]
        parts = [
            self._part(log, share, a, units_of(log, least_turn, strokes), reach)
            for log, share in zip(logs, self.shares, strict=True)
        ]
        self.moves = [part.moves for part in parts]
        self.ends = np.cumsum([0, *(len(part.torque) for part in parts)])
        self.terms = np.concatenate([part.terms for part in parts])
        self.torque = np.concatenate([part.torque for part in parts])
        self.root = np.sqrt(np.concatenate([part.weight for part in parts]))
        self.spans = self._spans(parts)
        turns = [path.reversals(log.theta, least_turn) for log in logs]
        self.cycles = min(sum(len(some) // 2 for some in turns), len(self.spans))
        names = [log.name for log in logs]
        owner = np.searchsorted(self.ends, [span.start for span in self.spans], side="right") - 1
        several = len(dict.fromkeys(names)) > 1
        self.fold = np.array([names.index(names[i]) for i in owner]) if several else None

    def _shares(self, log: Log) -> np.ndarray:
        """How much each row has of its bin, by its weight: (bins, rows). A bin that weighs nothing
        is seen where the others are seen on the mean, so that a shift finds it there.
        """
        bins = log.rows // self.rows
        if log.weight is None or self.rows == 1:
            return np.full((bins, self.rows), 1 / self.rows)
        weight = self._by_bin(log.weight)
        sums = weight.sum(axis=1, keepdims=True)
        usual = weight.sum(axis=0) / weight.sum()
        shares: np.ndarray = np.divide(weight, sums, where=sums > 0, out=np.tile(usual, (bins, 1)))
        return shares

    def _by_bin(self, values: np.ndarray) -> np.ndarray:
        """Rows by bin, (bins, rows, ...); what is left at the end goes."""
        bins = len(values) // self.rows
        return values[: bins * self.rows].reshape(bins, self.rows, *values.shape[1:])

    def _part(self, log: Log, shares: np.ndarray, a: float, units: np.ndarray, reach: int) -> Part:
        moves = log.moves_of(slice(0, log.rows))
        columns = self._mean(columns_of(log), shares)
        counted = self._counted(moves, a, min(reach, log.rows // 20))
        if log.weight is not None:
            counted *= self._by_bin(log.weight).mean(axis=1)
        unit = units[:: self.rows][: len(columns)]
        return Part(moves, columns[:, :-1], columns[:, -1], counted, unit)

    def _counted(self, moves: np.ndarray, a: float, reach: int) -> np.ndarray:
        """Which bins count: (bins,) 0 or 1."""
        travel = np.cumsum(np.abs(moves))
        counted = travel > min(FORGOTTEN / a, FORGOTTEN_PART * travel[-1])
        counted[:reach] = False
        counted[len(counted) - reach :] = False
        bins: np.ndarray = self._by_bin(counted).all(axis=1).astype(float)
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
                if part.weight[i:j].sum() > 0.1 * part.weight.mean() * (j - i):
                    spans.append(slice(int(start + i), int(start + j)))
        return spans

    def _mean(self, values: np.ndarray, shares: np.ndarray) -> np.ndarray:
        averaged: np.ndarray = np.einsum("br,br...->b...", shares, self._by_bin(values))
        return averaged

    def means(self, logs: Iterable[np.ndarray]) -> np.ndarray:
        """Means over the rows of each bin, by their weights, for values of each log by row."""
        pairs = zip(logs, self.shares, strict=True)
        return np.concatenate([self._mean(values, shares) for values, shares in pairs])

    def drawn(self, model: Model, a: float) -> np.ndarray:
        """F/Fc of a model from rest, (bins,)."""
        return self.means(model(moves, a) for moves in self.moves)

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


def rows_of_a_bin(usual: int, logs: Sequence[Log]) -> int:
    """The usual number, or where torques were read every so many rows a number near it that divides
    those: all readings lie at one place of their bins, and a shift finds it in the bins between.
    """
    read = [np.flatnonzero(log.weight) for log in logs if log.weight is not None]
    every = int(np.gcd.reduce(np.concatenate([np.ones(0, int), *map(np.diff, read)])))
    near = [n for n in range(1, 2 * usual + 1) if every % n == 0 and usual < 2 * n]
    return min(near, key=lambda n: abs(np.log(n / usual)), default=usual)


def _later(columns: np.ndarray, by: int) -> np.ndarray:
    """Whole bins later; the ends are drawn out."""
    index = np.clip(np.arange(len(columns)) - by, 0, len(columns) - 1)
    return columns[index]


def units_of(log: Log, least_turn: float, strokes: bool = False) -> np.ndarray:
    """Return the number of its cycle for each row: between every second reversal, or between all
    of them if these are few or with `strokes`. If there are hardly any (one log of several that are
    short), the rows before the first and behind the last one count too.
    """
    turns = path.reversals(log.theta, least_turn)
    if 2 * len(turns) <= LEAST:
        return np.searchsorted(turns, np.arange(log.rows), side="right")
    starts = turns[::2] if len(turns) > 2 * LEAST and not strokes else turns
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
