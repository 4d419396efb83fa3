# SPDX-License-Identifier: MIT
"""Helpers for tests of dahl-loop: run it, read its log, join its bus."""

import argparse
import configparser
import contextlib
import logging
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import can
import dahl
from conftest import ROOT, built
from dahl.bus import candump_line
from dahl.io import data
from dahl.sim import scene as scenes
from dahl.sim.run_file import RunFile

logging.getLogger("can").setLevel(logging.CRITICAL)  # it warns at every part of a TCP stream

ERROR = 0x20000000  # in an id of candump: an error frame
SCENES = ROOT / "host_sim" / "scenes"
EXAMPLE = ROOT / "host_sim" / "steering.run"  # of dahl-loop alone
LINE = re.compile(
    r"\((\d{10}\.\d{6})\) (\S+) ([0-9A-F]{3}|[0-9A-F]{8})#((?:[0-9A-F]{2}){0,8}|R[1-8]?)"
)

REPLAY = """[scene]
title = mine
[friction]
sigma0 = 50
Fc = 0.5
theta_per_count = 1e-4
[motion]
kind = log
file = a.csv
angle = a
counts_per_unit = 1
"""


def program() -> str:
    return str(built("host_sim", "dahl-loop"))


def setting(*texts: str) -> list[str]:
    """Options that set keys of a scene: "friction.gain=1"."""
    return [word for text in texts for word in ("--set", text)]


@dataclass
class Run:
    code: int
    out: str
    err: str
    summary: dict[str, Any] = field(default_factory=dict)
    log: Path = Path()

    def error(self, code: int) -> str:
        """The text of its only line, an error, if it ended with this code."""
        line = re.fullmatch(r"error: ([^\n]+)\n", self.err)
        assert self.code == code and line, self
        return line[1]


PIPES = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}


def spawn(words: Iterable[object], **how: object) -> subprocess.Popen:
    """Start a program; what it prints is text in pipes."""
    return subprocess.Popen([*map(str, words)], **{**PIPES, **how})


def run_alone(*words: object, **how: object) -> Run:
    """Run dahl-loop with these options alone."""
    command = [program(), *map(str, words)]
    done = subprocess.run(command, timeout=20, check=False, **{**PIPES, **how})
    return Run(done.returncode, done.stdout, done.stderr)


def run_program(*words: object, **how: object) -> Run:
    """Run `dahl loop` with these options alone."""
    command = [sys.executable, "-m", "dahl", "loop", *map(str, words)]
    done = subprocess.run(command, timeout=60, check=False, **{**PIPES, **how})
    return Run(done.returncode, done.stdout, done.stderr)


class KeptRunFile(RunFile):
    """A run file whose files stay in a folder, so that no process must inherit them."""

    def __init__(self, folder: Path, *words: Any) -> None:
        self.folder, self.files = folder, 0
        super().__init__(*words)

    def _in_memory(self, text: str) -> str:
        self.files += 1
        path = self.folder / f"dahl-loop.{self.files}"
        path.write_text(text, encoding="utf-8", errors="surrogateescape")
        return str(path)


STARTED: dict[Path, tuple[KeptRunFile, str, int, bool]] = {}  # facts of the last run of a folder


def command(folder: Path, scene: Path | str, *options: object) -> list[str]:
    """The words that start dahl-loop as `dahl loop --scene` does."""
    parser = argparse.ArgumentParser(allow_abbrev=False)
    parser.add_argument("--set", action="append", default=[])
    for name in ("--data", "--log-file"):
        parser.add_argument(name, type=Path)
    own, rest = parser.parse_known_args([*map(str, options)])
    for name, default in (("--role", "both"), ("--bus", "loopback"), ("--seed", "1")):
        parser.add_argument(name, default=default)
    facts, _ = parser.parse_known_args(rest)
    played = scenes.read(Path(scene), own.set)
    log = own.log_file
    if played.log and not log and facts.role != "node":
        log = data.find_log(played.log, own.data or played.path.parent)
    run_file = KeptRunFile(folder, played, log, facts.role)
    STARTED[folder] = (run_file, facts.bus, int(facts.seed), "--virtual" in rest)
    files = ("--log", folder / "run.log", "--counters", run_file.counters)
    return [program(), *map(str, (run_file.path, *files, *rest))]


def finished(folder: Path, process: subprocess.Popen, timeout: float = 60) -> Run:
    try:
        out, err = process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        process.kill()  # its log would fill the disk
        process.wait()
        raise
    return Run(process.returncode, out, err, summary_of(folder), folder / "run.log")


def summary_of(folder: Path) -> dict[str, Any]:
    """The summary of the last run of a folder, {} if it has written no counters."""
    run_file, *facts = STARTED[folder]
    return run_file.summary(*facts)


def run(folder: Path, scene: Path | str, *options: str, timeout: float = 60) -> Run:
    return finished(folder, start(folder, scene, *options), timeout)


def start(folder: Path, scene: Path | str, *options: str) -> subprocess.Popen:
    """Start a run. Remove the files of an earlier one, so that a test cannot read those."""
    folder.mkdir(exist_ok=True)
    (folder / "run.log").unlink(missing_ok=True)
    return spawn(command(folder, scene, *options))


def ended(folder: Path, process: subprocess.Popen, number: int = signal.SIGTERM) -> Run:
    process.send_signal(number)
    return finished(folder, process)


