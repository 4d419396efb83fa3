# SPDX-License-Identifier: MIT
"""Count the frames of friction nodes that a recorder has missed, by their sequence counters.

A counter has 4 bits, so it shows a gap modulo 16: the least number of missing frames. The most
follows from the time stamps and the mean of the last periods. A gap of 16 n frames looks like a
pause of the sender, and is not counted.

Any bytes may have a right CRC by chance. So gaps of an id count only once SENDER_FRAMES frames in a
row had a right CRC and a counter one higher than before: random bytes do so with a probability of
2^-44. Gaps before that moment count then too.

Angles that did not reach the node either were lost on the bus, not by the recorder. The counter of
the answers then has no gap. Without answers each gap counts.
"""

from __future__ import annotations

import functools
import math
from collections import deque
from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

from dahl.binding.library import load
from dahl.can import codec, counters

if TYPE_CHECKING:
    import can

ANGLE, TORQUE, STATUS = codec.EncoderState.base, codec.FrictionTorque.base, codec.Status.base
MAX_UNANSWERED = 16  # angles after a gap; after more the node does not answer
MAX_SPOILED = 16  # frames in a row; after more this id is not of a node
SENDER_FRAMES = 4  # in a row, with right CRC and counter; then this id is of a node
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


class Missing:
    """Feed it each recorded frame; count() returns how many frames of all nodes are missing."""

    def __init__(self) -> None:
        load()  # it must not fail later, while a bus is recorded
        self._nodes: dict[tuple[object, int], _Node] = {}

    def feed(self, frame: can.Message) -> None:
        """Process one frame of any kind."""
        identifier = frame.arbitration_id
        is_plain = not (frame.is_extended_id or frame.is_remote_frame or frame.is_error_frame)
        if is_plain and not frame.is_fd and ANGLE <= identifier <= STATUS | 15:
            key = (frame.channel, identifier & 15)
            self._nodes.setdefault(key, _Node()).feed(frame)

    def count(self) -> Gap:
        """Frames missing so far."""
        return self.proved().plus(_sum(node.unproved() for node in self._nodes.values()))

    def proved(self) -> Gap:
        """Missing frames that were certainly on the bus."""
        return _sum(node.proved() for node in self._nodes.values())


def _sum(gaps: Iterable[Gap]) -> Gap:
    return functools.reduce(Gap.plus, gaps, NO_GAP)


class _Sequence:
    """The frames of one id."""

    def __init__(self) -> None:
        self.counter = 0  # of the newest
        self._time: float | None = None
        self._periods: deque[float] = deque(maxlen=PERIODS)  # s, of frames without a gap
        self._spoiled = 0  # frames with a wrong CRC or length since the newest
        self._in_row = 0  # frames up to the newest whose counters follow each other
        self.is_sender = False  # this id is of a node
        self.proved = self._pending = NO_GAP  # missing frames; those before that was known

    def spoil(self) -> None:
        """Note an unreadable frame: it is recorded, so it is not missing."""
        self._spoiled += 1
        self._in_row = 0
        if self._spoiled > MAX_SPOILED:
            self._time, self.is_sender = None, False
        if not self.is_sender:
            self._pending = NO_GAP

    def prove(self, gap: Gap) -> None:
        """Count missing frames, once this id is of a node."""
        self._pending = self._pending.plus(gap)
        if self.is_sender:
            self.proved, self._pending = self.proved.plus(self._pending), NO_GAP

    def restart(self) -> None:
        """Forget the counter of a sender that has restarted."""
        self._time = None

    def gap(self, counter: int, now: float) -> Gap | None:
        """Return the frames missing before this frame; None if it is repeated or late."""
        before = self._time
        if before is not None:
            least, most = self._steps_to(counter, now - before)
            if least == 0:
                if counter == self.counter:
                    self._time = now
                return None
            if most == 1:
                self._periods.append(now - before)
        else:
            least = most = 1
        self._in_row = self._in_row + 1 if least == 1 else 1
        self.is_sender |= self._in_row >= SENDER_FRAMES
        spoiled, self._spoiled = self._spoiled, 0
        self.counter, self._time = counter, now
        return Gap(max(least - 1 - spoiled, 0), max(most - 1 - spoiled, 0))

    def _steps_to(self, counter: int, seconds: float) -> tuple[int, int]:
        """Return the steps of the counter, at least and by the elapsed time; 0 for a repeated or
        late frame.
        """
        ahead = (counter - self.counter) % codec.COUNTERS
        if ahead == 1:
            return 1, 1
        period = self._mean_period()
        if period <= 0:  # unknown, and this sender may not count
            step = 0 if ahead == 0 else counters.step(self.counter, counter, seconds)
            return step, step
        turns = math.ceil((seconds / period - ahead) / codec.COUNTERS - 0.5)
        most = ahead + codec.COUNTERS * turns
        return (0, 0) if most <= 0 else (ahead or codec.COUNTERS, most)

    def _mean_period(self) -> float:
        """s; 0 if it is unknown. The longest one is left out, since it may be a pause."""
        if len(self._periods) < 2:
            return 0.0
        return (sum(self._periods) - max(self._periods)) / (len(self._periods) - 1)


