# SPDX-License-Identifier: MIT
"""The pytest plugin in test files of a user, in a folder outside the tree."""

import contextlib
import logging
import re
import socket
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import dahl.node  # noqa: F401  # pytester forgets what it imports, and dahl.Node would be two classes
import pytest
from conftest import ROOT
from dahl.binding import models
from dahl.can import pytest_plugin
from dahl.can.rig import NoRig, open_rig
from dahl.codec import Param, ParamWrite
from loop_tools import client, serving

pytest_plugins = ["pytester"]
README, PAGE = (  # the test of the readme, the last example of the page
    re.findall(r"```python\n(.*?)```", (ROOT / name).read_text(), re.DOTALL)[-1]
    for name in ("README.md", "docs/python.md")
)
SCENE = "[friction]\nsigma0 = 100\nFc = 0.5\ntheta_per_count = 3.8e-4\n"


class Outcome(NamedTuple):
    code: int
    last: str
    said: str


@pytest.fixture
def outcome(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch, library: Path
) -> Callable[..., Outcome]:
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    monkeypatch.delenv("PYTEST_ADDOPTS", raising=False)

    def run(text: str, *options: str) -> Outcome:
        path = pytester.makepyfile(text)
        words = ["-p", "dahl.pytest_plugin", "-p", "no:cacheprovider", "-q"]
        words += ["-o", "dahl_answer_timeout=20"]  # for a busy machine
        words += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]  # it is imported already
        done = pytester.runpytest_inprocess(*words, *options, path)
        text = done.stdout.str() + done.stderr.str()
        return Outcome(int(done.ret), (done.outlines or [""])[-1], text)

    return run


def test_the_bus_is_opened_with_each_option(outcome):
    """A virtual one too: a test that names a channel shares it with another bus."""
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


def options_of(port: int) -> list[str]:
    words = ["--dahl-interface", "socketcand", "--dahl-channel", "vcan0"]
    return [*words, "--dahl-bus-kwargs", f"host=127.0.0.1 port={port}"]


@contextlib.contextmanager
def rig(
    folder: Path, lines: str = "", *options: str
) -> Iterator[tuple[list[str], subprocess.Popen]]:
    (folder / "scene.ini").write_text(f"{SCENE}{lines}\n")
    words = ("--role", "node", *options)
    with serving(folder / "loop", folder / "scene.ini", *words) as (process, port):
        yield options_of(port), process


# --- rig and simulation ---------------------------------------------------------------------------

