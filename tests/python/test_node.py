# SPDX-License-Identifier: MIT
"""The node in Python against the program: the same frames in, the same frames out, bit for bit;
and on buses of python-can.
"""

from __future__ import annotations

import asyncio
import contextlib
import copy
import ctypes
import itertools
import os
import pickle
import random
import re
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import can
import dahl
import numpy as np
import pytest
from can_socket import BUS_OFF, ERROR, EXTENDED, REMOTE, frame, joined, plant
from conftest import ROOT
from dahl import codec, node, scene
from dahl.codec import EncoderState, Param, ParamWrite, Reset, State, What, Write
from loop_tools import SCENES, finished, read_log, run, wait_until

THETA = 3.8e-4
PLAN = dahl.Plan(100, 0.7, THETA)
MODELS = {  # keys of a scene, and the same in Python
    "dahl": ("sigma0 = 100\nFc = 0.7", PLAN),
    "slip": ("sigma0 = 100 30\nFc = 0.2 0.7", dahl.Slip([100, 30], [0.2, 0.7], THETA)),
    "parallel": (
        "kinds = slip dahl dahl\nsigma0 = 30 100 50\nFc = 0.7 0.2 0.05",
        dahl.Parallel(
            dahl.Slip([30], [0.7], THETA),
            dahl.Friction(dahl.Plan(100, 0.2, THETA)),
            dahl.Friction(dahl.Plan(50, 0.05, THETA)),
        ),
    ),
    "asymmetric": ("sigma0 = 100\nFc = 0.2 0.7", dahl.Asymmetric(100, 0.2, 0.7, THETA)),
    "elastoplastic": (
        "sigma0 = 100\nFc = 0.7\nbreakaway = 0.6",
        dahl.ElastoPlastic(100, 0.7, THETA, 0.6),
    ),
}
FROM_NODE = (0x110, 0x120, 0x140)


def said(message: can.Message | None) -> list[tuple[int, bytes]]:
    return [] if message is None else [(message.arbitration_id, bytes(message.data))]


def replayed(log: Path, python: dahl.Node) -> tuple[list, list]:
    """What the program answered in a run in virtual time, and what Python does to the same."""
    program, here, due = [], [], 0
    for line in read_log(log):
        tick = round(line.time * 1000)
        for ms in range(due, tick + 1):
            here += said(python.tick(ms / 1000))
        due = tick + 1
        if line.id & ~15 in FROM_NODE:
            program.append((line.id, line.data))
            continue
        error = bool(line.id & ERROR)
        message = can.Message(arbitration_id=line.id & ~ERROR, data=line.data, is_error_frame=error)
        message.is_extended_id = line.is_extended
        here += said(python.receive(message))
    return program, here


@pytest.mark.parametrize("model", MODELS)
def test_each_model_answers_as_the_program_does(tmp_path, model):
    path = tmp_path / "model.ini"
    path.write_text(
        f"[friction]\nmodel = {model}\n{MODELS[model][0]}\ntheta_per_count = {THETA}\n"
        "gain = 0.91\nlimit = 0.85\nramp_ms = 300\nmax_step = 5000\n"
        "[motion]\nkind = steering\namplitude = 900\nsweep_s = 0.7\nhold_s = 0.1\n"
        "tremor = 20\ntremor_s = 0.05\nseconds = 1.5\n[status]\nperiod_ms = 70\n"
    )
    result = run(tmp_path, path, "--virtual")
    assert result.code == 0, result.err
    settings = {"gain": 0.91, "limit": 0.85, "ramp": 0.3, "max_step": 5000, "status_period": 0.07}
    program, here = replayed(result.log, dahl.Node(MODELS[model][1], **settings))
    assert len(program) > 1500
    assert here == program
    ratios = {data[4:] for identifier, data in program if identifier == 0x110}
    assert len(ratios) > 200


def test_a_load_is_answered_as_the_program_does(tmp_path):
    """It follows the torque of a motor, told by parameter Load."""
    scene = tmp_path / "loaded.ini"
    scene.write_text(
        f"[friction]\nmodel = loaded\nsigma0 = 100\nFc = 0.7\ntheta_per_count = {THETA}\n"
        "[load]\nfull = 4\nrest = 0.25\n[rotor]\ninertia = 0.01\nsigma0 = 100\nFc = 0.7\n"
        "[motor]\namplitude = 2\nfrequency = 3\nseconds = 1\n[status]\nperiod_ms = 100\n"
    )
    result = run(tmp_path, scene, "--virtual")
    assert result.code == 0, result.err
    python = dahl.Node(dahl.Loaded(PLAN))
    program, here = replayed(result.log, python)
    assert here == program
    assert python.counts.params > 900


