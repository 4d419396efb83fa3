# SPDX-License-Identifier: MIT
"""What a motion cannot tell, because it is the same in each stroke: a part of the torque that comes
late rounds each reversal as a softer bearing does, where all strokes have one speed; and so does an
encoder's error that repeats within a turn, where all of them turn at the same angles.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dahl.identify import path
from dahl.identify.log import Log

FEW = 4  # strokes, below which nothing is said
ONE_SPEED = 1.3  # the fastest tenth of the strokes over the slowest one
SAME_ANGLE = 0.5  # presliding lengths between the turning points on one side


def note(logs: Sequence[Log], a: float, least_turn: float) -> str:
    """What would go unseen, in words; "" where the strokes differ."""
    speeds, apart = [], []
    for log in logs:
        turns = path.reversals(log.theta, least_turn)
        if len(turns) < FEW:
            continue
        speeds += _speeds(log, turns)
        apart += [float(np.ptp(np.percentile(log.theta[turns[i::2]], (10, 90)))) for i in (0, 1)]
    unseen = []
    if speeds and np.percentile(speeds, 90) < ONE_SPEED * np.percentile(speeds, 10):
        unseen.append("one speed: a part of the torque that comes late")
    if apart and a * max(apart) < SAME_ANGLE:
        unseen.append("the same turning points: an error of the encoder there")
    if not unseen:
        return ""
    return f"all strokes have {', and '.join(unseen)}, would pass for another sigma0"


def _speeds(log: Log, turns: np.ndarray) -> list[float]:
    """Of each whole stroke, rad/s (m/s); rad a row (m) where there is no time."""
    clock = np.arange(log.rows) if log.time is None else log.time
    took = np.maximum(np.diff(clock[turns]), 1e-12)
    return list(map(float, np.abs(np.diff(log.theta[turns])) / took))
