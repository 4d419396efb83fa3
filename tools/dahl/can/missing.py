# SPDX-License-Identifier: MIT
"""Count the frames of friction nodes that a recorder has missed, by their sequence counters.

Any bytes may have a right CRC by chance. So gaps of an id count only once SENDER_FRAMES frames in a
row had a right CRC and a counter one higher than before: random bytes do so with a probability of
2^-44. Gaps before that moment count then too.

Angles that did not reach the node either were lost on the bus, not by the recorder: no answer
echoes them, and the counter of the answers has no gap for them. Without answers each gap counts.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, NamedTuple

from dahl.binding.library import load
from dahl.can import codec
from dahl.can.counters import MAX_STEPS_AHEAD, NO_GAP, Gap, Sequence, total

if TYPE_CHECKING:
    import can

ANGLE, TORQUE, STATUS = codec.EncoderState.base, codec.FrictionTorque.base, codec.Status.base
MAX_UNANSWERED = 16  # angles after a gap; after more the node does not answer
MAX_UNDECIDED = 64  # angles of a node that does not answer
MAX_SPOILED = 16  # frames in a row; after more this id is not of a node
SENDER_FRAMES = 4  # in a row, with right CRC and counter; then this id is of a node


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
        return self.proved().plus(total(node.unproved() for node in self._nodes.values()))

    def proved(self) -> Gap:
        """Missing frames that were certainly on the bus."""
        return total(node.proved() for node in self._nodes.values())


class _Sender(Sequence):
    """The frames of one id that may be of a node."""

    def __init__(self) -> None:
        super().__init__()
        self._spoiled = 0  # frames with a wrong CRC or length since the newest
        self._in_row = 0  # frames up to the newest whose counters follow each other
        self.is_sender = False  # this id is of a node
        self.proved = self._pending = NO_GAP  # missing frames; those before that was known

    def spoil(self) -> None:
        """Note an unreadable frame: it is recorded, so it is not missing."""
        self._spoiled += 1
        self._in_row = 0
        if self._spoiled > MAX_SPOILED:
            self.is_sender = False
            self.restart()
        if not self.is_sender:
            self._pending = NO_GAP

    def prove(self, gap: Gap) -> None:
        """Count missing frames, once this id is of a node."""
        self._pending = self._pending.plus(gap)
        if self.is_sender:
            self.proved, self._pending = self.proved.plus(self._pending), NO_GAP

    def gap(self, counter: int, now: float) -> Gap | None:
        gap = super().gap(counter, now)
        if gap is None:
            return None
        self._in_row = self._in_row + 1 if gap.least == 0 else 1
        self.is_sender |= self._in_row >= SENDER_FRAMES
        spoiled, self._spoiled = self._spoiled, 0
        return Gap(max(gap.least - spoiled, 0), max(gap.most - spoiled, 0))


class _Answer(NamedTuple):
    """A recorded answer, by the place of its angle in the sequence of angles."""

    place: int
    lost: int  # answers missing before it


class _Node:
    """The frames of one node: those proved missing, and missing angles that answers decide."""

    def __init__(self) -> None:
        self._by_kind = {kind: _Sender() for kind in (ANGLE, TORQUE, STATUS)}
        self._newest = 0  # place of the newest angle: a number that ends in its counter
        self._forget()

    def _forget(self) -> None:
        self._undecided: dict[int, int] = {}  # places of missing angles: turns of 16 more, or 0
        self._answers: deque[_Answer] = deque(maxlen=MAX_UNANSWERED)  # to angles not yet recorded
        self._answered: int | None = None  # place of the angle of the last answer

    def feed(self, frame: can.Message) -> None:
        kind = frame.arbitration_id & ~15
        sequence, data = self._by_kind[kind], frame.data
        if not codec.is_whole(frame.arbitration_id, data):
            sequence.spoil()
            if not self._by_kind[ANGLE].is_sender:
                self._undecided.clear()
            return
        counter, state = data[1] & 15, data[1] >> 4
        if kind != ANGLE and counter == 0 and state == codec.State.INIT:
            sequence.restart()
            self._forget()
        gap = sequence.gap(counter, frame.timestamp)
        if gap is None:
            return
        if kind == ANGLE:
            self._angle(gap, counter)
            gap = NO_GAP
        elif kind == TORQUE:
            self._answer(gap, echo=data[2] & 15)
        sequence.prove(gap)

    def _angle(self, gap: Gap, counter: int) -> None:
        self._newest += (counter - self._newest) % codec.COUNTERS or codec.COUNTERS
        for place in range(self._newest - gap.least, self._newest):
            self._undecided[place] = 0
        if gap.least:
            self._undecided[self._newest - 1] = gap.most - gap.least
        self._decide()
        last = next(reversed(self._undecided), self._newest)
        if self._newest - last > MAX_UNANSWERED or len(self._undecided) > MAX_UNDECIDED:
            self._prove(list(self._undecided), len(self._undecided))

    def _answer(self, gap: Gap, echo: int) -> None:
        behind = (self._newest - echo) % codec.COUNTERS
        ahead = codec.COUNTERS if behind > MAX_STEPS_AHEAD else 0
        self._answers.append(_Answer(self._newest - behind + ahead, gap.least))
        self._decide()

    def _decide(self) -> None:
        """Decide the missing angles up to each answer whose angle has been on the bus."""
        while self._answers and self._answers[0].place <= self._newest:
            answer = self._answers.popleft()
            if self._undecided:
                self._decide_before(answer)
            self._answered = answer.place

    def _decide_before(self, answer: _Answer) -> None:
        before = answer.place - 1 if self._answered is None else self._answered
        between = [one for one in self._undecided if before < one < answer.place]
        recorded = answer.place - before - 1 - len(between)
        self._prove(between, min(len(between), answer.lost - recorded))
        self._prove([one for one in self._undecided if one == answer.place], 1)
        for one in [one for one in self._undecided if one < answer.place]:  # lost on the bus
            del self._undecided[one]

    def _prove(self, places: list[int], number: int) -> None:
        """Count a number of these missing angles, and forget them."""
        turns = sum(self._undecided.pop(place) for place in places)
        if places and number > 0:
            self._by_kind[ANGLE].prove(Gap(number, number + turns))

    def proved(self) -> Gap:
        return total(sequence.proved for sequence in self._by_kind.values())

    def unproved(self) -> Gap:
        """Undecided angles of a node that never answers."""
        is_open = self._by_kind[ANGLE].is_sender and not self._by_kind[TORQUE].is_sender
        number = len(self._undecided)
        return Gap(number, number + sum(self._undecided.values())) if is_open else NO_GAP
