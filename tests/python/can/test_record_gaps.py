# SPDX-License-Identifier: MIT
"""`dahl record` counts the frames that are missing in its log, and only those that a slow recorder
can have lost.
"""

from __future__ import annotations

import re
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import pytest
from bus_frames import frames, new_channel, sending
from identify_tools import complaint
from loop_tools import SCENES, read_log, serving, wait_until
from test_monitor import ERRORS, bus_of

pytestmark = pytest.mark.usefixtures("library")

PERIOD, OFFSET = 0.001, 5  # s between two angles; the counter of the first one
SEEN = {"EncoderState": 0x100, "FrictionTorque": 0x110, "Status": 0x120}
STATUS = {f"Error{name}": 0 for name in ERRORS} | {"State": "OK", "Timeout": 100}
STATUS |= dict.fromkeys(("Lost", "Corrupt", "OutOfStep", "VersionMajor", "VersionMinor"), 0)
Tick = tuple[str, int]  # name of a message, number of its tick


def ticks(numbers: range, *names: str) -> list[Tick]:
    return [(name, number) for number in numbers for name in names]


BOTH = ticks(range(100), "EncoderState", "FrictionTorque")
ANGLES, ANSWERS = (ticks(range(100), name) for name in ("EncoderState", "FrictionTorque"))


def without(sent: list[Tick], numbers: range, *names: str) -> list[Tick]:
    """The frames that are left when these are lost."""
    return [one for one in sent if not (one[1] in numbers and one[0] in (names or SEEN))]


@pytest.fixture
def recorded(dahl, dbc):
    """Record these ticks; returns the bounds of the reported number of missing frames, or None."""

    def run(
        sent: list[Tick], change: Callable[[str, int], dict] = lambda *_: {}, spoil: int = -1
    ) -> tuple[int, int] | None:
        messages = []
        for name, number in sent:
            signals = {"Counter": (number + OFFSET) % 16, "EchoCounter": (number + OFFSET) % 16}
            signals |= {"Valid": 1, "Count": number, "State": "OK", "TorqueRatio": 0.5}
            if name == "Status":
                signals = STATUS | {"Counter": signals["Counter"]}
            signals |= change(name, number)
            moment = 1e9 + number * PERIOD + 1e-4 * list(SEEN).index(name)
            messages.append((name, signals.pop("moment", moment), signals))
        made = list(frames(dbc, *messages))
        if spoil >= 0:
            made[spoil].data[0] ^= 1
        channel = new_channel()
        with sending(channel, made):
            words = ("-i", "virtual", "-c", channel, "--frames", len(made))
            done = dahl("record", *words, "-o", "run.log", "--force")
        assert done.stdout == f"{len(made)} frames in run.log\n"
        if done.returncode == 0:
            assert done.stderr == ""
            return None
        code, line = complaint(done)
        bounds = re.fullmatch(r"run\.log: (\d+)(?: to (\d+))? frames are missing", line)
        assert code == 1 and bounds
        return int(bounds[1]), int(bounds[2] or bounds[1])

    return run


@pytest.mark.parametrize(
    ("sent", "missing"),
    [
        pytest.param(BOTH, None, id="nothing"),
        pytest.param(BOTH[61:143], None, id="begun and ended in the middle"),
        pytest.param(without(BOTH, range(40, 45)), (10, 10), id="a stretch"),
        pytest.param(without(BOTH, range(30, 60)), (28, 60), id="more than the counter holds"),
        pytest.param(without(BOTH, range(40, 56)), None, id="16, which a pause would be too"),
        pytest.param(without(BOTH, range(40, 43), "EncoderState"), (3, 3), id="but answered"),
        pytest.param(without(BOTH, range(40, 43), "FrictionTorque"), (3, 3), id="answers"),
        pytest.param(without(ANGLES, range(40, 45)), (5, 5), id="no node to ask"),
        pytest.param(without(ANGLES, range(98, 99)), (1, 1), id="the last but one"),
        pytest.param(without(ANSWERS, range(40, 45)), (5, 5), id="no encoder"),
        pytest.param(
            without(without(ANGLES, range(20, 22)), range(50, 57)), (9, 9), id="two stretches"
        ),
    ],
)
def test_a_gap_of_the_counters_is_counted(recorded, sent, missing):
    assert recorded(sent) == missing


