# SPDX-License-Identifier: MIT
"""dahl-loop on the served bus: what a witness sees is the log, in one process and in two, in real
and in virtual time; a log can be replayed; lockstep; what a bus that is not there is told.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import time

import can
import pytest
from e2e import p02
from loop_tools import (
    SCENES,
    client,
    counts_of,
    finished,
    program,
    raw_client,
    read_log,
    record,
    run,
    said,
    serving,
    setting,
    start,
    torques_of,
    wait_until,
)

STEERING = SCENES / "steering.ini"
PATIENT = setting("friction.timeout_ms=60000")
LONG = pytest.param(60, marks=pytest.mark.long)


@pytest.mark.timeout(120)
@pytest.mark.parametrize("seconds", [2, LONG])
def test_python_can_sees_every_frame_with_the_time_of_the_simulation(tmp_path, seconds):
    """One process and a client that must see each frame of the log, with its time stamp, which is
    the wall clock's; nothing is lost. How late ticks come is a matter of the machine.
    """
    begun = time.time()
    options = ("--wait-clients", "1", *setting(f"motion.seconds={seconds}"))
    with serving(tmp_path, STEERING, *options) as (process, port):
        with client(port) as bus:
            lines = record(bus, process)
        result = finished(tmp_path, process)
    assert (result.code, result.err) == (0, "")
    assert lines == result.log.read_text().splitlines()
    log, told = read_log(result.log), result.summary
    times = [frame.time for frame in log]
    assert times == sorted(times)
    assert begun - 0.1 < times[0] < times[0] + seconds - 0.1 < times[-1] < time.time() + 0.1
    assert told["frames_sent"] == told["ticks"] == told["node"]["ok"] == seconds * 1000
    assert told["frames_lost"] == 0 and {*told["bus_counts"].values()} == {0}
    assert told["max_rss_kib"] < 16 * 1024


def test_virtual_time_waits_for_its_clients_and_changes_nothing(tmp_path):
    alone = run(tmp_path / "alone", STEERING, "--virtual", "--seconds", "20")
    options = ("--virtual", "--wait-clients", "1", "--seconds", "20")
    with serving(tmp_path / "served", STEERING, *options) as (process, port), client(port) as bus:
        lines = record(bus, process)
        served = finished(tmp_path / "served", process)
    assert "\n".join(lines) + "\n" == alone.log.read_text() == served.log.read_text()
    assert served.summary["frames_lost"] == 0


def without_status(lines: list[str]) -> list[str]:
    return [line.split(" ", 1)[1] for line in lines if " 120#" not in line]


@pytest.mark.timeout(120)
@pytest.mark.parametrize(
    ("host", "seconds"),
    [("127.0.0.1", 2), ("localhost", 0.5), pytest.param("localhost", 60, marks=pytest.mark.long)],
)
def test_two_processes_and_a_witness_on_one_bus(tmp_path, host, seconds):
    """Joined by address or by name: the counts and torques of one process in virtual time."""
    end = setting(f"motion.seconds={seconds}")
    with (
        serving(tmp_path / "node", STEERING, "--role", "node", "--until-idle") as (node, port),
        client(port) as bus,
    ):
        words = ("--role", "encoder", "--bus", f"socketcand:{host}:{port}", *end)
        encoder = start(tmp_path / "encoder", STEERING, *words)
        lines = record(bus, encoder)
        sent = finished(tmp_path / "encoder", encoder)
        bus.shutdown()
        answered = finished(tmp_path / "node", node)
    assert (sent.code, answered.code) == (0, 0), sent.err + answered.err
    assert sent.summary["frames_sent"] == answered.summary["node"]["ok"] == seconds * 1000
    assert sent.summary["frames_lost"] == sent.summary["answers_unmatched"] == 0
    assert without_status(lines) == without_status(answered.log.read_text().splitlines())
    one, two, node_log = (
        read_log(log)
        for log in (run(tmp_path / "one", STEERING, "--virtual", *end).log, sent.log, answered.log)
    )
    assert counts_of(two) == counts_of(one)
    assert torques_of(two) == torques_of(one) == torques_of(node_log)
    assert max(sent.summary["max_rss_kib"], answered.summary["max_rss_kib"]) < 16 * 1024


def answer_to(angle: can.Message) -> can.Message:
    """A FrictionTorque that echoes an angle of its node; the torque is not what is looked at."""
    data = bytearray([0, angle.data[1] - 1 & 15, angle.data[1] & 15, 0, 0, 0, 0, 0])
    p02.e2e_p02_protect(data, bytes(0xC0 | counter for counter in range(16)))
    identifier = angle.arbitration_id + 0x10
    return can.Message(arbitration_id=identifier, data=data, is_extended_id=False)


def test_in_lockstep_a_slow_node_loses_nothing(tmp_path):
    """Two nodes take 5 ms each for an answer, now one is the first, now the other; and once neither
    answers: those two angles are lost.
    """
    options = ("--role", "encoder", "--nodes", "2", "--lockstep", "--wait-clients", "1")
    options += ("--seconds", "0.05")
    early, pauses = [], []
    with serving(tmp_path, STEERING, *options) as (process, port), client(port) as bus:
        for tick in range(50):
            begun = time.monotonic()
            angles = [bus.recv(10), bus.recv(10)]
            pauses.append(time.monotonic() - begun)
            for angle in angles[:: 1 if tick % 2 else -1]:
                early.append(bus.recv(0.005))
                if tick != 20:
                    bus.send(answer_to(angle))
        result = finished(tmp_path, process)
    assert early == [None] * 100
    assert 1.9 < pauses[21] < 2.9
    assert re.fullmatch(r"note: .* 2 s.* without it\n", result.err)
    assert (result.summary["frames_sent"], result.summary["frames_lost"]) == (100, 2)
    assert result.summary["answers_unmatched"] == 0


@pytest.mark.parametrize("number", [0, 1])
def test_the_last_answer_has_time_whichever_of_two_nodes_is_there(tmp_path, number):
    """It comes 0.3 s after the last tick; nobody answers the other encoder."""
    options = ("--role", "encoder", "--nodes", "2", "--wait-clients", "1", "--seconds", "0.3")
    with serving(tmp_path, STEERING, *options) as (process, port), client(port) as bus:
        for tick in range(300):
            while (angle := bus.recv(10)).arbitration_id != 0x100 + number:
                pass
            time.sleep(0.3 if tick == 299 else 0)
            bus.send(answer_to(angle))
        result = finished(tmp_path, process)
    assert result.summary["frames_answered"] == 300


def test_a_log_that_python_can_replays_gives_the_same_torques(tmp_path):
    """python-can reads the log as it is and keeps its times. To the node the old answers are
    foreign.
    """
    scene = SCENES / "segments.ini"
    recorded = run(tmp_path / "recorded", scene, "--virtual", "--seconds", "1").log
    options = ("--role", "node", "--until-idle", *PATIENT)
    with serving(tmp_path / "node", scene, *options) as (process, port):
        with client(port) as bus:
            for message in can.MessageSync(can.LogReader(recorded)):
                bus.send(message)
            heard = 0
            while heard < 1000:
                heard += bus.recv(10).arbitration_id == 0x110
        again = finished(tmp_path / "node", process)
    assert again.summary["node"]["ok"] == 1000
    answers = torques_of(read_log(recorded))
    assert sorted(torques_of(read_log(again.log))) == sorted(answers * 2)


def test_the_last_frame_of_a_client_that_leaves_is_answered_and_logged(tmp_path):
    options = ("--role", "node", "--until-idle")
    recorded = run(tmp_path / "recorded", STEERING, "--virtual", "--seconds", "0.001").log
    (angle,) = [frame.data for frame in read_log(recorded) if frame.id == 0x100]
    with serving(tmp_path / "node", SCENES / "segments.ini", *options) as (process, port):
        peer = raw_client(port)
        peer.sendall(f"< send 100 8 {' '.join(f'{byte:X}' for byte in angle)} >".encode())
        peer.close()
        log = read_log(finished(tmp_path / "node", process).log)
    assert [frame.id for frame in log if frame.id != 0x120] == [0x100, 0x110]


@pytest.mark.parametrize("bus", ["loopback", "socketcand:0", "joined"])
def test_between_two_ticks_the_processor_rests(tmp_path, bus):
    """A tick and its answer cost some 50 us; who asked again and again would need all there is."""
    words = [program(), "--scene", str(STEERING), "--role", "encoder", "--seconds", "0.5", "--bus"]
    with serving(tmp_path / "node", STEERING, "--role", "node") as (_, port):
        spec = f"socketcand:127.0.0.1:{port}" if bus == "joined" else bus
        with subprocess.Popen([*words, spec], stdout=subprocess.DEVNULL) as process:
            _, status, used = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0
    assert used.ru_utime + used.ru_stime < 0.2


@pytest.mark.skipif(shutil.which("log2asc") is None, reason="unproven: can-utils are not here")
def test_can_utils_read_the_log(tmp_path):
    """log2asc parses a line as canplayer does, and prints each frame it took. (It takes 0 s for no
    time, so not virtual time.)
    """
    recorded = run(tmp_path, STEERING, "--seconds", "0.5").log
    frames = read_log(recorded)
    done = subprocess.run(
        ["log2asc", "-I", recorded, "vcan0"], capture_output=True, text=True, check=True
    )
    line = r"^ +(\d+\.\d{6}) 1 +(\w+) +Rx +d 8 ((?:\w\w ?){8})$"
    taken = re.findall(line, done.stdout, re.MULTILINE)
    assert [(float(t), int(i, 16), bytes.fromhex(d)) for t, i, d in taken] == [
        (pytest.approx(frame.time - frames[0].time, abs=2e-6), frame.id, frame.data)
        for frame in frames
    ]


def test_the_bus_going_away_is_told_and_the_files_are_whole(tmp_path):
    with serving(tmp_path / "node", STEERING, "--role", "node") as (node, port):
        words = ("--role", "encoder", "--bus", f"socketcand:127.0.0.1:{port}")
        encoder = start(tmp_path / "encoder", STEERING, *words)
        log = tmp_path / "encoder" / "run.log"
        wait_until(lambda: log.exists() and log.stat().st_size > 40000)
        node.send_signal(signal.SIGTERM)
        result = finished(tmp_path / "encoder", encoder, 10)
    assert (result.code, result.err.count("\n")) == (1, 1)
    told = result.summary
    assert int(re.match(r"error: --bus \S+: .* (\d+) ticks\n", result.err)[1]) == told["ticks"]
    assert told["frames_answered"] > 300
    log = read_log(result.log)
    assert told["frames_answered"] <= sum(frame.id == 0x110 for frame in log)


ABSENT = [  # bus, what the system says
    ("socketcan:nosuchif0", ""),
    ("socketcand:127.0.0.1:65535", "Connection refused"),
    ("socketcand:::1:1", ""),  # an address with colons: the port stands behind the last
    (f"socketcand:{'x' * 127}:5", "Cannot assign requested address"),
    ("socketcand:255.255.255.255:1", "Network is unreachable"),
]


@pytest.mark.parametrize(("bus", "words"), ABSENT)
def test_a_bus_that_is_not_there(bus, words):
    done = said("--scene", STEERING, "--bus", bus)
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert done.stderr.startswith(f"error: --bus {bus}: {words}")
