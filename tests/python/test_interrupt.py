# SPDX-License-Identifier: MIT
"""Ctrl-C at any time of any verb: code 130, one line, no traceback, nobody left behind."""

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
from dahl import interrupt
from loop_tools import SCENES, serving

pytestmark = pytest.mark.usefixtures("library", "dahl_loop")

READY = """
import runpy, sys
sys.path.insert(0, {tools!r})
import dahl.interrupt
dahl.interrupt.at_start()
print("ready", flush=True)
sys.argv[0] = "dahl"
runpy.run_module("dahl", run_name="__main__", alter_sys=False)
"""


@pytest.fixture(scope="module")
def log(tmp_path_factory) -> Path:
    """A log that takes a moment to identify."""
    path = tmp_path_factory.mktemp("log") / "a.csv"
    theta = 0.05 * np.sin(np.linspace(0, 200, 40000))
    force = np.zeros_like(theta)
    for i in range(1, len(theta)):
        step = theta[i] - theta[i - 1]
        side = np.sign(step) or 1.0
        force[i] = side * 0.5 + (force[i - 1] - side * 0.5) * np.exp(-200 * abs(step))
    rows = np.column_stack([np.arange(len(theta)) * 1e-3, theta, force])
    np.savetxt(path, rows, delimiter=",", header="t [s],theta [rad],torque [Nm]", comments="")
    return path


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory, root) -> Path:
    """What a short demo left."""
    folder = tmp_path_factory.mktemp("run")
    words = [sys.executable, "-m", "dahl", "demo", "--scene", "creep", "--seconds", "2"]
    subprocess.run([*words, "--output", folder], cwd=root, check=True, capture_output=True)
    return folder


def started(arguments: list, root: Path, **how) -> subprocess.Popen:
    """The verb in a process group of its own, from the moment on that its first line has run."""
    words = [sys.executable, "-c", READY.format(tools=str(root / "tools")), *map(str, arguments)]
    process = subprocess.Popen(
        words,
        cwd=root,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        **how,
    )
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


def interrupted(process: subprocess.Popen, whole_group: bool) -> bool:
    """Send Ctrl-C; True where it came in time. It may have come too late."""
    if whole_group:
        os.killpg(process.pid, signal.SIGINT)
    else:
        process.send_signal(signal.SIGINT)
    out, errors = process.communicate(timeout=60)
    assert "Traceback" not in out + errors
    assert "KeyboardInterrupt" not in out + errors
    if process.returncode == 130:
        said = re.compile(r"identify |\d+ rows: ")  # progress, and what --follow has found so far
        lines = [line for line in errors.splitlines() if not said.match(line)]
        assert lines == ["interrupted"], errors
        return True
    assert process.returncode in (0, 1, 2), errors
    return False


def verbs(folder: Path, log: Path, run_folder: Path) -> dict[str, list]:
    columns = ["--angle", "theta [rad]", "--torque", "torque [Nm]", "-o", folder]
    own = ["--angle", "theta [rad]", "--sigma0", 100, "--fc", 0.5, "--counts-per-turn", 16384]
    each = folder / "each"
    each.mkdir(exist_ok=True)
    for i in range(6):
        if not (each / f"{i}.csv").exists():
            (each / f"{i}.csv").hardlink_to(log)
    return {
        "demo": ["demo", "--scene", "steering", "--output", folder / "demo"],
        "demo virtual": ["demo", "--scene", "creep", "--output", folder / "virtual"],
        "demo own": ["demo", log, *own, "--output", folder / "own"],
        "identify": ["identify", log, *columns],
        "identify each": ["identify", "--each", each, "--jobs", 2, *columns],
        "excite": ["excite", "--sigma0", 100, "--fc", 0.5, "--counts-per-turn", 16384]
        + ["-o", folder],
        "plot": ["plot", run_folder, "-o", folder / "x.png"],
        "report": ["report", run_folder, "-o", folder / "x.html"],
        "data": ["data"],
        "help": ["--help"],
        "wrong": ["demo", "--nothing"],
    }