def test_a_load_that_leaves_the_stiffness_is_refused():
    loaded = dahl.Loaded(dahl.Plan(100, 0.5), fixed_stiffness=True)
    with pytest.raises(dahl.Error, match="fixed_stiffness steps by angle; a node counts"):
        dahl.Node(loaded)


def test_a_storm_of_faults_is_answered_as_the_program_does(tmp_path):
    """Frames lost, doubled, late, spoiled, cut, foreign; silences, bus-offs and restarts."""
    often = [f"--set=faults.{kind}=0.001" for kind in ("silence", "bus_off", "restart")]
    result = run(tmp_path, SCENES / "fault-storm.ini", "--virtual", "--seconds", "15", *often)
    assert result.code == 0, result.err
    python = dahl.Node(dahl.Plan(120, 1.8, 2.396844981071314e-05), max_step=2000)
    program, here = replayed(result.log, python)
    assert here == program
    counted = {name: getattr(python.counts, name) for name in result.summary["node"]}
    assert counted == result.summary["node"]
    assert min(count for name, count in counted.items() if name not in ("params",)) > 0


# --- the same script to the program, live, and to Python ------------------------------------------


def params(rng: random.Random) -> ParamWrite:
    """Any, good or bad, but none that lets the hour decide."""
    value = {
        Param.SIGMA0: rng.randrange(2**20),
        Param.FC: rng.randrange(2**22),
        Param.THETA: rng.randrange(2**30),
        Param.GAIN: rng.randrange(70000),
        Param.LIMIT: rng.randrange(70000),
        Param.RAMP: rng.choice([0, 60001]),
        Param.TIMEOUT: rng.choice([0, 59000, 60001]),
        Param.STEP: rng.choice([0, 1000, 1000, 2**31 - 1, 2**31]),
        Param.STATUS: rng.choice([0, 60001]),
        Param.MODEL: 1,
        Param.LOAD: rng.randrange(70000),
    }
    param, write = rng.choice(list(value)), rng.choice(list(Write))
    unknown = ParamWrite(77, 5, write)
    return rng.choice([ParamWrite(param, value[param], write, rng.randrange(16))] * 9 + [unknown])


def script(rng: random.Random, steps: int) -> Iterator[can.Message]:
    """Frames of an encoder that goes its way, and everything that can befall them."""
    counter, count = 0, 0
    for _ in range(steps):
        kind = rng.choices(
            ("next", "skip", "again", "crc", "cut", "extended", "remote", "fd", "invalid")
            + ("far", "param", "reset", "bus off", "error", "foreign"),
            (60, 6, 4, 4, 3, 3, 3, 3, 2, 3, 12, 2, 1, 1, 3),
        )[0]
        counter = (counter + {"again": 0, "skip": rng.randrange(2, 16)}.get(kind, 1)) % 16
        count += rng.randrange(-3, 4) if kind != "far" else 2**28
        count = (count + 2**31) % 2**32 - 2**31
        message = codec.pack(EncoderState(count, counter, kind != "invalid"))
        if kind in ("crc", "cut"):
            message.data[rng.randrange(8)] ^= 1 << rng.randrange(8)
        if kind == "cut":
            message.data = message.data[: rng.randrange(8)]
            message.dlc = len(message.data)
        message.is_extended_id = kind == "extended"
        message.is_remote_frame = kind == "remote"
        message.is_fd = kind == "fd"
        message.is_error_frame = kind in ("bus off", "error")
        if kind == "bus off":
            message.arbitration_id = BUS_OFF
        if kind == "foreign":
            message.arbitration_id = rng.choice([0x101, 0x110, 0x12F, 0x7FF])
        if kind == "param":
            message = codec.pack(params(rng))
        if kind == "reset":
            message = codec.pack(Reset(rng.choice(list(What)), rng.randrange(16)))
        yield message


