# SPDX-License-Identifier: MIT
"""How dahl-loop ends: by signals, with its parent, behind an unread pipe, on a full disk."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import termios
import threading
import time

import pytest
from loop_tools import (
    LINE,
    SCENES,
    client,
    command,
    finished,
    program,
    raw_client,
    read_log,
    run,
    serving,
    start,
    wait_until,
)

STEERING = SCENES / "steering.ini"
ENDINGS = ["HUP", "INT", "QUIT", "TERM", "USR1", "USR2", "PIPE", "ALRM", "XCPU", "XFSZ"]
ENDINGS += ["IO", "PROF", "VTALRM", "STKFLT", "PWR", "RTMIN", "RTMAX"]
VIRTUAL = ("--virtual", "--set", "motion.seconds=300")


@pytest.fixture
def heard():
    """No signal is ignored by what is started here, though nohup or a shell's & began the tests."""
    numbers = (signal.SIGHUP, signal.SIGINT, signal.SIGQUIT)
    ignored = [number for number in numbers if signal.getsignal(number) == signal.SIG_IGN]
    for number in ignored:
        signal.signal(number, signal.SIG_DFL)
    yield
    for number in ignored:
        signal.signal(number, signal.SIG_IGN)


@pytest.mark.usefixtures("heard")
@pytest.mark.parametrize(("name", "options"), [*((name, ()) for name in ENDINGS), ("INT", VIRTUAL)])
def test_every_signal_that_ends_it_leaves_whole_files(tmp_path, name, options):
    process = start(tmp_path, STEERING, *options)
    log = tmp_path / "run.log"
    wait_until(lambda: log.exists() and log.stat().st_size > 10000)
    process.send_signal(signal.Signals[f"SIG{name}"])
    result = finished(tmp_path, process, 20)
    assert (result.code, result.err) == (0, "")
    lines = sum(1 for frame in read_log(log) if frame.id == 0x100)
    assert lines == result.summary["frames_sent"] > 100
    assert result.summary["frames_lost"] == 0


def test_under_nohup_it_goes_on(tmp_path):
    """A hang-up that was ignored when it started stays ignored."""
    words = ["nohup", *command(tmp_path, STEERING, "--seconds", "1.5")]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    log = tmp_path / "run.log"
    wait_until(lambda: log.exists() and log.stat().st_size > 10000)
    process.send_signal(signal.SIGHUP)
    assert finished(tmp_path, process).summary["ticks"] == 1500


def test_in_the_background_of_a_script_it_can_be_interrupted(tmp_path):
    """A shell without job control starts such children with SIGINT ignored."""
    words = " ".join(command(tmp_path, STEERING))
    done = subprocess.run(
        ["sh", "-c", f"{words} & sleep 1; kill -INT $!; wait $!"], timeout=20, check=False
    )
    assert done.returncode == 0
    assert 100 < json.loads((tmp_path / "summary.json").read_text())["ticks"] < 10000


PARENT = """
import os, subprocess, sys
options = [*sys.argv[1:], "--with-parent", str(os.getpid())]
print(subprocess.Popen(options, stdout=subprocess.DEVNULL, start_new_session=True).pid, flush=True)
sys.stdin.read()
"""


def is_running(pid: int) -> bool:
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.usefixtures("heard")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGHUP, signal.SIGTERM])
def test_it_ends_with_its_parent_and_leaves_whole_files(tmp_path, number):
    options = ("--bus", "socketcand:0", "--wait-clients", "0")
    words = [sys.executable, "-c", PARENT, *command(tmp_path, STEERING, *options)]
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as parent:
        child = int(parent.stdout.readline())
        wait_until((tmp_path / "run.log").exists)
        parent.send_signal(number)
    wait_until(lambda: not is_running(child))
    assert json.loads((tmp_path / "summary.json").read_text())["ticks"] >= 0
    read_log(tmp_path / "run.log")


def test_a_parent_that_has_ended_before_is_known(tmp_path):
    """The kernel tells of deaths to come only."""
    gone = subprocess.Popen(["true"])
    gone.wait()
    result = run(tmp_path, STEERING, "--with-parent", str(gone.pid), timeout=20)
    assert (result.code, result.summary["ticks"]) == (0, 0)


@pytest.mark.parametrize("user", [None, 65534])
def test_a_process_that_runs_and_is_no_parent_is_refused(tmp_path, user):
    """Such as $$ in a subshell: it would end at once, and nobody knew why. Or another user's."""
    words = [*command(tmp_path, STEERING, "--virtual"), "--with-parent", "1"]
    may = {"user": user} if user and os.geteuid() == 0 else {}
    done = subprocess.run(words, capture_output=True, text=True, timeout=20, check=False, **may)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert done.stderr.startswith("error: --with-parent 1: ")
    assert str(os.getpid()) in done.stderr


