# SPDX-License-Identifier: MIT
"""The fixtures of pytest as a user's test file has them, in a folder that is not ours."""

from __future__ import annotations

import contextlib
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import dahl.node  # noqa: F401  # pytester forgets what it imports, and dahl.Node would be two classes
import pytest
from conftest import ROOT
from loop_tools import serving

pytest_plugins = ["pytester"]
README = re.findall(r"```python\n(from dahl.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
SCENE = "[friction]\nsigma0 = 100\nFc = 0.5\ntheta_per_count = 3.8e-4\n"


class Outcome(NamedTuple):
    """Code, last line and all lines of a run of pytest."""

    code: int
    last: str
    said: str


@pytest.fixture
def outcome(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch, library: Path
) -> Callable[..., Outcome]:
    """Run pytest on a test file with these lines; the plugin by name, installed or not."""
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    monkeypatch.delenv("PYTEST_ADDOPTS", raising=False)

    def run(text: str, *options: str) -> Outcome:
        path = pytester.makepyfile(text)
        words = ("-p", "dahl.pytest_plugin", "-p", "no:cacheprovider", "-q")
        done = pytester.runpytest_inprocess(*words, *options, path)
        return Outcome(int(done.ret), done.outlines[-1], done.stdout.str())

    return run


def test_the_example_of_the_readme(outcome):
    (example,) = README
    assert len([line for line in example.splitlines() if line]) <= 5
    done = outcome(example)
    assert (done.code, done.last[:8]) == (0, "1 passed"), done.said
    assert "dahl.node" not in {thread.name for thread in threading.enumerate()}  # it has ended
    wrong = outcome(example.replace("ratio == 1", "ratio == 0.5"))
    assert (wrong.code, wrong.last[:8]) == (1, "1 failed"), wrong.said


def test_each_test_has_a_node_and_a_bus_of_its_own(outcome):
    done = outcome("""
import dahl, pytest, time
from dahl import codec, node

channels = []

@pytest.fixture
def dahl_plan():
    return dahl.Plan(50, 2, 1e-3)

@pytest.mark.parametrize("counter", [3, 9])
def test_plan(dahl_bus, dahl_node, counter):
    assert dahl_node.counts.ok == 0 and dahl_node.friction == dahl.Plan(50, 2, 1e-3)
    assert node.ask(dahl_bus, codec.EncoderState(5, counter)).state == codec.State.INIT
    time.sleep(0.12)  # more than the timeout of a node has by default
    assert node.ask(dahl_bus, codec.EncoderState(6, counter + 1)).state == codec.State.OK
    assert dahl_bus.channel_id not in channels
    channels.append(dahl_bus.channel_id)
    assert node.ask(dahl_bus, codec.ParamWrite(codec.Param.FC)).si == 2
    assert dahl_node.counts.ok == 2
""")
    assert (done.code, done.last[:8]) == (0, "2 passed"), done.said


def test_the_bus_is_opened_with_each_option(outcome):
    """A virtual one too: whoever names a channel shares it with a bus of their own."""
    words = ("--dahl-interface", "virtual", "--dahl-channel", "rig", "--dahl-bus-kwargs")
    done = outcome(
        """
def test_bus(dahl_bus, dahl_bus_settings):
    more = {"preserve_timestamps": True, "rx_queue_size": 7}
    assert dahl_bus_settings == {"interface": "virtual", "channel": "rig", **more}
    bus = dahl_bus
    assert (bus.channel_id, bus.preserve_timestamps, bus.queue.maxsize) == ("rig", True, 7)
""",
        *(*words, "preserve-timestamps=True rx_queue_size=7"),
    )
    assert (done.code, done.last[:8]) == (0, "1 passed"), done.said


@contextlib.contextmanager
def elsewhere(folder: Path, timeout_ms: int = 60000, number: int = 0) -> Iterator[list[str]]:
    """The options for a bus with a node of its own: dahl-loop's."""
    (folder / "scene.ini").write_text(f"{SCENE}timeout_ms = {timeout_ms}\nnode = {number}\n")
    with serving(folder / "loop", folder / "scene.ini", "--role", "node") as (_, port):
        words = ["--dahl-interface", "socketcand", "--dahl-channel", "vcan0"]
        yield [*words, "--dahl-bus-kwargs", f"host=127.0.0.1 port={port}"]


@pytest.mark.parametrize(("options", "number", "node"), [
    ((), 0, "is None"), (("--dahl-serve",), 9, ".counts.ok == 2")
])  # fmt: skip
def test_the_same_test_asks_the_node_of_another_bus(
    outcome, tmp_path, dahl_loop, options, number, node
):
    """That is there, or is served there too where none of its number is."""
    text = f"{README[0]}    assert dahl_node{'' if node[0] == '.' else ' '}{node}\n"
    with elsewhere(tmp_path, number=number) as bus:
        done = outcome(text, *options, *bus)
    assert (done.code, done.last[:8]) == (0, "1 passed"), done.said


def test_the_node_of_a_rig_is_asked_again_and_again(outcome, tmp_path, dahl_loop):
    """Counters that start anew, and pauses after which it is stale, are no matter."""
    with elsewhere(tmp_path, timeout_ms=100) as options:
        for _ in range(2):
            done = outcome(README[0], *options)
            assert (done.code, done.last[:8]) == (0, "1 passed"), done.said
            time.sleep(0.3)


def test_without_python_can_it_says_what_to_install(outcome, monkeypatch):
    monkeypatch.setitem(sys.modules, "can", None)
    done = outcome(README[0])
    assert done.code == 1 and "python-can is not here; pip install" in done.said
    assert "Traceback" not in done.said and "def python_can" not in done.said


def test_a_bus_that_is_not_there_is_one_line(outcome):
    options = ("--dahl-interface", "socketcand", "--dahl-channel", "vcan0")
    done = outcome(README[0], *options)
    assert done.code == 1
    assert "cannot open the bus (interface=socketcand channel=vcan0)" in done.said
    assert "open_bus" not in done.said and "During handling" not in done.said  # no insides


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--dahl-channel", "can0"), "--dahl-channel goes with --dahl-interface"),
        (("--dahl-serve",), "--dahl-serve goes with --dahl-interface"),
        (("--dahl-interface", "virtual", "--dahl-bus-kwargs", "fd=True bitrate"), "bitrate: KEY="),
        (("--dahl-interface", "virtual", "--dahl-bus-kwargs", "=1"), "=1: KEY=VALUE was expected"),
    ],
)
def test_an_option_that_would_be_passed_over_is_refused(pytester, monkeypatch, options, said):
    """A test that should ask can0 must not pass on a bus of its own."""
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    words = ("-p", "dahl.pytest_plugin", "-p", "no:cacheprovider", "-q")
    done = pytester.runpytest_inprocess(*words, *options, pytester.makepyfile(README[0]))
    assert done.ret == pytest.ExitCode.USAGE_ERROR
    assert said in done.stderr.str() and "passed" not in done.stdout.str()