def wire(message: can.Message) -> bytes:
    """struct can_frame, or struct canfd_frame."""
    flags = EXTENDED * message.is_extended_id | REMOTE * message.is_remote_frame
    identifier = message.arbitration_id | flags | ERROR * message.is_error_frame
    if message.is_fd:
        return struct.pack("=IB3x64s", identifier, message.dlc, bytes(message.data))
    return frame(identifier, bytes(message.data))


def heard(bus: socket.socket) -> tuple[int, bytes]:
    identifier, length, data = struct.unpack("=IB3x8s", bus.recv(100))
    return identifier, data[:length]


@pytest.mark.parametrize("model", ["dahl", "parallel"])
def test_any_frame_is_answered_as_the_program_does(tmp_path, model):
    """CRC errors, lost counters, short, remote, extended and FD frames, parameters, resets."""
    path = tmp_path / "node.ini"
    words = f"model = {model}\n{MODELS[model][0]}\ntheta_per_count = {THETA}\n"
    path.write_text(f"[friction]\n{words}timeout_ms = 60000\n")
    python = dahl.Node(MODELS[model][1], timeout=60, status_period=0)
    process, bus = joined(tmp_path, plant(tmp_path), "--role", "node", scene=path)
    answers = 0
    assert [heard(bus)] == said(python.tick())
    for message in script(random.Random(model), 6000):
        bus.send(wire(message))
        expected = said(python.receive(message)) + said(python.tick())
        assert [heard(bus) for _ in expected] == expected, message
        answers += len(expected)
    process.terminate()
    result = finished(tmp_path, process)
    assert bus.recv(100) == b"", "the program said more"
    bus.close()
    counts = {name: getattr(python.counts, name) for name in result.summary["node"]}
    assert counts == result.summary["node"]
    assert answers > 1000
    assert [name for name, count in counts.items() if count == 0] in ([], ["stale"])


def test_the_structure_is_that_of_the_header(tmp_path):
    """Offsets and sizes as the compiler has them."""
    names = [name for name, _ in node.NodeStructure._fields_]
    members = [re.sub("cleared_", "cleared.", name) for name in names]
    members = [f"counts.{name}" if name in node.COUNTS else name for name in members]
    members[names.index("parameters")] = "params"
    kept = ("slip", "asymmetric", "elastoplastic", "parallel")
    lines = [f'printf("%zu\\n", offsetof(dahl_node_t, {name}));' for name in members]
    lines += [f'printf("%zu\\n", sizeof({name}));' for name in ("dahl_node_t", "dahl_node_model_t")]
    lines += [f'printf("%zu\\n", sizeof(dahl_node_{name}_t));' for name in kept]
    program = "#include <stddef.h>\n#include <stdio.h>\n#include <dahl_node.h>\nint main(void) {"
    path = tmp_path / "offsets"
    words = ["cc", "-x", "c", "-", f"-I{ROOT / 'lib' / 'include'}", "-o", str(path)]
    subprocess.run(words, input=program + "".join(lines) + "}", text=True, check=True, timeout=60)
    done = subprocess.run([path], capture_output=True, text=True, check=True, timeout=60)
    *offsets, size, model, slip, asymmetric, elastoplastic, parallel = map(int, done.stdout.split())
    assert offsets == [getattr(node.NodeStructure, name).offset for name in names]
    assert (size, model) == (ctypes.sizeof(node.NodeStructure), node.MODEL_BYTES)
    assert max(slip, asymmetric, elastoplastic, parallel) <= 8 * node.KEPT_ROOM


# --- the class ------------------------------------------------------------------------------------


def moved(one: dahl.Node, *counts: int) -> list[codec.FrictionTorque]:
    """Answers to counts, from the counter on that comes next."""
    first = one.counts.ok
    messages = (codec.pack(EncoderState(c, (first + k) % 16)) for k, c in enumerate(counts))
    return [codec.unpack(one.receive(message)) for message in messages]


@pytest.mark.parametrize("model", MODELS)
def test_a_node_is_a_value_that_changes(model):
    one, other = (dahl.Node(MODELS[model][1], number=0) for _ in range(2))
    assert one == other
    moved(one, 0, 40, 30), moved(other, 0, -40, 30)
    assert one != other and other != dahl.Node(MODELS[model][1])
    for same in (copy.copy(one), copy.deepcopy(one), pickle.loads(pickle.dumps(one))):
        assert same == one and same is not one
        further = moved(same, 900)
        assert same != one
        assert further == moved(copy.copy(one), 900)
    assert repr(one).startswith(f"<Node {type(MODELS[model][1]).__name__}(")
    assert "state=OK, ok=3" in repr(one)


