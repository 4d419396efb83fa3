# SPDX-License-Identifier: MIT
"""The friction node as firmware in QEMU, with python-can over slcan: torques of the library, bad
frames, a trace equal to the host's bit for bit, random bytes on the serial line, parameters in
flash, and the demo.
"""

from __future__ import annotations

import contextlib
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
from dahl import codec
from dahl.codec import EncoderState, FrictionTorque, Param, ParamWrite, Reset, State, Write
from dahl.sim import firmware  # no public name starts QEMU with a page of parameters
from loop_tools import run

pytestmark = [pytest.mark.checks, pytest.mark.usefixtures("library")]

Params = tuple[float, float, float]
OURS: Params = (120.0, 1.8, 2.396844981071314e-05)  # sigma0, Fc, theta_per_count
TIMEOUT_US = 600000  # a busy host delays a frame by less
PATIENT_US = 60000000
TORQUE, STATUS, REPLY = 0x110, 0x120, 0x140
QUIET = 0.15  # s without an answer; longer than a period of Status


def image(core: str) -> Path:
    for tool in ("arm-none-eabi-gcc", "qemu-system-arm"):
        need(tool, "the node runs as firmware")
    return firmware.build(core)


def bristle(params: Params = OURS) -> dahl.Friction:
    """Return a bearing of the library."""
    return dahl.Friction(dahl.Plan(*params))


# --- on the bus ----------------------------------------------------------------------------------


@pytest.fixture
def bus(tmp_path) -> Iterator[can.BusABC]:
    node = firmware.Firmware("m4f", OURS, tmp_path, 0, TIMEOUT_US, image("m4f"))
    with node, can.Bus(**node.bus) as opened:
        yield opened


def heard(bus: can.BusABC, wanted: int, seconds: float = QUIET) -> Any:
    """Return the next frame with this id, unpacked; None if it does not come in time."""
    until = time.monotonic() + seconds
    while (left := until - time.monotonic()) > 0:
        message = bus.recv(left)
        if message is not None and message.arbitration_id == wanted:
            return codec.unpack(message)
    return None


def angle(count: int, counter: int) -> can.Message:
    return codec.pack(EncoderState(count=count, counter=counter % 16))


def ask(bus: can.BusABC, count: int, counter: int) -> FrictionTorque:
    """Send one angle; return its answer."""
    bus.send(angle(count, counter))
    answer = heard(bus, TORQUE, 2.0)
    assert answer is not None, "no answer"
    return answer


def test_each_answer_echoes_its_counter_with_the_torque_of_the_library(bus) -> None:
    """Also after a lost frame, because the count is absolute."""
    state, rng, count = bristle(), random.Random(3), 1000
    for n in range(300):
        step = rng.choice([0, 1, -1, 7, -300, 2000, -4000]) if n else 0
        count += step
        answer = ask(bus, count, n)
        assert (answer.echo, answer.state) == (n % 16, State.OK if n else State.INIT)
        assert answer.torque_q30 == state.step_counts_q30(step)
    answer = ask(bus, count + 3000, 301)
    assert answer.state == State.LOST
    assert answer.torque_q30 == state.step_counts_q30(3000)


def test_bad_and_foreign_frames_are_not_answered_and_move_nothing(bus) -> None:
    """Status counts the bad ones."""
    ask(bus, 0, 0)
    before = ask(bus, 500, 1).torque_q30
    broken, short, good = angle(900, 2), angle(900, 2), angle(77, 2)
    broken.data[0] ^= 1
    short.data, short.dlc = short.data[:7], 7
    remote = can.Message(arbitration_id=0x100, is_remote_frame=True, dlc=8, is_extended_id=False)
    extended = can.Message(arbitration_id=0x100, data=good.data, is_extended_id=True)
    foreign = [
        can.Message(arbitration_id=identifier, data=good.data, is_extended_id=False)
        for identifier in (0x101, 0x0FF, 0x110, 0x7FF)
    ]
    for bad in (broken, short, remote, angle(900, 1), angle(900, 9), *foreign, extended):
        bus.send(bad)
    assert heard(bus, TORQUE, 0.05) is None
    assert ask(bus, 500, 2).torque_q30 == before
    status = heard(bus, STATUS, 1.0)
    kinds = codec.Errors
    assert status.errors == kinds.CRC | kinds.FORMAT | kinds.REPEATED | kinds.WRONG_SEQUENCE
    assert (status.corrupt, status.out_of_step, status.lost) == (4, 2, 0)


