# SPDX-License-Identifier: MIT
"""Nodes in Python on buses of python-can: node.run, Listener and serve answer, node.ask waits for
it. Then buses that are silent, full or gone.
"""

import asyncio
import contextlib
import itertools
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace

import can
import dahl
import numpy as np
import pytest
from bus_frames import two_ends
from can_socket import BUS_OFF
from dahl import codec, node
from dahl.can import bus as buses
from dahl.can import rig
from dahl.codec import EncoderState, Param, ParamWrite, Reset, State, What
from loop_tools import wait_until

PLAN = dahl.Plan(100, 0.7, 3.8e-4)
Ends = tuple[can.BusABC, can.BusABC]


@pytest.fixture
def ends() -> Iterator[Ends]:
    with two_ends() as pair:
        yield pair


@contextlib.contextmanager
def listening(bus: can.BusABC, *nodes: dahl.Node) -> Iterator[node.Listener]:
    listener = node.Listener(bus, *nodes)
    notifier = can.Notifier(bus, [listener])
    try:
        yield listener
    finally:
        notifier.stop()


def new_node(number: int = 0) -> dahl.Node:
    """A node that a busy machine does not make stale."""
    return dahl.Node(PLAN, number, timeout=60)


def converse(bus: can.BusABC, number: int = 0) -> None:
    def ask(frame: codec.Frame) -> codec.Frame:
        return node.ask(bus, frame, number, timeout=60)

    alone = dahl.Friction(PLAN)
    for counter, count in enumerate((0, 30, 900, 850)):
        moves = count - (0, 0, 30, 900)[counter]
        assert ask(EncoderState(count, counter)).torque_q30 == alone.step_counts_q30(moves)
    reply = ask(ParamWrite(Param.FC))
    assert (reply.result, reply.si) == (codec.Result.DONE, pytest.approx(PLAN.Fc))
    status = ask(Reset(What.ERRORS))
    assert status.state == State.OK
    ask(ParamWrite.of_si(Param.TIMEOUT, 0.02))
    while status.state != State.STALE:
        message = bus.recv(60)
        if message.arbitration_id == 0x120 + int(number):
            status = codec.unpack(message)


# --- the node's side ------------------------------------------------------------------------------


def test_a_notifier_serves_several_nodes(ends):
    nodes = [new_node(number) for number in (0, np.uint8(3))]
    with listening(ends[0], *nodes) as listener:
        assert isinstance(listener, can.Listener)
        for number in (0, np.int8(3)):
            converse(ends[1], number)
    assert [(one.counts.ok, one.counts.ignored) for one in nodes] == [(4, 0)] * 2
    assert listener.traffic.received == 14 and listener.traffic.refused == 0


def test_run_serves_until_its_condition_ends_it(ends):
    ended, traffic = threading.Event(), []
    words = {"ended": ended.is_set, "seconds": 300}
    server = threading.Thread(target=lambda: traffic.append(node.run(ends[0], new_node(), **words)))
    server.start()
    try:
        converse(ends[1])
    finally:
        ended.set()
        server.join(60)
    assert not server.is_alive()
    assert traffic[0].received == 7 and traffic[0].sent >= 8


def test_asyncio_serves_more_buses_than_its_threads_until_each_task_is_cancelled():
    """asyncio's own threads stay free for the caller, and a bus can be read afterwards."""
    count = len(os.sched_getaffinity(0)) + 6

    async def all_at_once() -> None:
        with contextlib.ExitStack() as buses:
            pairs = [
                [buses.enter_context(can.Bus(f"many{i}", interface="virtual")) for _ in range(2)]
                for i in range(count)
            ]
            servers = [asyncio.create_task(node.serve(here, new_node())) for here, _ in pairs]
            for _, there in pairs:
                await asyncio.wait_for(asyncio.to_thread(converse, there), 60)
            for server in servers:
                server.cancel()
            ends = await asyncio.gather(*servers, return_exceptions=True)
            assert [type(end) for end in ends] == [asyncio.CancelledError] * count
            pairs[0][1].send(codec.pack(EncoderState(0)))
            assert pairs[0][0].recv(10) is not None

    asyncio.run(asyncio.wait_for(all_at_once(), 120))


