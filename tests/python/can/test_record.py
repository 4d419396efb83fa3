# SPDX-License-Identifier: MIT
"""`dahl record` writes logs that can be drawn and keeps old files. It counts the frames that are
missing in its log, and only those that a slow recorder can have lost.
"""

from __future__ import annotations

import itertools
import re
import resource
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Container
from pathlib import Path
from types import SimpleNamespace

import can
import numpy as np
import pytest
from bus_frames import ANGLE, ERRORS, bus_of, frames, new_channel, sending
from identify_tools import complaint
from loop_tools import SCENES, read_log, serving, wait_until

pytestmark = pytest.mark.usefixtures("library")

QUIET = ("-i", "virtual", "-c", "quiet")


@pytest.fixture
def served(tmp_path):
    limits = ("--wait-clients", "1", "--seconds", "120")
    with serving(tmp_path / "loop", SCENES / "steering.ini", *limits) as (_, port):
        yield bus_of(port)


def angles(log: Path) -> list[can.Message]:
    return [frame for frame in can.LogReader(log) if frame.arbitration_id == 0x100]


# --- the log --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "ending",
    [
        *(".log", ".asc"),
        *(pytest.param(one, marks=pytest.mark.checks) for one in (".blf", ".LOG", ".mf4", ".trc")),
    ],
)
def test_a_record_of_each_format_has_the_frames_of_the_bus_and_can_be_drawn(dahl, tmp_path, ending):
    log = f"run{ending}"
    limits = ("--wait-clients", "1", "--seconds", "120")
    with serving(tmp_path / "loop", SCENES / "steering.ini", *limits) as (_, port):
        done = dahl("record", *bus_of(port), "-o", log, "--frames", "400")
    assert (done.returncode, done.stderr, done.stdout) == (0, "", f"400 frames in {log}\n")
    held = angles(log)
    bus = [one for one in read_log(tmp_path / "loop" / "run.log") if one.id == 0x100][: len(held)]
    assert len(held) >= 180 and [bytes(one.data) for one in held] == [one.data for one in bus]
    shifts = np.array([one.timestamp for one in held]) - [one.time for one in bus]
    assert np.ptp(shifts) < 2e-4  # what the coarsest format rounds to
    done = dahl("plot", log, "--scene", "segments", "-o", "loop.png")
    assert done.returncode == 0, done.stderr
    assert Path("loop.png").stat().st_size > 10_000


def test_each_frame_is_written_at_once(dahl, dbc):
    """As a whole line, since the recorder may be killed."""
    log, lines, channel = Path("run.log"), [], new_channel()
    sent = frames(dbc, *(("EncoderState", 1e9 + n, ANGLE | {"Counter": n}) for n in range(4)))

    def look() -> None:
        wait_until(lambda: log.read_text().count("\n") == 3)
        lines.append(log.read_text())

    with sending(channel, sent, log.exists, look):
        done = dahl("record", "-i", "virtual", "-c", channel, "--frames", 4, "-o", log)
    assert (done.returncode, done.stdout) == (0, "4 frames in run.log\n")
    assert log.read_text().startswith(lines[0])
    assert [message.timestamp for message in can.LogReader(log)] == [1e9 + n for n in range(4)]


@pytest.mark.parametrize("ending", [".log", ".asc", ".trc"])
def test_a_full_disk_leaves_whole_lines(served, root, tmp_path, ending):
    """A limit of the file size cuts a line as a full disk does."""
    log, whole = tmp_path / f"run{ending}", tmp_path / f"whole{ending}"
    limit = 5003
    command = [sys.executable, "-m", "dahl", "record", *served, "--frames", "300", "-o"]
    how = {"cwd": root, "capture_output": True, "text": True, "timeout": 60}
    done = subprocess.run(
        [*command, log],
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
        **how,
    )
    assert complaint(done) == (1, f"{log}: File too large")
    subprocess.run([*command, whole], check=True, **how)
    text, line = log.read_bytes(), max(map(len, whole.read_bytes().splitlines(keepends=True)))
    assert text.endswith(b"\n") and limit - line <= len(text) <= limit
    assert len(list(can.LogReader(log))) > 50


