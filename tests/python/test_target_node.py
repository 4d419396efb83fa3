# SPDX-License-Identifier: MIT
"""The friction node seen from outside with python-can: as firmware in QEMU behind slcan, and on
SocketCAN where this kernel has it (behind socketcand: test_loop_node.py). Then what only firmware
can show: a trace equal to the host's bit for bit, and a serial line full of rubbish.
"""

from __future__ import annotations

import contextlib
import ctypes
import random
import shutil
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import can
import cantools
import pytest
from codec_tools import EncoderState, Frame
from conftest import built
from dahl import bus as buses
from dahl import firmware
from dahl.core import Friction, Plan
from e2e import p02

pytestmark = pytest.mark.checks

SIGMA0, FC, THETA = 120.0, 1.8, 2.396844981071314e-05
TIMEOUT_US = 600000  # more than a busy host holds a frame back
PATIENT_US = 60000000
SCENE = f"""[scene]
title = a node alone
[friction]
sigma0 = {SIGMA0}
Fc = {FC}
theta_per_count = {THETA}
timeout_ms = {TIMEOUT_US // 1000}
[status]
period_ms = 100
"""
ENCODER, TORQUE, STATUS = 0x100, 0x110, 0x120
OK, REPEATED, LOST, WRONG_SEQUENCE, CRC, STALE, INIT = range(7)
QUIET = 0.15  # s without an answer that counts as none; above a period of Status


def encoder_frame(count: int, counter: int, *, valid: bool = True) -> can.Message:
    codec = ctypes.CDLL(str(built("tests", "port", "libdahl_frames.so")))
    frame, state = Frame(), EncoderState(count, counter & 15, valid)
    codec.dahl_frames_pack_encoder(ctypes.byref(frame), 0, ctypes.byref(state))
    return can.Message(arbitration_id=frame.id, data=bytes(frame.data), is_extended_id=False)


# --- the buses -----------------------------------------------------------------------------------


def need_firmware(core: str = "m4f") -> Path:
    for program in ("arm-none-eabi-gcc", "qemu-system-arm"):
        if not shutil.which(program):
            pytest.skip(
                f"{program} is not installed (tools/setup.sh installs it where Debian has it)"
            )
    return firmware.build(core)