SAME = """
import dahl, pytest, time
from dahl import codec, node
from dahl.codec import EncoderState, Errors, Param, ParamWrite, State

PLAN = dahl.Plan(50, 2, 1e-3)
LONG_S = 60  # for an emulated kernel on a busy machine

def ask(bus, frame):
    return node.ask(bus, frame, timeout=LONG_S)

@pytest.fixture
def dahl_node_settings():
    return {"timeout": LONG_S}

@pytest.mark.dahl(plan=PLAN)
def test_what_a_node_says(dahl_bus, dahl_node, dahl_plan):
    assert (dahl_node.number, dahl_node.state, dahl_node.errors) == (0, State.INIT, 0)
    assert dahl_node.friction == dahl_plan == PLAN and dahl_node.counts.ok == 0
    alone = dahl.Friction(PLAN)
    for counter, count in enumerate((0, 40)):
        answer = ask(dahl_bus, EncoderState(count, counter))
        assert answer.torque_q30 == alone.step_counts_q30(count)
    time.sleep(0.3)  # the timeout is that of dahl_node_settings
    assert (dahl_node.state, dahl_node.counts.ok) == (State.OK, 2)
    node.expect_silence(dahl_bus, EncoderState(40, 1), seconds=0.5)
    assert (dahl_node.state, dahl_node.errors) == (State.REPEATED, Errors.REPEATED)
    spoiled = codec.pack(EncoderState(50, 2))
    spoiled.data[3] ^= 1
    node.expect_silence(dahl_bus, spoiled, seconds=0.5)
    assert dahl_node.state == State.CRC
    assert ask(dahl_bus, EncoderState(60, 4)).state == State.LOST
    counts = dahl_node.counts
    assert (counts.ok, counts.lost, counts.repeated, counts.crc, counts.format) == (3, 2, 1, 1, 0)
    assert (counts.wrong_sequence, counts.jump, counts.invalid, counts.stale) == (0, 0, 0, 0)
    for counter in (9, 10):
        dahl_bus.send(codec.pack(EncoderState(60, counter)))
    assert ask(dahl_bus, EncoderState(60, 11)).state == State.WRONG_SEQUENCE
    assert dahl_node.counts.ok == 3

@pytest.mark.dahl(timeout=50, gain=0.5, status_period=0.03)
def test_settings(dahl_bus, dahl_node):
    ask(dahl_bus, EncoderState(0))
    assert ask(dahl_bus, EncoderState(10**6, 1)).ratio == 0.5
    for param, value in ((Param.TIMEOUT, 50), (Param.GAIN, 0.5), (Param.STATUS, 0.03)):
        assert ask(dahl_bus, ParamWrite(param)).si == value
    ask(dahl_bus, ParamWrite.of_si(Param.TIMEOUT, 0.1))
    while dahl_node.state != State.STALE:
        time.sleep(0.1)
    assert dahl_node.errors == Errors.STALE

@pytest.mark.dahl(status_period=0)
def test_no_status(dahl_bus, dahl_node):
    ask(dahl_bus, EncoderState(0))
    while dahl_bus.recv(0.2):
        pass
    assert (dahl_node.state, dahl_node.errors, dahl_node.counts.ok) == (State.INIT, 0, 1)
    assert dahl_bus.recv(0.1) is None
    assert ask(dahl_bus, ParamWrite(Param.STATUS)).si == 0

def test_frames_wait_for_the_test_while_properties_are_read(dahl_bus, dahl_node):
    dahl_bus.send(codec.pack(EncoderState(0)))
    while dahl_node.counts.ok == 0:
        time.sleep(0.01)
    heard = []
    while message := dahl_bus.recv(0.2):
        heard.append(type(codec.unpack(message)))
        if heard[-1] == codec.FrictionTorque:
            break
    assert codec.FrictionTorque in heard and codec.ParamReply not in heard
"""


@pytest.mark.parametrize("where", ["here", "on a rig", "served on its bus"])
def test_the_same_tests_run_on_a_simulated_node_and_on_a_rig(outcome, tmp_path, dahl_loop, where):
    number = 9 if where == "served on its bus" else 0  # of the rig
    with rig(tmp_path, f"gain = 0.75\nnode = {number}") as (bus, _):
        before = parameters(bus, number)
        options = {"here": (), "on a rig": bus}.get(where, [*bus, "--dahl-serve"])
        done = outcome(SAME, *options)
        assert (done.code, done.last[:8]) == (0, "4 passed"), done.said
        assert "dahl.node" not in {thread.name for thread in threading.enumerate()}
        readme = outcome(f"{README}    assert dahl_node.counts.ok == 2\n", *options)
        assert (readme.code, readme.last[:8]) == (0, "1 passed"), readme.said
        assert parameters(bus, number) == before


def parameters(options: list[str], number: int) -> list[int]:
    """Raw values of all parameters of a node of the rig."""
    with client(int(options[-1].rpartition("=")[2])) as bus:
        replies = (dahl.node.ask(bus, ParamWrite(one), number, timeout=60) for one in Param)
        return [reply.value for reply in replies]


