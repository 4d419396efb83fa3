# SPDX-License-Identifier: MIT
"""`dahl record` writes logs that can be drawn, keeps old files, and reports the frames that are
missing in its log.
"""

import itertools
import re
import resource
import shutil
import socket
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import can
import numpy as np
import pytest
from bus_frames import ANGLE, bus_of, frames, new_channel, sending
from dahl.io import can_logs, candump
from identify_tools import complaint
from loop_tools import SCENES, read_log, serving, wait_until
from programs import call, run

QUIET = ("-i", "virtual", "-c", "quiet")


@pytest.fixture
def served(tmp_path):
    limits = ("--wait-clients", "1", "--seconds", "120")
    with serving(tmp_path / "loop", SCENES / "steering.ini", *limits) as (_, port):
        yield bus_of(port)


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
    held = [frame for frame in can.LogReader(log) if frame.arbitration_id == 0x100]
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


@pytest.mark.parametrize("ending", [".log", ".asc", ".trc", ".blf", ".mf4"])
def test_a_full_disk_leaves_whole_lines(served, root, tmp_path, ending):
    """A limit of the file size cuts a line as a full disk does. The message says how many frames
    the file holds.
    """
    log, whole = tmp_path / f"run{ending}", tmp_path / f"whole{ending}"
    limit = 2003 if ending == ".blf" else 5003
    command = [sys.executable, "-m", "dahl", "record", *served, "--frames", "300", "-o"]
    how = {"cwd": root, "timeout": 60}
    bound = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (limit, limit))
    code, said = complaint(call(*command, log, preexec_fn=bound, **how))
    held = int(re.search(r"(\d+) frames", said)[1])
    assert code == 1 and said.startswith(f"{log}: File too large")
    if ending == ".mf4":
        assert held == 0 and "lost" in said
        return
    assert held == len(list(can.LogReader(log))) > 30
    if ending == ".blf":
        return
    run(*command, whole, **how)
    text, line = log.read_bytes(), max(map(len, whole.read_bytes().splitlines(keepends=True)))
    assert text.endswith(b"\n") and limit - line <= len(text) <= limit


def test_the_end_of_the_server_is_an_error_and_the_log_is_whole(dahl, tmp_path):
    """python-can itself polls a dead connection without a pause."""
    limits = ("--wait-clients", "1", "--seconds", "0.3")
    with serving(tmp_path / "loop", SCENES / "segments.ini", *limits) as (_, port):
        code, said = complaint(dahl("record", *bus_of(port), "-o", "run.log"))
    assert code == 1 and "bus has gone" in said
    assert sum(one.arbitration_id == 0x100 for one in can.LogReader("run.log")) >= 300


# --- each kind of frame ---------------------------------------------------------------------------

DATA = bytes(range(190, 254))
KINDS = [  # arguments of can.Message, and id#data as candump writes it
    ({"arbitration_id": 0x123, "data": DATA[:8]}, "123#BEBFC0C1C2C3C4C5"),
    ({"arbitration_id": 0}, "000#"),
    ({"arbitration_id": 0x7FF, "data": b"\1"}, "7FF#01"),
    ({"arbitration_id": 0x12, "is_extended_id": True, "data": b"\2"}, "00000012#02"),
    ({"arbitration_id": 0x1FFFFFFF, "is_extended_id": True}, "1FFFFFFF#"),
    *(
        ({"arbitration_id": 5, "is_remote_frame": True, "dlc": dlc}, f"005#R{dlc or ''}")
        for dlc in (0, 1, 8)
    ),
    *(
        (
            {"arbitration_id": 6, "is_fd": True, "data": DATA[:size]}
            | {"bitrate_switch": bool(flags & 1), "error_state_indicator": bool(flags & 2)},
            f"006##{flags}{DATA[:size].hex().upper()}",
        )
        for size in (0, 1, 8, 12, 64)
        for flags in range(4)
    ),
    *(
        (
            {"arbitration_id": error, "is_error_frame": True, "data": DATA[:size]}
            | {"is_extended_id": True},
            f"2{error:07X}#{DATA[:size].hex().upper()}",
        )
        for error in (1, 4, 0x40, 0x80, 0x88, 0x1FF)
        for size in (0, 8)
    ),
]
PARTS = ("arbitration_id", "is_extended_id", "is_remote_frame", "is_error_frame", "is_fd", "dlc")
PARTS += ("bitrate_switch", "error_state_indicator")


def parts_of(frame: can.Message) -> list[object]:
    return [getattr(frame, part) for part in PARTS] + [bytes(frame.data)]