def test_time_is_the_callers():
    """STALE after the timeout and not before; a call without `now` is at the last one."""
    one = dahl.Node(PLAN, timeout=0.25, status_period=0)
    assert codec.unpack(one.tick(10.0)).state == State.INIT
    moved(one, 0, 5)
    assert one.tick(10.25) is None and one.state == State.OK
    status = codec.unpack(one.tick(10.2501))
    assert (status.state, status.out_of_step, status.timeout_s) == (State.STALE, 1, 0.25)
    assert one.errors == codec.Errors.STALE and one.counts.stale == 1
    assert one.receive(codec.pack(EncoderState(5, 2))) is None


@pytest.mark.parametrize("gap", [1001, 2200, 4294.967296 + 0.002, 1e5, 1e12])
def test_a_long_time_without_a_call_is_none_too_short(gap):
    """The clock of the C wraps after 71 minutes, and tells half of that."""
    one = dahl.Node(PLAN)
    one.tick(5.0)
    moved(one, 0, 5)
    assert one.receive(codec.pack(EncoderState(9000, 2)), 5.0 + gap) is None
    assert (one.state, one.counts.stale, one.counts.rearm) == (State.STALE, 1, 1)
    status = codec.unpack(one.tick())
    assert (status.state, status.counter, status.out_of_step) == (State.STALE, 1, 1)
    assert one.tick() is None
    assert one.receive(codec.pack(EncoderState(9000, 3))) is None
    assert codec.unpack(one.receive(codec.pack(EncoderState(9000, 4)))).state == State.STALE


def test_a_bus_off_of_long_ago_holds_nothing_back():
    """Where the clock of the C has come round to the same time."""
    one = dahl.Node(PLAN)
    off = can.Message(arbitration_id=BUS_OFF, is_error_frame=True, dlc=8, data=bytes(8))
    assert one.receive(off, 5.0) is None and one.counts.bus_off == 1
    frames = [codec.pack(EncoderState(5, counter)) for counter in range(3)]
    answers = [one.receive(message, 5.002 + 2**32 / 1e6) for message in frames]
    assert answers[:2] == [None, None] and answers[2] is not None


def test_a_copy_is_of_the_same_kind():
    """And so is what it is made of, which moves no further with what was given."""

    class Mine(dahl.Node):
        pass

    class Bearing(dahl.Plan):
        pass

    one = Mine(Bearing(PLAN.sigma0, PLAN.Fc, PLAN.theta_per_count))
    assert type(one.friction) is Bearing and moved(one, 0, 700) == moved(Mine(PLAN), 0, 700)
    for other in (copy.copy(one), copy.deepcopy(one)):
        assert type(other) is Mine and other == one
    one = dahl.Node(given := dahl.Slip([1], [1], 1e-3))
    given.step_counts(9)
    assert one.friction == dahl.Slip([1], [1], 1e-3) != given


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ({"friction": 3}, "friction = 3 is none of Plan, Slip, Parallel"),
        ({"friction": dahl.Plan(1, 1)}, "theta_per_count = 0"),
        ({"number": 16}, "number = 16 is not a whole number from 0 to 15"),
        ({"gain": 1.5}, "gain = 1.5 is outside 0 .. 1"),
        ({"timeout": 0}, "timeout = 0 is outside 0.001 .. 60 s"),
        ({"timeout": 60.01}, "timeout = 60.01 is outside 0.001 .. 60 s"),
        ({"ramp": 60.01}, "ramp = 60.01 is outside 0 .. 60 s"),
        ({"limit": -0.1}, "limit = -0.1 is outside 0 .. 1"),
        ({"status_period": 60.01}, "status_period = 60.01 is outside 0 .. 60 s"),
        ({"max_step": 2**31}, "max_step = 2147483648 is not a whole number"),
        ({"friction": dahl.Parallel()}, "friction has 0 elements, 1 to 8 were expected"),
        (
            {"friction": dahl.Parallel(dahl.Slip([1], [1], 1e-3), dahl.Slip([1], [1], 2e-3))},
            "friction has theta_per_count 0.001 and others",
        ),
        ({"nmber": 1}, "Node: nmber = 1: no such argument"),
    ],
)
def test_what_no_node_can_be_made_of_is_refused(words, complaint):
    with pytest.raises(dahl.Error) as caught:
        dahl.Node(**{"friction": PLAN, **words})
    assert str(caught.value).startswith(complaint)


