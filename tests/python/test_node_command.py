# SPDX-License-Identifier: MIT
"""`dahl node`: what it prints opens the bus, the node answers, Ctrl-C is its ordinary end."""

from __future__ import annotations

import argparse
import contextlib
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import can
import pytest
from dahl import Error, Friction, Node, Plan, node, scene
from dahl.bus import named
from dahl.cli import build_parser
from dahl.codec import EncoderState, Errors, FrictionTorque, Param, ParamWrite, State, Status, pack
from dahl.commands import node as node_command
from dahl.interrupt import Stop
from identify_tools import caller
from loop_tools import SCENES, serving

OWN = ("--sigma0", "100", "--fc", "0.5", "--theta-per-count", "3.8e-4")
PLAN = Plan(100, 0.5, 3.8e-4)
TIMING = ("f_clock=8000000", "brp=2", "tseg1=5", "tseg2=2", "sjw=2", "nof_samples=1")


@contextlib.contextmanager
def started(root, *words: str, end: int = signal.SIGINT) -> Iterator[tuple[list[str], list[str]]]:
    """What it says at first, and at the end."""
    command = [sys.executable, "-m", "dahl", "node", *words]
    process = subprocess.Popen(
        command, cwd=root, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    last: list[str] = []
    try:
        lines = []
        while not lines or lines[-1] not in ("Ctrl-C ends\n", ""):
            lines.append(process.stdout.readline())
        yield lines, last
        process.send_signal(end)
        out, err = process.communicate(timeout=20)
        assert (process.returncode, err) == (0, "")
        last += out.splitlines()
    finally:
        process.kill()
        process.communicate()


def opened(lines: list[str]) -> can.BusABC:
    """By the line of Python that it prints."""
    (call,) = [line.removeprefix("open    ") for line in lines if line.startswith("open    ")]
    return eval(call, {"can": can})


def asked(bus: can.BusABC, number: int = 0) -> None:
    """Torques as those of a bearing, and parameters as they were given."""
    bearing = Friction(PLAN)
    for counter, (count, move) in enumerate([(0, 0), (9, 9), (40, 31), (-7, -47)]):
        answer = node.ask(bus, EncoderState(count, counter), number, timeout=10)
        assert answer.torque_q30 == bearing.step_counts_q30(move)
    reply = node.ask(bus, ParamWrite(Param.FC), number, timeout=10)
    assert reply.si == PLAN.Fc


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
def test_a_served_node_by_the_line_that_it_prints(root, dahl_loop, library, end):
    with started(root, *OWN, "--node", "3", end=end) as (lines, last):
        assert "parameters of your own: dahl, Fc 0.5 N m" in lines[0]
        with opened(lines) as bus:
            asked(bus, 3)
            assert node.ask(bus, ParamWrite(Param.STATUS), 3, timeout=10).si == 0.1
    assert re.fullmatch(r"ended after \d+\.\d s: ok 4, params 2", last[-1])


def test_the_number_is_that_of_the_scene_unless_another_is_given(
    root, capsys, tmp_path, dahl_loop, library
):
    (path := tmp_path / "own.ini").write_text(
        "[friction]\nsigma0 = 100\nFc = 0.5\ntheta_per_count = 3.8e-4\nnode = 3\n"
    )
    with started(root, "--scene", str(path)) as (lines, _), opened(lines) as bus:
        asked(bus, 3)
    assert lines[0].startswith("node    3 ") and lines[2].endswith(" --node 3\n")
    words = ("--scene", path, "--node", 0, "-i", "virtual", "-c", "a rig", "--seconds", "0.05")
    assert caller(capsys)("node", *words).stdout.startswith("node    0 ")


def test_a_node_in_python_on_the_bus_that_is_named(root, tmp_path, dahl_loop, library):
    """Here another server, whose own node has another number."""
    hub = ("--role", "node", "--set", "friction.node=9")
    with serving(tmp_path, SCENES / "segments.ini", *hub) as (_, port):
        where = ("-i", "socketcand", "-c", "vcan0", "--host", "127.0.0.1", "--port", str(port))
        with started(root, *OWN, *where) as (lines, last), opened(lines) as bus:
            asked(bus)
    counts = dict(re.findall(r"(\w+) (\d+)(?:,|$)", last[-1]))
    assert (counts["ok"], counts["params"]) == ("4", "1")


def test_a_second_node_of_the_same_number_is_refused(
    tmp_path, capsys, monkeypatch, dahl_loop, library
):
    """Two would answer each angle with the same id; clients see one torque twice, or two."""
    assert node_command.LISTEN == 0.25  # s, as the pages say
    monkeypatch.setattr("dahl.commands.node.LISTEN", 20.0)  # ends with the first frame
    hub = ("--role", "node", "--set", "friction.node=3")
    with serving(tmp_path, SCENES / "segments.ini", *hub) as (_, port):
        where = ("-i", "socketcand", "-c", "vcan0", "--host", "127.0.0.1", "--port", str(port))
        done = caller(capsys)("node", *OWN, *where, "--node", "3", "--seconds", "1")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "error: node 3 is on this bus already; --node takes another number\n"


def test_the_printed_lines_name_the_same_bus(capsys, library):
    """`watch` as the monitor's own parser takes it, `open` as Python does: nothing left out."""
    words = ("-i", "virtual", "-c", "a rig", "-b", "500000", "--fd", "--data-bitrate", "2000000")
    words += ("--timing", *TIMING, "--bus-kwargs", "preserve_timestamps=True", "rx_queue_size=7")
    words += ("--node", "3")
    done = caller(capsys)("node", *OWN, *words, "--seconds", "0.05")
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines(keepends=True)
    assert re.fullmatch(r"ended after \d+\.\d s: no frame came\n", lines[-1])
    assert any(line.startswith("note ") for line in lines)  # that python-can's bus stays in here
    (watch,) = [line for line in lines if line.startswith("watch   dahl monitor ")]
    read = build_parser().parse_args(shlex.split(watch)[2:])
    meant = build_parser().parse_args(["monitor", *words])
    assert len(named(meant)) == 7
    assert (read.node, named(read)) == (3, named(meant))
    with opened(lines) as bus:
        assert (bus.channel_id, bus.preserve_timestamps, bus.queue.maxsize) == ("a rig", True, 7)


def test_what_the_bus_did_not_take_is_told(capsys, monkeypatch, library):
    monkeypatch.setattr(node, "run", lambda *_, **__: node.Traffic(received=9, refused=3))
    done = caller(capsys)("node", *OWN, "-i", "virtual", "-c", "a rig")
    assert done.stdout.endswith(": not sent 3\n")


def test_a_value_that_firmware_keeps_otherwise_is_refused(tmp_path, library):
    """Its steps of a timeout are whole ms."""
    (path := tmp_path / "own.ini").write_text(
        "[friction]\nsigma0 = 100\nFc = 0.5\ntheta_per_count = 3.8e-4\ntimeout_ms = 9000.4\n"
    )
    with can.Bus("rig", "virtual") as here, can.Bus("rig", "virtual") as there:
        notifier = can.Notifier(here, [node.Listener(here, Node(PLAN))])
        try:
            with pytest.raises(Error, match=r"timeout = 9.0004: the firmware keeps 9$"):
                node_command._configure(there, 0, scene.read(path))
        finally:
            notifier.stop()


def test_a_server_that_ends_before_its_time_is_told(capsys, monkeypatch, tmp_path):
    script = "echo 'socketcand 127.0.0.1:5 serves'\nsleep 0.3\necho error: no rig >&2\nexit 1\n"
    (program := tmp_path / "loop").write_text(f"#!/bin/sh\n{script}")
    program.chmod(0o755)
    monkeypatch.setenv("DAHL_LOOP", str(program))
    begun = time.monotonic()
    done = caller(capsys)("node", *OWN, "--host", "127.0.0.1", "--seconds", "30")
    assert (done.returncode, done.stderr) == (1, "error: no rig\n")
    assert time.monotonic() - begun < 20


def test_a_timing_without_an_interface_is_refused(capsys):
    """In one line, below that in which python-can repeats it."""
    done = caller(capsys)("node", "--timing", *TIMING)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert done.stderr.startswith("error: --timing f_clock=8000000 brp=2 tseg1=5")


@pytest.mark.parametrize("number", [0, 3])
def test_answers_and_status_of_its_own_node_alone_are_told(library, number):
    """Each frame of the bus is counted, whoever sent it."""
    with can.Bus("rig", "virtual") as other, can.Bus("rig", "virtual") as bus:
        for sender, answers in ((0, 1), (3, 2), (4, 4)):
            other.send(pack(EncoderState(0), sender))
            for _ in range(answers):
                other.send(pack(FrictionTorque(5), sender))
            counts = (5 + sender, 9 + sender, 1)
            other.send(pack(Status(1, State.OK, Errors(0), *counts, 0, 2, 25), sender))
        args = argparse.Namespace(node=number, seconds=0.01)
        found = node_command._watch(args, Stop(), bus)
    told = {"lost": 5 + number, "corrupt": 9 + number, "out_of_step": 1}
    assert found == {"frames": 13, "answers": {0: 1, 3: 2}[number], **told}


@pytest.mark.checks
def test_firmware_on_an_emulated_core(root, tmp_path, dahl_loop, library):
    """With all that the scene says of it, and the number that the bus's own node has else."""
    for program in ("arm-none-eabi-gcc", "qemu-system-arm"):
        if not shutil.which(program):
            pytest.skip(f"{program} is not installed (tools/setup.sh installs it)")
    scene = tmp_path / "own.ini"
    keys = "sigma0 = 100\nFc = 0.5\ntheta_per_count = 3.8e-4\nmax_step = 2000\ntimeout_ms = 9000\n"
    scene.write_text(f"[friction]\n{keys}[status]\nperiod_ms = 70\n")
    with started(root, "--scene", str(scene), "--target", "m4f", "--node", "15") as (lines, last):
        assert "node_image on mps2-an386 in QEMU" in lines[0], lines
        with opened(lines) as bus:
            asked(bus, 15)
            values = {Param.STEP: 2000, Param.TIMEOUT: 9, Param.STATUS: 0.07}
            for param, value in values.items():
                reply = node.ask(bus, ParamWrite(param), 15, timeout=10)
                assert reply.si == pytest.approx(value)
    counts = dict(re.findall(r"(\w+) (\d+)(?:,|$)", last[-1]))
    assert counts["answers"] == "4"


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("-i", "virtual", "--target", "m4f"), "-i and --target: one of both"),
        (("-c", "vcan0"), "-c vcan0: of which interface?"),
        (("-b", "500000"), "-b 500000: of which interface?"),
        (("--fd",), "--fd: of which interface?"),
        (("--data-bitrate", "9"), "--data-bitrate 9: of which interface?"),
        (("--bus-kwargs", "a=1", "b=2"), "--bus-kwargs a=1 b=2: of which interface?"),
        (
            ("-i", "virtual", "--host", "x", "--bus-kwargs", "host=y"),
            "host=y: --host x says it too",
        ),
        (("--fc", "3"), "--sigma0, --fc, --theta-per-count: all three, or a --scene"),
        ((*OWN, "--scene", "steering"), "--sigma0, --fc, --theta-per-count: all three, or a"),
        (("--scene", "nowhere"), "no scene 'nowhere'"),
        (("--host", "10.0.0.1"), "--host 10.0.0.1: it serves 127.0.0.1"),
        (("--target", "m4f", "--scene", "tribometer-slip"), "--target runs model dahl alone"),
        (("--target", "m4f", "--scene", "slow-reversal"), "--target runs model dahl alone"),
        ((*OWN[:3], "-1", *OWN[4:]), "error: Fc = -1 is outside 2^-64 <= Fc"),
        ((*OWN[:5], "0"), "theta_per_count = 0 is outside 2^-64 <= theta_per_count"),
        (("--port", "65536"), "argument --port: 65536: not an integer from 0 to 65535"),
        ((*OWN[:3], "-1", *OWN[4:], "-i", "virtual", "-c", "x"), "Fc = -1 is outside 2^-64 <= Fc"),
        (("--node", "16"), "argument --node: 16: not an integer from 0 to 15"),
    ],
)
def test_what_cannot_be_is_one_line(capsys, dahl_loop, library, words, complaint):
    done = caller(capsys)("node", *words)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("error: ") and complaint in done.stderr
    assert done.stderr.count("\n") == 1
