# SPDX-License-Identifier: MIT
"""The node of dahl-loop on a served bus: its timeout, its stalls, and answers of other nodes."""

from __future__ import annotations

import contextlib
import re
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import can
import dahl
import pytest
from dahl import codec
from dahl.codec import EncoderState, State, Status
from loop_tools import SCENES, Run, client, finished, record, serving, setting

pytestmark = pytest.mark.usefixtures("library")

PLAN = dahl.Plan(50, 0.5, 2.0**-14)
SCENE = f"[friction]\nsigma0 = {PLAN.sigma0}\nFc = {PLAN.Fc}\ntheta_per_count = {2.0**-14!r}\n"


@contextlib.contextmanager
def served(
    folder: Path, *sets: str, options: tuple[str, ...] = ()
) -> Iterator[tuple[can.BusABC, subprocess.Popen, list[Run]]]:
    (folder / "scene.ini").write_text(SCENE)
    ended: list[Run] = []
    words = ("--role", "node", *setting(*sets), *options)
    with serving(folder, folder / "scene.ini", *words) as (process, port):
        with client(port) as bus:
            yield bus, process, ended
        process.send_signal(signal.SIGTERM)
        ended.append(finished(folder, process))


def angle(counter: int, count: int, number: int = 0) -> can.Message:
    return codec.pack(EncoderState(count=count, counter=counter % 16), number)


def next_frame(bus: can.BusABC, kind: type) -> codec.Frame:
    while (message := bus.recv(10)) is not None:
        if message.arbitration_id & ~15 == kind.base:
            return codec.unpack(message)
    raise AssertionError(f"no {kind.__name__}")


def test_a_stalled_node_answers_all_frames_that_have_come(tmp_path):
    """Also if a signal ends it meanwhile."""
    with served(tmp_path) as (bus, process, ended):
        bus.send(angle(0, 0))
        next_frame(bus, codec.FrictionTorque)
        process.send_signal(signal.SIGSTOP)
        for counter in range(1, 60):
            bus.send(angle(counter, 10 * counter))
        time.sleep(0.3)  # longer than the timeout
        process.send_signal(signal.SIGTERM)
        process.send_signal(signal.SIGCONT)
        answers = [next_frame(bus, codec.FrictionTorque) for _ in range(1, 60)]
    assert [one.echo for one in answers] == [counter % 16 for counter in range(1, 60)]
    assert {one.state for one in answers} == {State.OK}
    assert (ended[0].summary["node"]["ok"], ended[0].summary["node"]["stale"]) == (60, 0)


def test_in_lockstep_the_clock_of_a_node_waits_2_s_for_the_next_angle(tmp_path):
    """Then it runs on and the timeout passes."""
    with served(tmp_path, "friction.node=5", options=("--lockstep",)) as (bus, _, ended):
        for counter in range(3):
            time.sleep(0.3)
            bus.send(angle(counter, 50 * counter, 5))
            next_frame(bus, codec.FrictionTorque)
        begin = time.monotonic()
        while next_frame(bus, Status).state != State.STALE:
            pass
        assert time.monotonic() - begin > 2
    node = ended[0].summary["node"]
    assert (node["ok"], node["stale"]) == (3, 1)
    assert re.fullmatch(r"note: .* 2 s.* clock .*\n", ended[0].err)


def test_a_loop_ignores_foreign_answers(tmp_path):
    options = ("--wait-clients", "1", "--seconds", "1", "--nodes", "2")
    serves = serving(tmp_path, SCENES / "steering.ini", *options)
    with serves as (process, port), client(port) as bus:
        for i in range(200):
            message = codec.pack(codec.FrictionTorque(0, echo=15), i % 2)
            message.data[0] ^= i % 4 < 2
            bus.send(message)
        record(bus, process)  # else the server would wait for its reader
        told = finished(tmp_path, process).summary
    assert (told["frames_lost"], told["frames_answered"]) == (0, 2000)
    assert (told["answers_corrupt"], told["answers_unmatched"]) == (100, 100)