@pytest.mark.parametrize("call", ["receive", "tick"])
def test_what_is_no_frame_and_no_time_is_refused(call):
    one = dahl.Node(PLAN)
    for junk in ("x", float("nan"), []):
        given = (junk,) if call == "tick" else (junk, 0.0)
        with pytest.raises(dahl.Error):
            getattr(one, call)(*given)


# --- on buses of python-can -----------------------------------------------------------------------


@pytest.fixture
def ends() -> Iterator[tuple[can.BusABC, can.BusABC]]:
    """Both ends of a bus of this process."""
    with (
        can.Bus(interface="virtual", channel="test_node") as one,
        can.Bus(interface="virtual", channel="test_node") as other,
    ):
        yield one, other


def converse(bus: can.BusABC, number: int = 0) -> None:
    """What a client sees: torques, parameters, resets, and Status when it falls silent."""
    alone = dahl.Friction(PLAN)
    for counter, count in enumerate((0, 30, 900, 850)):
        answer = node.ask(bus, EncoderState(count, counter), number)
        moves = count - (0, 0, 30, 900)[counter]
        assert answer.torque_q30 == alone.step_counts_q30(moves)
    reply = node.ask(bus, ParamWrite(Param.FC), number)
    assert (reply.result, reply.si) == (codec.Result.DONE, pytest.approx(PLAN.Fc))
    status = node.ask(bus, Reset(What.ERRORS), number)
    assert status.state == State.OK
    while status.state != State.STALE:  # after 100 ms
        message = bus.recv(2)
        assert message is not None
        status = codec.unpack(message) if message.arbitration_id == 0x120 + number else status


def test_a_notifier_serves_nodes(ends):
    here, there = ends
    nodes = [dahl.Node(PLAN, number) for number in (0, 3)]
    listener = node.Listener(here, *nodes)
    assert isinstance(listener, can.Listener)
    notifier = can.Notifier(here, [listener])
    try:
        for number in (0, 3):
            converse(there, number)
    finally:
        notifier.stop()
    assert [one.counts.ok for one in nodes] == [4, 4]
    assert all(one.counts.ignored == 0 for one in nodes)  # each sees what is its own
    assert listener.traffic.received == 12 and listener.traffic.refused == 0


def test_run_serves_until_it_is_told_to_end(ends):
    here, there = ends
    ended, traffic = threading.Event(), []
    words = {"ended": ended.is_set, "seconds": 30}
    server = threading.Thread(
        target=lambda: traffic.append(node.run(here, dahl.Node(PLAN), **words))
    )
    server.start()
    try:
        converse(there)
    finally:
        ended.set()
        server.join(10)
    assert not server.is_alive()
    assert traffic[0].received == 6 and traffic[0].sent >= 8


@pytest.mark.parametrize("numbers", [(0,), (0, 3)])
def test_what_of_a_bus_a_node_is_given(ends, numbers):
    """Its own answers do not come back to it, all else that this process sends does; of several
    nodes each has what has its number, and every bus-off.
    """
    nodes = [dahl.Node(PLAN, number) for number in numbers]
    listener = node.Listener(ends[0], *nodes)
    own, foreign = (codec.pack(codec.FrictionTorque(5)) for _ in range(2))
    foreign.is_rx = True
    off = can.Message(arbitration_id=BUS_OFF | 4, is_error_frame=True, dlc=8, data=bytes(8))
    for message in (codec.pack(EncoderState(0), 3), own, foreign, off):
        listener.on_message_received(message)
    listener.stop()
    found = [(one.counts.ok, one.counts.ignored, one.counts.bus_off) for one in nodes]
    assert found == {1: [(0, 2, 1)], 2: [(0, 1, 1), (1, 0, 1)]}[len(numbers)]
    assert listener.traffic.received == 4