def test_the_end_of_the_server_is_an_error_and_the_log_is_whole(dahl, tmp_path):
    """python-can itself polls a dead connection without a pause."""
    limits = ("--wait-clients", "1", "--seconds", "0.3")
    with serving(tmp_path / "loop", SCENES / "segments.ini", *limits) as (_, port):
        code, said = complaint(dahl("record", *bus_of(port), "-o", "run.log"))
    assert code == 1 and "bus has gone" in said
    assert len(angles("run.log")) >= 300


# --- frames that a format cannot hold -------------------------------------------------------------


def special_frames() -> list[can.Message]:
    """CAN FD, remote and error frames, which a .trc cannot hold."""
    kinds = ("is_fd", "is_remote_frame", "is_error_frame")
    return [
        can.Message(timestamp=1e9 + n, arbitration_id=0x100, is_extended_id=False, **{kind: True})
        for n, kind in enumerate(kinds)
    ]


@pytest.mark.parametrize(("ending", "held"), [(".TRC", 2), (".asc", 5)])
def test_frames_that_a_format_cannot_hold_are_not_counted_as_recorded(dahl, dbc, ending, held):
    (plain,) = frames(dbc, ("EncoderState", 1e9 + 5, ANGLE | {"Counter": 1}))
    log, channel = f"run{ending}", new_channel()
    with sending(channel, [plain, *special_frames(), plain]):
        done = dahl("record", "-i", "virtual", "-c", channel, "--frames", 5, "-o", log)
    assert (done.returncode, done.stderr) == (0, "")
    first, *more = done.stdout.splitlines()
    assert first == f"{held} frames in {log}" and len(list(can.LogReader(log))) == held
    assert [line.split()[0] for line in more] == ["3"] * (ending == ".TRC")


def test_a_trc_without_frames_keeps_the_old_file(dahl):
    """A bus with --fd is refused at once."""
    log, channel = Path("run.TRC"), new_channel()
    log.write_text("an old run")
    words = ("record", "-i", "virtual", "-c", channel, "--frames", 3, "-o", log, "--force")
    with sending(channel, special_frames()):
        done = dahl(*words)
    code, said = complaint(done)
    assert (code, done.stdout) == (1, "") and said.startswith("run.TRC: 3 frames")
    code, said = complaint(dahl(*words, "--fd", "--seconds", 1))
    assert code == 2 and said.startswith("run.TRC: ") and "--fd" in said
    assert log.read_text() == "an old run"


# --- old files and no bus -------------------------------------------------------------------------


def test_force_overwrites_a_log(served, dahl):
    log = Path("run.log")
    log.write_text("mine")
    assert dahl("record", *served, "-o", log, "--frames", "10", "--force").returncode == 0
    assert log.read_text().count("\n") == 10
    log.unlink()
    log.symlink_to("/dev/full")
    done = dahl("record", *served, "-o", log, "--frames", "10", "--force")
    assert complaint(done) == (1, "run.log: No space left on device")


@pytest.mark.parametrize("old", ["an old run", ""])
def test_a_silent_bus_is_announced_and_keeps_the_old_file(dahl, monkeypatch, old):
    monkeypatch.setattr("dahl.commands.record.SILENCE_NOTICE_S", -1)
    Path("run.log").write_text(old)
    done = dahl("record", *QUIET, "--seconds", "0.3", "-o", "run.log", "--force")
    assert done.returncode == 1 and Path("run.log").read_text() == old
    first, second = done.stderr.splitlines()
    assert "waiting" in first and "Ctrl-C" in first and second.startswith("error: ")


