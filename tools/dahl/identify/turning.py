# SPDX-License-Identifier: MIT
"""Turning points between the rows: what the motion went beyond the last row and came back is travel
that no row tells, and a fit answers with a stiffer bearing.

What it does to the fit is tried out: a log is made of the found parameters on a spline through the
angles, which turns between the rows, and is cleaned and fitted in the same way. The interval is
drawn out to what the parameters may then be.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from dahl.identify import angle_noise, path, trial
from dahl.identify.finding import Finding
from dahl.identify.fit import Estimate
from dahl.identify.log import Log
from dahl.identify.result import Result
from dahl.identify.trial import Refit

PARTS = 8  # of a row
SHOWS = 0.02  # presliding lengths beyond the last row and back, at the usual turning point
BEYOND = 1.5  # of what the trial says: a spline is no measurement


def untold(log: Log, least_turn: float) -> float:
    """Travel beyond the last row and back at the usual turning point, rad (m)."""
    turns = path.reversals(log.theta, least_turn)
    turns = turns[(turns > 0) & (turns < log.rows - 1)]
    if len(turns) == 0:
        return 0.0
    before, at, after = (log.theta[turns + k] for k in (-1, 0, 1))
    bend = np.abs(before - 2 * at + after)
    way = (after - before) ** 2 / np.where(bend > 0, 8 * bend, np.inf)  # a parabola's vertex
    return float(2 * np.median(way))


def finding(result: Result, refit: Refit, least_turn: float) -> list[Finding]:
    """How far the parameters may be off by the travel that no row tells."""
    estimate = result.estimate
    if estimate.a * max(untold(log, least_turn) for log in result.logs) < SHOWS:
        return []
    again = refit([_made(log.head(angle_noise.LOOKED_AT), estimate) for log in result.logs])
    if not trial.is_in(estimate, [again]):
        return []
    off, ends = {}, {}
    for name in trial.NAMES:
        value, interval = getattr(estimate, name), estimate.ci95[name]
        off[name] = getattr(again, name) / value - 1
        true, half = value / max(1 + BEYOND * off[name], 0.1), (interval.high - interval.low) / 2
        ends[name] = (min(true - half, value), max(true + half, value))
    text = "the motion turns between the rows, which are too few there"
    return trial.widening(text, estimate, off, ends)


def _made(log: Log, estimate: Estimate) -> Log:
    """A log of these parameters that turns between its rows."""
    spline = CubicSpline(np.arange(log.rows), log.theta)
    return trial.made(log, spline(np.arange((log.rows - 1) * PARTS + 1) / PARTS), estimate, PARTS)