ON_A_RIG = """
import copy, dahl, pytest, time
from concurrent.futures import ThreadPoolExecutor
from dahl import codec, node
from dahl.codec import EncoderState

NUMBERS = ("ignored", "params", "format", "repeated", "stale", "bus_off")
UNKNOWN = {f"counts.{name}": lambda one, name=name: getattr(one.counts, name) for name in NUMBERS}
UNKNOWN |= {"copy": copy.copy, "receive": lambda one: one.receive(None)}
UNKNOWN |= {"tick": lambda one: one.tick(1.0), "==": lambda one: one == dahl.Node(one.friction)}
UNKNOWN |= {"counts": lambda one: one.counts == one.counts}

@pytest.mark.dahl(timeout=0.5)
def test_a_count_is_known_if_it_is_0_or_alone_in_a_sum_of_status(dahl_bus, dahl_node):
    for counter in range(3):
        dahl_bus.send(codec.pack(EncoderState(0, counter)))
    assert dahl_node.counts.ok == 3  # it covers the frames just sent
    short = codec.pack(EncoderState(0, 3))
    short.dlc, short.data = 7, short.data[:7]
    for frame in (codec.pack(EncoderState(0, 2)), codec.pack(EncoderState(0, 12)), short):
        dahl_bus.send(frame)
    while dahl_node.state != codec.State.STALE:
        time.sleep(0.1)
    for name, call in UNKNOWN.items():
        with pytest.raises(dahl.RunError) as caught:
            call(dahl_node)
        assert f"dahl_node.{name}" in str(caught.value)
    assert (dahl_node.counts.jump, dahl_node.counts.invalid, dahl_node.counts.ok) == (0, 0, 3)
    with pytest.raises(AttributeError, match="okay"):
        dahl_node.counts.okay
    assert dahl_node == dahl_node and dahl_node in [dahl_node] and dahl_node.counts != 5

def test_threads_may_ask_while_properties_are_read(dahl_bus, dahl_node):
    def read(k):
        return dahl_node.friction.Fc if k % 2 else node.ask(dahl_bus, FC, timeout=60).si
    FC = codec.ParamWrite(codec.Param.FC, counter=7)
    with ThreadPoolExecutor(4) as threads:
        assert set(threads.map(read, range(80))) == {0.5}

@pytest.mark.dahl(status_period=0)
def test_a_status_that_a_property_did_not_cause_is_received(dahl_bus, dahl_node):
    assert dahl_node.errors == 0
    dahl_bus.send(codec.pack(codec.Reset(codec.What.ERRORS)))
    assert dahl_node.friction.Fc == 0.5
    kinds = [type(codec.unpack(message)) for message in iter(lambda: dahl_bus.recv(0.2), None)]
    assert kinds == [codec.Status]
"""


def test_an_unknown_value_of_a_rig_is_an_error(outcome, tmp_path, dahl_loop):
    with rig(tmp_path) as (options, _):
        done = outcome(ON_A_RIG, *options)
    assert (done.code, done.last[:8]) == (0, "3 passed"), done.said


def test_a_rig_of_another_model_keeps_it(outcome, tmp_path, dahl_loop):
    text = """
import dahl, pytest

def test_as_it_is(dahl_node, dahl_plan):
    assert (dahl_plan.sigma0, dahl_node.counts.ok) == (100, 0)
    with pytest.raises(dahl.RunError, match="dahl_node.friction.*17"):
        dahl_node.friction

@pytest.mark.dahl(plan=dahl.Plan(50, 2, 1e-3))
def test_another_plan(dahl_node): pass

@pytest.mark.dahl(plan=dahl.Slip([1, 2], [1, 1], 1e-3))
def test_another_model(dahl_node): pass
"""
    lines = f"model = {models.with_key('breakaway').name}\nbreakaway = 0.5"
    with rig(tmp_path, lines) as (options, _):
        done = outcome(text, *options)
    assert (done.code, done.last[:18]) == (1, "1 passed, 2 errors"), done.said
    assert "refuses SIGMA0 = 50" in done.said and "dahl_node.friction" in done.said
    assert "rig.py" not in done.said