def test_angles_that_no_node_answered_are_not_missing(recorded):
    """The answers have no gap. They may be some ticks late."""
    absent = (21, 22, 40, 60, 61, 62, 63, 98)
    numbers = [number for number in range(100) if number not in absent]
    place = {number: place for place, number in enumerate(numbers)}
    for late in (0, 3):
        sent = [
            one
            for at, number in enumerate(numbers)
            for one in [("EncoderState", number)]
            + [("FrictionTorque", numbers[at - late])] * (at >= late)
        ]
        assert recorded(sent, lambda name, n: answer_of(name, place[n])) is None


def answer_of(name: str, place: int) -> dict:
    return {"Counter": place % 16} if name == "FrictionTorque" else {}


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(lambda _, n: {"moment": 1e9 + n * PERIOD + 6 * (n >= 50)}, id="pause"),
        pytest.param(lambda _, n: {"Counter": min(n, 50) % 16, "Count": n // 2}, id="stuck"),
        pytest.param(lambda _, n: {"Counter": (n - (n > 50)) % 16}, id="repeated"),
        pytest.param(
            lambda _, n: {"Counter": (n - (n > 50)) % 16, "moment": 1e9 + n / 10}, id="slow"
        ),
        pytest.param(lambda *_: {"moment": 0.0}, id="no time stamps"),
    ],
)
def test_pauses_and_repeated_counters_are_no_gap(recorded, change):
    assert recorded(ANGLES, change) is None


def test_a_restart_of_node_and_encoder_is_no_gap(recorded):
    """After 50 ticks."""

    def change(_: str, number: int) -> dict:
        new = {"Counter": (number - 50) % 16, "State": "Init" if number == 50 else "OK"}
        return new if number >= 50 else {}

    status = ticks(range(100), "FrictionTorque", "Status")
    assert recorded(status, change) is None
    assert recorded(BOTH, change) is None


def test_a_frame_with_a_wrong_crc_is_recorded(recorded):
    assert recorded(ANGLES, spoil=50) is None


def test_each_node_has_its_own_counters(dahl, dbc):
    lost = {(7, 20), (7, 21), (15, 33)}
    both = [(node, n) for n in range(60) for node in (0, 7, 15) if (node, n) not in lost]
    angle = {"Valid": 1, "Count": 1}
    made = list(
        frames(
            dbc,
            *(
                ("EncoderState", 1e9 + n * PERIOD, angle | {"Counter": (n + node) % 16})
                for node, n in both
            ),
        )
    )
    for message, (node, _) in zip(made, both, strict=True):
        message.arbitration_id += node
    channel = new_channel()
    with sending(channel, made):
        words = ("-i", "virtual", "-c", channel, "--frames", len(made))
        code, line = complaint(dahl("record", *words, "-o", "run.log"))
    assert (code, line) == (1, "run.log: 3 frames are missing")


@pytest.mark.parametrize("limits", [("--virtual",), ("--set", "motion.seconds=2")])
def test_faults_on_the_bus_are_no_loss_of_the_recorder(dahl, tmp_path, limits):
    """A tenth of all frames is dropped or spoiled, and the node restarts."""
    more = ("--set", "faults.restart=0.002", "--set", "faults.drop=0.05")
    words = ("--wait-clients", "1", *more, *limits)
    with serving(tmp_path / "loop", SCENES / "fault-storm.ini", *words) as (_, port):
        done = dahl("record", *bus_of(port), "-o", "run.log", "--frames", "3000")
    assert (done.returncode, done.stderr) == (0, "")


# --- a recorder that is stopped -------------------------------------------------------------------