class _Node:
    """The frames of one node: those proved missing, and a gap of angles that its next answers
    decide.
    """

    def __init__(self) -> None:
        self._by_kind = {kind: _Sequence() for kind in (ANGLE, TORQUE, STATUS)}
        self._undecided = NO_GAP
        self._angles_since = 0  # the undecided gap
        self._is_answered_ahead = False  # the newest answer is to an angle not yet recorded

    def feed(self, frame: can.Message) -> None:
        kind = frame.arbitration_id & ~15
        sequence, data = self._by_kind[kind], frame.data
        if not codec.is_whole(frame.arbitration_id, data):
            sequence.spoil()
            if not self._by_kind[ANGLE].is_sender:
                self._undecided = NO_GAP
            return
        counter, state = data[1] & 15, data[1] >> 4
        if kind != ANGLE and counter == 0 and state == codec.State.INIT:
            sequence.restart()
            self._undecided = NO_GAP
        gap = sequence.gap(counter, frame.timestamp)
        if gap is None:
            return
        if kind == ANGLE:
            self._angle(gap)
            gap = NO_GAP
        elif kind == TORQUE:
            self._answer(gap, echo=data[2] & 15)
        sequence.prove(gap)

    def _angle(self, gap: Gap) -> None:
        if gap.least:
            self._undecided, self._angles_since = self._undecided.plus(gap), 0
            if self._is_answered_ahead:
                self._decide(is_missing=True)
        self._is_answered_ahead = False
        self._angles_since += 1
        if self._angles_since > MAX_UNANSWERED:
            self._decide(is_missing=True)

    def _answer(self, gap: Gap, echo: int) -> None:
        behind = (self._by_kind[ANGLE].counter - echo) % codec.COUNTERS
        self._is_answered_ahead = behind > counters.MAX_STEPS_AHEAD
        if gap.least or self._angles_since <= behind < self._angles_since + self._undecided.least:
            self._decide(is_missing=True)
        elif behind < self._angles_since:  # an answer after the gap, without a gap of its own
            self._decide(is_missing=False)

    def _decide(self, is_missing: bool) -> None:
        if is_missing:
            self._by_kind[ANGLE].prove(self._undecided)
        self._undecided = NO_GAP

    def proved(self) -> Gap:
        return _sum(sequence.proved for sequence in self._by_kind.values())

    def unproved(self) -> Gap:
        """An undecided gap of a node that never answers."""
        is_open = self._by_kind[ANGLE].is_sender and not self._by_kind[TORQUE].is_sender
        return self._undecided if is_open else NO_GAP