@pytest.mark.parametrize("numbers", [(0,), (0, 3)])
def test_a_listener_hands_over_frames_by_number_and_each_bus_off(ends, numbers):
    """A node does not receive its own answers, but it does receive other frames of this process."""
    nodes = [dahl.Node(PLAN, number) for number in numbers]
    listener = node.Listener(ends[0], *nodes)
    own, odd, foreign = (codec.pack(codec.FrictionTorque(5), number) for number in (0, 3, 0))
    foreign.is_rx = True
    off = can.Message(arbitration_id=BUS_OFF | 4, is_error_frame=True, dlc=8, data=bytes(8))
    for message in (codec.pack(EncoderState(0), 3), own, odd, foreign, off):
        listener.on_message_received(message)
    listener.stop()
    found = [(one.counts.ok, one.counts.ignored, one.counts.bus_off) for one in nodes]
    assert found == {1: [(0, 2, 1)], 2: [(0, 1, 1), (1, 0, 1)]}[len(numbers)]
    assert listener.traffic.received == 5


def test_run_and_listener_send_status_in_its_period(ends):
    """They wait at least this long; a busy machine waits longer."""
    here, there = ends
    sent_s: list[float] = []
    period, wanted = 0.02, 6

    def is_enough() -> bool:
        while there.recv(0):
            sent_s.append(time.monotonic())
        return len(sent_s) >= wanted

    one = dahl.Node(PLAN, status_period=period)
    assert node.run(here, one, seconds=0).sent == 0
    assert node.run(here, one, ended=is_enough, seconds=60).sent >= wanted
    assert sent_s[-1] - sent_s[0] > (wanted - 2) * period
    sent_s.clear()
    listener = node.Listener(here, one)
    assert all(thread.daemon for thread in threading.enumerate() if thread.name == "dahl.node")
    wait_until(is_enough, 60)
    listener.stop()
    assert sent_s[-1] - sent_s[0] > (wanted - 2) * period


class Waiting:
    def __init__(self, before=(), after=(), refuses=None, gone=False):
        self.queue, self.after, self.refuses, self.gone = iter(before), list(after), refuses, gone

    def recv(self, timeout=None):
        if self.gone:
            raise can.CanOperationError("cable out")
        return next(self.queue, None)

    def send(self, message, timeout=None):
        if self.refuses:
            raise self.refuses("no buffer space")
        self.queue = itertools.chain(self.queue, self.after)


@pytest.mark.parametrize("error", [can.CanOperationError, OSError])
def test_a_bus_that_refuses_frames_is_counted(error):
    full = Waiting(refuses=error)
    assert node.run(full, dahl.Node(PLAN), seconds=0.03) == node.Traffic(0, 0, 1)
    listener = node.Listener(full, dahl.Node(PLAN))
    wait_until(lambda: listener.traffic.refused == 1, 60)
    listener.stop()
    with pytest.raises(dahl.RunError, match="Reset.*no buffer space"):
        node.ask(full, Reset(What.RESTART))


def test_a_bus_that_has_gone_is_one_line():
    gone = Waiting(gone=True)
    for call in (
        lambda: node.run(gone, dahl.Node(PLAN), seconds=9),
        lambda: asyncio.run(asyncio.wait_for(node.serve(gone, dahl.Node(PLAN)), 10)),
        lambda: node.ask(gone, EncoderState(0)),
    ):
        with pytest.raises(dahl.RunError, match="cable out"):
            call()


def test_a_rig_that_opens_too_late_is_closed(monkeypatch):
    may_open, closed = threading.Event(), threading.Event()
    late = SimpleNamespace(shutdown=closed.set)
    monkeypatch.setattr(rig.buses, "open_bus", lambda **_: may_open.wait(60) and late)
    with pytest.raises(rig.NoRig):
        rig.open_rig({"interface": "socketcand"}, 0.01)
    may_open.set()
    assert closed.wait(60)


# --- the client's side ----------------------------------------------------------------------------


def reply(value: int, counter: int = 4, param: Param = Param.FC) -> can.Message:
    return codec.pack(codec.ParamReply(param, value, counter=counter))


