# SPDX-License-Identifier: MIT
"""dahl.Client against a friction object that makes the same moves without a bus."""

import contextlib
import copy
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import can
import dahl
import pytest
from bus_frames import two_ends
from can_socket import BUS_OFF
from dahl import codec, node
from dahl.can import client as client_module
from dahl.codec import EncoderState, Param, State
from hypothesis import given, settings
from hypothesis import strategies as st

PLAN = dahl.Plan(100, 0.7, 3.8e-4)
FRICTIONS = [
    dahl.Friction(PLAN),
    dahl.Slip([100, 50], [0.5, 0.25], 3.8e-4),
    dahl.Asymmetric(100, 0.7, 0.35, 3.8e-4),
    dahl.Parallel(dahl.Friction(PLAN), dahl.Slip([20], [1], 3.8e-4)),
]
FULL_TORQUE = [0.7, 0.75, 0.7, 1.7]  # N m that a ratio of 1 stands for
ROUNDING_Q30 = [0, 0, 0, 3]  # the node sums the elements of a Parallel within 1e-9
FC_STEP = 2**-20  # of parameter FC, N m
MOVES = st.integers(-900, 900) | st.sampled_from([0, 2**31 - 1, -(2**31), 2**30])


class Wire:
    """A bus that sends each frame to a node at once, and loses those that `loses` names. Waiting
    for a frame that does not come takes no time but that of its own clock `now`.
    """

    def __init__(self, *nodes: dahl.Node) -> None:
        self.nodes, self.sent, self.waits, self.now = nodes, [], [], 0.0
        self.loses = lambda frame: False
        self.error: Exception | None = None

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        if self.error:
            raise self.error
        self.sent.append(codec.unpack(message))
        self.now += 0.001
        for one in self.nodes:
            if message.arbitration_id & 15 == one.number and not self.loses(self.sent[-1]):
                self.tick(one)
                self.reply(one.receive(message, self.now))

    def tick(self, one: dahl.Node) -> None:
        self.reply(one.tick(self.now))

    def reply(self, message: can.Message | None) -> None:
        if message is not None and not self.loses(codec.unpack(message)):
            self.waits.append(message)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if self.waits:
            return self.waits.pop(0)
        self.now += timeout
        return None

    def counters(self) -> list[int]:
        return [frame.counter for frame in self.sent if isinstance(frame, EncoderState)]


@pytest.fixture
def wired(monkeypatch: pytest.MonkeyPatch) -> Callable[[dahl.Node], Wire]:
    """Return a function that makes a Wire, whose clock is then that of all clients."""

    def make(one: dahl.Node) -> Wire:
        wire = Wire(one)
        for module in (node, client_module):
            monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: wire.now))
        return wire

    return make


def model_of(friction: object) -> object:
    return PLAN if isinstance(friction, dahl.Friction) else friction


@settings(max_examples=25)
@given(st.lists(MOVES, max_size=20), st.sampled_from(range(len(FRICTIONS))))
def test_each_answer_is_that_of_the_model_and_the_torque_is_in_newton_meters(moves, which):
    alone = copy.deepcopy(FRICTIONS[which])
    wire = Wire(dahl.Node(model_of(FRICTIONS[which]), 5))
    client = dahl.Client(wire, 5, timeout=60)
    assert client.torque == 0 and wire.sent == []
    for move in moves:
        answer = client.move(move)
        error_q30 = answer.torque_q30 - alone.step_counts_q30(move)
        assert abs(error_q30) <= ROUNDING_Q30[which]
        torque = answer.ratio * FULL_TORQUE[which]
        assert client.torque == pytest.approx(torque, abs=FC_STEP)
    assert (client.count - sum(moves)) % 2**32 == 0 and -(2**31) <= client.count < 2**31
    assert wire.counters() == [k % 16 for k in range(len(wire.counters()))]


def test_a_new_client_of_a_node_that_has_moved_is_no_move(wired):
    wire = wired(dahl.Node(PLAN))
    dahl.Client(wire).move(5000)
    assert dahl.Client(wire).move(0).ratio == 0


