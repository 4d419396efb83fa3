# SPDX-License-Identifier: MIT
"""One long trajectory of a Dahl element on several cores.

The torque of a tick depends on the state before it, but a bristle forgets: travel of u presliding
lengths leaves exp(-u) of the difference of two states. So each part of a log runs from rest. Its
map w -> exp(-u) w + (its end from rest) gives the start of the next part. Then the first ticks of
a part, until its start is forgotten, run again from that state.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

FORGETTING_LENGTHS = 45.0  # exp(-45) is less than the last bit of a state in Q62
MIN_PART_TICKS = 1 << 18  # for which a thread is worth its start
BLOCK_TICKS = 512  # that the C computes together: a part begins at a multiple of them
FIRST_SUM_TICKS = 8 * BLOCK_TICKS  # of the first sum of travel; each next sum has twice as many
MAX_SUM_TICKS = 128 * BLOCK_TICKS  # so that they stay in a cache


@dataclass(frozen=True)
class Trajectory:
    """move(first, last, w) computes the ticks first .. last - 1 from the state w in Q62 and returns
    the state after them. travel(first, last) returns their travel in presliding lengths.
    """

    ticks: int
    move: Callable[[int, int, int], int]
    travel: Callable[[int, int], float]


@dataclass(frozen=True)
class _Part:
    first: int
    last: int
    end: int = 0  # state in Q62, from rest
    settled: int = 0  # the tick from which on the state at the start is forgotten, or `last`
    left: float = 0.0  # fraction of the state at the start that remains at the end


def run(whole: Trajectory, w: int, threads: int) -> None:
    """Compute all ticks from the state w in Q62, on as many threads as pay."""
    count = max(1, min(threads, whole.ticks // MIN_PART_TICKS))
    edges = [k * whole.ticks // count // BLOCK_TICKS * BLOCK_TICKS for k in range(count)]
    edges.append(whole.ticks)
    if count == 1:
        whole.move(0, whole.ticks, w)
        return
    with ThreadPoolExecutor(count) as pool:
        head = pool.submit(whole.move, 0, edges[1], w)
        spans = zip(edges[1:-1], edges[2:], strict=True)
        parts = list(pool.map(lambda span: _from_rest(whole, *span), spans))
        starts = _starts(parts, head.result())
        list(pool.map(lambda part, w: whole.move(part.first, part.settled, w), parts, starts))


def _from_rest(whole: Trajectory, first: int, last: int) -> _Part:
    """Compute a part from rest, and find the tick at which its start is forgotten."""
    end = whole.move(first, last, 0)
    travel, settled, ticks = 0.0, first, FIRST_SUM_TICKS
    while settled < last and travel < FORGETTING_LENGTHS:
        further = min(settled + ticks, last)
        travel += whole.travel(settled, further)
        settled, ticks = further, min(2 * ticks, MAX_SUM_TICKS)
    left = math.exp(-travel) if travel < FORGETTING_LENGTHS else 0.0
    return _Part(first, last, end, settled, left)


def _starts(parts: list[_Part], w: int) -> list[int]:
    """Return the state at the start of each part, in Q62; w is that of the first."""
    starts = []
    for part in parts:
        starts.append(w)
        w = max(-(2**62), min(2**62, part.end + round(part.left * w)))
    return starts
