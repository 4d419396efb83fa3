# SPDX-License-Identifier: MIT
"""dahl.Node over random sequences of frames, ticks, faults, resets, parameters and copies. The
reference is the node of loop_model.py, written from the headers and the fault table alone.
"""

from __future__ import annotations

import can
import dahl
import numpy as np
import pytest
from frame_sequences import (
    FRICTION_VALUES,
    HOURS,
    NUMBER,
    OTHERS,
    TIMES,
    Frames,
    message_of,
    run_sequences,
    writes,
)
from hypothesis import strategies as st
from hypothesis.stateful import rule
from law_tools import modes
from loop_model import (
    Q30_BOUND,
    STATUS,
    TORQUE,
    Answer,
    Node,
    Reply,
    Status,
    status_in,
    travel_per_count,
)
from loop_tools import Logged, word
from strategies import COPIES

pytestmark = pytest.mark.usefixtures("library")

PARAMS = [float(np.float32(value)) for value in (100, 0.7, 3.8e-4)]
BOUND = 4 * Q30_BOUND  # a gain is cut to Q30, and other parameters keep F to 2^-30
RAMP_BOUND = 3 * 2.0**-16  # the gain moves by whole steps


def read(message: can.Message | None, now_us: int) -> Answer | Status | Reply | None:
    """Return a message as the model does."""
    if message is None:
        return None
    assert message.arbitration_id & 15 == NUMBER
    data = bytes(message.data)
    kind = message.arbitration_id & ~15
    if kind == TORQUE:
        ratio = word(data, 4) / 2**30
        return Answer(now_us / 1e6, data[1] >> 4, data[2] & 15, ratio, data[1] & 15)
    if kind == STATUS:
        return status_in(Logged(now_us / 1e6, message.arbitration_id, data))
    return Reply(data[1] & 15, data[1] >> 4, data[2], word(data, 4) % 2**32)


def assert_equal(here: object, there: object, bound: float) -> None:
    if isinstance(here, Answer) and isinstance(there, Answer):
        assert abs(here.ratio - there.ratio) <= bound, (here, there)
        here = Answer(here.time, here.state, here.echo, there.ratio, here.counter)
    assert here == there


class AgainstTheModel(Frames):
    """Compare each frame sent, each state, each sticky error and each count."""

    def __init__(self) -> None:
        super().__init__()
        self.real = dahl.Node(dahl.Plan(*PARAMS), NUMBER)
        self.model = Node(travel_per_count(*PARAMS), number=NUMBER, params=PARAMS)
        self.bound = BOUND

    def play(self, frame: Logged | None, now_us: int) -> None:
        seconds = now_us / 1e6
        if frame is None:
            here, there = self.real.tick(seconds), self.model.tick(now_us)
        else:
            here = self.real.receive(message_of(frame), seconds)
            there = self.model.receive(frame, now_us)
        self.bound = RAMP_BOUND if self.model.ramp_us else self.bound
        assert_equal(read(here, now_us), there, self.bound)
        assert (self.real.state, self.real.errors) == (self.model.state, self.model.errors)

    @rule(what=writes(FRICTION_VALUES))
    def write_friction(self, what: tuple) -> None:
        self.parameter(*what)

    @rule(what=writes(TIMES, OTHERS))
    def write_setting(self, what: tuple) -> None:
        self.parameter(*what)

    @rule(hours=HOURS, is_off=st.booleans(), is_ticked=st.booleans())
    def long_time_without_a_call(self, hours: int, is_off: bool, is_ticked: bool) -> None:
        """The clock of the C wraps meanwhile."""
        if self.now_us + hours > 2**53:  # us that a float of seconds still tells
            return
        if is_off:
            self.bus_off(pause=0, times=1)
        self.send(*[None] * is_ticked, pause_us=hours)
        self.send_row((4, 3, 0, None))

    @rule(copied=st.sampled_from(COPIES))
    def go_on_with_a_copy(self, copied) -> None:
        other = copied(self.real)
        assert other == self.real and other is not self.real
        other.receive(message_of(self.next_angle(0, 1)), self.now_us / 1e6)  # its own way
        self.real = copied(self.real)

    def teardown(self) -> None:
        counted = vars(self.real.counts).copy()
        assert counted.pop("ignored") <= self.model.counts.pop("ignored", 0)  # no error frames
        assert {name: count for name, count in counted.items() if count} == +self.model.counts


@modes(200, 5000)
def test_a_node_behaves_as_its_headers_describe(examples):
    run_sequences(AgainstTheModel, examples)


class WithTicks(Frames):
    """Ticks between frames, as a main loop makes them between receive interrupts."""

    def __init__(self) -> None:
        super().__init__()
        self.nodes = {ticks: dahl.Node(dahl.Plan(*PARAMS), NUMBER) for ticks in (0, 1, 5)}
        self.played_us = self.now_us

    def play(self, frame: Logged | None, now_us: int) -> None:
        answers = set()
        for ticks, node in self.nodes.items():
            for k in range(ticks):
                node.tick((self.played_us + (now_us - self.played_us) * k / ticks) / 1e6)
            message = node.receive(message_of(frame), now_us / 1e6) if frame else None
            is_torque = message is not None and message.arbitration_id == TORQUE | NUMBER
            answers.add(bytes(message.data) if is_torque else b"")
        self.played_us = now_us
        assert len(answers) == 1


@modes(60, 2000)
def test_ticks_between_frames_change_no_torque(examples):
    run_sequences(WithTicks, examples)
