# SPDX-License-Identifier: MIT
"""A delay that may be lost motion: play between encoder and bearing, or in the encoder's coupling,
makes the torque late or early by a travel after each reversal, which in a motion of one stroke
looks like a delay.

Where the fit took a delay, the angle is led through plays of many widths, both ways, and Dahl's
torque fitted anew without any delay. Where one of them explains the log as well as the delay did,
parameters on which they disagree are not claimed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from dahl.identify import clean, lowpass
from dahl.identify.finding import Finding
from dahl.identify.log import Log
from dahl.identify.lowpass import Fit, Measured
from dahl.identify.result import Result

LATE = 0.3  # rows
WIDTHS = np.geomspace(0.04, 2.56, 7)  # presliding lengths
CLOSER, STAGES = 2.0, 3  # between the best width and its neighbours
NODES = np.geomspace(0.35, 2.8, 16)  # of a

Way = Callable[[Log, Log, float], np.ndarray]  # of a log, and as it was read


def followed(theta: np.ndarray, width: float) -> np.ndarray:
    """The angle behind a play: (rows,)."""
    half, behind, drawn = width / 2, float(theta[0]), []
    for one in theta.tolist():
        behind = min(max(behind, one - half), one + half)
        drawn.append(behind)
    return np.array(drawn)


def led(theta: np.ndarray, read: np.ndarray, width: float) -> np.ndarray:
    """The angle before a play that gives this angle behind it: half the width ahead while it moves.
    Where what was read rests between two directions, the shaft turned at the beginning, and went
    faster and faster from one side of the play to the other.
    """
    moves = np.diff(read, prepend=read[0])
    moving, rows = np.flatnonzero(moves), np.arange(len(read))
    side = np.sign(moves[moving])
    last = np.clip(np.searchsorted(moving, rows, side="right") - 1, 0, len(moving) - 2)
    begin, end = moving[last], moving[last + 1]
    part = np.clip((rows - begin) / (end - begin), 0.0, 1.0) ** 2
    ahead: np.ndarray = theta + width / 2 * (side[last] + (side[last + 1] - side[last]) * part)
    return ahead


WAYS: dict[str, Way] = {
    "before": lambda log, _, width: followed(log.theta, width),
    "in": lambda log, raw, width: led(log.theta, raw.theta, width),
}


def finding(result: Result) -> list[Finding]:
    """Whether a play explains the log as well as the delay, and which parameters that changes."""
    if abs(result.delay) < LATE:
        return []
    before = _squares(result)
    way = "before" if result.delay > 0 else "in"
    best, width = _best(result, WAYS[way])
    if lowpass.is_better(best.squares, before):
        return []
    doubts = tuple(name for name in ("sigma0", "Fc") if _disagrees(result, best, name))
    if not doubts:
        return []
    log = result.logs[0]
    words = f"not a delay but a play of {width:.3g} {log.angle_unit} {way} the encoder explains it"
    told = f"{words} as well: sigma0 is then {best.sigma0:.4g} {log.slope_unit}"
    reach = {name: (getattr(best, name), getattr(best, name)) for name in doubts}
    return [Finding(told, doubts, reach)]


def _squares(result: Result) -> np.ndarray:
    """Of the fit's residuals, on the rows looked at. What is drawn is shifted, not the torque: one
    taken between two rows has less noise than those.
    """
    parts = []
    for log, raw, drawn in zip(result.logs, result.eased, result.predicted, strict=True):
        late = clean.shifted(drawn, -result.delay)
        weight = np.ones(log.rows) if log.weight is None else log.weight
        left: np.ndarray = weight * (result.sign * raw.torque - late) ** 2
        parts.append(left[: lowpass.LOOKED_AT])
    return np.concatenate(parts)


def _disagrees(result: Result, other: Fit, name: str) -> bool:
    ends = result.estimate.ci95[name]
    return not ends.low <= getattr(other, name) <= ends.high


def _best(result: Result, way: Way) -> tuple[Fit, float]:
    """The fit with the best width of a play, and the width in rad (m)."""
    tried: dict[float, Fit] = {}
    length = 1 / result.estimate.a

    def look(widths: Sequence[float]) -> float:
        for width in widths:
            if width not in tried:
                tried[width] = _fitted(result, way, width)
        return min(tried, key=lambda one: tried[one].cost)

    here, step = look((length * WIDTHS).tolist()), float(WIDTHS[1] / WIDTHS[0])
    for _ in range(STAGES):
        step = step ** (1 / CLOSER)
        here = look([here / step, here, here * step])
    return tried[here], here


def _fitted(result: Result, way: Way, width: float) -> Fit:
    """The best fit with a play of this width and no delay."""
    logs = []
    for log, raw in zip(result.logs, result.eased, strict=True):
        first = log.head(lowpass.LOOKED_AT)
        theta = way(first, raw.head(lowpass.LOOKED_AT), width)
        logs.append(replace(first, theta=theta, free_moves=None))
    measured = Measured(replace(result, logs=logs))
    return measured.fits([("", lambda x: x)], result.estimate.a * NODES)[0]
