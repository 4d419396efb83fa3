# SPDX-License-Identifier: MIT
"""The node over random sequences of frames of every form, ticks, faults, resets and parameters. The
reference is the node of loop_model.py, written from the headers and the fault table alone.
"""

from __future__ import annotations

from collections.abc import Iterator

import can
import dahl
import numpy as np
import pytest
from crccheck.crc import Crc8Autosar
from hypothesis import strategies as st
from law_tools import holds, modes
from loop_model import (
    BUS_OFF,
    ENCODER,
    ERROR,
    KINDS,
    PARAM,
    Q30_BOUND,
    RESET,
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

pytestmark = pytest.mark.usefixtures("library")

NUMBER = 5
PARAMS = [float(np.float32(value)) for value in (100, 0.7, 3.8e-4)]
BEGIN_US = 4294_000_000  # the clock of the C wraps soon
BOUND = 4 * Q30_BOUND  # a gain is cut to Q30, and other parameters keep F to 2^-30
RAMP_BOUND = 3 * 2.0**-16  # the gain moves by whole steps

# --- what comes ----------------------------------------------------------------------------------

PAUSES = st.sampled_from([0, 1, 500, 1000, 1000, 1000, 1001, 2000, 43500, 99_999, 100_000, 100_001])
LONGER = st.sampled_from([250_000, 1_000_000, 3_000_000])
MOVES = st.integers(-40, 40) | st.sampled_from([0, 999, 1000, 1001, 2000, -5000, 2**28, 2**31])
SPOILS = st.sampled_from(["crc", "cut", "extended", "foreign", "error"])
VALUES = {
    0: st.sampled_from([0, 1024, 51200, 2**20]),
    1: st.sampled_from([0, 1024, 524288, 2**22]),
    2: st.sampled_from([0, 2**14, 2**20, 2**28 + 1]),
    3: st.sampled_from([0, 1, 32768, 65536, 65537]),
    4: st.sampled_from([0, 1, 32768, 65536, 65537]),
    5: st.sampled_from([0, 1, 5, 200, 60000, 60001]),
    6: st.sampled_from([0, 1, 2, 50, 1000, 60000, 60001]),
    7: st.sampled_from([0, 1, 10, 1000, 2**31 - 1, 2**31]),
    8: st.sampled_from([0, 1, 70, 60000, 60001]),
    9: st.sampled_from([0, 1]),
    10: st.sampled_from([0, 65536]),
    11: st.just(7),
    255: st.just(7),
}
STEPS = st.sampled_from([1, 1, 1, 1, 2, 3, 4, 8, 0, 5, 9, 13, 15])  # of the counter
VALID = st.sampled_from([True, True, True, False])
ANGLES = st.tuples(st.just("angle"), PAUSES, STEPS, MOVES, VALID)
ROWS = st.tuples(  # frames that go on from each other, of which one may be bad
    st.integers(1, 6),
    st.integers(-12, 12),
    st.integers(0, 5),
    st.sampled_from([None, "crc", False]),
)
RUNS = st.tuples(st.just("run"), PAUSES, STEPS, MOVES, ROWS)
SILENCES = st.tuples(st.just("silence"), LONGER | PAUSES, ROWS)
SPOILT = st.tuples(st.just("spoilt"), PAUSES, st.sampled_from([*KINDS]), SPOILS)
WRITES = st.sampled_from([0, 1, 1, 2, 3])
FRICTION = st.integers(0, 2).flatmap(
    lambda number: st.tuples(
        st.just("param"), st.just(number), st.sampled_from([1, 2, 2, 3]), VALUES[number]
    )
)
PARAMETERS = st.sampled_from([*VALUES]).flatmap(
    lambda number: st.tuples(st.just("param"), st.just(number), WRITES, VALUES[number])
)
MAX_STEPS = st.tuples(st.just("param"), st.just(7), st.just(1), VALUES[7])
READS = st.tuples(st.just("param"), st.sampled_from([*VALUES]), st.just(0), st.just(0))
TICKS = st.tuples(st.just("tick"), PAUSES | LONGER)
RARE = (
    st.tuples(st.just("reset"), st.integers(0, 3))
    | st.tuples(st.just("off"), PAUSES, st.integers(1, 3))
    | st.tuples(st.just("foreign"), st.sampled_from([0x100, 0x115, 0x125, 0x145, 0x7FF, 0x004]))
)
STREAM = [ANGLES, RUNS, RUNS, RUNS, SILENCES, SPOILT, TICKS, RARE]
SETTING = [FRICTION, FRICTION, PARAMETERS, PARAMETERS, MAX_STEPS]


def talks(*kinds: st.SearchStrategy) -> st.SearchStrategy:
    """Sequences in which each of these kinds is as frequent as the others."""
    one = st.integers(0, len(kinds) - 1).flatmap(lambda k: kinds[k])
    return st.lists(one, min_size=30, max_size=70)


def sealed(kind: int, counter: int, more: int, body: bytes) -> bytes:
    """Eight bytes with counter and CRC."""
    data = bytes([counter % 16 | more << 4]) + body.ljust(6, b"\0")
    return bytes([Crc8Autosar.calc(data + bytes([KINDS[kind] << 4 | counter % 16]))]) + data


def spoilt(kind: int, how: str, data: bytes) -> Logged:
    """What is left of a good frame."""
    if how == "crc":
        data = data[:5] + bytes([data[5] ^ 4]) + data[6:]
    identifier = kind | NUMBER | (ERROR if how == "error" else 0)
    short = data[:7] if how == "cut" else data
    return Logged(0, identifier, short, how == "extended", how == "foreign")


class Encoder:
    """Frames of one encoder and one client, from what comes."""

    def __init__(self) -> None:
        self.now_us, self.counter, self.count = BEGIN_US, 0, 0

    def angle(self, step: int, move: int, is_valid: bool) -> Logged:
        self.counter = (self.counter + step) % 16
        self.count = (self.count + move + 2**31) % 2**32 - 2**31
        body = self.count.to_bytes(4, "little", signed=True)
        data = sealed(ENCODER, self.counter, int(is_valid), body)
        return Logged(0, ENCODER | NUMBER, data)

    def row(self, frames: int, move: int, bad: int, how: str | bool | None) -> Iterator[Logged]:
        """One each ms; how: what the bad one is, spoilt or not valid."""
        for k in range(frames):
            self.now_us += 1000
            frame = self.angle(1, move, k != bad or how is not False)
            yield spoilt(ENCODER, how, frame.data) if k == bad and how else frame

    def angles(self, kind: str, pause: int, *rest) -> Iterator[Logged | None]:
        """Of an entry that takes time; None: only the time."""
        self.now_us += pause
        if kind in ("tick", "silence"):
            yield None
        if kind == "angle":
            yield self.angle(*rest)
        if kind == "run":
            yield self.angle(*rest[:2], True)
        if kind in ("run", "silence"):
            yield from self.row(*rest[-1])
            yield None

    def frames(self, kind: str, *rest) -> Iterator[Logged | None]:
        """Those of one entry, the clock being that of each."""
        if kind == "param":
            number, write, value = rest
            body = bytes([number, 0]) + value.to_bytes(4, "little")
            yield Logged(0, PARAM | NUMBER, sealed(PARAM, self.counter, write, body))
        elif kind == "reset":
            yield Logged(0, RESET | NUMBER, sealed(RESET, self.counter, rest[0], b""))
        elif kind == "foreign":
            yield Logged(0, rest[0], bytes(8))
        elif kind == "off":
            self.now_us += rest[0]
            yield from [Logged(0, BUS_OFF, bytes(8), True)] * rest[1]
        elif kind == "spoilt":
            self.now_us += rest[0]
            yield spoilt(rest[1], rest[2], self.angle(1, 3, True).data)
        else:
            yield from self.angles(kind, *rest)


def message_of(frame: Logged) -> can.Message:
    return can.Message(
        arbitration_id=frame.id & ~ERROR,
        data=frame.data,
        is_error_frame=bool(frame.id & ERROR),
        is_extended_id=frame.is_extended,
        is_fd=frame.is_foreign,
    )


# --- what is sent --------------------------------------------------------------------------------


def read(message: can.Message | None, now_us: int) -> Answer | Status | Reply | None:
    """Return it as the model does."""
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


def alike(here: object, there: object, bound: float) -> None:
    if isinstance(here, Answer) and isinstance(there, Answer):
        assert abs(here.ratio - there.ratio) <= bound, (here, there)
        here = Answer(here.time, here.state, here.echo, there.ratio, here.counter)
    assert here == there


def play(talk: list[tuple]) -> None:
    """Play the same frames to both."""
    real, model = dahl.Node(dahl.Plan(*PARAMS), NUMBER), Node(travel_per_count(*PARAMS))
    model.number, model.params, model.held = NUMBER, list(PARAMS), list(PARAMS)
    encoder, bound = Encoder(), BOUND
    for entry in talk:
        for frame in encoder.frames(*entry):
            now_us = encoder.now_us
            if frame is None:
                here = read(real.tick(now_us / 1e6), now_us)
                there = model.tick(now_us)
            else:
                here = read(real.receive(message_of(frame), now_us / 1e6), now_us)
                there = model.receive(frame, now_us)
            bound = RAMP_BOUND if model.ramp_us else bound
            alike(here, there, bound)
            assert real.state == model.state and real.errors == model.errors
    counted = {name: getattr(real.counts, name) for name in vars(real.counts)}
    ignored = model.counts.pop("ignored", 0)
    assert counted.pop("ignored") <= ignored  # in Python error frames do not come so far
    assert {name: count for name, count in counted.items() if count} == +model.counts


@modes(200, 5000)
def test_a_node_is_the_one_that_its_headers_describe(examples):
    """Each frame sent, each count, each sticky error, whatever came before."""
    holds(play, examples, talks(*STREAM, *SETTING))


def answers(talk: list[tuple], ticks: int) -> list[bytes]:
    """FrictionTorque frames, with so many ticks from each frame to the next."""
    one, encoder, found = dahl.Node(dahl.Plan(*PARAMS), NUMBER), Encoder(), []
    for entry in talk:
        before_us = encoder.now_us
        for frame in encoder.frames(*entry):
            for k in range(ticks):
                one.tick((before_us + (encoder.now_us - before_us) * k / ticks) / 1e6)
            before_us = encoder.now_us
            message = one.receive(message_of(frame), encoder.now_us / 1e6) if frame else None
            if message is not None and message.arbitration_id == TORQUE | NUMBER:
                found.append(bytes(message.data))
    return found


@modes(100, 2000)
def test_ticks_between_frames_change_no_torque(examples):
    """However a receive interrupt and the ticks of a main loop take turns."""

    def law(talk: list[tuple]) -> None:
        plain = answers(talk, 0)
        assert plain == answers(talk, 1) == answers(talk, 5)

    holds(law, examples, talks(*STREAM, READS))