def test_ask_returns_the_answer_to_its_frame():
    spoiled, extended = reply(7), reply(8)
    spoiled.data[5] ^= 1
    extended.is_extended_id = True
    asked = ParamWrite(Param.FC, counter=4)
    other_node = codec.pack(codec.ParamReply(Param.FC, 9, counter=4), 1)
    others = [reply(2, counter=5), reply(3, param=Param.GAIN), spoiled, extended, other_node]
    assert node.ask(Waiting([reply(1)], [*others, reply(5), reply(6)]), asked).value == 5
    torques = [codec.pack(codec.FrictionTorque(7, echo=echo)) for echo in (2, 3, 4)]
    assert node.ask(Waiting([], torques), EncoderState(9, 3)).echo == 3
    old, new = (
        codec.pack(codec.Status(1, State.OK, codec.Errors(0), n, 0, 0, 0, 2, 25)) for n in (9, 0)
    )
    assert node.ask(Waiting([old], [new]), Reset(What.ERRORS)).lost == 0
    none = reply(77, param=Param.NONE)
    assert node.ask(Waiting((), [none]), ParamWrite(77, counter=4)).param == Param.NONE
    with pytest.raises(dahl.RunError, match=r"ParamReply of node 0 in 0\.02 s"):
        node.ask(Waiting((), [none]), asked, timeout=0.02)


def test_a_missing_answer_is_named_with_node_and_frame(ends):
    for kind in (TimeoutError, dahl.RunError):
        with pytest.raises(kind):
            node.ask(ends[0], EncoderState(1), timeout=0)
    with pytest.raises(dahl.RunError, match=r"FrictionTorque of node 5 in 0\.05 s.*EncoderState\("):
        node.ask(ends[0], EncoderState(1, 2), node=5, timeout=0.05)
    busy = Waiting(itertools.repeat(reply(1)))
    with pytest.raises(dahl.RunError, match=r"Status of node 0 in 0\.05 s"):
        node.ask(busy, Reset(What.ERRORS), timeout=0.05)


def test_a_client_waits_for_its_default_time(monkeypatch):
    """By a clock that only recv() advances."""
    clock, silent = SimpleNamespace(now_s=0.0), Waiting()
    monkeypatch.setattr(node, "time", SimpleNamespace(monotonic=lambda: clock.now_s))
    silent.recv = lambda seconds: setattr(clock, "now_s", clock.now_s + seconds)
    node.expect_silence(silent)
    assert clock.now_s == pytest.approx(0.1)
    with pytest.raises(dahl.Timeout, match="in 1 s"):
        node.ask(silent, EncoderState(0))
    assert clock.now_s == pytest.approx(1.1)


SPOILED = codec.pack(EncoderState(5))
SPOILED.data[5] ^= 1
STATUS = codec.pack(codec.Status(1, State.OK, codec.Errors(0), 0, 0, 0, 0, 2, 25))
TORQUE, OTHER = (codec.pack(codec.FrictionTorque(7), number) for number in (0, 1))


@pytest.mark.parametrize("asked", [None, EncoderState(5), SPOILED])
@pytest.mark.parametrize(
    ("after", "is_answer"),
    [((), False), ((STATUS, SPOILED, OTHER), False), ((STATUS, TORQUE), True), ((reply(1),), True)],
)
def test_expect_silence_raises_only_for_an_answer_of_that_node(asked, after, is_answer):
    bus = Waiting([TORQUE], after)
    sent, send = [], bus.send
    bus.send = lambda message: (sent.append(bytes(message.data)), send(message))
    if asked is None:
        bus.queue = iter([TORQUE, None, *after])
    with pytest.raises(dahl.RunError, match="node 0") if is_answer else contextlib.nullcontext():
        node.expect_silence(bus, asked, seconds=60 if is_answer else 0.02)
    wanted = codec.pack(asked) if isinstance(asked, codec.Frame) else asked
    assert sent == ([] if asked is None else [bytes(wanted.data)])