@pytest.fixture
def stopped(root, tmp_path) -> Iterator[Callable]:
    """Start the command on a bus and stop it until what() is true. Returns code, output, errors and
    the log of the bus.
    """
    running = []

    def run(what: Callable[[subprocess.Popen], bool], *words: object, verb: str = "record"):
        limits = ("--wait-clients", "1", "--until-idle", "--set", "motion.seconds=60")
        with serving(tmp_path / "loop", SCENES / "steering.ini", *limits) as (server, port):
            command = [sys.executable, "-m", "dahl", verb, *bus_of(port), *map(str, words)]
            pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
            process = subprocess.Popen(command, cwd=root, **pipes)
            running.append(process)
            log = tmp_path / "loop" / "run.log"
            wait_until(lambda: log.exists() and log.stat().st_size > 20000, 30)
            process.send_signal(signal.SIGSTOP)
            what(server)
            process.send_signal(signal.SIGCONT)
            if "--seconds" not in words:
                process.send_signal(signal.SIGINT)
            out, errors = process.communicate(timeout=60)
        return process.returncode, out, errors, read_log(log)

    yield run
    for process in running:
        process.kill()
        process.communicate()


def log_grows(folder: Path) -> Callable[[subprocess.Popen], None]:
    """Wait for 3000 frames more."""

    def wait(_: subprocess.Popen) -> None:
        log = folder / "loop" / "run.log"
        begin = log.stat().st_size
        wait_until(lambda: log.stat().st_size > begin + 3000 * 44, 30)

    return wait


def drops(server: subprocess.Popen) -> None:
    assert "too slowly" in server.stderr.readline()


@pytest.mark.parametrize("words", [(), ("--seconds", 1)])
def test_frames_that_wait_at_the_end_are_recorded(stopped, tmp_path, words):
    """The end is Ctrl-C or a limit that has passed meanwhile."""
    log = tmp_path / "run.log"
    code, out, errors, _ = stopped(log_grows(tmp_path), "-o", log, *words)
    held = read_bus(log)
    assert (code, out, errors) == (0, f"{len(held)} frames in {log}\n", "")
    assert len(held) > (500 if words else 3000)  # most of them waited while it was stopped
    span = held[-1].timestamp - held[0].timestamp
    assert not words or 0.3 < span < 1.5


def read_bus(log: Path) -> list[can.Message]:
    """The frames of a log whose angles have no gap."""
    held = list(can.LogReader(log))
    counters = [one.data[1] & 15 for one in held if one.arbitration_id == 0x100]
    assert {(b - a) % 16 for a, b in zip(counters, counters[1:], strict=False)} == {1}
    return held


@pytest.mark.parametrize("words", [(), ("--seconds", 55)])
def test_a_recorder_that_the_server_drops_reports_it(stopped, tmp_path, words):
    """Its log has whole lines until then."""
    log = tmp_path / "run.log"
    code, out, errors, bus = stopped(drops, "-o", log, *words)
    held = read_bus(log)
    assert (code, out) == (1, f"{len(held)} frames in {log}\n")
    assert re.fullmatch(r"error: the bus has gone: .* \d+\.\d s late\n", errors)
    assert 1000 < len(held) < len(bus)


def test_the_monitor_shows_its_delay(stopped, tmp_path):
    code, out, _, _ = stopped(log_grows(tmp_path), "--seconds", 3, verb="monitor")
    now, most = map(float, re.search(r"behind  (\d+\.\d) s, at most (\d+\.\d) s", out).groups())
    assert code == 0 and now < most and most > 0.5


def test_frames_that_the_kernel_dropped_are_missing(dahl, monkeypatch):
    """A UDP socket counts drops like SocketCAN, since this kernel may have no CAN."""
    link, peer = (socket.socket(type=socket.SOCK_DGRAM) for _ in range(2))
    link.bind(("127.0.0.1", 0))
    link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)

    class Full(can.BusABC):
        def __init__(self, **_: object) -> None:
            super().__init__("x")
            self.socket = link

        def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
            link.settimeout(timeout)
            return can.Message(arbitration_id=0x321, data=link.recv(8)), False

        def send(self, msg: can.Message, timeout: float | None = None) -> None: ...

    monkeypatch.setattr(can, "Bus", Full)
    for _ in range(500):
        peer.sendto(bytes(8), link.getsockname())
    link.setblocking(False)
    held = 0
    with pytest.raises(BlockingIOError):
        while link.recv(8):
            held += 1
    for _ in range(held):
        peer.sendto(bytes(8), link.getsockname())
    words = ("-i", "virtual", "-c", "x", "--frames", held)
    code, said = complaint(dahl("record", *words, "-o", "run.log"))
    assert (code, said) == (1, f"run.log: {500 - held} frames are missing")
    link.close()
    peer.close()