def test_the_clock_is_looked_at_every_few_ms(ends):
    """By run() and by a Listener: a Status is due 15 times."""
    one = dahl.Node(PLAN, status_period=0.02)
    assert 8 <= node.run(ends[0], one, seconds=0.3).sent <= 16
    listener = node.Listener(ends[0], one)
    assert all(thread.daemon for thread in threading.enumerate() if thread.name == "dahl.node")
    time.sleep(0.3)
    listener.stop()
    assert 8 <= listener.traffic.sent <= 16


def test_asyncio_serves_until_the_task_is_cancelled(ends):
    here, there = ends

    async def both() -> None:
        server = asyncio.create_task(node.serve(here, dahl.Node(PLAN)))
        await asyncio.to_thread(converse, there)
        server.cancel()
        with pytest.raises(asyncio.CancelledError):
            await server
        there.send(codec.pack(EncoderState(0)))
        assert here.recv(0.2) is not None, "it receives still"

    asyncio.run(asyncio.wait_for(both(), 30))


def test_asyncio_serves_more_buses_than_its_threads():
    """And leaves asyncio's own threads to the caller."""
    count = len(os.sched_getaffinity(0)) + 6

    async def all_at_once() -> None:
        with contextlib.ExitStack() as buses:
            pairs = [
                [buses.enter_context(can.Bus(f"many{i}", interface="virtual")) for _ in range(2)]
                for i in range(count)
            ]
            servers = [asyncio.create_task(node.serve(here, dahl.Node(PLAN))) for here, _ in pairs]
            for _, there in pairs:
                await asyncio.wait_for(asyncio.to_thread(converse, there), 20)
            for server in servers:
                server.cancel()
            assert len(await asyncio.gather(*servers, return_exceptions=True)) == count

    asyncio.run(asyncio.wait_for(all_at_once(), 60))


def test_asyncio_hears_that_the_bus_has_gone():
    class Cut(can.BusABC):
        def __init__(self):
            super().__init__("x")

        def send(self, msg, timeout=None):
            pass

        def _recv_internal(self, timeout):
            raise can.CanOperationError("cable out")

    with Cut() as bus, pytest.raises(dahl.RunError, match="the bus has gone: cable out"):
        asyncio.run(asyncio.wait_for(node.serve(bus, dahl.Node(PLAN)), 10))


class Waiting:
    """A bus on which some frames wait, and others come after something was sent."""

    def __init__(self, before=(), after=(), refuses=False):
        self.queue, self.after, self.refuses = iter(before), list(after), refuses

    def recv(self, timeout=None):
        return next(self.queue, None)

    def send(self, message, timeout=None):
        if self.refuses:
            raise can.CanOperationError("no buffer space")
        self.queue = itertools.chain(self.after, self.queue)


def reply(value, counter=4, param=Param.FC):
    return codec.pack(codec.ParamReply(param, value, counter=counter))


def test_an_answer_is_to_what_was_asked():
    """Not one that waited, not to another counter or parameter, and nothing that is not whole."""
    spoiled = reply(7)
    spoiled.data[5] ^= 1
    extended = reply(8)
    extended.is_extended_id = True
    asked = ParamWrite(Param.FC, counter=4)
    others = [reply(2, counter=5), reply(3, param=Param.GAIN), spoiled, extended]
    assert node.ask(Waiting([reply(1)], [*others, reply(5), reply(6)]), asked).value == 5
    torques = [codec.pack(codec.FrictionTorque(7, echo=echo)) for echo in (2, 3, 4)]
    assert node.ask(Waiting([], torques), EncoderState(9, 3)).echo == 3
    none = reply(77, param=Param.NONE)
    assert node.ask(Waiting((), [none]), ParamWrite(77, counter=4)).param == Param.NONE
    with pytest.raises(dahl.RunError, match="no ParamReply of node 0 in 0.02 s"):
        node.ask(Waiting((), [none]), asked, timeout=0.02)


def test_a_bus_that_takes_nothing_is_one_line():
    with pytest.raises(dahl.RunError, match="does not take Reset.*: no buffer space"):
        node.ask(Waiting(refuses=True), Reset(What.RESTART))
    for timeout in (-1, float("nan"), 1e9, "x"):
        with pytest.raises(dahl.Error, match="timeout = "):
            node.ask(Waiting(refuses=True), Reset(What.RESTART), timeout=timeout)