def test_silence_makes_it_stale_while_status_goes_on(bus) -> None:
    """A motion during the silence changes no torque."""
    ask(bus, 0, 0)
    moved = ask(bus, 4000, 1).torque_q30
    assert heard(bus, STATUS, 10.0)
    start = time.monotonic()
    counters = [heard(bus, STATUS, 10.0).counter for _ in range(8)]
    assert 0.5 < time.monotonic() - start < 1.4  # every 0.1 s
    steps = [(b - a) % 16 for a, b in zip(counters, counters[1:], strict=False)]
    assert steps == [1] * 7
    for counter in (2, 3):
        bus.send(angle(900000, counter))
    answer = ask(bus, 900000, 4)
    assert (answer.state, answer.torque_q30) == (State.STALE, moved)


def test_parameters_and_reset(bus) -> None:
    """They can be written and read, have limits, and survive a restart."""

    def answer_to(param: Param, value: int = 0, write: Write = Write.READ) -> tuple[int, str]:
        bus.send(codec.pack(ParamWrite(param, value, write=write, counter=4)))
        reply = heard(bus, REPLY, 2.0)
        assert reply.param == param
        return reply.value, reply.result.name

    assert answer_to(Param.FC) == (round(OURS[1] * 2**20), "DONE")
    assert answer_to(Param.GAIN, 2**14, Write.WRITE) == (2**14, "DONE")
    assert answer_to(Param.TIMEOUT, 60001, Write.WRITE)[1] == "OUT_OF_RANGE"
    ask(bus, 0, 0)
    assert ask(bus, 2**24, 1).torque_q30 == pytest.approx(2**28, abs=2**10)
    bus.send(codec.pack(Reset(codec.What.RESTART)))
    assert heard(bus, STATUS, 2.0)
    answer = ask(bus, 7, 9)
    assert (answer.state, answer.torque_q30) == (State.INIT, 0)
    assert answer_to(Param.GAIN) == (2**14, "DONE")


# --- on the serial line --------------------------------------------------------------------------


class Serial:
    """The serial line of the firmware as bytes; a thread reads it."""

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
        """Return the complete lines with this head; BEL ends a line like CR."""
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


def line_of(count: int, counter: int, node: int = 0) -> bytes:
    message = angle(count, counter)
    return f"t{0x100 + node:03X}8{message.data.hex().upper()}".encode()


@pytest.fixture
def serial(tmp_path) -> Iterator:
    """Open firmware on a core: serial('m4f'). Its timeout is long, for busy hosts."""
    with contextlib.ExitStack() as stack:

        def start(core: str, params: Params | None = OURS, number: int = 0) -> Serial:
            node = firmware.Firmware(core, params, tmp_path, number, PATIENT_US, image(core))
            line = Serial(stack.enter_context(node).port)
            stack.callback(line.link.close)
            line.send(b"", b"C", b"O")
            return line

        yield start


@pytest.mark.parametrize("core", firmware.boards())
def test_a_trace_equals_that_of_the_host(core: str, serial, tmp_path) -> None:
    """A steering manoeuvre with at most 20 angles unanswered."""
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


def test_a_closed_port_skips_no_counter_of_status(serial) -> None:
    """The first counter is 0."""
    line = serial("m4f")
    line.wait(b"t120", 2)
    line.send(b"C")
    time.sleep(0.5)
    line.send(b"O")
    found = line.wait(b"t120", len(line.lines(b"t120")) + 2)
    assert len(found) >= 4
    assert [int(text[8:9], 16) for text in found] == [number % 16 for number in range(len(found))]


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
        torque = bristle(used).step_counts_q30(4000).to_bytes(4, "little", signed=True)
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