@pytest.fixture
def elsewhere(tmp_path):
    """No cache of earlier runs, and sets from a closed port."""
    return {
        **os.environ,
        "MPLCONFIGDIR": str(tmp_path / "mpl"),
        "XDG_CACHE_HOME": str(tmp_path / "cache"),
        "DAHL_DATA_URL": "http://127.0.0.1:1/{path}",
    }


NAMES = [
    "demo",
    "demo virtual",
    "demo own",
    "identify",
    "identify each",
    "excite",
    "plot",
    "report",
]


FEW, MANY = (0.0, 0.4, 1.5), (0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.5, 4.0)


@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    ("whole_group", "latest"),
    [
        pytest.param(False, FEW, id="alone", marks=pytest.mark.checks),
        pytest.param(False, MANY, id="often", marks=pytest.mark.long),
        pytest.param(True, MANY, id="group", marks=pytest.mark.long),
    ],
)
@pytest.mark.parametrize("name", [*NAMES, "data", "help", "wrong"])
def test_ctrl_c_at_random_times(
    tmp_path, root, log, run_folder, elsewhere, name, whole_group, latest
):
    """Soon, while modules are imported, and over the seconds in which it works."""
    arguments = verbs(tmp_path, log, run_folder)[name]
    rng = random.Random(name)
    hits = 0
    for longest in latest:
        process = started(arguments, root, env=elsewhere)
        time.sleep(rng.uniform(0.3, 1) * longest)
        hits += interrupted(process, whole_group)
        until = time.monotonic() + 10
        while members(process.pid) and time.monotonic() < until:
            time.sleep(0.05)
        assert not members(process.pid)
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
        for delay in (0.05, 0.5, 2.0):
            process = started([verb, *bus, *more[verb]], root)
            time.sleep(delay)
            came_in_time = interrupted(process, whole_group=False)
            assert came_in_time or verb == "identify"  # which ends when it knows enough


SWALLOWED = """
import os, signal, sys, time
from dahl import interrupt
class Odd:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.01)
def swallow():
    odd = Odd()
    del odd
    for _ in range(100):
        time.sleep(0.01)
    print("went on")
    return 0
def turn():
    try:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(1)
    except BaseException:
        raise ImportError("numpy could not be loaded")
    return 0
def lose():
    try:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(1)
    except BaseException:
        pass
    with interrupt.Stop() as stop:
        print("" if stop.asked else "went on", end="")
    return 0
def twice():
    with interrupt.Stop() as stop:
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.01)
        if stop.asked:
            os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(1)
    print("went on")
    return 0
def after():
    with interrupt.Stop():
        pass
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(1)
    print("went on")
    return 0
def nohup():
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with interrupt.Stop() as stop:
        os.kill(os.getpid(), signal.SIGHUP)
        time.sleep(0.01)
        if not stop.asked:
            os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.01)
        print("" if stop.asked else "went on", end="")
    return 0
def text():
    exec("os.kill(os.getpid(), signal.SIGINT); time.sleep(1)")
sys.exit(interrupt.guarded(globals()[sys.argv[1]]))
"""


def test_another_thread_than_the_main_one_hears_no_interrupt():
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(interrupt.guarded, lambda: 5).result() == 5


@pytest.mark.parametrize("way", ["swallow", "turn", "lose", "text", "twice", "after", "nohup"])
def test_an_interrupt_that_a_library_swallows_comes_again(root, way):
    """In a __del__ an exception cannot leave; nor may one be turned into another kind, nor be lost
    before a bus runs, nor may one that leaves an exec() (as of a dataclass) change the code. While
    a bus runs the first wish ends it in order, the second at once, and a hang-up under nohup is
    none; after it all is as before.
    """
    done = subprocess.run(
        [sys.executable, "-c", SWALLOWED, way],
        cwd=root / "tools",
        capture_output=True,
        text=True,
        timeout=20,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n")
