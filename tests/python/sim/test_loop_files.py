# SPDX-License-Identifier: MIT
"""Files of dahl-loop: no output destroys an input, no line is cut, and lines that a full disk or an
unread pipe loses are counted.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import resource
import signal
import struct
import subprocess
import termios
import time
from pathlib import Path

import pytest
from loop_tools import (
    LINE,
    SCENES,
    client,
    command,
    finished,
    program,
    read_log,
    run,
    run_program,
    serving,
    start,
    wait_until,
)

STEERING = SCENES / "steering.ini"
REPLAY = (
    "[scene]\ntitle = t\n[friction]\nsigma0 = 50\nFc = 0.5\ntheta_per_count = 1e-4\n"
    "[motion]\nkind = log\nfile = log.csv\nangle = angle\ncounts_per_unit = 10\n"
)
SHAFT = (
    "[rotor]\ninertia = 0.1\nsigma0 = 50\nFc = 0.5\n[control]\nkp = 1\nkd = 1\ntorque_limit = 1\n"
)


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "log.csv").write_text("angle\n1\n2\n3\n")
    (tmp_path / "scene.ini").write_text(REPLAY + SHAFT)
    return tmp_path / "scene.ini"


@pytest.mark.parametrize("option", ["--log", "--summary", "--trace"])
@pytest.mark.parametrize("way", ["same", "link", "symlink", "dots"])
@pytest.mark.parametrize("victim", ["scene.ini", "log.csv"])
def test_no_output_destroys_an_input(tmp_path, scene, option, way, victim):
    target, other = tmp_path / victim, tmp_path / "other"
    kept = target.read_bytes()
    if way == "link":
        other.hardlink_to(target)
    elif way == "symlink":
        other.symlink_to(target)
    path = {"same": target, "dots": f"{tmp_path}/../{tmp_path.name}/{victim}"}.get(way, other)
    done = run_program("--scene", scene, "--virtual", option, path)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert done.stderr.startswith(f"error: {option} {path}: ") and str(target) in done.stderr
    assert target.read_bytes() == kept


def test_two_outputs_cannot_be_one_file(tmp_path, scene):
    """Existing or new files. /dev/null may be named twice."""
    new = tmp_path / "new"
    for one, other in (("--log", "--summary"), ("--log", "--trace"), ("--trace", "--summary")):
        for again in (new, f"{tmp_path}/./new", "new"):
            done = run_program("--scene", scene, "--virtual", one, new, other, again, cwd=tmp_path)
            assert (done.returncode, done.stderr.count("\n"), new.exists()) == (2, 1, False)
            assert {one, other, str(new)} <= set(re.split(r"[ \n]|: ", done.stderr))
    (tmp_path / "sub").mkdir()
    for apart in (["/dev/null"] * 2, [tmp_path / "a", tmp_path / "b"], [new, tmp_path / "sub/new"]):
        options = ["--virtual", "--log", apart[0], "--summary", apart[1]]
        assert run_program("--scene", scene, *options).returncode == 0
    assert json.loads((tmp_path / "sub/new").read_text())["ticks"] == 3
    roots = ["--virtual", "--log", "/proc/new", "--summary", "/sys/new"]  # both have inode 1
    assert run_program("--scene", scene, *roots).stderr.startswith("error: --log /proc/new: ")


def test_outputs_replace_old_files(tmp_path, scene):
    mask = os.umask(0o027)
    words = (tmp_path, scene, "--virtual", "--trace", tmp_path / "trace.csv")
    try:
        assert run(*words).code == 0
    finally:
        os.umask(mask)
    files = [tmp_path / name for name in ("run.log", "trace.csv", "summary.json")]
    assert {path.stat().st_mode & 0o777 for path in files} == {0o640}
    wanted = [path.read_text() for path in files[:2]]
    for path in files:
        path.write_text("old\n" * 10000)
    assert run_program(*command(*words)[1:]).returncode == 0
    assert json.loads(files[2].read_text())["ticks"] == 3
    assert [path.read_text() for path in files[:2]] == wanted


def test_odd_names_keep_the_summary_valid_json(tmp_path, scene):
    title = '"é€😀\\' + 148 * "t"  # 159 bytes, as many as there may be
    scene.write_text(REPLAY.replace("title = t", f"title = {title}"), encoding="utf-8")
    odd = scene.rename(tmp_path / os.fsdecode("aé€😀".encode() + b"\xe9 \xe2\x82" + b".ini"))
    result = run(tmp_path, odd, "--virtual")
    assert (result.code, result.summary["title"]) == (0, title)
    assert result.summary["scene"] == f"{tmp_path}/aé€😀? ??.ini"


def test_the_path_of_a_measured_log_has_1023_characters_at_most(tmp_path, scene):
    folder = f"{tmp_path}{'/' * (1023 - len(str(tmp_path)) - len('log.csv'))}"
    result = run(tmp_path, scene, "--virtual", "--data", folder)
    assert (result.code, result.summary["ticks"]) == (0, 3)
    done = run_program("--scene", scene, "--virtual", "--data", folder + "/")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert done.stderr.startswith("error: log.csv: ")


# --- full disks -----------------------------------------------------------------------------------


@pytest.mark.parametrize("option", ["--log", "--summary", "--trace"])
@pytest.mark.parametrize("path", ["/dev/full", "absent/file", "shut/file"])
@pytest.mark.parametrize("seconds", [1, 0.002])
def test_an_output_that_cannot_be_written_is_refused(tmp_path, option, path, seconds):
    """Permissions are tested as another user if this one is root. Only the close of a file writes
    the few bytes of a short run.
    """
    (tmp_path / "shut").mkdir(mode=0o500)
    other = {"user": 65534} if os.geteuid() == 0 and path == "shut/file" else {}
    place = path if path[0] == "/" else str(tmp_path / path)
    words = ("--virtual", "--set", f"motor.seconds={seconds}", option, place)
    done = run_program("--scene", SCENES / "creep.ini", *words, **other)
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert done.stderr.startswith(f"error: {option} {place}: ")
    why = {"absent/file": "No such file or directory", "shut/file": "Permission denied"}
    assert why.get(path, "No space left on device") in done.stderr


def test_a_full_standard_output_is_an_error():
    words = [program(), "--scene", STEERING, "--virtual", "--seconds", "0.001", "--summary", "-"]
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            words, stdout=full, stderr=subprocess.PIPE, text=True, timeout=20, check=False
        )
    assert done.returncode == 1 and done.stderr.startswith("error: --summary -: ")


@pytest.mark.parametrize("size", [30000, 30017, 4096])
@pytest.mark.parametrize("goes_on", [False, True])
def test_a_full_disk_leaves_whole_lines_and_counts_the_others(tmp_path, size, goes_on):
    """SIGXFSZ ends the run. If it is ignored, all later lines are missing."""
    words = ("--virtual", "--seconds", "2")
    limited = ["prlimit", f"--fsize={size}", *command(tmp_path, STEERING, *words)]
    deaf = ["sh", "-c", 'trap "" XFSZ; exec "$@"', "sh", *limited]
    process = subprocess.Popen(
        deaf if goes_on else limited, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    result = finished(tmp_path, process)
    assert result.code == 1 and "run.log: File too large" in result.err
    logged = len(read_log(result.log))
    assert size - 60 < result.log.stat().st_size <= size
    missing = int(re.search(r"(\d+) lines", result.err)[1])
    told = result.summary
    assert (told["ticks"] == 2000) == goes_on and told["ticks"] > 0
    status = logged + missing - told["frames_sent"] - told["node"]["ok"]
    assert abs(status - told["ticks"] / 100) <= 1


def test_a_trace_on_a_disk_that_was_full_for_a_while_is_an_error(tmp_path):
    trace = tmp_path / "trace.csv"
    words = command(tmp_path, SCENES / "creep.ini", "--trace", trace, "--set", "motor.seconds=60")
    limited = ["prlimit", "--fsize=30000:unlimited", *map(str, words)]
    deaf = ["sh", "-c", 'trap "" XFSZ; exec "$@"', "sh", *limited]
    process = subprocess.Popen(deaf, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    wait_until(lambda: trace.exists() and trace.stat().st_size == 30000)
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (-1, -1))
    wait_until(lambda: trace.stat().st_size > 30000)
    process.send_signal(signal.SIGTERM)
    result = finished(tmp_path, process)
    assert result.code == 1 and f"error: --trace {trace}: File too large\n" in result.err


# --- pipes ----------------------------------------------------------------------------------------


def piped(folder: Path, scene: Path, *options: object) -> tuple[subprocess.Popen, int]:
    reading, writing = os.pipe()
    words = command(folder, scene, *options)
    words[words.index("--log") + 1] = f"/dev/fd/{writing}"
    process = subprocess.Popen(
        words, pass_fds=[writing], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    os.close(writing)
    return process, reading


def waiting_in(reading: int) -> int:
    return struct.unpack("i", fcntl.ioctl(reading, termios.FIONREAD, b"\0" * 4))[0]


def read_all(reading: int) -> str:
    with open(reading, encoding="ascii") as pipe:
        return pipe.read()


HELD = 2**16 + 2**18  # bytes of a log that a pipe and the buffer of dahl-loop hold
OVERFLOW = HELD // 90  # ticks that write more, with two lines of 47 bytes each


@pytest.mark.parametrize("is_read", [False, True])
def test_a_pipe_that_overflows_loses_whole_lines_that_are_counted(tmp_path, is_read):
    """The pipe is read after the end, or from the overflow on. The trace shows the ticks."""
    trace = tmp_path / "trace.csv"
    process, reading = piped(tmp_path, SCENES / "creep.ini", "--trace", trace)
    wait_until(lambda: trace.exists() and trace.read_bytes().count(b"\n") > OVERFLOW, 60)
    text = b""
    while is_read and len(text) < HELD + 5000:
        text += os.read(reading, 1 << 16)
    process.send_signal(signal.SIGTERM)
    if not is_read:
        process.wait(60)
    lines = (text.decode() + read_all(reading)).splitlines(keepends=True)
    result = finished(tmp_path, process)
    assert result.code == 1
    missing = int(re.fullmatch(r"error: --log /dev/fd/\d+: .*?(\d+) lines.*\n", result.err)[1])
    torn = 0 if lines[-1].endswith("\n") else 1
    assert missing > 0 and torn <= (not is_read)
    assert all(LINE.fullmatch(line.rstrip("\n")) for line in lines[: len(lines) - torn])
    told = result.summary  # a Status every 100 ms, and one at the start
    status = missing + len(lines) - torn - told["frames_sent"] - told["node"]["ok"]
    assert abs(status - told["ticks"] / 100) <= 2


def test_virtual_time_waits_for_the_reader_of_a_pipe(tmp_path):
    """A pipe that is read half a second late, and a named one, lose no line."""
    alone = run(tmp_path / "alone", STEERING, "--virtual")
    process, reading = piped(tmp_path, STEERING, "--virtual")
    time.sleep(0.5)
    assert read_all(reading) == alone.log.read_text()
    result = finished(tmp_path, process)
    assert (result.code, result.err) == (0, "")
    os.mkfifo(tmp_path / "pipe")
    process = start(tmp_path, STEERING, "--virtual", "--log", tmp_path / "pipe")
    assert (tmp_path / "pipe").read_text() == alone.log.read_text()
    assert finished(tmp_path, process).code == 0


def test_ctrl_c_ends_the_wait_for_an_unread_pipe(tmp_path):
    """Virtual time would wait 10 s for each line without room."""
    process, reading = piped(tmp_path, STEERING, "--virtual", "--nodes", "16")
    wait_until(lambda: waiting_in(reading) > 4000)
    time.sleep(0.3)
    process.send_signal(signal.SIGINT)
    result = finished(tmp_path, process)
    os.close(reading)
    assert result.code == 1 and int(re.search(r"(\d+) lines", result.err)[1]) > 0
    assert 0 < result.summary["ticks"] < 30000


def test_a_pipe_without_a_reader_ends_the_run(tmp_path):
    """A reader that has left ends it at once, a reader that never comes after 2 s."""
    process, reading = piped(tmp_path, STEERING)
    os.read(reading, 1000)
    os.close(reading)
    result = finished(tmp_path, process)
    assert (result.code, "Broken pipe" in result.err) == (1, True)
    assert re.search(r"(\d+) lines", result.err) and 0 < result.summary["ticks"] < 10000
    os.mkfifo(tmp_path / "pipe")
    begun = time.monotonic()
    result = run(tmp_path / "b", STEERING, "--virtual", "--log", tmp_path / "pipe", timeout=20)
    assert time.monotonic() - begun > 1.9
    assert (result.code, result.summary) == (1, {})
    assert result.err.startswith(f"error: --log {tmp_path}/pipe: ")


def test_a_killed_run_loses_at_most_4_kib_of_its_log(tmp_path):
    """The log has all frames that a client has received, except its last 4 KiB."""
    with serving(tmp_path, STEERING, "--wait-clients", "1") as (process, port):
        with client(port) as bus:
            seen = sum(bus.recv(5) is not None for _ in range(1000))
        process.kill()
        process.wait()
    text = (tmp_path / "run.log").read_text()
    line = len("(0000000000.000000) vcan0 100#0000000000000000\n")
    assert seen * line - len(text) < 4096 + 2 * line
