# SPDX-License-Identifier: MIT
"""An encoder that is read in step with the motion: each cycle has the counts of the one before, so
their rounding, which is an error of the angle, is the same each time. It does not go out in the
mean over the cycles, and cycles that are alike tell nothing of it.

What it does to the fit is tried out: logs are made of the found parameters and a few cycles, drawn
by as few harmonics as the counts allow, each moved and stretched by another part of a count, so
that they round elsewhere. How far they come back from where they were widens the intervals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import t as student

from dahl.identify import angle_noise, clean, path, trial
from dahl.identify.finding import Finding
from dahl.identify.fit import Estimate
from dahl.identify.log import Log
from dahl.identify.result import Result
from dahl.identify.trial import Refit

ALIKE = 0.5  # of the rows with the count of a cycle before
FEW = 4  # turning points on a side, below which no cycle is compared
CYCLES = 8  # that a trial takes
LONG = 3000  # rows: in a longer cycle the rounding goes out by itself
TRIALS = 8
PARTS = ((np.sqrt(5) - 1) / 2, np.sqrt(2) - 1)  # of a count, times a whole number
ROUNDED = 0.32  # counts, root of the mean square: an error of rounding has 0.29


def period_of(log: Log, least_turn: float) -> int:
    """Rows of a cycle, where the counts are those of a cycle before; else 0."""
    turns = path.reversals(log.theta, least_turn)[::2]
    if not log.resolution or len(turns) < FEW:
        return 0
    usual = round(float(np.median(np.diff(turns))))
    best = max((usual - 1, usual, usual + 1), key=lambda rows: _alike(log, rows))
    return best if best <= LONG and _alike(log, best) >= ALIKE else 0


def _alike(log: Log, rows: int) -> float:
    """Part of the rows that have the count of so many rows before."""
    if not 0 < rows < log.rows:
        return 0.0
    apart = np.abs(log.theta[rows:] - log.theta[:-rows])
    return float(np.mean(apart < log.resolution / 2))


def finding(result: Result, refit: Refit, least_turn: float) -> list[Finding]:
    """How far the parameters may be off by a rounding that is the same in each cycle."""
    periods = [period_of(log, least_turn) for log in result.raw]
    if not any(periods):
        return []
    pairs = list(zip(result.raw, periods, strict=True))
    short = [log.head(CYCLES * (rows or LONG)) for log, rows in pairs]
    paths = [_path_of(log, rows) for log, rows in zip(short, periods, strict=True)]
    if not all(map(np.ptp, paths)):  # no more motion than rounding makes
        return []
    found = [
        refit([_made(*pair, result.estimate, k) for pair in zip(short, paths, strict=True)])
        for k in range(TRIALS)
    ]
    return _widened(result.estimate, found) if trial.is_in(result.estimate, found) else []


def _path_of(log: Log, rows: int) -> np.ndarray:
    """The motion behind the counts: of cycles, the mean one by the fewest harmonics that leave no
    more of it than rounding does.
    """
    if not rows:
        return angle_noise.smoothed(log.theta)
    if clean.rests(log):  # which no few harmonics draw
        return clean.between_counts(log)
    whole = log.rows // rows
    waves = np.fft.rfft(log.theta[: whole * rows].reshape(whole, rows).mean(axis=0))
    beyond = np.sqrt(2 * np.cumsum(np.abs(waves[::-1]) ** 2)[::-1]) / rows  # from each one on
    waves[beyond < ROUNDED * log.resolution] = 0
    return np.resize(np.fft.irfft(waves, rows), log.rows)


def _made(log: Log, true: np.ndarray, estimate: Estimate, k: int) -> Log:
    """A log of these parameters on this path, whose counts round elsewhere, without noise."""
    moved, stretched = ((k // 2 + 1) * part % 1 * log.resolution for part in PARTS)
    moved *= (-1) ** k  # to either side, so that a mirrored log has the same interval
    middle, half = (true.max() + true.min()) / 2, np.ptp(true) / 2
    true = true + moved + (true - middle) / half * stretched
    return replace(trial.made(log, true, estimate), theta=trial.read_by(log, true))


def _widened(estimate: Estimate, found: Sequence[Estimate]) -> list[Finding]:
    """By a standard error about where the parameters were, beside the interval that they have."""
    off, ends = {}, {}
    for name in trial.NAMES:
        value = getattr(estimate, name)
        apart = np.array([getattr(one, name) for one in found]) / value - 1
        off[name] = float(student.ppf(0.975, len(apart)) * np.sqrt(np.mean(apart**2)))
        wide = float(np.hypot(off[name], estimate.ci95[name].relative(value)))
        ends[name] = (value * max(1 - wide, 0.0), value * (1 + wide))
    text = "the encoder is read in step with the motion, the same counts in each cycle"
    return trial.widening(text, estimate, off, ends)
