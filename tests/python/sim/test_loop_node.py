# SPDX-License-Identifier: MIT
"""The served node against python-can, cantools and autosar-e2e: parameters,
timeout, stalls of node or encoder.
"""

from __future__ import annotations

import contextlib
import math
import re
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import can
import cantools
import pytest
from e2e import p02
from loop_model import Q30_BOUND, travel_per_count
from loop_tools import SCENES, client, finished, read_log, record, run, serving, setting

SIGMA0, FC, THETA = 50.0, 0.5, 2.0**-14
SCENE = f"[friction]\nsigma0 = {SIGMA0}\nFc = {FC}\ntheta_per_count = {THETA!r}\n"
PATIENT = ("friction.timeout_ms=60000",)  # Python may be slow
IDS = {"EncoderState": 0x30, "ParamWrite": 0x60, "Reset": 0xA0}
ANSWERS = {"ParamWrite": "ParamReply", "Reset": "Status"}
TRAVEL = travel_per_count(SIGMA0, FC, THETA)


class Encoder:
    """An encoder with frames by cantools and autosar-e2e, and torques in closed form."""

    def __init__(self, bus: can.BusABC, database: cantools.database.Database) -> None:
        self.bus, self.database = bus, database
        self.number = 0  # of the node
        self.w, self.count = 0.0, 0

    def packed(self, name: str, counter: int, **signals: object) -> bytearray:
        """Data of a frame. The protection increments the counter."""
        message = self.database.get_message_by_name(name)
        known = {"Crc": 0, "Counter": (counter - 1) % 16, **signals}
        data = bytearray(message.encode(known, strict=False))
        p02.e2e_p02_protect(data, bytes(IDS[name] | number for number in range(16)))
        return data

    def frame(self, counter: int, count: int, **changes: object) -> can.Message:
        data = self.packed("EncoderState", counter, Valid=1, Count=count)
        known = {"arbitration_id": 0x100 | self.number, "data": data, "is_extended_id": False}
        return can.Message(**{**known, **changes})

    def heard(self, identifier: int, **wanted: str) -> dict:
        """The next frame with this id whose signals are those."""
        until = time.monotonic() + 5
        while (message := self.bus.recv(5)) is not None and time.monotonic() < until:
            if message.arbitration_id == identifier | self.number:
                said = self.database.decode_message(identifier, message.data)
                if all(str(said[name]) == value for name, value in wanted.items()):
                    return said
        raise AssertionError(f"no frame {identifier:X} {wanted}")

    def good(self, counter: int, count: int, state: str = "OK", used: bool = True) -> None:
        """Send a frame that must be answered, and check the answer."""
        self.bus.send(self.frame(counter, count))
        if used and count != self.count:
            side = math.copysign(1, count - self.count)
            self.w = side - (side - self.w) * math.exp(-TRAVEL * abs(count - self.count))
        self.count = count
        answer = self.heard(0x110)
        assert (str(answer["State"]), answer["EchoCounter"]) == (state, counter)
        assert abs(answer["TorqueRatio"] - self.w) < Q30_BOUND

    def asked(self, name: str, counter: int, **signals: object) -> dict:
        """Send a frame of this kind and decode the answer."""
        identifier = self.database.get_message_by_name(name).frame_id
        data = self.packed(name, counter, **signals)
        self.bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
        return self.heard(self.database.get_message_by_name(ANSWERS[name]).frame_id)


@pytest.fixture(scope="module")
def database(dbc: Path) -> cantools.database.Database:
    return cantools.database.load_file(dbc)


@pytest.fixture
def node(tmp_path, database):
    """Serve a node with an encoder as its client. The summary is appended to the list at the
    end.
    """

    @contextlib.contextmanager
    def served(
        *sets: str, options: tuple[str, ...] = ()
    ) -> Iterator[tuple[Encoder, subprocess.Popen, list[dict]]]:
        (tmp_path / "scene.ini").write_text(SCENE)
        results: list[dict] = []
        words = ("--role", "node", *setting(*sets), *options)
        with serving(tmp_path, tmp_path / "scene.ini", *words) as (process, port):
            with client(port) as bus:
                yield Encoder(bus, database), process, results
            process.send_signal(signal.SIGTERM)
            result = finished(tmp_path, process)
            results.append({**result.summary, "err": result.err})

    return served


def test_the_dbc_alone_reads_and_writes_parameters(node):
    """Defaults are its start values. Two values are written together."""
    with node(*PATIENT, "status.period_ms=100") as (encoder, _, results):
        write = encoder.database.get_message_by_name("ParamWrite")
        names = ("Gain", "Limit", "Ramp", "MaxStep", "StatusPeriod")
        for counter, name in enumerate(names):
            line = encoder.asked("ParamWrite", counter, Write="Read", Param=name, **{name: 0})
            assert line[name] == (write.get_signal_by_name(name).initial or 0), name
        for words, Fc in (  # noqa: N806
            ({"Write": "Hold", "Param": "Fc", "Fc": 2 * FC}, FC),
            ({"Write": "Write", "Param": "Sigma0", "Sigma0": 2 * SIGMA0}, 2 * FC),
        ):
            encoder.asked("ParamWrite", 5, **words)
            assert encoder.asked("ParamWrite", 6, Write="Read", Param="Fc", Fc=0)["Fc"] == Fc
    counted = {name: results[0]["node"][name] for name in ("params", "ignored")}
    assert counted == {"params": 9, "ignored": 0}