# --- no rig, and several tests at once ------------------------------------------------------------

THREE = """
import pytest

@pytest.mark.parametrize("n", range(3))
def test_alike(dahl_node, n):
    assert dahl_node.counts.ok == 0
"""


@pytest.mark.parametrize("what", ["no bus", "no node", "no such device"])
def test_without_a_rig_the_tests_are_skipped_after_one_try(outcome, tmp_path, dahl_loop, what):
    """python-can alone would try for 10 s in each test."""
    with rig(tmp_path, "node = 5") as (silent, _), socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))  # no server
        options = {
            "no bus": options_of(unused.getsockname()[1]),
            "no node": silent,
            "no such device": ["--dahl-interface", "socketcan", "--dahl-channel", "dahl9"],
        }
        wait = ("--dahl-answer-timeout", "0.8")  # not the 20 s of the ini file
        done = outcome(THREE, *options[what], *wait, "-rs", "--durations=0")
        required = outcome(THREE, *options[what], *wait, "--dahl-require")
        in_file = outcome(THREE, *options[what], *wait, "-o", "dahl_require=true")
    seconds = [float(each) for each in re.findall(r"([\d.]+)s (?:setup|call) ", done.said)]
    assert len(seconds) <= 1 or sorted(seconds)[-2] < 5  # the first test alone waits
    assert (done.code, done.last[:9]) == (0, "3 skipped"), done.said
    [reason] = re.findall(r"no rig: (.*)", done.said)
    assert ("node 0" if what == "no node" else options[what][3]) in reason
    assert what != "no bus" or "`dahl node --port" in reason
    for failed in (required, in_file):
        assert (failed.code, failed.last[:8]) == (1, "3 errors"), failed.said
        assert f"no rig: {reason}" in failed.said and "pytest_plugin.py" not in failed.said
        assert "During handling" not in failed.said


def test_a_rig_that_stops_answering_fails_the_tests(outcome, tmp_path, dahl_loop):
    with rig(tmp_path) as (options, process):
        text = THREE + f"    import os; n == 1 and os.kill({process.pid}, 15)\n"
        done = outcome(text, *options)
    assert done.code == 1 and done.last.startswith("2 passed, ") and "skipped" not in done.last
    assert "ERROR test_a_rig_that_stops_answering_fails_the_tests.py::test_alike[2]" in done.said


def test_parallel_workers_take_turns_on_a_rig(outcome, tmp_path, dahl_loop):
    text = """
import pytest, time
from dahl import codec, node

@pytest.mark.parametrize("n", range(6))
def test_alone(dahl_bus, dahl_node, n):
    for counter in range(16):
        node.ask(dahl_bus, codec.EncoderState(n, counter))
        time.sleep(0.03)
    assert dahl_node.counts.ok == 16 and dahl_node.errors == 0
"""
    with rig(tmp_path) as (options, _):
        done = outcome(text, *options, "-p", "xdist", "-n", "3", "-p", "no:dahl")
    assert (done.code, done.last[:8]) == (0, "6 passed"), done.said


# --- more of a test -------------------------------------------------------------------------------


