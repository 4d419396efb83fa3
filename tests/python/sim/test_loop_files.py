# SPDX-License-Identifier: MIT
"""Files of dahl-loop: no output destroys an input, no line is cut, and lines that a full disk or an
unread pipe loses are counted.
"""

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
from itertools import combinations, product
from pathlib import Path

import loop_tools as loop
import pytest
from identify_tools import complaint
from loop_tools import (
    SCENES,
    command,
    ended,
    finished,
    read_log,
    run_alone,
    run_program,
    spawn,
    wait_until,
)

STEERING, CREEP = SCENES / "steering.ini", SCENES / "creep.ini"
OUTPUTS = ("--log", "--summary", "--trace")
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


def links_to(target: Path) -> list[object]:
    """The file by its name, by another path, by a hard and by a symbolic link."""
    folder = target.parent
    link, symlink = folder / "link", folder / "symlink"
    for path in (link, symlink):
        path.unlink(missing_ok=True)
    link.hardlink_to(target)
    symlink.symlink_to(target)
    return [target, f"{folder}/../{folder.name}/{target.name}", link, symlink]


def test_no_output_destroys_an_input(dahl, scene):
    for victim in (scene, scene.with_name("log.csv")):
        kept = victim.read_bytes()
        for option, path in product(OUTPUTS, links_to(victim)):
            code, line = complaint(dahl("loop", "--scene", scene, "--virtual", option, path))
            assert (code, victim.read_bytes()) == (2, kept)
            assert line.startswith(f"{option} {path}: ") and str(victim) in line


def test_no_output_of_dahl_loop_destroys_an_input(tmp_path):
    (tmp_path / "counts").write_text("1\n2\n")
    (tmp_path / "run").write_text("motion.kind = counts\nmotion.file = counts\n")
    for name, option in product(("run", "counts"), ("--log", "--trace", "--counters")):
        victim = tmp_path / name
        kept = victim.read_bytes()
        for path in links_to(victim):
            error = run_alone(tmp_path / "run", "--virtual", option, path).error(2)
            assert error.startswith(f"{option} {path}: ") and str(victim) in error
            assert victim.read_bytes() == kept


def test_two_outputs_cannot_be_one_file(dahl, scene, tmp_path):
    """A file that does not exist is known by folder and name. /dev/null may be named twice."""
    new, words = tmp_path / "new", ("loop", "--scene", scene, "--virtual")
    for one, other in combinations(OUTPUTS, 2):
        for again in (new, f"{tmp_path}/./new", "new"):
            code, line = complaint(dahl(*words, one, new, other, again))
            assert (code, new.exists()) == (2, False)
            assert {one, other, str(new)} <= {*re.split(r" |: ", line)}
            alone = [option.replace("summary", "counters") for option in (one, other)]
            error = run_alone(
                loop.EXAMPLE, "--virtual", alone[0], new, alone[1], again, cwd=tmp_path
            )
            assert {*alone, str(new)} <= {*re.split(r" |: ", error.error(2))} and not new.exists()
    (tmp_path / "sub").mkdir()
    for pair in (["/dev/null"] * 2, [tmp_path / "a", tmp_path / "b"], [new, tmp_path / "sub/new"]):
        assert dahl(*words, "--log", pair[0], "--summary", pair[1]).returncode == 0
    assert json.loads((tmp_path / "sub/new").read_text())["ticks"] == 3
    roots = run_alone(loop.EXAMPLE, "--log", "/proc/new", "--counters", "/sys/new")
    assert roots.err.startswith("error: --log /proc/new: ")  # both folders have inode 1


def test_outputs_replace_old_files(tmp_path, scene):
    files = [tmp_path / name for name in ("run.log", "trace.csv", "summary.json")]
    words = ["--scene", scene, "--virtual"]
    words += [
        word for pair in zip(("--log", "--trace", "--summary"), files, strict=True) for word in pair
    ]
    assert run_program(*words, umask=0o027).code == 0
    assert {path.stat().st_mode & 0o777 for path in files} == {0o640}
    wanted = [path.read_text() for path in files[:2]]
    for path in files:
        path.write_text("old\n" * 10000)
    assert run_program(*words).code == 0
    assert json.loads(files[2].read_text())["ticks"] == 3
    assert [path.read_text() for path in files[:2]] == wanted


