# SPDX-License-Identifier: MIT
"""Ctrl-C at any time of any command: code 130, one line, no traceback, no process left."""

import re
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from identify_tools import dahl_torque
from loop_tools import SCENES, serving, wait_until
from programs import call

READY = """
import runpy, signal, sys
real = signal.signal
def first(*given):
    signal.signal, before = real, real(*given)
    print("ready", flush=True)
    return before
signal.signal = first
sys.argv[0] = "dahl"
runpy.run_module("dahl", run_name="__main__", alter_sys=False)
"""


def started(arguments: list[object], folder: Path) -> subprocess.Popen:
    words = [sys.executable, "-c", READY, *map(str, arguments)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(words, cwd=folder, start_new_session=True, **pipes)
    assert process.stdout.readline() == "ready\n"
    return process


def members(group: int) -> list[int]:
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, pgrp = stat.read_text().rpartition(")")[2].split()[:3]
        except (OSError, ValueError):
            continue
        if int(pgrp) == group and state != "Z":
            found.append(int(stat.parent.name))
    return found


def interrupted(process: subprocess.Popen) -> bool:
    """Send Ctrl-C. False if the command had already ended."""
    process.send_signal(signal.SIGINT)
    out, errors = process.communicate(timeout=60)
    assert "Traceback" not in out + errors
    assert "KeyboardInterrupt" not in out + errors
    wait_until(lambda: not members(process.pid))
    if process.returncode == 130:
        said = re.compile(r"identify |\d+ rows: ")  # progress, and interim results of --follow
        lines = [line for line in errors.splitlines() if not said.match(line)]
        assert lines == ["interrupted"], errors
        return True
    assert process.returncode in (0, 1, 2), errors
    return False


# --- any command, early and during its work -------------------------------------------------------

COLUMNS = ("--angle", "theta [rad]", "--torque", "torque [Nm]", "-o", "out")
BUS = ("-i", "socketcand", "-c", "vcan0", "--host", "127.0.0.1", "--port", "PORT")
FOLLOW = ("--follow", "--dbc", ROOT / "lib/node/dahl.dbc", "--angle", "Count")
VERBS = {
    "demo": ("demo", "--scene", "steering", "-o", "out"),
    "demo virtual": ("demo", "--scene", "creep", "-o", "out"),
    "identify": ("identify", "a.csv", *COLUMNS),
    "identify each": ("identify", "--each", ".", "--jobs", 2, *COLUMNS),
    "excite": ("excite", "--sigma0", 100, "--fc", 0.5, "--counts-per-turn", 16384, "-o", "out"),
    "help": ("--help",),
    "monitor": ("monitor", *BUS),
    "record": ("record", *BUS, "--force", "-o", "x.log"),  # a recording ends in order
    "follow": ("identify", *BUS, *FOLLOW, "--torque", "TorqueRatio", "-o", "out"),
}
QUICK = ("demo", "monitor", "record", "follow")


def write_log(path: Path) -> None:
    """Write a log whose identification is slow enough to interrupt."""
    theta = 0.05 * np.sin(np.linspace(0, 200, 40000))
    rows = np.column_stack([np.arange(len(theta)) * 1e-3, theta, dahl_torque(theta)])
    np.savetxt(path, rows, delimiter=",", header="t [s],theta [rad],torque [Nm]", comments="")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[] if n in QUICK else pytest.mark.checks) for n in VERBS]
)
def test_ctrl_c_ends_a_command_in_one_line(tmp_path, name):
    write_log(tmp_path / "a.csv")
    with serving(tmp_path / "node", SCENES / "steering.ini") as (_, port):
        words = [port if word == "PORT" else word for word in VERBS[name]]
        hits = []
        for delay in (0.05, 1.0):
            process = started(words, tmp_path)
            time.sleep(delay)
            hits.append(interrupted(process))
    assert hits[0] or name == "help"


# --- a library that swallows the interrupt --------------------------------------------------------

SWALLOWED = """
import os, signal, sys, time
import can
from dahl.__main__ import main

def asked(number=signal.SIGINT):
    os.kill(os.getpid(), number)

class Bus:
    '''A silent bus.'''
    def __enter__(self):
        return self
    def __exit__(self, *_):
        pass
    def recv(self, timeout):
        time.sleep(timeout)

class Odd:
    def __del__(self):  # an exception cannot leave it
        asked()
        time.sleep(0.01)

def swallow():
    odd = Odd()
    del odd
    for _ in range(100):
        time.sleep(0.01)

def turn():
    try:
        asked()
        time.sleep(1)
    except BaseException:
        raise ImportError("numpy could not be loaded")

def lose():
    try:
        asked()
        time.sleep(1)
    except BaseException:
        return Bus()

def text():  # as of a dataclass
    exec("asked(); time.sleep(1)")

class Twice(Bus):
    def recv(self, timeout):
        asked(signal.SIGTERM)
        time.sleep(0.01)
        asked(signal.SIGTERM)
        time.sleep(1)

class After(Bus):
    def __exit__(self, *_):
        asked()
        time.sleep(1)

def nohup():
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    return Hanging()

class Hanging(Bus):
    heard = 0
    def recv(self, timeout):
        Hanging.heard += 1
        if Hanging.heard == 3:
            asked()
        else:
            asked(signal.SIGHUP)
        time.sleep(0.01)

words = ["monitor", "-i", "virtual", "-c", "x", "--seconds"]
for way in sys.argv[1:]:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    can.Bus = lambda **_: globals()[way]()
    print(way, main([*words, "0.1" if way == "After" else "20"]), flush=True)
print("SIGHUP is ignored", Hanging.heard > 2)
"""


WAYS = ("swallow", "turn", "lose", "Twice", "After", "nohup", "text")


def test_an_interrupt_that_a_library_swallows_is_raised_again():
    """Swallowed in __del__, turned into another exception, lost before a bus runs, or raised in
    exec(). While a bus runs, the first signal ends it in order (1: there was no frame) and the
    second at once. SIGHUP under nohup is ignored.
    """
    done = call(sys.executable, "-c", SWALLOWED, *WAYS, timeout=120)
    assert done.returncode == 0, done.stderr
    codes = [f"{way} {1 if way == 'nohup' else 130}" for way in WAYS]
    assert done.stdout.splitlines() == [*codes, "SIGHUP is ignored True"]
    lines = done.stderr.splitlines()
    assert lines.pop(WAYS.index("nohup")).startswith("error: no frame ")
    assert lines == ["interrupted"] * (len(WAYS) - 1)


def test_a_command_restores_the_handlers_of_signals(dahl):
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(number) for number in numbers]
    dahl("monitor", "-i", "virtual", "-c", "x", "--seconds", "0.05")
    assert [signal.getsignal(number) for number in numbers] == before


def test_a_command_runs_in_another_thread(dahl):
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(dahl, "data", "--json").result().returncode == 0