def test_the_report_of_a_failed_test_has_its_frames(outcome):
    done = outcome("""
import can
from dahl import codec, node

def test_good(dahl_bus, dahl_node):
    node.ask(dahl_bus, codec.EncoderState(7777, 2))

def test_bad(dahl_bus, dahl_node):
    node.ask(dahl_bus, codec.EncoderState(12345, 3))
    dahl_bus.send(can.Message(arbitration_id=0x7FF, data=b"abc", is_extended_id=False))
    spoiled = codec.pack(codec.EncoderState(5, 4))
    spoiled.data[0] ^= 1
    dahl_bus.send(spoiled)
    node.expect_silence(dahl_bus, node=9)
    for counter in (11, 12):
        dahl_bus.send(codec.pack(codec.ParamWrite(codec.Param.FC, counter=counter)))
    while dahl_node.counts.params < 2:
        pass
    assert dahl_node.counts.ok == 2
""")
    assert (done.code, done.last[:8]) == (1, "1 failed"), done.said
    rows = re.findall(r"^ +[\d.]+ (->|<-) ([0-9A-F]{3})#(\w+)(.*)", done.said, re.MULTILINE)
    sent = [(identifier, summary) for way, identifier, _, summary in rows if way == "->"]
    assert [identifier for identifier, _ in sent] == ["100", "7FF", "100", "130", "130"]
    for place, summary in ((0, "12345"), (1, ""), (2, "CRC"), (3, "FC")):
        assert summary in sent[place][1]
    received = [identifier for way, identifier, _, _ in rows if way == "<-"]
    assert {"110", "120"} <= set(received) and received.count("140") == 2
    assert "7777" not in done.said


def test_the_report_of_a_failed_test_counts_the_frames_that_it_omits(outcome):
    """The bus may have gone before the report reads the frames that wait."""
    done = outcome("""
import can

def gone(timeout):
    raise can.CanError("unplugged")

def test_bad(dahl_bus):
    for _ in range(203):
        dahl_bus.send(can.Message(arbitration_id=0x7FF, is_extended_id=False))
    dahl_bus._recv_internal = gone
    assert False
""")
    assert (done.code, done.last[:8]) == (1, "1 failed"), done.said
    assert "(3 earlier frames are left out)" in done.said and done.said.count("-> 7FF#") == 200


def test_the_frames_of_a_failed_test_are_in_junit_xml_and_bounded(outcome, pytester):
    done = outcome(
        """
import can, pytest
from dahl import codec, node

@pytest.fixture
def primed(dahl_bus, dahl_node):
    node.ask(dahl_bus, codec.EncoderState(111, 1))

def test_good(dahl_bus, dahl_node):
    node.ask(dahl_bus, codec.EncoderState(7777, 2))

def test_bad(dahl_bus, primed):
    node.ask(dahl_bus, codec.EncoderState(222, 2))
    assert False

def test_many(dahl_bus, primed):
    for _ in range(300):
        dahl_bus.send(can.Message(arbitration_id=7, data=bytes(64), is_fd=True))
        dahl_bus.send(can.Message(data=bytes(10**5), check=False))
        with pytest.raises(AttributeError):
            dahl_bus.send("x" * 10**5)
    assert False
""",
        *("--junitxml", "result.xml"),
    )
    assert (done.code, done.last[:18]) == (1, "2 failed, 1 passed"), done.said
    cases = ElementTree.parse(pytester.path / "result.xml").iter("testcase")
    good, bad, many = ([one.get("value") for one in case.iter("property")] for case in cases)
    assert good == [] and len(bad) == len(many) == 1
    found = re.findall(r"(?:-> 100#.*count=(\d+)|^(---))", bad[0], re.MULTILINE)
    assert found == [("111", ""), ("", "---"), ("222", "")]  # a line after the set-up
    assert len(many[0].splitlines()) == 201 and len(many[0]) < 100_000
    assert "---" not in many[0]  # the set-up is left out


def test_an_error_of_dahl_points_at_the_line_of_the_test(outcome):
    """A frame of the package itself is no help: the error names its cause."""
    done = outcome("""
import dahl
from dahl import codec, node

def test_ask(dahl_bus):
    node.ask(dahl_bus, codec.EncoderState(5), timeout=0.01)

def test_silence(dahl_bus, dahl_node):
    node.expect_silence(dahl_bus, codec.EncoderState(5), seconds=60)

async def test_await(dahl_async_bus):
    await dahl_async_bus.ask(codec.EncoderState(5), timeout=0.01)

def test_value():
    codec.unpack(codec.pack(codec.EncoderState(5)), codec.Status)
""")
    assert (done.code, done.last[:8]) == (1, "4 failed"), done.said
    files = set(re.findall(r"^(\S+\.py):\d+: ", done.said, re.MULTILINE))
    assert files == {"test_an_error_of_dahl_points_at_the_line_of_the_test.py"}, done.said