def test_odd_names_keep_the_summary_valid_json(dahl, tmp_path, scene):
    title = '"é€😀\\' + 1480 * "t"
    scene.write_text(REPLAY.replace("title = t", f"title = {title}"), encoding="utf-8")
    odd = scene.rename(tmp_path / "aé€😀\u001b.ini")
    done = dahl("loop", "--scene", odd, "--virtual", "--summary", "-")
    assert (done.returncode, json.loads(done.stdout)["title"]) == (0, title)


# --- full disks -----------------------------------------------------------------------------------


@pytest.mark.parametrize("option", ["--log", "--counters", "--trace"])
@pytest.mark.parametrize("seconds", [1, 0.002])
def test_an_output_that_cannot_be_written_is_refused(tmp_path, option, seconds):
    """Only the close of a file writes the few bytes of a short run. Root may write to any folder,
    so the program runs as another user.
    """
    tmp_path.chmod(0o755)
    words = command(tmp_path, CREEP, "--virtual", "--set", f"motor.seconds={seconds}")[1:2]
    words += ["--virtual", option]
    (shut := tmp_path / "shut").mkdir(mode=0o500)
    for path, why in (
        ("/dev/full", "No space left on device"),
        (tmp_path / "absent" / "file", "No such file or directory"),
        *([(shut / "file", "Permission denied")] if os.geteuid() != 0 else []),
    ):
        error = run_alone(*words, path).error(1)
        assert error.startswith(f"{option} {path}: ") and why in error


@pytest.mark.parametrize("path", ["/dev/full", "absent/file", "."])
def test_a_summary_that_cannot_be_written_is_an_error(dahl, path):
    words = ("--scene", STEERING, "--virtual", "--seconds", "0.001", "--summary")
    code, line = complaint(dahl("loop", *words, path))
    assert code == 1 and line.startswith(f"--summary {path}: ")


def test_a_full_standard_output_is_an_error():
    words = ("--virtual", "--seconds", "0.001")
    with open("/dev/full", "w") as full:
        done = run_alone(loop.EXAMPLE, *words, "--counters", "-", stdout=full)
        assert done.error(1).startswith("--counters -: ")
        done = run_program("--scene", STEERING, *words, "--summary", "-", stdout=full)
        assert "No space left" in done.error(1)


def limited(size: str, words: list[str], goes_on: bool = True) -> subprocess.Popen:
    """A program with a limited size of its files. If SIGXFSZ is ignored, it goes on."""
    start = ["env", "--ignore-signal=XFSZ"] if goes_on else []
    return spawn([*start, "prlimit", f"--fsize={size}", *words])


@pytest.mark.parametrize("size", [30000, 30017, 4096])
@pytest.mark.parametrize("goes_on", [False, True])
def test_a_full_disk_leaves_whole_lines_and_counts_the_others(tmp_path, size, goes_on):
    """SIGXFSZ ends the run. If it is ignored, all later lines are missing."""
    words = command(tmp_path, STEERING, "--virtual", "--seconds", "2")
    result = finished(tmp_path, limited(str(size), words, goes_on))
    assert "run.log: File too large" in result.error(1)
    assert size - 60 < result.log.stat().st_size <= size
    assert (result.summary["ticks"] == 2000) == goes_on and result.summary["ticks"] > 0
    check_lines(result, len(read_log(result.log)), late=0)


def check_lines(result: loop.Run, logged: int, late: int) -> None:
    """Logged and missing lines are all frames: counts, answers, and a Status every 100 ms."""
    missing, counts = int(re.search(r"(\d+) lines", result.error(1))[1]), result.summary
    status = logged + missing - counts["frames_sent"] - counts["node"]["ok"]
    assert missing > 0 and abs(status - counts["ticks"] / 100) <= 1 + late