@pytest.mark.parametrize("lost", ["count", "answer"])
def test_the_counts_go_on_after_a_timeout(wired, lost):
    """The count is absolute: a lost frame costs no motion."""
    wire, alone = wired(dahl.Node(PLAN, timeout=10)), dahl.Friction(PLAN)
    client = dahl.Client(wire)
    client.move(100)
    kind = EncoderState if lost == "count" else codec.FrictionTorque
    wire.loses = lambda frame: isinstance(frame, kind)
    with pytest.raises(dahl.Timeout):
        client.move(30)
    wire.loses = lambda frame: False
    answer = client.move(-7)
    for move in (100, 30, -7):
        alone.step_counts(move)
    assert (answer.ratio, client.count) == (pytest.approx(alone.torque / 0.7, abs=1e-6), 123)
    assert wire.counters() == [k % 16 for k in range(len(wire.counters()))]


@pytest.mark.parametrize("knows", ["by Status", "by write()", "not"])
def test_after_a_pause_the_node_answers_again_and_the_move_is_not_lost(wired, knows):
    one = dahl.Node(PLAN, timeout=0.02 if knows == "by Status" else 10)
    wire, alone = wired(one), dahl.Friction(PLAN)
    client = dahl.Client(wire)
    client.move(100)
    if knows == "by write()":
        assert client.write(Param.TIMEOUT, 0.02) == 0.02
    if knows == "not":  # another client changes it
        node.ask(wire, codec.ParamWrite.of_si(Param.TIMEOUT, 0.02))
    for _ in range(3):
        wire.now += 0.03  # STALE
        with pytest.raises(dahl.Timeout) if knows == "not" else contextlib.nullcontext():
            client.move(0)
        assert client.move(30).state == State.OK
    for move in (100, 30, 30, 30):
        alone.step_counts(move)
    assert client.torque == pytest.approx(alone.torque, abs=FC_STEP)
    assert one.counts.stale == 3


@pytest.mark.parametrize("timeout_ms", [4, 11, 2600])
def test_a_pause_is_that_of_the_node_to_the_millisecond(wired, timeout_ms):
    """Status has the timeout in steps of 10 ms, and only up to 2.55 s."""
    wire, alone = wired(dahl.Node(PLAN, timeout=timeout_ms / 1000)), dahl.Friction(PLAN)
    client = dahl.Client(wire)
    for pause in (0.51, 0.9, 1.1, 2):
        assert client.move(3).torque_q30 == alone.step_counts_q30(3)
        wire.now += pause * timeout_ms / 1000


def test_restart_ends_a_silence_that_three_good_frames_do_not_end(wired):
    one = dahl.Node(PLAN, timeout=10)
    wire = wired(one)
    client = dahl.Client(wire)
    client.move(100)
    off = can.Message(arbitration_id=BUS_OFF | 4, is_error_frame=True, dlc=8, data=bytes(8))
    for _ in range(4):
        one.receive(off, wire.now)
    for _ in range(2):
        with pytest.raises(dahl.Timeout):
            client.move(1)
    client.restart()
    assert client.torque == 0
    assert client.move(5).torque_q30 == dahl.Friction(PLAN).step_counts_q30(5)


def test_a_node_that_restarts_by_itself_says_so(wired):
    wire = wired(dahl.Node(PLAN, timeout=10))
    client = dahl.Client(wire)
    client.move(100)
    wire.nodes = (dahl.Node(PLAN, timeout=10),)
    answer = client.move(30)
    assert (answer.state, answer.ratio) == (State.INIT, 0)
    assert client.move(5).torque_q30 == dahl.Friction(PLAN).step_counts_q30(5)