@pytest.mark.parametrize("ms", [None, 150])
def test_a_silent_bus_makes_the_node_stale_after_its_timeout(node, ms):
    """100 ms by default. The third good frame is a new start."""
    sets = (f"friction.timeout_ms={ms}", "status.period_ms=50") if ms else ()
    with node(*sets) as (encoder, _, results):
        encoder.good(0, 0, state="Init", used=False)
        begin = time.monotonic()
        status = encoder.heard(0x120, State="Stale")
        assert time.monotonic() - begin > (ms or 100) / 1000 - 0.02
        assert (str(status["ErrorStale"]), status["OutOfStep"]) == ("Seen", 1)
        for counter in (2, 3):
            encoder.bus.send(encoder.frame(counter, 6000))
        encoder.good(4, 7000, state="Stale", used=False)
    assert (results[0]["node"]["stale"], results[0]["node"]["ok"]) == (1, 2)


def test_a_stalled_node_answers_all_frames_that_have_come(node):
    """In order and without a new start."""
    with node() as (encoder, process, results):
        encoder.good(0, 0, state="Init", used=False)
        process.send_signal(signal.SIGSTOP)
        for counter in range(1, 60):
            encoder.bus.send(encoder.frame(counter % 16, 10 * counter))
            time.sleep(0.01)
        process.send_signal(signal.SIGCONT)
        answers = [encoder.heard(0x110) for _ in range(1, 60)]
    assert {str(answer["State"]) for answer in answers} == {"OK"}
    assert (results[0]["node"]["ok"], results[0]["node"]["stale"]) == (60, 0)


def test_a_node_answers_waiting_frames_before_it_ends(node):
    """A node that is asked to end while frames wait for it."""
    with node(*PATIENT) as (encoder, process, results):
        encoder.good(0, 0, state="Init", used=False)
        process.send_signal(signal.SIGSTOP)
        for counter in range(1, 60):
            encoder.bus.send(encoder.frame(counter % 16, 10 * counter))
        process.send_signal(signal.SIGTERM)
        process.send_signal(signal.SIGCONT)
        answers = [encoder.heard(0x110) for _ in range(1, 60)]
    assert [answer["EchoCounter"] for answer in answers] == [k % 16 for k in range(1, 60)]
    assert results[0]["node"]["ok"] == 60


def test_in_lockstep_the_clock_of_a_node_waits_2_s_for_the_next_angle(node):
    """Then it runs on and the timeout passes."""
    with node("friction.node=5", options=("--lockstep",)) as (encoder, _, results):
        encoder.number = 5
        encoder.good(0, 0, state="Init", used=False)
        for counter in (1, 2, 3):
            time.sleep(0.4)
            encoder.good(counter, 50 * counter)
        begin = time.monotonic()
        encoder.heard(0x120, State="Stale")
        assert time.monotonic() - begin > 2
    assert (results[0]["node"]["ok"], results[0]["node"]["stale"]) == (4, 1)
    assert re.fullmatch(r"note: .* 2 s.* clock .*\n", results[0]["err"])


def test_a_loop_ignores_foreign_answers(tmp_path):
    """Answers with a wrong CRC, and correct answers to no angle, for both nodes."""
    options = ("--wait-clients", "1", "--seconds", "1.5", "--nodes", "2")
    path = SCENES / "steering.ini"
    good = bytearray(8)
    p02.e2e_p02_protect(good, bytes(0xC0 | counter for counter in range(16)))
    with serving(tmp_path, path, *options) as (process, port), client(port) as bus:
        for i in range(200):
            data = good if i % 4 < 2 else bytes([i] * 8)
            identifier = 0x110 | i % 2
            bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
            bus.recv(0.005)
        record(bus, process)  # else the server would wait for its reader
        result = finished(tmp_path, process)
    told = result.summary
    assert (told["frames_lost"], told["frames_answered"]) == (0, 3000)
    assert told["answers_corrupt"] + told["answers_unmatched"] == 200
    assert min(told["answers_corrupt"], told["answers_unmatched"]) > 95


SHIPPED = sorted(path for path in SCENES.glob("*.ini") if "kind = log" not in path.read_text())


@pytest.mark.parametrize("path", SHIPPED, ids=[path.stem for path in SHIPPED])
def test_each_shipped_scene_has_the_default_timeout(tmp_path, database, path):
    """The start value of the parameter in the DBC."""
    timeout = database.get_message_by_name("ParamWrite").get_signal_by_name("Timeout")
    log = read_log(run(tmp_path, path, "--virtual", "--seconds", "0.5").log)
    told = {database.decode_message(0x120, f.data)["Timeout"] for f in log if f.id == 0x120}
    assert told == {timeout.initial} == {100}