@pytest.mark.parametrize(
    ("timeout", "counter", "words"),
    [
        (0.05, 1, {"STALE", "RESTART"}),
        (60, 9, {"WRONG_SEQUENCE", "RESTART"}),
        (60, 0, {"REPEATED"}),
    ],
)
def test_the_error_of_a_missing_answer_names_state_and_remedy(ends, timeout, counter, words):
    theirs, ours = ends
    with listening(theirs, dahl.Node(PLAN, timeout=timeout, status_period=0.02)):
        node.ask(ours, EncoderState(0, 0), timeout=60)
        time.sleep(0.2)
        with pytest.raises(dahl.RunError) as caught:
            node.ask(ours, EncoderState(0, counter), timeout=1)
        known = {"STALE", "WRONG_SEQUENCE", "RESTART", "REPEATED"}
        assert {word for word in known if word in str(caught.value)} == words
        node.ask(ours, Reset(What.RESTART), timeout=60)
        assert node.ask(ours, EncoderState(0, 0), timeout=60).ratio == 0


# --- refusals -------------------------------------------------------------------------------------

BUS = Waiting()
REFUSED: list[tuple[Callable[[], object], str]] = [
    *((lambda v=v: node.run(BUS, dahl.Node(PLAN), seconds=v), f"seconds = {v!r}")
      for v in (float("nan"), -1)),
    (lambda: node.ask(BUS, Reset(What.RESTART), timeout=1e9), "timeout = "),
    (lambda: node.run(BUS, seconds=0), "no node"),
    (lambda: node.run(BUS, dahl.Node(PLAN), dahl.Node(PLAN), seconds=0), "number"),
    (lambda: node.ask(BUS, EncoderState(0), 16), "node = 16"),
    (lambda: node.expect_silence(BUS, seconds=-1), "seconds = -1"),
    (lambda: node.expect_silence(BUS, node=16), "node = 16"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "words"), REFUSED)
def test_a_wrong_value_is_refused(call, words):
    with pytest.raises(dahl.InputError, match=words):
        call()


WRONG_TYPES: list[tuple[Callable[[], object], str]] = [
    (lambda: node.run(BUS, dahl.Node(PLAN), seconds=True), "seconds = True"),
    (lambda: node.run(BUS, dahl.Node(PLAN), seconds=0, ended=None), "ended = None"),
    (lambda: node.run(BUS, dahl.Node(PLAN), second=0), "second"),
    (lambda: node.run(BUS, dahl.Node(PLAN), "x", seconds=0), r"nodes\[1\] = 'x'"),
    (lambda: node.ask(BUS, codec.FrictionTorque(5)), "frame = Friction"),
    (lambda: node.expect_silence(BUS, 5, seconds=0), "5 is not a can.Message"),
    (lambda: node.run(None, dahl.Node(PLAN), seconds=0), "bus = None"),
    (lambda: node.ask(5, EncoderState(0)), "bus = 5"),
    (lambda: node.Listener(None, dahl.Node(PLAN)), "bus = None"),
]


@pytest.mark.parametrize(("call", "words"), WRONG_TYPES)
def test_a_wrong_type_is_a_type_error(call, words):
    with pytest.raises(TypeError, match=words):
        call()


@pytest.mark.parametrize("error", [can.CanOperationError, OSError])
def test_a_lost_bus_and_a_missing_answer_are_os_errors_and_no_value_errors(ends, error):
    """A program that retries after ConnectionError or TimeoutError must not retry a wrong value."""
    calls = [
        (lambda: node.ask(Waiting(gone=True), EncoderState(0)), ConnectionError),
        (lambda: node.expect_silence(Waiting(refuses=error), EncoderState(5)), ConnectionError),
        (lambda: buses.open_bus(interface="socketcand", host="x", channel="y"), ConnectionError),
        (lambda: node.ask(ends[0], EncoderState(0), timeout=0.01), TimeoutError),
    ]
    for call, kind in calls:
        with pytest.raises(kind) as caught:
            call()
        assert isinstance(caught.value, dahl.RunError) and not isinstance(caught.value, ValueError)


def test_without_python_can_frames_are_bytes_and_other_calls_name_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "can", None)
    data = codec.to_bytes(EncoderState(5))
    assert codec.from_bytes(0x100, data) == EncoderState(5)
    for call in (lambda: codec.pack(EncoderState(5)), lambda: dahl.Node(PLAN).tick()):
        with pytest.raises(dahl.RunError, match=r"pip install 'python-can\[serial\]>=[\d.]+'"):
            call()
