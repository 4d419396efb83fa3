# SPDX-License-Identifier: MIT
"""Count the frames that are missing between two frames, by their sequence counters.

A counter has 4 bits, so it shows a gap modulo 16: the least number of missing frames. The most
follows from the time stamps and the mean of the last periods. A gap of 16 n frames looks like a
pause of the sender, and is not counted.
"""

from __future__ import annotations

import functools
import math
from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from dahl.can import codec

MAX_STEPS_AHEAD = 8  # of a counter; a frame further ahead is late (DAHL_NODE_GAP_MAX_STEP)
MAX_LATE_S = 0.005  # of a late frame; after more time a counter that went back is a gap
PERIODS = 64  # last ones, of which the mean is used


class Gap(NamedTuple):
    """A number of missing frames, of which only the bounds are known."""

    least: int = 0
    most: int = 0

    def plus(self, other: Gap) -> Gap:
        return Gap(self.least + other.least, self.most + other.most)

    def at_least(self, number: int) -> Gap:
        return Gap(max(self.least, number), max(self.most, number))

    def __str__(self) -> str:
        return str(self.least) if self.least == self.most else f"{self.least} to {self.most}"


NO_GAP = Gap()


def total(gaps: Iterable[Gap]) -> Gap:
    return functools.reduce(Gap.plus, gaps, NO_GAP)


class Sequence:
    """The frames of one id."""

    def __init__(self) -> None:
        self.counter = 0  # of the newest
        self._time: float | None = None
        self._periods: deque[float] = deque(maxlen=PERIODS)  # s, of frames without a gap

    def restart(self) -> None:
        """Forget the counter of a sender that has restarted."""
        self._time = None

    def gap(self, counter: int, now: float) -> Gap | None:
        """Return the frames missing before this frame; None if it is repeated or late."""
        before, least, most = self._time, 1, 1
        if before is not None:
            least, most = self._steps_to(counter, now - before)
            if least == 0:
                if counter == self.counter:
                    self._time = now
                return None
            if most == 1:
                self._periods.append(now - before)
        self.counter, self._time = counter, now
        return Gap(least - 1, most - 1)

    def _steps_to(self, counter: int, seconds: float) -> tuple[int, int]:
        """Return the steps of the counter, at least and by the elapsed time; 0 for a repeated or
        late frame.
        """
        ahead = (counter - self.counter) % codec.COUNTERS
        if ahead == 1:
            return 1, 1
        if ahead > MAX_STEPS_AHEAD and seconds < MAX_LATE_S:
            return 0, 0
        period = self._mean_period()
        if period <= 0:  # unknown, and this sender may not count
            return ahead, ahead
        turns = math.ceil((seconds / period - ahead) / codec.COUNTERS - 0.5)
        most = ahead + codec.COUNTERS * turns
        return (0, 0) if most <= 0 else (ahead or codec.COUNTERS, most)

    def _mean_period(self) -> float:
        """s; 0 if it is unknown. The longest one is left out, since it may be a pause."""
        if len(self._periods) < 2:
            return 0.0
        return (sum(self._periods) - max(self._periods)) / (len(self._periods) - 1)