def test_nobody_there_is_said(ends):
    with pytest.raises(dahl.RunError) as caught:
        node.ask(ends[0], EncoderState(1, 2), node=5, timeout=0.05)
    assert str(caught.value).startswith("no FrictionTorque of node 5 in 0.05 s, to EncoderState(")
    with pytest.raises(dahl.Error, match="none that a node answers"):
        node.ask(ends[0], codec.FrictionTorque(5))
    with pytest.raises(dahl.RunError, match="no Status of node 0 in 0.05 s"):  # others speak
        node.ask(Waiting(itertools.repeat(reply(1))), Reset(What.ERRORS), timeout=0.05)


ANEW = "; after a Reset with What.RESTART it answers"
REPEATED = "; REPEATED is among its errors: each EncoderState has a counter one higher"


@pytest.mark.parametrize(
    ("timeout", "counter", "words"),
    [
        (0.05, 1, f"STALE{ANEW}"),
        (60, 9, f"WRONG_SEQUENCE{ANEW}"),
        (0.25, 0, f"STALE{ANEW}{REPEATED}"),
        (60, 0, f"REPEATED{REPEATED}"),
    ],
)
def test_a_node_that_does_not_answer_has_its_state_told(ends, timeout, counter, words):
    """What leads out of that stands in the error, and does so."""
    theirs, ours = ends
    notifier = can.Notifier(theirs, [node.Listener(theirs, dahl.Node(PLAN, timeout=timeout))])
    try:
        node.ask(ours, EncoderState(0, 0))
        time.sleep(0.2)
        with pytest.raises(dahl.RunError, match=f"; its Status says {words}$"):
            node.ask(ours, EncoderState(0, counter), timeout=0.3)
        node.ask(ours, Reset(What.RESTART))
        assert node.ask(ours, EncoderState(0, 0)).ratio == 0
    finally:
        notifier.stop()


def test_two_nodes_of_one_number_are_refused(ends):
    for nodes in ((), (dahl.Node(PLAN), dahl.Node(PLAN)), ("x",)):
        with pytest.raises(dahl.Error):
            node.run(ends[0], *nodes, seconds=0)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ({"seconds": float("nan")}, "seconds = nan is not a number of s, 0 or above"),
        ({"seconds": -1}, "seconds = -1 is not a number of s, 0 or above"),
        ({"seconds": "1"}, "seconds = '1' is not a number; a number of s"),
        ({"seconds": True}, "seconds = True is not a number"),
        ({"seconds": 0, "ended": None}, "ended = None cannot be called"),
        ({"second": 0}, "run: second = 0: no such argument"),
    ],
)
def test_what_run_cannot_take_is_refused(ends, words, complaint):
    with pytest.raises(dahl.Error) as caught:
        node.run(ends[0], dahl.Node(PLAN), **words)
    assert str(caught.value).startswith(complaint)


@pytest.mark.parametrize("bus", [None, "can0", 5])
def test_what_is_no_bus_is_refused(bus):
    for call in (
        lambda: node.run(bus, dahl.Node(PLAN), seconds=0),
        lambda: node.ask(bus, EncoderState(0)),
        lambda: node.Listener(bus, dahl.Node(PLAN)),
    ):
        with pytest.raises(dahl.Error, match="is not a bus of python-can"):
            call()


def test_a_number_of_numpy_names_a_node(ends):
    notifier = can.Notifier(ends[0], [node.Listener(ends[0], dahl.Node(PLAN, np.uint8(3)))])
    try:
        assert node.ask(ends[1], EncoderState(5, 0), np.int8(3)).ratio == 0
    finally:
        notifier.stop()


@pytest.mark.parametrize("identifier", [2**29, -1, 256.5, None, "256"])
def test_an_id_that_no_bus_has_is_refused(identifier):
    message = codec.pack(EncoderState(5))
    message.arbitration_id = identifier
    for call in (codec.unpack, dahl.Node(PLAN).receive):
        with pytest.raises(dahl.Error, match="arbitration_id = "):
            call(message)


def test_a_message_is_as_long_as_it_says():
    message = codec.pack(EncoderState(5))
    message.dlc = 4
    with pytest.raises(dahl.Error, match="4 bytes, 8 were expected"):
        codec.unpack(message)