def test_a_trace_on_a_disk_that_was_full_for_a_while_is_an_error(tmp_path):
    trace = tmp_path / "trace.csv"
    words = command(tmp_path, CREEP, "--trace", trace, "--set", "motor.seconds=60")
    process = limited("30000:unlimited", words)
    wait_until(lambda: trace.exists() and trace.stat().st_size == 30000)
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (-1, -1))
    loop.wait_for_bytes(trace, 30000)
    error = ended(tmp_path, process).err
    assert f"error: --trace {trace}: File too large\n" in error


# --- pipes ----------------------------------------------------------------------------------------


def piped(folder: Path, scene: Path, *options: object) -> tuple[subprocess.Popen, int]:
    """Run with a pipe as the log. Return the program and the end to read."""
    reading, writing = os.pipe()
    words = command(folder, scene, *options)
    words[words.index("--log") + 1] = f"/dev/fd/{writing}"
    process = spawn(words, pass_fds=[writing])
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
    process, reading = piped(tmp_path, CREEP, "--trace", trace)
    wait_until(lambda: trace.exists() and trace.read_bytes().count(b"\n") > OVERFLOW, 60)
    text = b""
    while is_read and len(text) < HELD + 5000:
        text += os.read(reading, 1 << 16)
    process.send_signal(signal.SIGTERM)
    if not is_read:
        process.wait(60)
    whole, _, torn = (text.decode() + read_all(reading)).rpartition("\n")
    lines, result = whole.splitlines(), finished(tmp_path, process)
    assert result.err.startswith("error: --log /dev/fd/")
    assert torn == "" or not is_read
    assert all(map(loop.LINE.fullmatch, lines))
    check_lines(result, len(lines), late=1)


def test_virtual_time_waits_for_the_reader_of_a_pipe(tmp_path):
    """A pipe that is read half a second late, and a named one, lose no line."""
    alone = loop.run(tmp_path / "alone", STEERING, "--virtual").log.read_text()
    process, reading = piped(tmp_path, STEERING, "--virtual")
    time.sleep(0.5)
    assert read_all(reading) == alone
    result = finished(tmp_path, process)
    assert (result.code, result.err) == (0, "")
    os.mkfifo(tmp_path / "pipe")
    process = loop.start(tmp_path, STEERING, "--virtual", "--log", tmp_path / "pipe")
    assert (tmp_path / "pipe").read_text() == alone
    assert finished(tmp_path, process).code == 0


def test_ctrl_c_ends_the_wait_for_an_unread_pipe(tmp_path):
    """Virtual time would wait 10 s for each line without room."""
    process, reading = piped(tmp_path, STEERING, "--virtual", "--nodes", "16")
    wait_until(lambda: waiting_in(reading) > 4000)
    time.sleep(0.3)
    result = ended(tmp_path, process, signal.SIGINT)
    os.close(reading)
    assert int(re.search(r"(\d+) lines", result.error(1))[1]) > 0
    assert 0 < result.summary["ticks"] < 30000


def test_a_pipe_without_a_reader_ends_the_run(tmp_path):
    """A reader that has left ends it at once, a reader that never comes after 2 s."""
    process, reading = piped(tmp_path, STEERING)
    os.read(reading, 1000)
    os.close(reading)
    result = finished(tmp_path, process)
    assert re.search(r"Broken pipe; \d+ lines", result.error(1))
    assert 0 < result.summary["ticks"] < 10000
    os.mkfifo(pipe := tmp_path / "pipe")
    begun = time.monotonic()
    error = run_alone(loop.EXAMPLE, "--virtual", "--log", pipe).error(1)
    assert time.monotonic() - begun > 1.9 and error.startswith(f"--log {pipe}: ")


def test_a_killed_run_loses_at_most_4_kib_of_its_log(tmp_path):
    """The log has all frames that a client has received, except its last 4 KiB."""
    with loop.serving(tmp_path, STEERING, "--wait-clients", "1") as (process, port):
        with loop.client(port) as bus:
            seen = sum(bus.recv(5) is not None for _ in range(1000))
        process.kill()
        process.wait()
    line = len("(0000000000.000000) vcan0 100#0000000000000000\n")
    assert seen * line - (tmp_path / "run.log").stat().st_size < 4096 + 2 * line