@contextlib.contextmanager
def serving(
    folder: Path, scene: Path | str, *options: str
) -> Iterator[tuple[subprocess.Popen, int]]:
    """Serve a bus on a free port. The server is terminated on the way out."""
    process = start(folder, scene, "--bus", "socketcand:0", *options)
    try:
        served = process.stdout.readline()
        yield process, int(re.fullmatch(r"socketcand 127\.0\.0\.1:(\d+) vcan0\n", served)[1])
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(15)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@contextlib.contextmanager
def client(port: int, opens: Callable[..., can.BusABC] = can.Bus) -> Iterator[can.BusABC]:
    bus = opens(interface="socketcand", channel="vcan0", host="127.0.0.1", port=port)
    try:
        yield bus
    finally:
        bus.shutdown()


def record(bus: can.BusABC, process: subprocess.Popen, silence: float = 0.5) -> list[str]:
    """All frames until the program has ended and only Status frames come."""
    lines, last_s = [], time.monotonic()
    while process.poll() is None or time.monotonic() - last_s < silence:
        message = bus.recv(0.05)
        lines += [candump_line(message)] if message else []
        is_other = message is not None and message.arbitration_id & ~15 != 0x120
        last_s = time.monotonic() if is_other or process.poll() is None else last_s
    return lines


@dataclass
class Logged:
    time: float
    id: int
    data: bytes
    is_extended: bool = False
    is_foreign: bool = False  # a remote frame or a frame of CAN FD; not in a log


def read_log(path: Path) -> list[Logged]:
    text = path.read_text(encoding="ascii")
    assert text == "" or text.endswith("\n")
    matches = [LINE.fullmatch(line) for line in text.splitlines()]
    assert all(matches), "a line of the log is not whole"
    found = []
    for time_s, _, identifier, text in (match.groups() for match in matches):
        data = b"" if text.startswith("R") else bytes.fromhex(text)
        found.append(Logged(float(time_s), int(identifier, 16), data, len(identifier) == 8))
    return found


def message_of(frame: Logged) -> can.Message:
    return can.Message(
        arbitration_id=frame.id & ~ERROR,
        data=frame.data,
        is_extended_id=frame.is_extended and not frame.id & ERROR,
        is_error_frame=bool(frame.id & ERROR),
    )


def scene_with(folder: Path, name: str, *settings: str) -> Path:
    """A shipped scene with some keys changed: "friction.gain=1"."""
    parser = configparser.ConfigParser(inline_comment_prefixes=(";",), interpolation=None)
    parser.optionxform = str
    parser.read(SCENES / f"{name}.ini")
    for text in settings:
        place, _, value = text.partition("=")
        section, _, key = place.partition(".")
        if not parser.has_section(section):
            parser.add_section(section)
        parser.set(section, key, value)
    with (folder / "scene.ini").open("w") as file:
        parser.write(file)
    return folder / "scene.ini"


def check_node(result: Run, scene: Path, number: int = 0) -> list[tuple[int, bytes]]:
    """The node sent the frames of a dahl.Node that receives the other frames of the log, bit for
    bit and in order, and has its counts. Returns these frames. For virtual time and one node.
    """
    played = scenes.read(scene)
    node = dahl.Node(scenes.element(played), number, **scenes.settings(played))
    sent, due, ticked = [], [], -1
    for frame in read_log(result.log):
        while ticked < int(frame.time * 1000 + 1e-3):
            ticked += 1
            due.append(node.tick(ticked / 1000))
        if frame.id in (0x110 | number, 0x120 | number, 0x140 | number):
            sent.append((frame.id, frame.data))
        else:
            due.append(node.receive(message_of(frame), frame.time))
    assert sent == [(one.arbitration_id, bytes(one.data)) for one in due if one is not None]
    assert result.summary["node"] == vars(node.counts)
    return sent


def word(data: bytes, at: int) -> int:
    return int.from_bytes(data[at : at + 4], "little", signed=True)


def counts_of(log: list[Logged], number: int = 0) -> list[int]:
    return [word(frame.data, 2) for frame in log if frame.id == 0x100 + number]


def torques_of(log: list[Logged], number: int = 0) -> list[tuple[int, int]]:
    """(state, F/Fc in Q30) of each answer, in order."""
    answers = [frame.data for frame in log if frame.id == 0x110 + number]
    return [(data[1] >> 4, word(data, 4)) for data in answers]


def raw_client(port: int, receive_buffer: int | None = None) -> socket.socket:
    peer = socket.socket()
    peer.settimeout(10)
    if receive_buffer:
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
    peer.connect(("127.0.0.1", port))
    for words in (b"", b"< open vcan0 >", b"< rawmode >"):
        peer.sendall(words)
        assert peer.recv(6) == (b"< ok >" if words else b"< hi >")
    return peer


def is_running(pid: int) -> bool:
    """False if the process has ended, also while /proc is read."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return stat.rpartition(")")[2].split()[0] != "Z"


def wait_until(what, seconds: float = 10) -> None:
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)


def wait_for_bytes(path: Path, count: int, seconds: float = 10) -> None:
    """Wait until a file has more bytes than `count`."""
    wait_until(lambda: path.exists() and path.stat().st_size > count, seconds)
