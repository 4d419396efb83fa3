# SPDX-License-Identifier: MIT
"""How dahl-loop ends: by each signal, and with its parent."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from identify_tools import complaint
from loop_tools import (
    EXAMPLE,
    SCENES,
    command,
    ended,
    is_running,
    read_log,
    run,
    run_alone,
    spawn,
    summary_of,
    wait_for_bytes,
    wait_until,
)

STEERING = SCENES / "steering.ini"
ENDINGS = "HUP INT QUIT TERM USR1 USR2 PIPE ALRM XCPU XFSZ IO PROF VTALRM STKFLT PWR RTMIN RTMAX"
AT_START = "--default-signal"  # nohup or a shell may have ignored some
SIGNALS = [  # signals of the process at its start, the signal, options
    *((AT_START, name, ()) for name in ENDINGS.split()),
    (AT_START, "INT", ("--virtual", "--set", "motion.seconds=300")),
    ("--ignore-signal=INT", "INT", ()),  # a shell ignores it for jobs in the background
    ("--ignore-signal=PIPE", "PIPE", ()),
]


@pytest.mark.parametrize(("at_start", "name", "options"), SIGNALS)
def test_each_signal_ends_a_run_with_whole_files(tmp_path, at_start, name, options):
    process = spawn(["env", at_start, *command(tmp_path, STEERING, *options)])
    wait_for_bytes(tmp_path / "run.log", 10000)
    result = ended(tmp_path, process, signal.Signals[f"SIG{name}"])
    assert (result.code, result.err) == (0, "")
    sent = sum(frame.id == 0x100 for frame in read_log(result.log))
    whole = 300_000 if options else 30_000  # frames of the motion
    assert 100 < sent == result.summary["frames_sent"] < whole
    assert result.summary["frames_lost"] == 0


def test_a_run_under_nohup_ignores_sighup(tmp_path):
    words = ["env", "--ignore-signal=HUP", *command(tmp_path, STEERING, "--seconds", "1")]
    process = spawn(words)
    wait_for_bytes(tmp_path / "run.log", 10000)
    assert ended(tmp_path, process, signal.SIGHUP).summary["ticks"] == 1000


CHILD = '"$@" --with-parent $$ >/dev/null & echo $!; read word'


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_run_ends_with_its_parent_and_leaves_whole_files(tmp_path, number):
    words = ["sh", "-c", CHILD, "sh", *command(tmp_path, STEERING)]
    with spawn(words, stdin=subprocess.PIPE) as parent:
        child = int(parent.stdout.readline())
        wait_for_bytes(tmp_path / "run.log", 10000)
        assert is_running(child)
        parent.send_signal(number)
    wait_until(lambda: not is_running(child))
    assert summary_of(tmp_path)["ticks"] > 100
    read_log(tmp_path / "run.log")


def test_a_parent_that_has_already_ended_ends_the_run(tmp_path):
    """The kernel reports only later deaths."""
    gone = subprocess.Popen(["true"])
    gone.wait()
    result = run(tmp_path, STEERING, "--with-parent", gone.pid, timeout=20)
    assert (result.code, result.summary["ticks"]) == (0, 0)


def test_a_process_that_is_not_the_parent_is_refused(dahl):
    """Such as $$ in a subshell."""
    error = run_alone(EXAMPLE, "--virtual", "--with-parent", 1).error(2)
    assert error.startswith("--with-parent 1: ") and str(os.getpid()) in error
    code, line = complaint(dahl("loop", "--scene", STEERING, "--virtual", "--with-parent", 1))
    assert code == 2 and line.startswith("--with-parent 1: ") and str(os.getppid()) in line


LOOP = [sys.executable, "-m", "dahl", "loop", "--scene", str(STEERING)]


@pytest.mark.parametrize("name", ["INT", "TERM", "HUP"])
def test_a_signal_to_dahl_loop_ends_the_run_with_a_summary(tmp_path, name):
    files = ["--log", str(tmp_path / "run.log"), "--summary", str(tmp_path / "summary.json")]
    process = spawn([*LOOP, *files, "--set", "motion.seconds=300"])
    wait_for_bytes(tmp_path / "run.log", 10000)
    process.send_signal(signal.Signals[f"SIG{name}"])
    assert process.communicate(timeout=60) == ("", "") and process.returncode == 0
    sent = sum(frame.id == 0x100 for frame in read_log(tmp_path / "run.log"))
    assert 100 < sent == json.loads((tmp_path / "summary.json").read_text())["frames_sent"] < 300000


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_run_of_dahl_loop_ends_with_its_parent(tmp_path, number):
    """Also dahl-loop, the child of `dahl loop`."""
    with spawn(["sh", "-c", CHILD, "sh", *LOOP, "--log", tmp_path / "run.log"], stdin=-1) as parent:
        child = int(parent.stdout.readline())
        wait_for_bytes(tmp_path / "run.log", 10000, 30)
        own = Path(f"/proc/{child}/task/{child}/children").read_text().split()
        assert len(own) == 1
        parent.send_signal(number)
    wait_until(lambda: not is_running(child) and not is_running(int(own[0])))
