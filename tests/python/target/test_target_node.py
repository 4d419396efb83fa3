# SPDX-License-Identifier: MIT
"""The friction node as firmware in QEMU, over slcan: a timeout, a trace equal to the host's bit for
bit, random bytes on the serial line, parameters in flash, and the demo.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import random
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
import dahl
import pytest
from conftest import ROOT, need
from dahl import codec, node
from dahl.codec import EncoderState, Param, ParamWrite, State, Write
from dahl.sim import firmware  # no public name starts QEMU with a page of parameters
from loop_tools import run

pytestmark = [pytest.mark.checks, pytest.mark.usefixtures("library")]

Params = tuple[float, float, float]
OURS: Params = (120.0, 1.8, 2.396844981071314e-05)  # sigma0, Fc, theta_per_count
PATIENT_US = 60000000  # the timeout; a busy host delays frames


def image(core: str) -> Path:
    for tool in ("arm-none-eabi-gcc", "qemu-system-arm"):
        need(tool, "the node runs as firmware")
    return firmware.build(core)


# --- on the bus ----------------------------------------------------------------------------------


@pytest.fixture
def bus(tmp_path) -> Iterator[can.BusABC]:
    image_node = firmware.Firmware("m4f", OURS, tmp_path, 0, PATIENT_US, image("m4f"))
    with image_node, can.Bus(**image_node.bus) as opened:
        yield opened


def ask(bus: can.BusABC, frame: Any) -> Any:
    return node.ask(bus, frame, timeout=60)


def next_status(bus: can.BusABC) -> codec.Status:
    while (message := bus.recv(60)).arbitration_id != codec.Status.base:
        pass
    return codec.unpack(message)


def test_silence_makes_it_stale_while_status_goes_on(bus) -> None:
    """A motion during the silence changes no torque. No Status is skipped."""
    ask(bus, ParamWrite(Param.TIMEOUT, 300, Write.WRITE))
    ask(bus, EncoderState(0, 0))
    moved = ask(bus, EncoderState(4000, 1)).torque_q30
    found: list[codec.Status] = []
    while not found or found[-1].state != State.STALE or len(found) < 8:
        found.append(next_status(bus))
    steps = [(b.counter - a.counter) % 16 for a, b in itertools.pairwise(found)]
    assert steps == [1] * len(steps)
    ask(bus, ParamWrite(Param.TIMEOUT, 60000, Write.WRITE))
    for counter in (2, 3):
        node.expect_silence(bus, EncoderState(900000, counter), seconds=0.01)
    answer = ask(bus, EncoderState(900000, 4))
    assert (answer.state, answer.torque_q30) == (State.STALE, moved)


# --- on the serial line --------------------------------------------------------------------------


class Serial:
    def __init__(self, port: int) -> None:
        self.link = socket.create_connection(("127.0.0.1", port))
        self.text = bytearray()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        with contextlib.suppress(OSError):
            while piece := self.link.recv(65536):
                self.text += piece

    def send(self, *lines: bytes) -> None:
        self.link.sendall(b"".join(line + b"\r" for line in lines))

    def lines(self, head: bytes) -> list[bytes]:
        whole = bytes(self.text).replace(b"\a", b"\r").rpartition(b"\r")[0]
        return [line for line in whole.split(b"\r") if line.startswith(head)]

    def wait(self, head: bytes, number: int, seconds: float = 30) -> list[bytes]:
        """Wait for this number of lines, or until none has come for some seconds."""
        known, last = 0, time.monotonic()
        while known < number and time.monotonic() - last < seconds:
            time.sleep(0.005)
            if (now := len(self.lines(head))) != known:
                known, last = now, time.monotonic()
        return self.lines(head)


def line_of(count: int, counter: int, number: int = 0) -> bytes:
    message = codec.pack(EncoderState(count, counter % 16))
    return f"t{0x100 + number:03X}8{message.data.hex().upper()}".encode()


@pytest.fixture
def serial(tmp_path) -> Iterator:
    """Open firmware on a core: serial('m4f'). Its timeout is long, for busy hosts."""
    with contextlib.ExitStack() as stack:

        def start(core: str, params: Params | None = OURS, number: int = 0) -> Serial:
            image_node = firmware.Firmware(core, params, tmp_path, number, PATIENT_US, image(core))
            line = Serial(stack.enter_context(image_node).port)
            stack.callback(line.link.close)
            line.send(b"", b"C", b"O")
            return line

        yield start


@pytest.mark.parametrize("core", firmware.boards())
def test_a_trace_equals_that_of_the_host(core: str, serial, tmp_path) -> None:
    seconds = 10 if core == "m4f" else 2
    scene = ROOT / "host_sim/scenes/steering.ini"
    log = run(tmp_path, scene, "--virtual", "--seconds", str(seconds)).log.read_text()
    frames = [line.split()[2].replace("#", "8") for line in log.splitlines()]
    asked = [f"t{frame}".encode() for frame in frames if frame.startswith("100")]
    answers = [f"t{frame}".encode() for frame in frames if frame.startswith("110")]
    assert len(asked) == len(answers) == seconds * 1000
    assert len({answer[-8:] for answer in answers}) > seconds * 150
    line = serial(core)
    for n in range(0, len(asked), 20):
        line.send(*asked[n : n + 20])
        line.wait(b"t110", min(n + 20, len(asked)), 10)
    assert line.lines(b"t110") == answers


# QEMU passes one byte at a time to the CMSDK UART and six to that of the nRF51, which is faster.
@pytest.mark.parametrize(
    "core, pieces", [("m0", 100), ("m4f", 10), pytest.param("m4f", 100, marks=pytest.mark.long)]
)
def test_the_node_answers_after_random_bytes(core: str, pieces: int, serial) -> None:
    line = serial(core)
    line.send(b"F", line_of(0, 0))
    assert len(line.wait(b"t110", 1)) == 1
    rng = random.Random(11)
    for _ in range(pieces):
        line.link.sendall(rng.randbytes(10000))
    line.send(b"", b"", b"C", b"O", b"F")
    assert line.wait(b"F80", 1, 200), "no answer after all these bytes"
    answered = len(line.lines(b"t110"))
    line.send(*(line_of(10 * n, n) for n in range(20)))
    now = len(line.wait(b"t110", answered + 20, 1))
    assert now >= answered + 18  # the first ones are out of sequence
    assert line.text.count(b"\a") > 30 * pieces


def test_no_status_is_lost_on_a_closed_line(serial) -> None:
    """The node does not count frames that a closed line would discard."""
    line = serial("m4f")
    line.wait(b"t120", 1)
    line.send(b"C")
    time.sleep(0.35)  # three periods of Status
    line.send(b"O")
    found = line.wait(b"t120", len(line.lines(b"t120")) + 2)
    counters = [int(one[8:9], 16) for one in found]
    assert {(b - a) % 16 for a, b in itertools.pairwise(counters)} == {1}


@pytest.mark.parametrize(
    ("params", "number", "used"),
    [
        (OURS, 0, OURS),
        (OURS, 5, OURS),
        (None, 0, (36500.0, 2.7, 1e-7)),
        ((-1.0, 1.8, 1e-5), 0, None),
    ],
)
def test_parameters_and_number_from_flash(serial, params, number, used) -> None:
    """A blank page means defaults; wrong parameters leave a node without torque."""
    line = serial("m4f", params, number)
    line.send(line_of(0, 0, number), line_of(4000, 1, number), b"V")
    assert line.wait(b"V", 1)
    head = f"t{0x110 + number:03X}".encode()
    if used is None:
        assert not line.lines(b"t1")
    else:
        bearing = dahl.Friction(dahl.Plan(*used))
        torque = bearing.step_counts_q30(4000).to_bytes(4, "little", signed=True)
        assert line.wait(head, 2)[1].decode().endswith(torque.hex().upper())


# --- tools/demo.sh --target ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scene", "number", "seconds"),
    [("steering", 0, 4), ("segments", 3, 0.3), ("segments", 15, 0.3)],
)
def test_the_demo_runs_with_firmware(run_dahl, dahl_loop, tmp_path, scene, number, seconds) -> None:
    """Each angle gets its exact answer, however slow the emulation, because the encoder waits. The
    number is that of the scene, even if another program of the bus has the same.
    """
    for tool in ("arm-none-eabi-gcc", "qemu-system-arm"):
        need(tool, "the demo runs with firmware on an emulated core")
    text = (ROOT / f"host_sim/scenes/{scene}.ini").read_text()
    own = tmp_path / "own.ini"
    own.write_text(text.replace("[friction]", f"[friction]\nnode = {number}") if number else text)
    words = ("--scene", own, "--seconds", seconds, "--target", "m4f", "--output", tmp_path / "run")
    done = run_dahl("demo", *words)
    assert done.returncode == 0, done.stderr
    numbers = json.loads((tmp_path / "run/summary.json").read_text())
    ticks = round(1000 * seconds)
    assert (numbers["target"], numbers["ticks"]) == ("m4f", ticks)
    assert (numbers["frames_answered"], numbers["frames_lost"]) == (ticks, 0)
    assert numbers["node"] == {} and numbers["max_error_ulp_Fc"] <= 0.52
    assert (tmp_path / "run/loop.png").stat().st_size > 10000