def test_a_missing_server_is_refused_in_one_line(dahl, monkeypatch, tmp_path):
    """python-can tries for ten seconds, which pass at once here."""
    quick = SimpleNamespace(time=itertools.count().__next__, sleep=time.sleep)
    monkeypatch.setattr("can.interfaces.socketcand.socketcand.time", quick)
    for verb in (("monitor",), ("record", "-o", "run.log")):
        code, said = complaint(dahl(*verb, *bus_of(1)))
        assert code == 1 and "interface=socketcand channel=vcan0" in said and "port=1" in said
    assert list(tmp_path.iterdir()) == []


# --- missing frames -----------------------------------------------------------------------------

PERIOD, OFFSET = 0.001, 5  # s between two angles; the counter of the first one
SEEN = {"EncoderState": 0x100, "FrictionTorque": 0x110, "Status": 0x120}
STATUS = {f"Error{name}": 0 for name in ERRORS} | {"State": "OK", "Timeout": 100}
STATUS |= dict.fromkeys(("Lost", "Corrupt", "OutOfStep", "VersionMajor", "VersionMinor"), 0)
Tick = tuple[str, int]  # name of a message, number of its tick


def ticks(numbers: range, *names: str) -> list[Tick]:
    return [(name, number) for number in numbers for name in names]


BOTH = ticks(range(100), "EncoderState", "FrictionTorque")
ANGLES, ANSWERS = (ticks(range(100), name) for name in ("EncoderState", "FrictionTorque"))


def without(sent: list[Tick], numbers: Container[int], *names: str) -> list[Tick]:
    return [one for one in sent if not (one[1] in numbers and one[0] in (names or SEEN))]


@pytest.fixture
def record(dahl):
    """Record messages; returns the bounds of the reported number of missing frames, or None."""

    def run(messages: list[can.Message]) -> tuple[int, int] | None:
        channel = new_channel()
        with sending(channel, messages):
            words = ("-i", "virtual", "-c", channel, "--frames", len(messages))
            done = dahl("record", *words, "-o", "run.log", "--force")
        assert done.stdout == f"{len(messages)} frames in run.log\n"
        if done.returncode == 0:
            assert done.stderr == ""
            return None
        code, line = complaint(done)
        bounds = re.fullmatch(r"run\.log: (\d+)(?: to (\d+))? frames are missing", line)
        assert code == 1 and bounds
        return int(bounds[1]), int(bounds[2] or bounds[1])

    return run


@pytest.fixture
def recorded(record, dbc):
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
        return record(made)

    return run


@pytest.mark.parametrize(
    ("sent", "missing"),
    [
        pytest.param(BOTH[61:143], None, id="begun and ended in the middle"),
        pytest.param(without(BOTH, range(40, 45)), (10, 10), id="a stretch"),
        pytest.param(without(BOTH, range(30, 60)), (28, 60), id="more than the counter holds"),
        pytest.param(without(ANGLES[:30], range(3, 22)), (3, 19), id="after a period of 3 frames"),
        pytest.param(without(BOTH, range(40, 56)), None, id="16, which a pause would be too"),
        pytest.param(without(BOTH, range(40, 43), "EncoderState"), (3, 3), id="but answered"),
        pytest.param(without(BOTH, range(40, 43), "FrictionTorque"), (3, 3), id="answers"),
        pytest.param(without(ANGLES, range(98, 99)), (1, 1), id="the last but one"),
        pytest.param(without(ANSWERS, range(40, 45)), (5, 5), id="no encoder"),
        pytest.param(
            without(without(ANGLES, range(20, 22)), range(50, 57)), (9, 9), id="two stretches"
        ),
        pytest.param(without(ANGLES, (20, 21, 26, 27, 28)), (5, 5), id="one soon after another"),
    ],
)
def test_a_gap_of_the_counters_is_counted(recorded, sent, missing):
    assert recorded(sent) == missing


def answer_of(name: str, place: int) -> dict:
    return {"Counter": place % 16} if name == "FrictionTorque" else {}


