# SPDX-License-Identifier: MIT
"""`dahl node`: what it prints opens the bus, the node answers, Ctrl-C is its ordinary end."""

from __future__ import annotations

import contextlib
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator

import can
import pytest
from dahl import Friction, Plan, node
from dahl.codec import EncoderState, Param, ParamWrite
from identify_tools import caller
from loop_tools import SCENES, serving

OWN = ("--sigma0", "100", "--fc", "0.5", "--theta-per-count", "3.8e-4")
PLAN = Plan(100, 0.5, 3.8e-4)


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
    assert re.fullmatch(r"ended after \d+\.\d s: ok 4, params 1", last[-1])


def test_a_node_in_python_on_the_bus_that_is_named(root, tmp_path, dahl_loop, library):
    """Here another server, whose own node has another number."""
    hub = ("--role", "node", "--set", "friction.node=9")
    with serving(tmp_path, SCENES / "segments.ini", *hub) as (_, port):
        where = ("-i", "socketcand", "-c", "vcan0", "--host", "127.0.0.1", "--port", str(port))
        with started(root, *OWN, *where) as (lines, last), opened(lines) as bus:
            asked(bus)
    counts = dict(re.findall(r"(\w+) (\d+)(?:,|$)", last[-1]))
    assert (counts["ok"], counts["params"]) == ("4", "1")


@pytest.mark.checks
def test_firmware_on_an_emulated_core(root, dahl_loop, library):
    for program in ("arm-none-eabi-gcc", "qemu-system-arm"):
        if not shutil.which(program):
            pytest.skip(f"{program} is not installed (tools/setup.sh installs it)")
    with started(root, *OWN, "--target", "m4f") as (lines, last):
        assert "node_image on mps2-an386 in QEMU" in lines[0], lines
        with opened(lines) as bus:
            asked(bus)
    counts = dict(re.findall(r"(\w+) (\d+)(?:,|$)", last[-1]))
    assert counts["answers"] == "4"


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("-i", "virtual", "--target", "m4f"), "-i and --target: one of both"),
        (("-c", "vcan0"), "-c vcan0: of which interface?"),
        (("--fc", "3"), "--sigma0, --fc, --theta-per-count: all three, or a --scene"),
        ((*OWN, "--scene", "steering"), "--sigma0, --fc, --theta-per-count: all three, or a"),
        (("--scene", "nowhere"), "no scene 'nowhere'"),
        (("--host", "10.0.0.1"), "--host 10.0.0.1: it serves 127.0.0.1"),
        (("--target", "m4f", "--scene", "tribometer-slip"), "--target runs model dahl alone"),
        ((*OWN[:3], "-1", *OWN[4:]), "[friction] Fc = -1.0: outside"),
        ((*OWN[:3], "-1", *OWN[4:], "-i", "virtual", "-c", "x"), "Fc = -1 is outside 2^-64 <= Fc"),
        (("--node", "16"), "argument --node: 16: not an integer from 0 to 15"),
    ],
)
def test_what_cannot_be_is_one_line(capsys, dahl_loop, library, words, complaint):
    done = caller(capsys)("node", *words)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("error: ") and complaint in done.stderr
    assert done.stderr.count("\n") == 1
