# SPDX-License-Identifier: MIT
"""dahl.Node over random sequences of frames, ticks, faults, resets, parameters and copies. The
reference is the node of loop_model.py, written from the headers and the fault table alone.
"""

from collections.abc import Iterator

import can
import dahl
import hypothesis
import numpy as np
from crccheck.crc import Crc8Autosar
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule, run_state_machine_as_test
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
from property_tools import SLOW, modes
from strategies import COPIES

PARAMS = [float(np.float32(value)) for value in (100, 0.7, 3.8e-4)]
BOUND = 4 * Q30_BOUND  # a gain is cut to Q30, and other parameters keep F to 2^-30
RAMP_BOUND = 3 * 2.0**-16  # the gain moves by whole steps


NUMBER = 5  # of the node
WRAP_US = 2**32  # the clock of the C wraps
BEGIN_US = WRAP_US - 1_000_000

PAUSES = st.sampled_from([0, 1, 500, 1000, 1000, 1000, 1001, 2000, 43500, 99_999, 100_000, 100_001])
LONGER = st.sampled_from([250_000, 1_000_000, 3_000_000])
HOURS = st.sampled_from([999_000_000, WRAP_US // 2 + 52_000, WRAP_US + 2000, 10**11, 10**13])
MOVES = st.integers(-40, 40) | st.sampled_from([0, 999, 1000, 1001, 2000, -5000, 2**28, 2**31])
STEPS = st.sampled_from([1, 1, 1, 1, 2, 3, 4, 8, 0, 5, 9, 13, 15])  # of the counter
FAULTS = st.sampled_from(["crc", "cut", "extended", "fd", "remote", "error"])
FOREIGN = st.sampled_from([0x100, 0x115, 0x125, 0x145, 0x7FF, 0x004])
ROWS = st.tuples(  # frames in sequence: how many, counts between them, which one is bad, and how
    st.integers(1, 6),
    st.integers(-12, 12),
    st.integers(0, 5),
    st.sampled_from([None, "crc", "invalid"]),
)
FRACTIONS = st.sampled_from([0, 1, 32768, 65536, 65537])  # in 1/65536
FRICTION_VALUES = {
    0: st.sampled_from([0, 1024, 51200, 2**20]),
    1: st.sampled_from([0, 1024, 524288, 2**22]),
    2: st.sampled_from([0, 2**14, 2**20, 2**28 + 1]),
}
TIMES = {
    5: st.sampled_from([0, 1, 5, 200, 60000, 60001]),
    6: st.sampled_from([0, 1, 2, 50, 1000, 60000, 60001]),
    8: st.sampled_from([0, 1, 70, 60000, 60001]),
}
OTHERS = {
    3: FRACTIONS,
    4: FRACTIONS,
    7: st.sampled_from([0, 1, 10, 1000, 2**31 - 1, 2**31]),
    9: st.sampled_from([0, 1]),
    10: st.sampled_from([0, 65536]),
    11: st.just(7),
    255: st.just(7),
}


def writes(*tables: dict[int, st.SearchStrategy]) -> st.SearchStrategy[tuple[int, int, int]]:
    values = {number: each for table in tables for number, each in table.items()}
    ways = st.sampled_from([0, 1, 1, 2, 3])
    return st.sampled_from([*values]).flatmap(lambda n: st.tuples(st.just(n), ways, values[n]))


READ = st.sampled_from([*FRICTION_VALUES, *TIMES, *OTHERS])


def pack(kind: int, counter: int, high: int, body: bytes) -> bytes:
    """Return eight bytes with counter and CRC, without the codec under test."""
    data = bytes([counter % 16 | high << 4]) + body.ljust(6, b"\0")
    return bytes([Crc8Autosar.calc(data + bytes([KINDS[kind] << 4 | counter % 16]))]) + data


def with_fault(kind: int, fault: str, data: bytes) -> Logged:
    identifier = kind | NUMBER | (ERROR if fault == "error" else 0)
    if fault == "crc":
        data = data[:5] + bytes([data[5] ^ 4]) + data[6:]
    changed = {"cut": data[:7], "remote": b""}.get(fault, data)
    return Logged(0, identifier, changed, fault == "extended", fault in ("fd", "remote"))


def message_of(frame: Logged) -> can.Message:
    return can.Message(
        arbitration_id=frame.id & ~ERROR,
        data=frame.data,
        is_error_frame=bool(frame.id & ERROR),
        is_extended_id=frame.is_extended,
        is_fd=frame.is_foreign and len(frame.data) > 0,
        is_remote_frame=frame.is_foreign and len(frame.data) == 0,
    )


def read(message: can.Message | None, now_us: int) -> Answer | Status | Reply | None:
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


class AgainstTheModel(RuleBasedStateMachine):
    """Frames of an encoder that moves and of a client, and the faults of a bus. Compare each frame
    sent, each state, each sticky error and each count.
    """

    def __init__(self) -> None:
        super().__init__()
        self.now_us, self.counter, self.count = BEGIN_US, 0, 0
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

    def send(self, *frames: Logged | None, pause_us: int = 0) -> None:
        """Hand frames to both nodes; None: time has passed."""
        self.now_us += pause_us
        for frame in frames:
            self.play(frame, self.now_us)

    def next_angle(self, step: int, move: int, is_valid: bool = True) -> Logged:
        self.counter = (self.counter + step) % 16
        self.count = (self.count + move + 2**31) % 2**32 - 2**31
        body = self.count.to_bytes(4, "little", signed=True)
        return Logged(0, ENCODER | NUMBER, pack(ENCODER, self.counter, int(is_valid), body))

    def next_row(self, frames: int, move: int, bad: int, fault: str | None) -> Iterator[Logged]:
        for k in range(frames):
            frame = self.next_angle(1, move, k != bad or fault != "invalid")
            yield with_fault(ENCODER, "crc", frame.data) if k == bad and fault == "crc" else frame

    def send_row(self, row: tuple) -> None:
        for frame in self.next_row(*row):
            self.send(frame, pause_us=1000)
        self.send(None)

    @rule(pause=PAUSES, step=STEPS, move=MOVES, is_valid=st.sampled_from([True, True, False]))
    def angle(self, pause: int, step: int, move: int, is_valid: bool) -> None:
        self.send(self.next_angle(step, move, is_valid), pause_us=pause)

    @rule(pause=PAUSES, step=STEPS, move=MOVES, row=ROWS)
    def angle_and_row(self, pause: int, step: int, move: int, row: tuple) -> None:
        self.send(self.next_angle(step, move), pause_us=pause)
        self.send_row(row)

    @rule(rows=st.lists(ROWS, min_size=1, max_size=4))
    def rows(self, rows: list[tuple]) -> None:
        for row in rows:
            self.send_row(row)

    @rule(pause=LONGER | PAUSES, row=ROWS)
    def silence(self, pause: int, row: tuple) -> None:
        self.send(None, pause_us=pause)
        self.send_row(row)

    @rule(pause=PAUSES, kind=st.sampled_from([*KINDS]), fault=FAULTS)
    def faulty_frame(self, pause: int, kind: int, fault: str) -> None:
        self.send(with_fault(kind, fault, self.next_angle(1, 3).data), pause_us=pause)

    @rule(pause=PAUSES | LONGER)
    def tick(self, pause: int) -> None:
        self.send(None, pause_us=pause)

    @rule(pause=PAUSES, times=st.integers(1, 4))
    def bus_off(self, pause: int, times: int) -> None:
        self.send(*[Logged(0, BUS_OFF, bytes(8), True)] * times, pause_us=pause)

    @rule(identifier=FOREIGN)
    def foreign_frame(self, identifier: int) -> None:
        self.send(Logged(0, identifier, bytes(8)))

    @rule(what=st.integers(0, 3))
    def reset(self, what: int) -> None:
        self.send(Logged(0, RESET | NUMBER, pack(RESET, self.counter, what, b"")))

    @rule(number=READ)
    def read_parameter(self, number: int) -> None:
        self.parameter(number, 0, 0)

    def parameter(self, number: int, way: int, value: int) -> None:
        body = bytes([number, 0]) + value.to_bytes(4, "little")
        self.send(Logged(0, PARAM | NUMBER, pack(PARAM, self.counter, way, body)))

    @rule(what=writes(FRICTION_VALUES))
    def write_friction(self, what: tuple) -> None:
        self.parameter(*what)

    @rule(what=writes(TIMES, OTHERS))
    def write_setting(self, what: tuple) -> None:
        self.parameter(*what)

    @rule(hours=HOURS, is_off=st.booleans(), is_ticked=st.booleans())
    def long_time_without_a_call(self, hours: int, is_off: bool, is_ticked: bool) -> None:
        """The clock of the C wraps meanwhile."""
        if self.now_us + hours > 2**53:  # us that a float of seconds can still hold
            return
        if is_off:
            self.bus_off(pause=0, times=1)
        self.send(*[None] * is_ticked, pause_us=hours)
        self.send_row((4, 3, 0, None))

    @rule(copied=st.sampled_from(COPIES))
    def go_on_with_a_copy(self, copied) -> None:
        other = copied(self.real)
        assert other == self.real and other is not self.real
        other.receive(message_of(self.next_angle(0, 1)), self.now_us / 1e6)
        self.real = copied(self.real)

    def teardown(self) -> None:
        counted = vars(self.real.counts).copy()
        assert counted.pop("ignored") <= self.model.counts.pop("ignored", 0)  # no error frames
        assert {name: count for name, count in counted.items() if count} == +self.model.counts


@modes(200, 5000)
def test_a_node_behaves_as_its_headers_describe(examples):
    how = hypothesis.settings(max_examples=examples, suppress_health_check=SLOW)
    run_state_machine_as_test(AgainstTheModel, settings=how)