def test_the_logger_of_python_can_keeps_its_level(outcome):
    logger = logging.getLogger("can")
    for level in (logging.DEBUG, logging.NOTSET):
        logger.setLevel(level)
        done = outcome("def test_node(dahl_node): pass\n")
        assert (done.code, logger.level) == (0, level), done.said


def test_attempts_to_connect_to_a_rig_are_not_logged(caplog):
    """python-can makes thousands; other records of its logger are kept."""
    caplog.set_level(logging.WARNING, "can")
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        settings = {"interface": "socketcand", "channel": "vcan0", "host": "127.0.0.1"}
        with pytest.raises(NoRig):
            open_rig(settings | {"port": unused.getsockname()[1]}, 0.3)
    logging.getLogger("can.interfaces.socketcand.socketcand").warning("Invalid Frame: <>")
    assert [record.message for record in caplog.records] == ["Invalid Frame: <>"]


def test_the_lock_of_a_rig_follows_its_address(tmp_path, monkeypatch):
    monkeypatch.setenv("CAN_CHANNEL", "can0")
    (tmp_path / "tty").touch()
    (tmp_path / "by-id").symlink_to(tmp_path / "tty")
    kernel, server, serial = ({"interface": name} for name in ("socketcan", "socketcand", "slcan"))
    buses = [  # each row is one bus
        [kernel | more for more in ({}, {"channel": "can0"}, {"channel": "can0", "fd": True})],
        [kernel | {"channel": "can1"}],
        [
            server | {"channel": "vcan0", "host": host, "port": port}
            for host, port in (("127.0.0.1", 29536), ("localhost", "29536"), ("127.1", 29536))
        ],
        [server | {"channel": "vcan0", "host": "127.0.0.1", "port": 29537}],
        [server | {"channel": "vcan0", "host": "127.0.0.2", "port": 29536}],
        [
            serial | {"channel": f"{tmp_path}/{name}", **more}
            for name, more in (
                ("tty", {}),
                ("by-id", {"bitrate": 500000}),
                ("../" + tmp_path.name + "/tty@115200", {}),
            )
        ],
        [serial | {"channel": f"socket://{host}:4000"} for host in ("localhost", "127.0.0.1")],
        *(
            [serial | {"channel": f"socket://{end}"}]
            for end in ("localhost:4001", "[bad", "h:99999")
        ),
        [{"interface": "kvaser", "channel": channel} for channel in (0, "0")],
        [{"interface": "of a user", "channel": channel} for channel in (0, "0")],
    ]
    addresses = [{pytest_plugin._address(one) for one in row} for row in buses]
    assert [len(found) for found in addresses] == [1] * len(buses), addresses
    assert len(set.union(*addresses)) == len(buses)


# --- a bus for several tests ----------------------------------------------------------------------

SESSION = """
import can, dahl, os, pytest
from dahl import codec, node

BUSES = []

@pytest.fixture(scope="session", autouse=True)
def calibrated(dahl_bus):
    dahl_bus.send(can.Message(arbitration_id=0x7F1, is_extended_id=False))
    return dahl_bus

@pytest.mark.parametrize("n", range(3))
def test_alike(calibrated, dahl_bus, dahl_node, n):
    assert calibrated is dahl_bus and dahl_node.counts.ok == 0
    BUSES.append(dahl_bus)
    assert all(bus is dahl_bus for bus in BUSES)
    dahl_bus.send(codec.pack(codec.EncoderState(1000 + n)))  # its answer waits for nobody
    while dahl_node.counts.ok == 0:
        pass

def test_no_frame_of_an_earlier_test_is_received(dahl_bus):
    kinds = {m.arbitration_id & 0x7F0 for m in iter(lambda: dahl_bus.recv(0.1), None)}
    assert kinds <= {0x120}

def test_bad(dahl_bus, dahl_node):
    node.ask(dahl_bus, codec.EncoderState(5), timeout=60)
    assert False
"""


