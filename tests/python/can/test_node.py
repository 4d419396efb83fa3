# SPDX-License-Identifier: MIT
"""The node in Python against the program: the same frames in, the same frames out, bit for bit; and
dahl.Node as a value with a clock that is the caller's.
"""

from __future__ import annotations

import copy
import ctypes
import pickle
import random
import socket
import struct
import subprocess
from collections.abc import Iterator
from pathlib import Path

import can
import dahl
import pytest
from can_socket import BUS_OFF, ERROR, EXTENDED, REMOTE, frame, joined, plant
from conftest import ROOT
from dahl import codec
from dahl.codec import EncoderState, Param, ParamWrite, Reset, State, What, Write
from loop_tools import SCENES, finished, read_log, run

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
    "loaded": ("sigma0 = 100\nFc = 0.7", dahl.Loaded(PLAN)),
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


STEERING = "[motion]\nkind = steering\namplitude = 900\nsweep_s = 0.7\nhold_s = 0.1\n"
STEERING += "tremor = 20\ntremor_s = 0.05\nseconds = 1.5\n"
MOTOR = "[load]\nfull = 4\nrest = 0.25\n[rotor]\ninertia = 0.01\nsigma0 = 100\nFc = 0.7\n"
MOTOR += "[motor]\namplitude = 2\nfrequency = 3\nseconds = 1\n"


@pytest.mark.parametrize("model", MODELS)
def test_each_model_answers_as_the_program_does(tmp_path, model):
    """With a gain, a limit and a ramp; a load follows the torque of a motor, by parameter Load."""
    keys, friction = MODELS[model]
    path = tmp_path / "model.ini"
    path.write_text(
        f"[friction]\nmodel = {model}\n{keys}\ntheta_per_count = {THETA}\n"
        "gain = 0.91\nlimit = 0.85\nramp_ms = 300\nmax_step = 5000\n"
        f"{MOTOR if model == 'loaded' else STEERING}[status]\nperiod_ms = 70\n"
    )
    result = run(tmp_path, path, "--virtual")
    assert result.code == 0, result.err
    settings = {"gain": 0.91, "limit": 0.85, "ramp": 0.3, "max_step": 5000, "status_period": 0.07}
    program, here = replayed(result.log, python := dahl.Node(friction, **settings))
    assert here == program
    ratios = {data[4:] for identifier, data in program if identifier == 0x110}
    assert len(program) > 1000 and len(ratios) > 200
    assert (python.counts.params > 900) == (model == "loaded")


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
    assert [name for name, count in counted.items() if count == 0] in ([], ["params"])


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
    for message in script(random.Random(model), 4000):
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


def test_the_library_has_room_for_all_that_it_writes(tmp_path):
    """As the compiler has it. An exception to the public names: too little room would show nowhere
    else, but spoil the memory beside it.
    """
    kept = ("slip", "asymmetric", "elastoplastic", "parallel", "loaded")
    types = ["dahl_node_t", *(f"dahl_node_{name}_t" for name in kept)]
    lines = [f'printf("%zu\\n", sizeof({name}));' for name in types]
    program = "#include <stdio.h>\n#include <dahl_node.h>\nint main(void) {"
    words = ["cc", "-x", "c", "-", f"-I{ROOT / 'lib' / 'include'}", "-o", tmp_path / "sizes"]
    subprocess.run(words, input=program + "".join(lines) + "}", text=True, check=True, timeout=60)
    done = subprocess.run([tmp_path / "sizes"], capture_output=True, text=True, check=True)
    size, *needed = map(int, done.stdout.split())
    one = dahl.Node(PLAN)
    assert ctypes.sizeof(one._node) == size
    assert ctypes.sizeof(one._kept) >= max(needed)


# --- the class ------------------------------------------------------------------------------------


def moved(one: dahl.Node, *counts: int) -> list[codec.FrictionTorque]:
    """Answers to counts, from the counter on that comes next."""
    first = one.counts.ok
    messages = (codec.pack(EncoderState(c, (first + k) % 16)) for k, c in enumerate(counts))
    return [codec.unpack(one.receive(message)) for message in messages]


