# SPDX-License-Identifier: MIT
"""The friction node as firmware in QEMU, over slcan: a timeout, a trace equal to the host's bit for
bit, random bytes on the serial line, parameters in flash, and the demo.
"""

import contextlib
import itertools
import json
import random
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import dahl
import pytest
from conftest import ROOT, need
from dahl import codec, node
from dahl.codec import EncoderState, Param, ParamWrite, State, Write
from dahl.facts import BOARDS
from dahl.target import firmware  # no public name starts QEMU with a page of parameters
from loop_tools import is_running, message_of, read_log, run, wait_until

pytestmark = pytest.mark.checks

Params = tuple[float, float, float]
OURS: Params = (120.0, 1.8, 2.396844981071314e-05)  # sigma0, Fc, theta_per_count
PATIENT_US = 60000000  # the timeout; a busy host delays frames
PATIENT_S = 60


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., can.BusABC]]:
    """Run firmware on a core: start("m4f") is its bus."""
    for tool in ("arm-none-eabi-gcc", "qemu-system-arm"):
        need(tool, "the node runs as firmware")
    with contextlib.ExitStack() as stack:

        def opened(core: str, params: Params | None = OURS, number: int = 0) -> can.BusABC:
            image = firmware.Firmware(core, params, tmp_path, number, PATIENT_US)
            bus = stack.enter_context(image).bus
            return stack.enter_context(can.Bus(**bus, sleep_after_open=0))

        yield opened


def frames(bus: can.BusABC, identifier: int, number: int) -> list[can.Message]:
    """Return the next frames with this identifier; fewer if the node is silent."""
    found: list[can.Message] = []
    while len(found) < number and (message := bus.recv(PATIENT_S)):
        found += [message] if message.arbitration_id == identifier else []
    return found


def statuses(bus: can.BusABC, number: int) -> list[codec.Status]:
    """Return the next Status frames. None between them is skipped."""
    found = [codec.unpack(one) for one in frames(bus, codec.Status.base, number)]
    steps = [(b.counter - a.counter) % 16 for a, b in itertools.pairwise(found)]
    assert steps == [1] * (number - 1)
    return found


def test_silence_makes_it_stale_while_status_goes_on(start) -> None:
    """A motion during the silence changes no torque."""
    bus = start("m4f")

    def ask(frame: object) -> object:
        return node.ask(bus, frame, timeout=PATIENT_S)

    ask(ParamWrite(Param.TIMEOUT, 300, Write.WRITE))
    ask(EncoderState(0, 0))
    moved = ask(EncoderState(4000, 1)).torque_q30
    assert statuses(bus, 8)[-1].state == State.STALE
    ask(ParamWrite(Param.TIMEOUT, 60000, Write.WRITE))
    for counter in (2, 3):
        node.expect_silence(bus, EncoderState(900000, counter), seconds=0.01)
    answer = ask(EncoderState(900000, 4))
    assert (answer.state, answer.torque_q30) == (State.STALE, moved)


@pytest.mark.parametrize("core", BOARDS)
def test_a_trace_equals_that_of_the_host(core: str, start, tmp_path: Path) -> None:
    seconds = 10 if core == "m4f" else 2
    scene = ROOT / "host_sim/scenes/steering.ini"
    log = read_log(run(tmp_path, scene, "--virtual", "--seconds", str(seconds)).log)
    asked, answers = ([one for one in log if one.id == base] for base in (0x100, 0x110))
    assert len(asked) == len(answers) == seconds * 1000
    assert len({bytes(answer.data) for answer in answers}) > seconds * 150
    bus = start(core)
    for n in range(0, len(asked), 20):
        for one in asked[n : n + 20]:
            bus.send(message_of(one))
        found = [bytes(one.data) for one in frames(bus, 0x110, 20)]
        assert found == [bytes(one.data) for one in answers[n : n + 20]]


# QEMU passes one byte at a time to the CMSDK UART and six to that of the nRF51, which is faster.
@pytest.mark.parametrize(
    "core, pieces", [("m0", 100), ("m4f", 10), pytest.param("m4f", 100, marks=pytest.mark.long)]
)
def test_the_node_answers_after_random_bytes(core: str, pieces: int, start) -> None:
    """In time: the bytes fill the serial line for a while. The first frames are out of sequence."""
    bus = start(core)
    rng, port = random.Random(11), bus.serialPortOrig
    for _ in range(pieces):
        port.write(rng.randbytes(10000))
    port.write(b"\r\rC\rO\r")
    for n in range(22):
        bus.send(codec.pack(EncoderState(10 * n, n % 16)))
    echoes = [codec.unpack(one).echo for one in frames(bus, 0x110, 18)]
    assert echoes == [(echoes[0] + k) % 16 for k in range(18)]


def test_no_status_is_lost_on_a_closed_line(start) -> None:
    """The node does not count frames that a closed line would discard."""
    bus = start("m4f")
    (before,) = statuses(bus, 1)
    bus.close()
    time.sleep(0.35)  # three periods of Status
    bus.open()
    assert statuses(bus, 2)[0].counter == (before.counter + 1) % 16


@pytest.mark.parametrize(
    ("params", "number", "used"),
    [(OURS, 0, OURS), (OURS, 5, OURS), (None, 0, (36500.0, 2.7, 1e-7))],
)
def test_parameters_and_number_from_flash(start, params, number, used) -> None:
    """A blank page means defaults."""
    bus = start("m4f", params, number)
    for counter in (0, 1):
        bus.send(codec.pack(EncoderState(4000 * counter, counter), number))
    answer = codec.unpack(frames(bus, 0x110 + number, 2)[1])
    assert answer.torque_q30 == dahl.Friction(dahl.Plan(*used)).step_counts_q30(4000)


def test_wrong_parameters_in_flash_leave_a_node_that_sends_nothing(start) -> None:
    bus = start("m4f", (-1.0, 1.8, 1e-5))
    for counter in range(20):
        bus.send(codec.pack(EncoderState(4000 * counter, counter % 16)))
    bus.serialPortOrig.timeout = PATIENT_S
    bus.serialPortOrig.write(b"V\r")
    assert b"t" not in bus.serialPortOrig.read_until(b"V")


START_CHILD = """import subprocess, time
from dahl.target.firmware import with_parent
print(subprocess.Popen([*with_parent(), "sleep", "600"]).pid, flush=True)
time.sleep(600)"""


def test_a_program_ends_with_its_parent_even_if_that_is_killed() -> None:
    words = [sys.executable, "-c", START_CHILD]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as parent:
        child = int(parent.stdout.readline())
        comm = Path(f"/proc/{child}/comm")
        wait_until(lambda: comm.read_text() == "sleep\n")  # now it would know of the end
        parent.kill()
    wait_until(lambda: not is_running(child))


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
