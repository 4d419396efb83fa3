# SPDX-License-Identifier: MIT
"""One timeout for every node, and what is a silence of the bus and what is none."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import cantools
import pytest
from loop_tools import SCENES, client, finished, read_log, run, serving, setting
from test_loop_faults import storm
from test_loop_node import SCENE, STATES, Encoder

SHIPPED = sorted(path.stem for path in SCENES.glob("*.ini"))
WITHOUT_DATA = [
    name for name in SHIPPED if "kind = log" not in (SCENES / f"{name}.ini").read_text()
]


@pytest.fixture(scope="module")
def database(dbc: Path) -> cantools.database.Database:
    return cantools.database.load_file(dbc)


def default_ms(database: cantools.database.Database) -> int:
    """As the DBC says it to a user: the start value of the parameter."""
    timeout = database.get_message_by_name("ParamWrite").get_signal_by_name("Timeout")
    assert timeout.initial == 100
    return timeout.initial


@pytest.mark.parametrize("name", WITHOUT_DATA)
def test_each_shipped_scene_has_the_timeout_of_a_node(tmp_path, database, name):
    log = read_log(run(tmp_path, SCENES / f"{name}.ini", "--virtual", "--seconds", "0.5").log)
    said = {
        database.decode_message("Status", frame.data)["Timeout"]
        for frame in log
        if frame.id == 0x120
    }
    assert said == {default_ms(database)}


@pytest.mark.parametrize("ms", [100, 30, 400])
def test_stale_is_told_in_the_tick_after_the_timeout(tmp_path, ms):
    """Virtual time, to the millisecond: counted from the last frame that came."""
    words = setting(f"friction.timeout_ms={ms}")
    log = read_log(storm(tmp_path, *words, silence=0.01).log)
    last, running, told = 0, 0, []
    for frame in log:
        tick = round(frame.time * 1000)
        if frame.id == 0x100:
            last, running = tick, running + 1
        elif frame.id == 0x120 and running > 10 and frame.data[1] >> 4 == STATES["Stale"]:
            told.append(tick - last)
            running = 0
    assert len(told) > 10
    assert set(told) == {ms + 1}


@contextlib.contextmanager
def node(
    folder: Path, database: cantools.database.Database, *options: str
) -> Iterator[tuple[Encoder, subprocess.Popen, list[dict]]]:
    """A served node with the default timeout."""
    (folder / "scene.ini").write_text(SCENE)
    results: list[dict] = []
    with serving(folder, folder / "scene.ini", "--role", "node", *options) as (process, port):
        with client(port) as bus:
            yield Encoder(bus, database), process, results
        process.send_signal(signal.SIGTERM)
        result = finished(folder, process)
        results.append({**result.summary, "err": result.err})


def stale_after(encoder: Encoder) -> float:
    """s from now until a Status says Stale; a scene without [status] sends one at once then."""
    begin = time.monotonic()
    while (message := encoder.bus.recv(5)) is not None:
        if message.arbitration_id == 0x120:
            status = encoder.database.decode_message("Status", message.data)
            if str(status["State"]) == "Stale":
                return time.monotonic() - begin
    raise AssertionError("no Status said Stale")


def test_without_a_word_of_it_silence_is_told_after_100_ms(tmp_path, database):
    with node(tmp_path, database) as (encoder, _, results):
        encoder.good(0, 0, state="Init", used=False)
        assert 0.08 < stale_after(encoder) < 1
    assert results[0]["node"]["stale"] == 1


def test_a_stall_of_the_nodes_program_is_no_silence_of_the_bus(tmp_path, database):
    """Frames that came while it could not look are answered in order, and none is a new start."""
    with node(tmp_path, database) as (encoder, process, results):
        encoder.good(0, 0, state="Init", used=False)
        process.send_signal(signal.SIGSTOP)
        for counter in range(1, 60):
            encoder.bus.send(encoder.frame(counter % 16, 10 * counter))
            time.sleep(0.01)
        process.send_signal(signal.SIGCONT)
        answers = [encoder.answer() for _ in range(1, 60)]
    assert {str(answer["State"]) for answer in answers} == {"OK"}
    assert (results[0]["node"]["ok"], results[0]["node"]["stale"]) == (60, 0)


def test_in_lockstep_a_stall_of_the_encoders_program_is_none_either(tmp_path, database):
    number = setting("friction.node=5")
    with node(tmp_path, database, "--lockstep", *number) as (encoder, _, results):
        encoder.number = 5
        encoder.good(0, 0, state="Init", used=False)
        for counter in (1, 2, 3):
            time.sleep(0.4)
            encoder.good(counter, 50 * counter)
    assert (results[0]["node"]["ok"], results[0]["node"]["stale"]) == (4, 0)


def test_in_lockstep_patience_has_an_end(tmp_path, database):
    with node(tmp_path, database, "--lockstep") as (encoder, _, results):
        encoder.good(0, 0, state="Init", used=False)
        assert 2 < stale_after(encoder) < 2.9
    assert results[0]["node"]["stale"] == 1
    assert results[0]["err"] == "note: no angle came for 2 s; the node's clock runs on\n"
