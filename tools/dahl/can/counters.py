# SPDX-License-Identifier: MIT
"""Decide from the 4-bit counters which frame is new, and how many frames are missing before it."""

from __future__ import annotations

from dahl.can import codec

MAX_STEPS_AHEAD = 8  # of a counter; a frame further ahead is late (DAHL_NODE_GAP_MAX_STEP)
MAX_LATE_S = 0.005  # of a late frame; after more time a counter that went back is a gap


def step(before: int, now: int, seconds: float) -> int:
    """Return how many frames a counter advanced from `before` to `now` within `seconds`: 1 if no
    frame is missing, 0 if this frame is repeated or late.
    """
    ahead = (now - before) % codec.COUNTERS
    if seconds < MAX_LATE_S and (ahead == 0 or ahead > MAX_STEPS_AHEAD):
        return 0
    return ahead or codec.COUNTERS