@pytest.mark.parametrize("error", [can.CanOperationError, OSError])
def test_a_bus_that_takes_nothing_is_counted(ends, error):
    class Full:
        def send(self, _: can.Message) -> None:
            raise error("Transmit buffer full")

        def recv(self, _: float) -> None:
            return None

    assert node.run(Full(), dahl.Node(PLAN), seconds=0.03).refused == 1
    listener = node.Listener(ends[0], dahl.Node(PLAN))
    wait_until(lambda: listener.traffic.sent == 1)
    listener.stop()
    assert replace(listener.traffic) == node.Traffic(0, 1, 0)


@pytest.mark.parametrize("model", [*MODELS, "loaded"])
def test_a_scene_names_the_same_node(tmp_path, model):
    """What `dahl node` makes of a scene is what dahl-loop makes of it."""
    path = tmp_path / "scene.ini"
    keys, friction = {**MODELS, "loaded": (MODELS["dahl"][0], dahl.Loaded(PLAN))}[model]
    words = f"model = {model}\n{keys}\ntheta_per_count = {THETA}\n"
    kept = "gain = 0.5\nlimit = 0.25\nramp_ms = 300\nmax_step = 7\ntimeout_ms = 20\n"
    path.write_text(f"[friction]\n{words}{kept}[status]\nperiod_ms = 40\n")
    read = scene.read(path)
    made = dahl.Node(scene.element(read), **scene.settings(read))
    both = {"slip": (130, 0.9), "parallel": (180, 0.95)}.get(model, (100, 0.7))
    assert (read.sigma0, read.Fc) == pytest.approx(both)
    assert made == dahl.Node(
        friction,
        **{"gain": 0.5, "limit": 0.25, "ramp": 0.3, "max_step": 7, "timeout": 0.02},
        status_period=0.04,
    )
    path.write_text(f"[friction]\n{words}")
    assert scene.settings(scene.read(path)) == {"status_period": 0}


SLIP = "model = slip\nsigma0 = 100 40"
MIX = "model = parallel\nsigma0 = 100 40\nFc = 0.5 0.3"


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("model = dhal\nsigma0 = 1\nFc = 1", "model = dhal is none of dahl, slip"),
        ("sigma0 = 100\nFc = 0.5\ngian = 0.2", "has no key 'gian' (known: model, sigma0, Fc"),
        ("sigma0 = 100\nFc = 1\n[status]\nperiod = 9", "has no key 'period' (known: period_ms)"),
        ("sigma0 = 100 40\nFc = 0.5 0.3", "sigma0 has 2 numbers and Fc 2: not those of dahl"),
        (f"{SLIP}\nFc = 0.5", "sigma0 has 2 numbers and Fc 1: not those of slip"),
        ("model = asymmetric\nsigma0 = 1\nFc = 1", "Fc 1: not those of asymmetric"),
        (f"{SLIP}\nFc = 1 1\nkinds = slip slip", "kinds has no meaning for model = slip"),
        ("sigma0 = 1\nFc = 1\nbreakaway = 0.5", "breakaway has no meaning for model = dahl"),
        (f"{MIX}\nkinds = dahl", "kinds = dahl: not dahl or slip for each of 2"),
        (f"{MIX}\nkinds = dahl slpi", "kinds = dahl slpi: not dahl or slip for each of 2"),
        (MIX, "kinds = : not dahl or slip for each of 2"),
        ("theta_per_count = 1", "has no sigma0 and Fc"),
    ],
)
def test_a_scene_that_dahl_loop_refuses_makes_no_node(tmp_path, keys, words):
    """Half of it would answer other torques than the user meant."""
    (path := tmp_path / "scene.ini").write_text(f"[friction]\n{keys}\n")
    with pytest.raises(dahl.Error) as caught:
        scene.element(scene.read(path))
    assert str(caught.value).startswith(f"{path}: [") and words in str(caught.value)


def test_what_needs_python_can_says_so(monkeypatch):
    """The frames as bytes do not."""
    monkeypatch.setitem(sys.modules, "can", None)
    data = codec.to_bytes(EncoderState(5))
    assert codec.from_bytes(0x100, data) == EncoderState(5)
    for call in (lambda: codec.pack(EncoderState(5)), lambda: dahl.Node(PLAN).tick()):
        with pytest.raises(dahl.RunError, match="python-can is not here; pip install"):
            call()