@pytest.mark.parametrize("late", [0, 3])
def test_angles_that_no_node_answered_are_not_missing(recorded, late):
    absent = (21, 22, 40, 60, 61, 62, 63, 98)
    numbers = [number for number in range(100) if number not in absent]
    place = {number: place for place, number in enumerate(numbers)}
    sent = [
        one
        for at, number in enumerate(numbers)
        for one in [("EncoderState", number)]
        + [("FrictionTorque", numbers[at - late])] * (at >= late)
    ]
    assert recorded(sent, lambda name, n: answer_of(name, place[n])) is None


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


@pytest.mark.parametrize("other", ["EncoderState", "Status"])
def test_a_restart_of_node_and_encoder_is_no_gap(recorded, other):
    """After 50 ticks."""

    def change(_: str, number: int) -> dict:
        new = {"Counter": (number - 50) % 16, "State": "Init" if number == 50 else "OK"}
        return new if number >= 50 else {}

    assert recorded(ticks(range(100), other, "FrictionTorque"), change) is None


def test_a_frame_with_a_wrong_crc_is_recorded(recorded):
    assert recorded(ANGLES, spoil=50) is None
    assert recorded(without(ANGLES, range(70, 73)), spoil=50) == (3, 3)


def test_each_node_has_its_own_counters(record, dbc):
    lost = {(7, 20), (7, 21), (15, 33)}
    both = [(node, n) for n in range(60) for node in (0, 7, 15) if (node, n) not in lost]
    signals = ((1e9 + n * PERIOD, ANGLE | {"Counter": (n + node) % 16}) for node, n in both)
    made = list(frames(dbc, *(("EncoderState", *each) for each in signals)))
    for message, (node, _) in zip(made, both, strict=True):
        message.arbitration_id += node
    assert record(made) == (3, 3)


def test_faults_on_the_bus_are_no_loss_of_the_recorder(dahl, tmp_path):
    more = ("--set", "faults.restart=0.002", "--set", "faults.drop=0.05")
    words = ("--wait-clients", "1", "--virtual", *more)
    with serving(tmp_path / "loop", SCENES / "fault-storm.ini", *words) as (_, port):
        done = dahl("record", *bus_of(port), "-o", "run.log", "--frames", "3000")
    assert (done.returncode, done.stderr) == (0, "")


# --- a recorder that is stopped -------------------------------------------------------------------


@pytest.mark.parametrize("is_dropped", [False, True])
def test_a_stopped_recorder_records_what_waits_or_reports_that_it_was_dropped(
    root, tmp_path, is_dropped
):
    """Its log has whole lines without a gap. It ends by Ctrl-C or if the server drops it."""
    record, log, bus_log = None, tmp_path / "run.log", tmp_path / "loop" / "run.log"
    limits = ("--wait-clients", "1", "--until-idle", "--set", "motion.seconds=60")
    with serving(tmp_path / "loop", SCENES / "steering.ini", *limits) as (server, port):
        words = [sys.executable, "-m", "dahl", "record", *bus_of(port), "-o", log]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        with subprocess.Popen(list(map(str, words)), cwd=root, **pipes) as record:
            wait_until(lambda: log.exists() and log.stat().st_size > 5000, 60)
            record.send_signal(signal.SIGSTOP)
            waiting = bus_log.stat().st_size
            if is_dropped:
                assert "too slowly" in server.stderr.readline()
            else:
                wait_until(lambda: bus_log.stat().st_size > waiting + 3000 * 44, 60)
            record.send_signal(signal.SIGCONT)
            record.send_signal(signal.SIGINT)
            out, errors = record.communicate(timeout=60)
    held = list(can.LogReader(log))
    counters = [one.data[1] & 15 for one in held if one.arbitration_id == 0x100]
    assert {(b - a) % 16 for a, b in zip(counters, counters[1:], strict=False)} == {1}
    assert (record.returncode, out) == (int(is_dropped), f"{len(held)} frames in {log}\n")
    late = r"error: the bus has gone: .* \d+\.\d s late\n"
    assert re.fullmatch(late if is_dropped else "", errors)
    assert (1000 if is_dropped else 2000) < len(held) <= len(read_log(bus_log))


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