@pytest.mark.parametrize("where", ["here", "on a rig", "with two workers on a rig"])
def test_a_bus_of_the_session_is_open_once_and_each_test_begins_without_frames(
    outcome, tmp_path, dahl_loop, where
):
    with rig(tmp_path) as (options, _):
        words = {"here": (), "on a rig": options}.get(
            where, (*options, "-p", "xdist", "-n", "2", "-p", "no:dahl")
        )
        done = outcome(SESSION, "-o", "dahl_bus_scope=session", *words)
    assert (done.code, done.last[:18]) == (1, "1 failed, 4 passed"), done.said
    counts = re.findall(r"-> 100#.*count=(\d+)", done.said)
    assert counts == ["5"]  # the frames of the failed test alone


def test_a_bus_of_a_test_is_no_bus_for_a_session(outcome):
    done = outcome(SESSION)
    assert done.code == 1 and "ScopeMismatch" in done.said


SEVERAL_NODES = """
def test_more(dahl_bus, dahl_node, dahl_make_node):
    third = dahl_make_node(number=3, friction=dahl.Plan(50, 2, 1e-3), gain=0.5)
    assert (dahl_node.number, dahl_make_node().number, third.number) == (0, 1, 3)
    assert third.friction.Fc == 2
    for number, ratio in ((0, 1), (1, 1), (3, 0.5)):
        node.ask(dahl_bus, codec.EncoderState(0), number)
        assert node.ask(dahl_bus, codec.EncoderState(10**6, 1), number).ratio == ratio
    assert (dahl_node.counts.ok, third.counts.ok) == (2, 2)
    for wrong, said in (({"number": 3}, "number = 3"), ({"number": 2, "gain": 2}, "gain = 2")):
        with pytest.raises(dahl.Error, match=said):
            dahl_make_node(**wrong)
"""


@pytest.mark.parametrize("where", ["here", "on a rig"])
def test_a_test_may_have_more_nodes(outcome, tmp_path, dahl_loop, where):
    with rig(tmp_path, "", "--nodes", "4") as (options, _):
        done = outcome(PAGE + SEVERAL_NODES, *options if where != "here" else ())
    assert (done.code, done.last[:8]) == (0, "3 passed"), done.said


def test_async_tests_need_no_plugin(outcome):
    done = outcome("""
import asyncio, dahl, pytest
from dahl.codec import EncoderState, Param, ParamWrite

class TestAsync:
    @pytest.mark.parametrize("wanted", [0, 1])
    async def test_torque(self, dahl_async_bus, dahl_node, wanted, own="a default"):
        assert (await dahl_async_bus.ask(EncoderState(0))).ratio == wanted

async def test_several_at_once(dahl_async_bus, dahl_node, dahl_make_node):
    nodes = {0: dahl_node, 3: dahl_make_node(3, dahl.Plan(100, 0.25, 1e-3))}
    asked = [dahl_async_bus.ask(ParamWrite(Param.FC, counter=k), k % 2 * 3) for k in range(8)]
    replies = [(reply.counter, reply.si) for reply in await asyncio.gather(*asked)]
    assert replies == [(k, nodes[k % 2 * 3].friction.Fc) for k in range(8)]
    await dahl_async_bus.expect_silence(EncoderState(0), node=7, seconds=0.02)
    with pytest.raises(dahl.RunError, match="silent"):
        await dahl_async_bus.expect_silence(EncoderState(0), seconds=9)
    await dahl_async_bus.send(ParamWrite(Param.GAIN), 3)
    while (message := await dahl_async_bus.recv()).arbitration_id != 0x143:
        pass
""")
    assert (done.code, done.last[:18]) == (1, "1 failed, 2 passed"), done.said
    assert "test_torque[1]" in done.said


