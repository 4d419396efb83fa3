# SPDX-License-Identifier: MIT
"""Warn if all strokes are alike, since some effects then look like friction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dahl.identify.models import turning_points
from dahl.io.log import Log

MIN_STROKES = 4
MAX_SPEED_RATIO = 1.3  # fastest to slowest tenth of the strokes; below it there is one speed
MAX_SPREAD_LENGTHS = 0.5  # presliding lengths between the turning points of one side


def warning(logs: Sequence[Log], a: float, min_turn: float) -> str:
    """Return one line about effects that this motion hides; "" if the strokes differ.

    If all strokes have one speed, a delayed torque rounds each reversal as a softer bearing does.
    If all have the same turning points, an encoder error there does the same.
    """
    speeds: list[float] = []
    spreads: list[float] = []
    for log in logs:
        turns = turning_points(log.theta, min_turn)
        if len(turns) < MIN_STROKES:
            continue
        clock = np.arange(log.rows) if log.time is None else log.time
        seconds = np.maximum(np.diff(clock[turns]), 1e-12)
        speeds += (np.abs(np.diff(log.theta[turns])) / seconds).tolist()
        sides = (log.theta[turns[0::2]], log.theta[turns[1::2]])
        spreads += [float(np.ptp(np.percentile(side, (10, 90)))) for side in sides]
    alike, effects = [], []
    if speeds and np.percentile(speeds, 90) < MAX_SPEED_RATIO * np.percentile(speeds, 10):
        alike.append("one speed")
        effects.append("a late torque")
    if spreads and a * max(spreads) < MAX_SPREAD_LENGTHS:
        alike.append("the same turning points")
        effects.append("an encoder error there")
    if not alike:
        return ""
    return f"all strokes have {' and '.join(alike)}: {' or '.join(effects)} could change sigma0"
