# SPDX-License-Identifier: MIT
"""The 4-bit counters of frames: which frame is new, and how many are missing before it."""

from __future__ import annotations

from dahl.can import codec

LATE = 8  # counter steps ahead; a frame of more is late (DAHL_NODE_GAP_MAX_STEP)
TOGETHER = 0.005  # s between two frames; after more a counter that went back is a gap


def step(before: int, now: int, seconds: float) -> int:
    """Frames from one with the counter `before` to one with `now`, itself included, `seconds`
    later: 1 where none is missing, 0 for one that is repeated or late.
    """
    ahead = (now - before) % codec.COUNTERS
    if seconds < TOGETHER and (ahead == 0 or ahead > LATE):
        return 0
    return ahead or codec.COUNTERS
