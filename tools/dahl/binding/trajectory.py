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

FORGOTTEN = 45.0  # presliding lengths: exp(-45) is less than the last bit of a state in Q62
PART_LEAST = 1 << 18  # ticks of a part for which a thread is worth its start
BLOCK = 512  # ticks that the C computes together: a part begins at a multiple of them
LOOK = 8 * BLOCK  # ticks of the first sum of travel; each next sum has twice as many
LOOK_MOST = 128 * BLOCK  # at most, so that they stay in a cache


@dataclass(frozen=True)
class Trajectory:
    """move(first, last, w) computes these ticks from the state w in Q62 and returns the state after
    them; travel(first, last) is theirs in presliding lengths.
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
    left: float = 0.0  # of the state at the start, at the end


def run(whole: Trajectory, w: int, threads: int) -> None:
    """Compute all ticks from the state w in Q62, on as many threads as are worth while."""
    count = max(1, min(threads, whole.ticks // PART_LEAST))
    edges = [k * whole.ticks // count // BLOCK * BLOCK for k in range(count)]
    edges.append(whole.ticks)
    if count == 1:
        whole.move(0, whole.ticks, w)
        return
    with ThreadPoolExecutor(count) as pool:
        head = pool.submit(whole.move, 0, edges[1], w)
        spans = zip(edges[1:-1], edges[2:], strict=True)
        parts = list(pool.map(lambda span: _from_rest(whole, *span), spans))
        starts = _starts(parts, head.result())
        list(pool.map(lambda part, start: _put_right(whole, part, start), parts, starts))


def _from_rest(whole: Trajectory, first: int, last: int) -> _Part:
    end = whole.move(first, last, 0)
    travel, settled, look = 0.0, first, LOOK
    while settled < last and travel < FORGOTTEN:
        further = min(settled + look, last)
        travel += whole.travel(settled, further)
        settled, look = further, min(2 * look, LOOK_MOST)
    return _Part(first, last, end, settled, math.exp(-travel) if travel < FORGOTTEN else 0.0)


def _starts(parts: list[_Part], w: int) -> list[int]:
    """The state at the start of each part, in Q62, w that of the first."""
    starts = []
    for part in parts:
        starts.append(w)
        w = max(-(2**62), min(2**62, part.end + round(part.left * w)))
    return starts


def _put_right(whole: Trajectory, part: _Part, start: int) -> None:
    whole.move(part.first, part.settled, start)