def test_the_nearest_mark_or_fixture_configures_the_node(outcome):
    done = outcome("""
import dahl, math, pytest

pytestmark = pytest.mark.dahl(number=4)

def test_node(dahl_bus, dahl_node):
    assert dahl_node.number == 4

def test_default(dahl_plan, dahl_node_settings, dahl_bus_settings):
    assert dahl_bus_settings["interface"] == "virtual" and dahl_bus_settings["channel"]
    assert dahl_plan == dahl.Plan(100, 0.5, 2 * math.pi / 16384)
    assert dahl_node_settings == {"timeout": 10}

class TestNearest:
    pytestmark = pytest.mark.dahl(plan=dahl.Plan(1, 2, 3))

    def test_plan(self, dahl_plan, dahl_node):
        assert dahl_node.friction == dahl_plan == dahl.Plan(1, 2, 3)

class TestOwnFixture:
    @pytest.fixture
    def dahl_plan(self):
        return dahl.Plan(3, 2, 1)

    def test_plan(self, dahl_node):
        assert dahl_node.friction == dahl.Plan(3, 2, 1)
""")
    assert (done.code, done.last[:8]) == (0, "4 passed"), done.said


def test_each_test_that_uses_the_bus_has_the_mark(outcome):
    text = "def test_bus(dahl_bus): pass\ndef test_none(): pass\n"
    done = outcome(text, "--strict-markers", "-m", "dahl")
    assert (done.code, done.last[:23]) == (0, "1 passed, 1 deselected "), done.said


# --- errors ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mark", "value"),
    [("5", "5"), ("gian=1", "gian"), ("gain=7", "gain = 7"), ("plan=3", "friction = 3")],
)
def test_a_wrong_mark_is_one_line(outcome, mark, value):
    done = outcome(f"import pytest\n@pytest.mark.dahl({mark})\ndef test_node(dahl_node): pass\n")
    assert (done.code, done.last[:7]) == (1, "1 error"), done.said
    assert value in done.said and "pytest_plugin" not in done.said.replace("-p dahl", "")


VIRTUAL = ("--dahl-interface", "virtual", "--dahl-bus-kwargs")
REFUSED = [
    (("--dahl-channel", "can0"), "--dahl-channel goes with --dahl-interface"),
    (("--dahl-serve",), "--dahl-serve goes with --dahl-interface"),
    ((*VIRTUAL, "fd=True bitrate"), "bitrate: KEY="),
    ((*VIRTUAL, "=1"), "=1: KEY=VALUE was expected"),
    (("--dahl-require",), "--dahl-require goes with --dahl-interface"),
    *(
        (("-o", f"dahl_answer_timeout={value}"), f"dahl_answer_timeout = {value}: 0 < ")
        for value in ("0", "-1", "nan", "60.1", "1 s")
    ),
    (("--dahl-answer-timeout", "0"), "dahl_answer_timeout = 0.0: 0 < "),
    (("-o", "dahl_bus_scope=test"), "dahl_bus_scope = test: one of function,"),
    (
        ("--dahl-interface", "socketcand", "--dahl-channel", "x"),  # it needs a host
        "cannot open the bus (interface=socketcand channel=x)",
    ),
]


@pytest.mark.parametrize(("options", "message"), REFUSED)
def test_wrong_options_of_the_bus_are_refused_and_no_test_runs(outcome, options, message):
    """A test of can0 must not pass on another bus. No internal frames are shown."""
    done = outcome(README, *options)
    assert done.code in (1, pytest.ExitCode.USAGE_ERROR) and "passed" not in done.said
    assert message in done.said
    assert "open_bus" not in done.said and "During handling" not in done.said