def test_what_a_killed_run_has_not_logged_is_a_page_at_most(tmp_path):
    """What a client has seen is in the log, but for the last 4 KiB of it."""
    with serving(tmp_path, STEERING, "--wait-clients", "1") as (process, port):
        with client(port) as bus:
            seen = sum(bus.recv(5) is not None for _ in range(1000))
        process.kill()
        process.wait()
    text = (tmp_path / "run.log").read_text()
    line = len("(0000000000.000000) vcan0 100#0000000000000000\n")
    assert seen * line - len(text) < 4096 + 2 * line


def piped(folder, *options: str) -> tuple[subprocess.Popen, int]:
    """Logging into a pipe that is open and not read: (program, reading end)."""
    reading, writing = os.pipe()
    words = command(folder, STEERING, *options)
    words[words.index("--log") + 1] = f"/dev/fd/{writing}"
    process = subprocess.Popen(
        words, pass_fds=[writing], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    os.close(writing)
    return process, reading


def waiting_in(reading: int) -> int:
    """Bytes that a pipe holds."""
    return struct.unpack("i", fcntl.ioctl(reading, termios.FIONREAD, b"\0" * 4))[0]


def read_all(reading: int) -> str:
    with open(reading, encoding="ascii") as pipe:
        return pipe.read()


def test_a_pipe_that_nobody_reads_does_not_stop_the_loop(tmp_path):
    """It keeps its ticks; the lines that found no room are counted, and what came is whole."""
    process, reading = piped(tmp_path, "--seconds", "6")
    result = finished(tmp_path, process, 30)
    text = read_all(reading)
    assert result.summary["ticks"] == 6000
    missing = re.fullmatch(
        r"error: --log /dev/fd/\d+: its reader is too slow; (\d+) lines are missing\n", result.err
    )
    assert missing, result.err
    assert result.code == 1
    whole = text[: text.rindex("\n") + 1].splitlines()
    assert all(map(LINE.fullmatch, whole))
    sent = 6000 + result.summary["node"]["ok"] + sum(" 120#" in line for line in whole)
    assert int(missing[1]) >= sent - len(whole) - 1


def test_a_pipe_that_is_read_later_has_whole_lines_and_says_what_is_missing(tmp_path):
    process, reading = piped(tmp_path, "--seconds", "7")
    wait_until(lambda: waiting_in(reading) > 4000)  # it has begun; there is room for less than 4 s
    time.sleep(5.8)
    text = read_all(reading)
    result = finished(tmp_path, process, 30)
    lines = text.splitlines()
    assert text.endswith("\n")
    assert all(map(LINE.fullmatch, lines))
    assert result.code == 1
    missing = int(re.search(r"(\d+) lines are missing", result.err)[1])
    node = result.summary["node"]
    status = missing + len(lines) - result.summary["frames_sent"] - node["ok"]
    assert 50 <= status <= 200 + node["stale"]  # every 100 ms, and at each stall of the machine


def test_in_virtual_time_the_reader_has_its_time(tmp_path):
    alone = run(tmp_path / "alone", STEERING, "--virtual")
    process, reading = piped(tmp_path, "--virtual")
    time.sleep(1)
    text = read_all(reading)
    result = finished(tmp_path, process, 30)
    assert (result.code, result.err) == (0, "")
    assert text == alone.log.read_text()


def test_ctrl_c_ends_the_patience_with_a_pipe_that_nobody_reads(tmp_path):
    """In virtual time, where a reader has 10 s at each line that finds no room: 32 a tick."""
    process, reading = piped(tmp_path, "--virtual", "--nodes", "16")
    time.sleep(0.7)
    begun = time.monotonic()
    process.send_signal(signal.SIGINT)
    result = finished(tmp_path, process, 30)
    os.close(reading)
    assert time.monotonic() - begun < 6
    assert result.code == 1
    assert re.search(r"its reader is too slow; \d+ lines are missing\n", result.err)
    assert 0 < result.summary["ticks"] < 30000


def test_what_waits_at_the_end_is_given_time_to_be_read(tmp_path):
    """Real time, and more than a pipe holds: read half a second after the last tick."""
    process, reading = piped(tmp_path, "--seconds", "1.5")
    time.sleep(2)
    assert process.poll() is None
    text = read_all(reading)
    result = finished(tmp_path, process, 30)
    assert (result.code, result.err) == (0, "")
    assert text.count(" 100#") == text.count(" 110#") == 1500


def test_a_named_pipe_without_a_reader_is_told(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    begun = time.monotonic()
    result = run(tmp_path, STEERING, "--virtual", "--log", str(tmp_path / "pipe"), timeout=20)
    assert 1.9 < time.monotonic() - begun < 4
    assert result.code == 1
    assert result.err == f"error: --log {tmp_path}/pipe: nobody reads this pipe\n"


def test_a_named_pipe_whose_reader_comes_a_little_later_is_read_whole(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    process = start(tmp_path, STEERING, "--virtual", "--log", str(tmp_path / "pipe"))
    time.sleep(0.5)
    text = (tmp_path / "pipe").read_text()
    assert finished(tmp_path, process).code == 0
    assert text.count(" 110#") == 30000


def test_a_reader_that_leaves_ends_the_run_with_a_line(tmp_path):
    process, reading = piped(tmp_path)
    os.read(reading, 1000)
    os.close(reading)
    result = finished(tmp_path, process, 20)
    assert result.code == 1
    assert re.search(r"Broken pipe; \d+ lines are missing\n", result.err)
    assert 0 < result.summary["ticks"] < 10000


@pytest.mark.parametrize("size", [30000, 30001, 30017, 4096])
def test_where_a_file_may_not_grow_its_lines_are_whole(tmp_path, size):
    """As on a full disk: a piece of a line that still found room is cut off again."""
    limited = ["prlimit", f"--fsize={size}", *command(tmp_path, STEERING, "--virtual")]
    process = subprocess.Popen(limited, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    result = finished(tmp_path, process, 20)
    assert result.code == 1
    assert "run.log: File too large; " in result.err
    assert len(read_log(result.log)) > 80
    assert size - 60 < result.log.stat().st_size <= size
    assert result.summary["ticks"] > 0


def test_missing_lines_are_counted_to_the_last_one(tmp_path):
    """A file that may not grow, and a run that goes on: what is not there is missing."""
    words = ("--virtual", "--seconds", "2")
    alone = run(tmp_path / "alone", STEERING, *words)
    limited = ["prlimit", "--fsize=30000", *command(tmp_path, STEERING, *words)]
    deaf = ["sh", "-c", 'trap "" XFSZ; exec "$@"', "sh", *limited]
    process = subprocess.Popen(deaf, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    result = finished(tmp_path, process, 20)
    assert result.summary["ticks"] == 2000
    missing = int(re.search(r"(\d+) lines are missing", result.err)[1])
    assert missing == len(read_log(alone.log)) - len(read_log(result.log)) > 1000


def test_silent_clients_do_not_hold_their_places(tmp_path):
    """Sixteen connect and say nothing or half a greeting; a while later one that speaks gets in."""
    options = ("--role", "node")
    with serving(tmp_path, STEERING, *options) as (process, port):
        silent = [socket.create_connection(("127.0.0.1", port)) for _ in range(16)]
        for peer in silent[:8]:
            peer.sendall(b"< open vcan0 >")
        begun = time.monotonic()
        for peer in silent:
            peer.settimeout(20)
            while peer.recv(100):
                pass
        assert 4.5 < time.monotonic() - begun < 7.5
        raw_client(port).close()
        process.send_signal(signal.SIGTERM)
        result = finished(tmp_path, process)
    assert result.code == 0
    note = r"(note: socketcand client \d+ dropped: it did not enter raw mode in time\n){16}"
    assert re.fullmatch(note, result.err)


def test_who_speaks_keeps_its_place(tmp_path):
    with serving(tmp_path, STEERING, "--role", "node") as (_, port):
        peer = raw_client(port)
        peer.settimeout(0.5)
        until = time.monotonic() + 6
        while time.monotonic() < until:
            with contextlib.suppress(TimeoutError):
                assert peer.recv(1000) != b""
        peer.close()


def examples() -> list[str]:
    """The command lines that --help prints, whole."""
    text = subprocess.run([program(), "--help"], capture_output=True, text=True, check=True).stdout
    lines = text.partition("Examples")[2].replace("\\\n", " ").splitlines()[1:]
    return [re.sub(r"    \w.*", "", line).strip() for line in lines if "dahl-loop" in line]


def checkout(folder, root):
    """A folder with what the examples name, and a build folder."""
    (folder / "build" / "host" / "host_sim").mkdir(parents=True)
    (folder / "build" / "host" / "host_sim" / "dahl-loop").symlink_to(program())
    (folder / "host_sim").mkdir()
    (folder / "host_sim" / "scenes").symlink_to(SCENES)
    (folder / ".gitignore").write_text((root / ".gitignore").read_text())
    return {path.name for path in folder.iterdir()}


def test_the_printed_examples_run_and_leave_nothing_outside_build(tmp_path, root):
    before = checkout(tmp_path, root)
    alone, served = examples()
    done = subprocess.run(
        ["sh", "-c", alone], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads(done.stdout)["ticks"] == 30000
    port = 20000 + os.getpid() % 10000
    served = served.replace("28600", str(port)).replace("--bus", "--summary build/s.json --bus")
    shell = subprocess.Popen(["sh", "-c", f"{served} wait"], cwd=tmp_path, stdout=subprocess.PIPE)
    assert shell.stdout.readline().startswith(b"socketcand ")
    time.sleep(1)
    assert shell.poll() is None  # it waits for its clients
    client = raw_client(port)
    heard = threading.Thread(target=lambda: client.recv(100000))
    heard.start()
    time.sleep(1)
    heard.join()
    client.close()
    assert shell.wait(10) == 0
    assert 0 < json.loads((tmp_path / "build" / "s.json").read_text())["ticks"] < 20000
    assert {path.name for path in tmp_path.iterdir()} == before
