# SPDX-License-Identifier: MIT
"""How dahl-loop ends: by each signal, with its parent, and in the examples of its help."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys

import pytest
from loop_tools import (
    SCENES,
    command,
    finished,
    is_running,
    read_log,
    run,
    run_program,
    start,
    wait_until,
)

STEERING = SCENES / "steering.ini"
ENDINGS = ["HUP", "INT", "QUIT", "TERM", "USR1", "USR2", "PIPE", "ALRM", "XCPU", "XFSZ"]
ENDINGS += ["IO", "PROF", "VTALRM", "STKFLT", "PWR", "RTMIN", "RTMAX"]
VIRTUAL = ("--virtual", "--set", "motion.seconds=300")


@pytest.fixture
def default_signals():
    """Restore signals that nohup or a shell ignores."""
    numbers = (signal.SIGHUP, signal.SIGINT, signal.SIGQUIT)
    ignored = [number for number in numbers if signal.getsignal(number) == signal.SIG_IGN]
    for number in ignored:
        signal.signal(number, signal.SIG_DFL)
    yield
    for number in ignored:
        signal.signal(number, signal.SIG_IGN)


@pytest.mark.usefixtures("default_signals")
@pytest.mark.parametrize(("name", "options"), [*((name, ()) for name in ENDINGS), ("INT", VIRTUAL)])
def test_each_signal_ends_a_run_with_whole_files(tmp_path, name, options):
    process = start(tmp_path, STEERING, *options)
    log = tmp_path / "run.log"
    wait_until(lambda: log.exists() and log.stat().st_size > 10000)
    process.send_signal(signal.Signals[f"SIG{name}"])
    result = finished(tmp_path, process, 20)
    assert (result.code, result.err) == (0, "")
    lines = sum(1 for frame in read_log(log) if frame.id == 0x100)
    assert lines == result.summary["frames_sent"] > 100
    assert result.summary["frames_lost"] == 0


@pytest.mark.parametrize(("number", "ends"), [("HUP", False), ("INT", True), ("PIPE", True)])
def test_a_signal_ignored_at_the_start_stays_ignored_except_sigint(tmp_path, number, ends):
    """nohup ignores SIGHUP. A shell starts background jobs with SIGINT ignored."""
    words = command(tmp_path, STEERING, "--seconds", "1")
    shell = ["sh", "-c", f'trap "" {number}; exec "$@"', "sh"]
    process = subprocess.Popen(
        [*shell, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    log = tmp_path / "run.log"
    wait_until(lambda: log.exists() and log.stat().st_size > 10000)
    process.send_signal(signal.Signals[f"SIG{number}"])
    result = finished(tmp_path, process)
    assert (result.code, result.summary["ticks"] < 1000) == (0, ends)


PARENT = """
import os, subprocess, sys
options = [*sys.argv[1:], "--with-parent", str(os.getpid())]
print(subprocess.Popen(options, stdout=subprocess.DEVNULL, start_new_session=True).pid, flush=True)
sys.stdin.read()
"""


@pytest.mark.usefixtures("default_signals")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_run_ends_with_its_parent_and_leaves_whole_files(tmp_path, number):
    options = ("--bus", "socketcand:0", "--wait-clients", "0")
    words = [sys.executable, "-c", PARENT, *command(tmp_path, STEERING, *options)]
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as parent:
        child = int(parent.stdout.readline())
        log = tmp_path / "run.log"
        wait_until(lambda: log.exists() and log.stat().st_size > 10000)
        assert is_running(child)
        parent.send_signal(number)
    wait_until(lambda: not is_running(child))
    assert json.loads((tmp_path / "summary.json").read_text())["ticks"] > 100
    read_log(log)


def test_a_parent_that_has_already_ended_ends_the_run(tmp_path):
    """The kernel reports only later deaths."""
    gone = subprocess.Popen(["true"])
    gone.wait()
    result = run(tmp_path, STEERING, "--with-parent", gone.pid, timeout=20)
    assert (result.code, result.summary["ticks"]) == (0, 0)


@pytest.mark.parametrize("user", [None, 65534])
def test_a_process_that_is_not_the_parent_is_refused(tmp_path, user):
    """Such as $$ in a subshell, or a process of another user."""
    may = {"user": user} if user and os.geteuid() == 0 else {}
    done = run_program("--scene", STEERING, "--virtual", "--with-parent", 1, **may)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert done.stderr.startswith("error: --with-parent 1: ")
    assert str(os.getpid()) in done.stderr
