# SPDX-License-Identifier: MIT
"""Ctrl-C at any time of any command: code 130, one line, no traceback, no process left."""

from __future__ import annotations

import os
import random
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from identify_tools import dahl_torque
from loop_tools import SCENES, serving, wait_until

pytestmark = pytest.mark.usefixtures("library", "dahl_loop")

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


@pytest.fixture(scope="module")
def log(tmp_path_factory) -> Path:
    """A log that takes a moment to identify."""
    path = tmp_path_factory.mktemp("log") / "a.csv"
    theta = 0.05 * np.sin(np.linspace(0, 200, 40000))
    rows = np.column_stack([np.arange(len(theta)) * 1e-3, theta, dahl_torque(theta)])
    np.savetxt(path, rows, delimiter=",", header="t [s],theta [rad],torque [Nm]", comments="")
    return path


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory, root) -> Path:
    """Files of a short demo."""
    folder = tmp_path_factory.mktemp("run")
    words = [sys.executable, "-m", "dahl", "demo", "--scene", "creep", "--seconds", "2"]
    subprocess.run([*words, "--output", folder], cwd=root, check=True, capture_output=True)
    return folder


def started(arguments: list[object], root: Path, **how: object) -> subprocess.Popen:
    """Start the command in its own process group; return when it handles Ctrl-C."""
    words = [sys.executable, "-c", READY, *map(str, arguments)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(words, cwd=root, start_new_session=True, **pipes, **how)
    assert process.stdout.readline() == "ready\n"
    return process


def members(group: int) -> list[int]:
    """Processes of a group that still run."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, pgrp = stat.read_text().rpartition(")")[2].split()[:3]
        except (OSError, ValueError):
            continue
        if int(pgrp) == group and state != "Z":
            found.append(int(stat.parent.name))
    return found


def interrupted(process: subprocess.Popen, whole_group: bool = False) -> bool:
    """Send Ctrl-C. False if the command had already ended."""
    if whole_group:
        os.killpg(process.pid, signal.SIGINT)
    else:
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


# --- any command, at random times -----------------------------------------------------------------

FEW, MANY = (0.0, 0.4, 1.5), (0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.5, 4.0)
TURNS = ("--sigma0", 100, "--fc", 0.5, "--counts-per-turn", 16384)
COLUMNS = ("--angle", "theta [rad]", "--torque", "torque [Nm]", "-o", "out")
VERBS = {  # LOG, EACH and RUN are files and folders of the test
    "demo": ("demo", "--scene", "steering", "-o", "out"),
    "demo virtual": ("demo", "--scene", "creep", "-o", "out"),
    "demo own": ("demo", "LOG", "--angle", "theta [rad]", *TURNS, "-o", "out"),
    "identify": ("identify", "LOG", *COLUMNS),
    "identify each": ("identify", "--each", "EACH", "--jobs", 2, *COLUMNS),
    "excite": ("excite", *TURNS, "-o", "out"),
    "plot": ("plot", "RUN", "-o", "x.png"),
    "report": ("report", "RUN", "-o", "x.html"),
    "data": ("data",),
    "help": ("--help",),
    "wrong": ("demo", "--nothing"),
}


def words_of(name: str, folder: Path, log: Path, run_folder: Path) -> list[object]:
    each = folder / "each"
    each.mkdir()
    for i in range(6):
        (each / f"{i}.csv").hardlink_to(log)
    files = {"LOG": log, "EACH": each, "RUN": run_folder}
    return [files.get(word, word) for word in VERBS[name]]


@pytest.fixture
def clean_environment(tmp_path) -> dict[str, str]:
    """No cache of earlier runs, and measured sets at a closed port."""
    own = {"MPLCONFIGDIR": str(tmp_path / "mpl"), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    return {**os.environ, **own, "DAHL_DATA_URL": "http://127.0.0.1:1/{path}"}


@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    ("whole_group", "latest"),
    [
        pytest.param(False, FEW, id="alone", marks=pytest.mark.checks),
        pytest.param(False, MANY, id="often", marks=pytest.mark.long),
        pytest.param(True, MANY, id="group", marks=pytest.mark.long),
    ],
)
@pytest.mark.parametrize("name", VERBS)
def test_ctrl_c_at_random_times(
    tmp_path, log, run_folder, clean_environment, name, whole_group, latest
):
    """Early, while modules are imported, and during the work."""
    arguments = words_of(name, tmp_path, log, run_folder)
    rng, hits = random.Random(name), 0
    for longest in latest:
        process = started(arguments, tmp_path, env=clean_environment)
        time.sleep(rng.uniform(0.3, 1) * longest)
        hits += interrupted(process, whole_group)
    assert hits >= 1


@pytest.mark.parametrize("verb", ["monitor", "record", "identify"])
def test_ctrl_c_of_a_client_of_a_bus(tmp_path, root, verb):
    with serving(tmp_path / "node", SCENES / "steering.ini") as (_, port):
        bus = ["-i", "socketcand", "-c", "vcan0", "--host", "127.0.0.1", "--port", port]
        follow = ["--follow", "--dbc", root / "lib" / "node" / "dahl.dbc", "--angle", "Count"]
        more = {
            "record": ["--force", "-o", tmp_path / "x.log"],  # what an interruption left stays
            "identify": [*follow, "--torque", "TorqueRatio", "-o", tmp_path],
            "monitor": [],
        }
        for delay in (0.05, 1.0):
            process = started([verb, *bus, *more[verb]], root)
            time.sleep(delay)
            came_in_time = interrupted(process)
            # A recording ends in order, and identify when it knows enough.
            assert came_in_time or verb in ("identify", "record")


# --- a library that swallows the interrupt --------------------------------------------------------

SWALLOWED = """
import os, signal, sys, time
import can
from dahl.__main__ import main

def asked(number=signal.SIGINT):
    os.kill(os.getpid(), number)

class Bus:
    '''A bus on which nobody speaks.'''
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
        self.heard += 1
        if self.heard == 3:
            asked()
        else:
            asked(signal.SIGHUP)
        time.sleep(0.01)

words = ["monitor", "-i", "virtual", "-c", "x", "--seconds"]
for way in sys.argv[1:]:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    can.Bus = lambda **_: globals()[way]()
    print(way, main([*words, "0.1" if way == "After" else "20"]), flush=True)
"""


WAYS = ("swallow", "turn", "lose", "Twice", "After", "nohup", "text")


def test_an_interrupt_that_a_library_swallows_is_raised_again():
    """Swallowed in __del__, turned into another exception, lost before a bus runs, or raised in
    exec(). While a bus runs, the first signal ends it in order and the second at once. SIGHUP under
    nohup is ignored.
    """
    words = [sys.executable, "-c", SWALLOWED, *WAYS]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [f"{way} 130" for way in WAYS]
    assert done.stderr.splitlines() == ["interrupted"] * len(WAYS)


def test_a_command_runs_in_another_thread(dahl):
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(dahl, "data", "--json").result().returncode == 0
