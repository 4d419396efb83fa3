# SPDX-License-Identifier: MIT
"""Friction that follows a measured load: how much of it, whether that explains the logs better, and
the torque as it would have been at one and the same load.

With share = 1 + slope (load - reference), sigma0 and Fc are both `share` times those at the
reference, by the rule of dahl_loaded_step_counts(): F falls with the load and is kept where it
grows. The reference is the mean of the load, weighed by how much of the friction shows, so that
what is not known of the slope hardly moves Fc.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dahl.identify import choices, path
from dahl.identify.choices import Choice, Trial
from dahl.identify.cycles import Cut, jackknife, least_squares, left_out
from dahl.identify.fit import Estimate, Interval
from dahl.identify.log import Log
from dahl.identify.terms import places_of

SURE = 3.0  # standard errors of the slope
LEAST_CYCLES = 6  # or strokes, by which the load is judged
LEAST_SHARE = 1e-3  # of the friction at the reference, that is left at any load of the logs
APART = 0.02  # of log a, and of the friction over the range of the load: for derivatives
ROUNDS, LONGEST, STILL = 8, 0.4, 1e-4  # of Gauss and Newton; of a step; of the last one


@dataclass(frozen=True)
class Follows:
    """By how much friction follows the load."""

    reference: float  # load at which sigma0 and Fc are told
    a: float  # 1/rad (1/m), and
    Fc: float  # N m (N) there, as fitted with the slope
    slope: float  # of share, for a unit of load
    error: float  # standard error of the slope
    ends: tuple[float, float]  # least and largest load of the logs
    r2: float  # of cycles left out
    r2_without: float  # the same, as if there were no load
    wider: dict[str, float] = field(default_factory=dict)  # intervals, as the slope is not known

    def share(self, load: np.ndarray) -> np.ndarray:
        """Friction at each load over that at the reference."""
        return share(load, self.slope, self.reference)

    @property
    def shares(self) -> tuple[float, float]:
        """Least and largest share in the logs."""
        at = self.share(np.array(self.ends))
        return float(at.min()), float(at.max())

    @property
    def words(self) -> str:
        """For people."""
        (low, high), (first, last) = self.ends, self.share(np.array(self.ends)).tolist()
        return (
            f"sigma0 and Fc follow the load: {first:.3g} times as large at {low:.4g}, {last:.3g}"
            f" times at {high:.4g}, told at {self.reference:.4g}; R2 of cycles left out"
            f" {self.r2:.4f}, without the load {self.r2_without:.4f}"
        )


def share(load: np.ndarray, slope: float, reference: float) -> np.ndarray:
    """Friction at each load over that at the reference, never quite 0."""
    shares: np.ndarray = np.maximum(1 + slope * (load - reference), LEAST_SHARE)
    return shares


class Loads:
    """Logs in bins with the columns of a friction that follows their loads."""

    def __init__(self, logs: Sequence[Log], estimate: Estimate, least_turn: float) -> None:
        self.cut, self.terms = Cut(logs, estimate.a, least_turn, 0), tuple(estimate.terms)
        loads = [log.load for log in logs if log.load is not None]
        self.loads = [one[: len(m)] for one, m in zip(loads, self.cut.moves, strict=True)]
        self.ends = min(map(np.min, self.loads)), max(map(np.max, self.loads))
        self.range = float(self.ends[1] - self.ends[0])
        w = [path.dahl(moves, estimate.a) for moves in self.cut.moves]
        shown = np.concatenate(w).astype(float) ** 2
        self.reference = float(shown @ np.concatenate(self.loads) / max(shown.sum(), 1e-300))

    def drawn(self, a: float, slope: float) -> np.ndarray:
        """F/Fc at the reference: (bins,)."""
        shares = [share(load, slope, self.reference) for load in self.loads]
        pairs = zip(self.cut.moves, shares, strict=True)
        return self.cut.means(path.loaded(moves, a, at) for moves, at in pairs)

    def grams(self, a: float, slope: float) -> np.ndarray:
        """Of F/Fc, its change with log a and with the slope over the range, the terms."""
        near = APART / self.range
        by_a = self.drawn(a * np.exp(APART), slope) - self.drawn(a * np.exp(-APART), slope)
        by_slope = self.drawn(a, slope + near) - self.drawn(a, slope - near)
        beside = self.cut.terms[:, places_of(self.terms)]
        changes = np.column_stack((by_a, by_slope)) / (2 * APART)
        return self.cut.grams(np.column_stack((self.drawn(a, slope), changes, beside)))

    def bounded(self, slope: float) -> float:
        """A slope that leaves some friction at both ends of the load."""
        low, high = self.ends
        most = (1 - LEAST_SHARE) / max(self.reference - low, 1e-3 * self.range)
        least = -(1 - LEAST_SHARE) / max(high - self.reference, 1e-3 * self.range)
        return float(np.clip(slope, least, most))


def found(logs: Sequence[Log], estimate: Estimate, least_turn: float) -> Follows | None:
    """How the friction of cleaned logs follows their loads; nothing where there are too few cycles
    to tell, where it does not pay or may be chance. `least_turn` in rad (m) tells the cycles.
    """
    loads = Loads(logs, estimate, least_turn)
    if len(loads.cut.spans) < LEAST_CYCLES or not loads.range > 0 or not estimate.Fc > 0:
        return None
    plain = choices.fitted(loads.cut, estimate.a, Choice(loads.terms))
    a, slope = _best(loads, estimate.a)
    trial, error, wider = _judged(loads, a, slope)
    surely = abs(slope) > SURE * error
    if plain is None or not surely or trial.cost.sum() > (1 - choices.PAYS) * plain.cost.sum():
        return None
    r2, without = (1 - float(one.cost.sum()) / loads.cut.spread for one in (trial, plain))
    Fc = trial.value["Fc"]  # noqa: N806
    return Follows(loads.reference, a, Fc, slope, error, loads.ends, r2, without, wider)


def _best(loads: Loads, a: float) -> tuple[float, float]:
    """The a and the slope of least cost, by Gauss and Newton from no load on."""
    slope = 0.0
    for _ in range(ROUNDS):
        Fc, by_a, by_slope = least_squares(loads.grams(a, slope).sum(axis=0))[:3]  # noqa: N806
        if not Fc > 0:
            break
        step, turn = np.clip((by_a / Fc, by_slope / Fc), -LONGEST, LONGEST)
        a *= float(np.exp(step))
        slope = loads.bounded(slope + float(turn) / loads.range)
        if max(abs(step), abs(turn)) < STILL:
            break
    return a, slope


def _judged(loads: Loads, a: float, slope: float) -> tuple[Trial, float, dict[str, float]]:
    """The fit by cycles left out, the standard error of the slope, and by how much the intervals
    of sigma0 and Fc are wider than with a slope that is known.
    """
    grams = loads.grams(a, slope)
    known = [0, 1, *range(3, grams.shape[1])]
    free, fixed = (left_out(some, loads.cut.fold) for some in (grams, grams[:, known][:, :, known]))
    Fc = float(least_squares(grams.sum(axis=0))[0])  # noqa: N806
    errors = [
        {"sigma0": jackknife(one[:, 0] + one[:, 1]), "Fc": jackknife(one[:, 0])}
        for one in (free.found, fixed.found)
    ]
    wider = {name: max(e / max(errors[1][name], 1e-300), 1.0) for name, e in errors[0].items()}
    value = {"sigma0": a * Fc, "Fc": Fc}
    trial = Trial(Choice(loads.terms), a, value, {}, free.cost)
    return trial, jackknife(free.found[:, 2]) / abs(Fc) / loads.range, wider


def more(log: Log, follows: Follows | None) -> np.ndarray:
    """The torque beyond that at the reference: (rows,) N m (N)."""
    if follows is None or log.load is None:
        return np.zeros(log.rows)
    moves = log.moves_of(slice(0, log.rows))
    at = path.loaded(moves, follows.a, follows.share(log.load))
    beyond: np.ndarray = follows.Fc * (at - path.dahl(moves, follows.a))
    return beyond


def widened(estimate: Estimate, follows: Follows | None) -> Estimate:
    """With the intervals that hold what is not known of the slope."""
    ci95 = dict(estimate.ci95)
    for name, factor in follows.wider.items() if follows else ():
        value, one = getattr(estimate, name), ci95[name]
        if value > 0:
            low, high = (value * (end / value) ** factor for end in (one.low, one.high))
            ci95[name] = Interval(float(low), float(high))
    return replace(estimate, ci95=ci95)