def test_parameters_are_read_and_written_in_their_units(wired):
    wire = wired(dahl.Node(PLAN, gain=0.5, timeout=2, max_step=7))
    client = dahl.Client(wire)
    values = {Param.SIGMA0: 100, Param.FC: 0.7, Param.THETA: 3.8e-4, Param.GAIN: 0.5}
    values |= {Param.TIMEOUT: 2, Param.STEP: 7, Param.MODEL: 0, Param.LOAD: 1, Param.STATUS: 0.1}
    for param, value in values.items():
        assert client.read(param) == pytest.approx(value, rel=1e-5), param
    client.write(Param.STEP, 0)
    assert client.write(Param.GAIN, 0.25000001) == 0.25
    client.move(10**6)
    assert client.torque == pytest.approx(0.25 * 0.7, abs=FC_STEP)
    client.write(Param.FC, 0.35)
    client.move(10**6)
    assert client.torque == pytest.approx(0.25 * 0.35, abs=FC_STEP)
    for param, value, words in (
        (Param.TIMEOUT, 100, "value = 100 of parameter TIMEOUT .* keeps 2"),
        (Param.FC, -1, "value = -1"),
        (Param.FC, 1e-9, "value = .* keeps 0.35"),
        (Param.GAIN, 1.1, "GAIN .* keeps 0.25"),
        (77, 1, "param = 77"),
        (-1, 1, "param = -1"),
    ):
        with pytest.raises(dahl.InputError, match=words):
            client.write(param, value)


def test_a_move_beyond_max_step_is_not_answered_and_the_next_one_is(wired):
    one = dahl.Node(PLAN, max_step=50, timeout=10)
    client = dahl.Client(wired(one))
    before = client.move(20).ratio
    with pytest.raises(dahl.Timeout):
        client.move(10**6)
    assert client.move(0).ratio == before  # the node does not know that move
    assert client.count == 10**6 + 20 and one.counts.jump > 0


WRONG = [
    (lambda bus: dahl.Client(5), TypeError, "bus = 5"),
    (lambda bus: dahl.Client(bus, "0"), TypeError, "number = '0'"),
    (lambda bus: dahl.Client(bus, 16), dahl.InputError, "number = 16"),
    (lambda bus: dahl.Client(bus, timeout="1"), TypeError, "timeout = '1'"),
    (lambda bus: dahl.Client(bus, timeout=-1), dahl.InputError, "timeout = -1"),
    (lambda bus: dahl.Client(bus).move("1"), TypeError, "dcounts = '1'"),
    (lambda bus: dahl.Client(bus).move(0.5), dahl.InputError, "dcounts = 0.5"),
    (lambda bus: dahl.Client(bus).move(2**31), dahl.InputError, "dcounts = 2147483648"),
    (lambda bus: dahl.Client(bus).read("FC"), TypeError, "param = 'FC'"),
    (lambda bus: dahl.Client(bus).write(Param.FC, None), TypeError, "value = None"),
]


@pytest.mark.parametrize(("call", "kind", "words"), WRONG)
def test_a_wrong_argument_is_refused_and_nothing_is_sent(call, kind, words):
    wire = Wire(dahl.Node(PLAN))
    with pytest.raises(kind, match=words):
        call(wire)
    assert wire.sent == []


@pytest.mark.parametrize("error", [can.CanOperationError("cable out"), OSError("cable out")])
def test_a_lost_bus_is_a_connection_error(wired, error):
    wire = wired(dahl.Node(PLAN))
    client = dahl.Client(wire)
    client.move(5)
    wire.error = error
    for call in (lambda: client.move(5), lambda: client.read(Param.FC), client.restart):
        with pytest.raises(ConnectionError, match="cable out") as caught:
            call()
        assert isinstance(caught.value, dahl.BusError) and not isinstance(caught.value, ValueError)
    wire.error = None
    assert client.move(5).state == State.OK and client.count == 15


@contextlib.contextmanager
def served(*nodes: dahl.Node) -> Iterator[can.BusABC]:
    with two_ends() as (ours, theirs):
        notifier = can.Notifier(theirs, [node.Listener(theirs, *nodes)], timeout=0.02)
        yield ours
        notifier.stop()


def test_threads_share_a_bus_and_a_client():
    nodes = [dahl.Node(PLAN, number, timeout=60) for number in (0, 3)]
    with served(*nodes) as bus, ThreadPoolExecutor(4) as threads:
        clients = [dahl.Client(bus, one.number, timeout=60) for one in nodes]
        list(threads.map(lambda k: clients[k % 2].move(1), range(200)))
        assert [client.count for client in clients] == [100, 100]
        assert [one.counts.ok for one in nodes] == [101, 101]
        assert [(one.counts.lost, one.counts.repeated) for one in nodes] == [(0, 0)] * 2