@pytest.mark.parametrize("ending", [".log", ".asc", ".blf", ".mf4", ".trc"])
def test_each_kind_of_frame_is_recorded_and_read_as_it_was(dahl, ending):
    """An ASC has no place for the class and data of an error frame, a TRC none for CAN FD, remote
    and error frames. Both say so.
    """
    sent = [
        can.Message(**{"timestamp": 1.7e9 + n / 1e3, "is_extended_id": False, **kind})
        for n, (kind, _) in enumerate(KINDS)
    ]
    log, channel = Path(f"run{ending}"), new_channel()
    with sending(channel, sent):
        words = ("-i", "virtual", "-c", channel, "--frames", len(sent))
        done = dahl("record", *words, "-o", log)
    plain = [one for one in sent if not (one.is_fd or one.is_remote_frame or one.is_error_frame)]
    special, errors = len(sent) - len(plain), sum(one.is_error_frame for one in sent)
    kept = plain if ending == ".trc" else sent
    first, *more = done.stdout.splitlines()
    assert (done.returncode, done.stderr, first) == (0, "", f"{len(kept)} frames in {log}")
    said = {".asc": [f"{errors}"], ".trc": [f"{special}"]}.get(ending, [])
    assert [line.split()[0] for line in more] == said
    held = list(can_logs.frames_of(log, []))
    start = sent[0].timestamp - held[0].timestamp
    assert start == 0 or ending in (".asc", ".trc")
    for was, now in zip(kept, held, strict=True):
        assert now.timestamp + start == pytest.approx(was.timestamp, abs=1e-6)
        if ending == ".asc" and was.is_error_frame:
            assert now.is_error_frame
        else:
            assert parts_of(now) == parts_of(was)
    if ending == ".log":
        assert [line.split()[2] for line in log.read_text().splitlines()] == [k for _, k in KINDS]


def test_frames_before_the_first_one_have_its_time_in_an_asc(dahl):
    """Two controllers of one bus may reorder frames; python-can would write the date as a time."""
    sent = [can.Message(timestamp=1.7e9 + n, arbitration_id=1) for n in (0, -1e-3, 1, 2)]
    channel = new_channel()
    with sending(channel, sent):
        dahl("record", "-i", "virtual", "-c", channel, "--frames", 4, "-o", "run.asc")
    assert [one.timestamp for one in can.LogReader("run.asc")] == [0, 0, 1, 2]


@pytest.mark.checks
def test_can_utils_read_a_log_as_it_is_recorded(dahl):
    """log2asc and asc2log share their parser with candump and canplayer. They have no directions,
    and ASC no error classes.
    """
    if not shutil.which("log2asc"):
        pytest.skip("can-utils are not installed (tools/setup.sh installs them where it can)")
    texts = [text for _, text in KINDS if text[0] != "2"]
    Path("run.log").write_text("".join(f"(1700000000.000000) can0 {text}\n" for text in texts))
    for form in ((), ("-f",)):  # also classic frames in the form of CAN FD
        subprocess.run(["log2asc", *form, "-I", "run.log", "-O", "other.asc", "can0"], check=True)
        held = can_logs.frames_of(Path("other.asc"), [])
        assert [candump.candump_line(one).split()[2] for one in held] == texts


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
    assert [line.split()[0] for line in more] == ["3" if ending == ".TRC" else "1"]


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


@pytest.mark.parametrize(("last", "missing"), [(4, ""), (7, "3"), (23, "3 to 19")])
def test_a_log_that_lacks_frames_replaces_the_old_one_and_exits_with_1(dahl, dbc, last, missing):
    """By counter and time: test_missing.py."""
    channel, numbers, log = new_channel(), (0, 1, 2, 3, last), Path("run.log")
    log.write_text("an old run")
    sent = frames(dbc, *(("EncoderState", n / 1e3, ANGLE | {"Counter": n % 16}) for n in numbers))
    with sending(channel, sent):
        words = ("-i", "virtual", "-c", channel, "--frames", 5, "-o", log, "--force")
        done = dahl("record", *words)
    said = f"error: run.log: {missing} frames are missing\n" if missing else ""
    wanted = (int(bool(missing)), "5 frames in run.log\n", said)
    assert (done.returncode, done.stdout, done.stderr) == wanted
    assert [one.timestamp for one in can.LogReader(log)] == [n / 1e3 for n in numbers]


def test_faults_on_the_bus_are_no_loss_of_the_recorder(dahl, tmp_path):
    more = ("--set", "faults.restart=0.002", "--set", "faults.drop=0.05")
    words = ("--wait-clients", "1", "--virtual", *more)
    with serving(tmp_path / "loop", SCENES / "fault-storm.ini", *words) as (_, port):
        done = dahl("record", *bus_of(port), "-o", "run.log", "--frames", "3000")
    assert (done.returncode, done.stderr) == (0, "")


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