@contextlib.contextmanager
def loop_node(folder: Path, bus: str) -> Iterator[subprocess.Popen]:
    scene = folder / "node.ini"
    scene.write_text(SCENE)
    command = [built("host_sim", "dahl-loop"), "--scene", scene, "--role", "node", "--bus", bus]
    process = subprocess.Popen([str(word) for word in command], stdout=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.terminate()
        process.wait(10)


@contextlib.contextmanager
def slcan(folder: Path) -> Iterator[can.BusABC]:
    image = need_firmware()
    with (
        firmware.Firmware("m4f", (SIGMA0, FC, THETA), folder, 0, TIMEOUT_US, image) as node,
        can.Bus(**node.bus) as bus,
    ):
        yield bus


@contextlib.contextmanager
def socketcan(folder: Path) -> Iterator[can.BusABC]:
    if not buses.has_socketcan() or not buses.vcan_is_up():
        pytest.skip("this kernel has no SocketCAN, or no vcan0 is up")
    with (
        loop_node(folder, "socketcan:vcan0"),
        can.Bus(interface="socketcan", channel="vcan0") as bus,
    ):
        time.sleep(0.3)
        yield bus


BUSES = {"firmware": slcan, "socketcan": socketcan}


@pytest.fixture(params=BUSES)
def bus(request, tmp_path) -> Iterator[can.BusABC]:
    with BUSES[request.param](tmp_path) as opened:
        yield opened


@pytest.fixture(scope="module")
def database():
    return cantools.database.load_file(Path(__file__).resolve().parents[2] / "lib/node/dahl.dbc")


def heard(bus: can.BusABC, wanted: int, seconds: float = QUIET) -> can.Message | None:
    """The next frame with that id, None when there is none in time."""
    until = time.monotonic() + seconds
    while (left := until - time.monotonic()) > 0:
        message = bus.recv(left)
        if message is not None and message.arbitration_id == wanted:
            return message
    return None


def ask(bus: can.BusABC, frame: can.Message, seconds: float = 2.0) -> can.Message:
    """Send one EncoderState and wait for its answer."""
    bus.send(frame)
    answer = heard(bus, TORQUE, seconds)
    assert answer is not None, "no answer"
    return answer


# --- the same on every bus -----------------------------------------------------------------------


def test_torque_bit_for_bit(bus, database, library) -> None:
    """Each answer echoes its question, and its torque is the library's own."""
    state = Friction(Plan(SIGMA0, FC, THETA))
    rng, count = random.Random(3), 1000
    for n in range(300):
        step = rng.choice([0, 1, -1, 7, -300, 2000, -4000]) if n else 0
        count += step
        answer = database.decode_message(
            TORQUE, ask(bus, encoder_frame(count, n)).data, decode_choices=False
        )
        assert answer["EchoCounter"] == n % 16
        assert answer["State"] == (OK if n else INIT)
        assert round(answer["TorqueRatio"] * 2**30) == state.step_counts_q30(step)


def test_bad_frames(bus, database) -> None:
    """None of them is answered or moves the torque; Status says that they came."""
    ask(bus, encoder_frame(0, 0))
    before = ask(bus, encoder_frame(500, 1)).data[4:]
    broken = encoder_frame(900, 2)
    broken.data[0] ^= 1
    short = can.Message(
        arbitration_id=ENCODER, data=encoder_frame(900, 2).data[:7], is_extended_id=False
    )
    remote = can.Message(arbitration_id=ENCODER, is_remote_frame=True, dlc=8, is_extended_id=False)
    for bad in (broken, short, remote, encoder_frame(900, 1), encoder_frame(900, 9)):
        bus.send(bad)
    assert heard(bus, TORQUE, 0.05) is None
    after = ask(bus, encoder_frame(500, 2)).data
    assert after[4:] == before
    status = heard(bus, STATUS, 1.0)
    decoded = database.decode_message(STATUS, status.data, decode_choices=False)
    assert [
        decoded[f"Error{name}"] for name in ("Crc", "Format", "Repeated", "Sequence", "Lost")
    ] == [1, 1, 1, 1, 0]
    assert decoded["Corrupt"] == 3
    assert decoded["OutOfStep"] == 2


def test_lost_frames_are_bridged(bus, database, library) -> None:
    """A counter step of 2 is used, as lost: the count is absolute."""
    state = Friction(Plan(SIGMA0, FC, THETA))
    ask(bus, encoder_frame(0, 0))
    answer = database.decode_message(
        TORQUE, ask(bus, encoder_frame(3000, 2)).data, decode_choices=False
    )
    assert answer["State"] == LOST
    assert round(answer["TorqueRatio"] * 2**30) == state.step_counts_q30(3000)


def test_silence_makes_it_stale(bus, database) -> None:
    ask(bus, encoder_frame(0, 0))
    moved = ask(bus, encoder_frame(4000, 1)).data[4:]
    time.sleep(1.0)
    bus.send(encoder_frame(900000, 2))
    bus.send(encoder_frame(900000, 3))
    answer = ask(bus, encoder_frame(900000, 4)).data
    assert answer[1] >> 4 == STALE
    assert answer[4:] == moved, "a jump while nobody looked became a torque"


def test_status_every_100_ms(bus, database) -> None:
    assert heard(bus, STATUS, 1.0)
    start, counters = time.monotonic(), []
    for _ in range(5):
        counters.append(heard(bus, STATUS, 1.0).data[1] & 15)
    assert 0.3 < time.monotonic() - start < 0.9
    assert [(b - a) % 16 for a, b in zip(counters, counters[1:], strict=False)] == [1] * 4


def protected(database, name: str, **signals: object) -> can.Message:
    """A frame of the DBC with the CRC that autosar-e2e gives it."""
    message = database.get_message_by_name(name)
    data = bytearray(message.encode({"Crc": 0, "Counter": 4, **signals}))
    kind = {"ParamWrite": 0x6, "Reset": 0xA}[name]
    p02.e2e_p02_protect(data, bytes(kind << 4 | counter for counter in range(16)))
    return can.Message(arbitration_id=message.frame_id, data=data, is_extended_id=False)


def test_parameters_and_reset(bus, database) -> None:
    """Written, read back, refused out of range, used, and kept over a restart."""

    def asked(**signals: object) -> dict:
        bus.send(protected(database, "ParamWrite", **signals))
        return database.decode_message("ParamReply", heard(bus, 0x140, 2.0).data)

    assert asked(Write=0, Param="Fc", Fc=1.0)["Fc"] == pytest.approx(FC, abs=2**-20)
    done = asked(Write=1, Param="Gain", Gain=0.25)
    assert (str(done["Result"]), done["Gain"], done["Counter"]) == ("Done", 0.25, 5)
    refused = protected(database, "ParamWrite", Write=1, Param="Timeout", Timeout=60000)
    refused.data[4:8] = (60001).to_bytes(4, "little")
    p02.e2e_p02_protect(refused.data, bytes(0x60 | counter for counter in range(16)))
    bus.send(refused)
    reply = database.decode_message("ParamReply", heard(bus, 0x140, 2.0).data)
    assert str(reply["Result"]) == "OutOfRange"
    ask(bus, encoder_frame(0, 0))
    answer = database.decode_message(TORQUE, ask(bus, encoder_frame(2**24, 1)).data)
    assert answer["TorqueRatio"] == pytest.approx(0.25, abs=1e-6)
    bus.send(protected(database, "Reset", What="Restart"))
    assert heard(bus, STATUS, 2.0)
    answer = database.decode_message(TORQUE, ask(bus, encoder_frame(7, 9)).data)
    assert (str(answer["State"]), answer["TorqueRatio"]) == ("Init", 0)
    assert asked(Write=0, Param="Gain", Gain=0)["Gain"] == 0.25


def test_other_ids_are_not_its_business(bus) -> None:
    for identifier in (0x101, 0x0FF, 0x110, 0x7FF):
        message = encoder_frame(77, 0)
        bus.send(can.Message(arbitration_id=identifier, data=message.data, is_extended_id=False))
    bus.send(
        can.Message(arbitration_id=ENCODER, data=encoder_frame(77, 0).data, is_extended_id=True)
    )
    assert heard(bus, TORQUE, 0.05) is None
    ask(bus, encoder_frame(5, 3))


# --- the firmware alone --------------------------------------------------------------------------


Params = tuple[float, float, float]


class Serial:
    """The firmware's serial line as bytes, read all the while."""

    def __init__(self, port: int) -> None:
        self.link = socket.create_connection(("127.0.0.1", port))
        self.text = bytearray()
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()

    def _read(self) -> None:
        with contextlib.suppress(OSError):
            while piece := self.link.recv(65536):
                self.text += piece

    def send(self, data: bytes) -> None:
        self.link.sendall(data)

    def lines(self, head: bytes) -> list[bytes]:
        """Whole lines that begin so; a BEL ends a line as a CR does."""
        whole = bytes(self.text).replace(b"\a", b"\r").rpartition(b"\r")[0]
        return [line for line in whole.split(b"\r") if line.startswith(head)]

    def wait(self, head: bytes, number: int, seconds: float = 30) -> list[bytes]:
        """Until so many such lines have come, or none has for a while."""
        known, last = 0, time.monotonic()
        while known < number and time.monotonic() - last < seconds:
            time.sleep(0.005)
            if (now := len(self.lines(head))) != known:
                known, last = now, time.monotonic()
        return self.lines(head)

    def close(self) -> None:
        self.link.close()


def slcan_line(message: can.Message) -> bytes:
    return f"t{message.arbitration_id:03X}{message.dlc}{message.data.hex().upper()}\r".encode()


@pytest.fixture
def serial(tmp_path) -> Iterator:
    """Open firmware on a core: serial('m4f'). It is patient, so that a busy host is no timeout."""
    with contextlib.ExitStack() as stack:

        def start(
            core: str, params: Params | None = (SIGMA0, FC, THETA), number: int = 0
        ) -> Serial:
            image = need_firmware(core)
            node = stack.enter_context(
                firmware.Firmware(core, params, tmp_path, number, PATIENT_US, image)
            )
            line = Serial(node.port)
            stack.callback(line.close)
            line.send(b"\rC\rO\r")
            return line

        yield start


def trace(folder: Path, seconds: float) -> tuple[list[bytes], list[bytes]]:
    """A steering manoeuvre on the host: the encoder's frames and the node's answers as lines."""
    scene = (Path(__file__).resolve().parents[2] / "host_sim/scenes/steering.ini").read_text()
    (folder / "trace.ini").write_text(scene)
    command = [built("host_sim", "dahl-loop"), "--scene", folder / "trace.ini", "--virtual"]
    command += ["--seconds", str(seconds), "--log", folder / "trace.log"]
    subprocess.run([str(word) for word in command], check=True, capture_output=True, timeout=60)
    frames = [line.split()[2] for line in (folder / "trace.log").read_text().splitlines()]
    lines = [f"t{frame.replace('#', '8')}".encode() for frame in frames]
    return [line for line in lines if line.startswith(b"t100")], [
        line for line in lines if line.startswith(b"t110")
    ]


def replay(line: Serial, asked: list[bytes], ahead: int = 20) -> list[bytes]:
    """Send all, never more than `ahead` unanswered, so that the node sees a steady stream."""
    for n in range(0, len(asked), ahead):
        line.send(b"".join(question + b"\r" for question in asked[n : n + ahead]))
        line.wait(b"t110", min(n + ahead, len(asked)), 10)
    return line.lines(b"t110")


@pytest.mark.parametrize("core", firmware.boards())
def test_trace_equals_the_hosts(core: str, serial, tmp_path) -> None:
    seconds = 10 if core == "m4f" else 2
    asked, answers = trace(tmp_path, seconds)
    assert len(asked) == len(answers) == seconds * 1000
    assert len({answer[-8:] for answer in answers}) > seconds * 150, "nothing moves in this trace"
    got = replay(serial(core), asked)
    assert got == answers


# QEMU hands the CMSDK UART one byte at a time and the nRF51's six, so the latter takes the million
# within seconds.
RUBBISH = [("m0", 100), ("m4f", 10), pytest.param("m4f", 100, marks=pytest.mark.long)]


@pytest.mark.parametrize("core, pieces", RUBBISH)
def test_a_million_random_bytes(core: str, pieces: int, serial) -> None:
    line = serial(core)
    line.send(b"F\r" + slcan_line(encoder_frame(0, 0)))
    assert len(line.wait(b"t110", 1)) == 1
    rng = random.Random(11)
    for _ in range(pieces):
        line.send(rng.randbytes(10000))
    line.send(b"\r\rC\rO\rF\r")
    assert line.wait(b"F80", 1, 200), "no answer after all these bytes"
    answered = len(line.lines(b"t110"))
    line.send(b"".join(slcan_line(encoder_frame(10 * n, n)) for n in range(20)))
    assert (
        len(line.wait(b"t110", answered + 20, 1)) >= answered + 18
    )  # the first ones find it out of sequence
    assert line.text.count(b"\a") > 30 * pieces


def test_parameters_from_flash(serial, library) -> None:
    """A blank page leaves the defaults; refused parameters leave a node without torque."""
    for params, first in (
        ((SIGMA0, FC, THETA), Friction(Plan(SIGMA0, FC, THETA))),
        (None, Friction(Plan(36500.0, 2.7, 1e-7))),
    ):
        line = serial("m4f", params)
        line.send(slcan_line(encoder_frame(0, 0)) + slcan_line(encoder_frame(4000, 1)))
        expected = first.step_counts_q30(4000).to_bytes(4, "little", signed=True).hex().upper()
        assert line.wait(b"t110", 2)[1].decode().endswith(expected)
    mute = serial("m4f", (-1.0, FC, THETA))
    mute.send(slcan_line(encoder_frame(0, 0)) + b"V\r")
    assert mute.wait(b"V", 1) and not mute.lines(b"t1")


def test_node_number(serial) -> None:
    line = serial("m4f", number=5)
    line.send(b"t105" + slcan_line(encoder_frame(0, 0))[4:])
    assert line.wait(b"t115", 1)