@pytest.mark.parametrize("model", MODELS)
def test_a_node_is_a_value_that_changes(model):
    """It moves no further with what it was made of, and a copy goes its own way."""
    one, other = (dahl.Node(MODELS[model][1], number=0) for _ in range(2))
    assert one == other
    moved(one, 0, 40, 30), moved(other, 0, -40, 30)
    assert one != other and other != dahl.Node(MODELS[model][1])
    for same in (copy.copy(one), copy.deepcopy(one), pickle.loads(pickle.dumps(one))):
        assert same == one and same is not one and same.counts == one.counts
        further = moved(same, 900)
        assert same != one
        assert further == moved(copy.copy(one), 900)
    assert one.friction == MODELS[model][1] and "state=OK, ok=3" in repr(one)
    given = copy.deepcopy(MODELS[model][1])
    one = dahl.Node(given)
    if hasattr(given, "run_counts"):
        given.run_counts(*[[1]] * (2 if model == "loaded" else 1))
        assert one.friction != given


def test_a_copy_is_of_the_same_kind():
    """And a model of a subclass is a model."""

    class Mine(dahl.Node):
        pass

    class Bearing(dahl.Plan):
        pass

    one = Mine(Bearing(PLAN.sigma0, PLAN.Fc, PLAN.theta_per_count))
    assert type(one.friction) is Bearing and moved(one, 0, 700) == moved(Mine(PLAN), 0, 700)
    for other in (copy.copy(one), copy.deepcopy(one)):
        assert type(other) is Mine and other == one


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


@pytest.mark.parametrize("gap", [999, 1001, 2200, 4294.967296 + 0.002, 1e5, 1e12])
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


LIMITS = {  # of each setting: a value just beyond, and the limit that is told
    "number": [(-1, "0"), (16, "15")],
    "gain": [(-0.001, "0"), (1.001, "1")],
    "limit": [(-0.001, "0"), (1.001, "1")],
    "ramp": [(-0.001, "0"), (60.01, "60")],
    "timeout": [(0, "0.001"), (0.0009, "0.001"), (60.01, "60")],
    "status_period": [(-0.001, "0"), (60.01, "60")],
    "max_step": [(-1, "0"), (2**31, "2147483647")],
}
SLIPS = [dahl.Slip([1] * 5, [1] * 5, theta) for theta in (1e-3, 1e-3, 2e-3)]
NO_FRICTION = [
    (3, "3"),
    (dahl.Plan(1, 1), "theta_per_count = 0"),
    (dahl.Loaded(PLAN, fixed_stiffness=True), "fixed_stiffness"),
    (dahl.Parallel(), "0 elements"),
    (dahl.Parallel(*SLIPS[:2]), "10 elements"),
    (dahl.Parallel(dahl.Slip([1], [1], 1e-3), dahl.Slip([1], [1], 2e-3)), "theta_per_count"),
]


def test_what_no_node_can_be_made_of_is_refused():
    """And both limits of each setting are taken."""
    for name, beyond in LIMITS.items():
        for value, limit in beyond:
            with pytest.raises(dahl.Error, match=rf"{name} = {value}\b.* {limit}\b"):
                dahl.Node(PLAN, **{name: value})
            dahl.Node(PLAN, **{name: float(limit)})
    for friction, word in NO_FRICTION:
        with pytest.raises(dahl.Error, match=word):
            dahl.Node(friction)
    with pytest.raises(dahl.Error, match="nmber = 1"):
        dahl.Node(PLAN, nmber=1)


@pytest.mark.parametrize("identifier", [2**29, -1, 256.5, None, "256"])
def test_what_is_no_frame_and_no_time_is_refused(identifier):
    one, before = dahl.Node(PLAN), dahl.Node(PLAN)
    message = codec.pack(EncoderState(5))
    message.arbitration_id = identifier
    for call in (codec.unpack, one.receive):
        with pytest.raises(dahl.Error, match="arbitration_id = "):
            call(message)
    for junk in ("x", float("nan"), []):
        for call, given in ((one.tick, (junk,)), (one.receive, (junk, 0.0))):
            with pytest.raises(dahl.Error):
                call(*given)
    assert one == before
