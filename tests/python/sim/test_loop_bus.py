# SPDX-License-Identifier: MIT
"""dahl-loop on the served bus in real time: a client sees every frame of the log, in one process
and in two. Lockstep, a node that stalls, foreign answers, and a bus that is missing or goes away.
"""

import os
import re
import signal
import subprocess
import time

import can
import loop_tools as loop
import pytest
from dahl import codec
from dahl.codec import EncoderState, FrictionTorque, State, Status
from loop_tools import SCENES, client, ended, finished, read_log, run, serving, setting

STEERING = SCENES / "steering.ini"


@pytest.mark.timeout(120)
@pytest.mark.parametrize("seconds", [1, pytest.param(60, marks=pytest.mark.long)])
def test_a_client_sees_every_frame_of_the_log_with_its_time(tmp_path, seconds):
    begun = time.time()
    options = ("--wait-clients", "1", *setting(f"motion.seconds={seconds}"))
    with serving(tmp_path, STEERING, *options) as (process, port), client(port) as bus:
        lines = loop.record(bus, process)
        result = finished(tmp_path, process)
    assert (result.code, result.err) == (0, "")
    assert "".join(lines) == result.log.read_text()
    times = [frame.time for frame in read_log(result.log)]
    assert times == sorted(times)
    assert begun - 0.1 < times[0] < times[0] + seconds - 0.1 < times[-1] < time.time() + 0.1
    summary = result.summary
    assert summary["frames_sent"] == summary["ticks"] == summary["node"]["ok"] == seconds * 1000
    assert summary["frames_lost"] == 0 and {*summary["bus_counts"].values()} == {0}
    assert summary["max_rss_kib"] < 8 * 1024


def without_status(lines: list[str]) -> list[str]:
    return [line.split(" ", 1)[1] for line in lines if " 120#" not in line]


def test_two_processes_give_the_counts_and_torques_of_one(tmp_path):
    """The second process joins by name. A client sees the frames of the log."""
    end, nodes = setting("motion.seconds=1"), ("--role", "node", "--until-idle")
    with serving(tmp_path / "node", STEERING, *nodes) as (node, port), client(port) as bus:
        words = ("--role", "encoder", "--bus", f"socketcand:localhost:{port}", *end)
        encoder = loop.start(tmp_path / "encoder", STEERING, *words)
        lines = loop.record(bus, encoder)
        sent = finished(tmp_path / "encoder", encoder)
        bus.shutdown()
        answered = finished(tmp_path / "node", node)
    assert (sent.code, answered.code) == (0, 0), sent.err + answered.err
    assert sent.summary["frames_sent"] == answered.summary["node"]["ok"] == 1000
    assert sent.summary["frames_lost"] == sent.summary["answers_unmatched"] == 0
    assert without_status(lines) == without_status([*answered.log.open()])
    alone = run(tmp_path / "one", STEERING, "--virtual", *end)
    one, two, of_node = (read_log(each.log) for each in (alone, sent, answered))
    assert loop.counts_of(two) == loop.counts_of(one)
    assert loop.torques_of(two) == loop.torques_of(one) == loop.torques_of(of_node)


def answer_to(angle: can.Message) -> can.Message:
    """A FrictionTorque that echoes this angle; its torque is not read."""
    return codec.pack(FrictionTorque(0, echo=angle.data[1] & 15), angle.arbitration_id & 15)


def test_lockstep_waits_for_each_answer_up_to_2_s(tmp_path):
    """Two nodes answer after 5 ms each, in either order. Once neither answers: two angles are
    lost.
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
    assert pauses[21] > 1.9
    assert re.fullmatch(r"note: .* 2 s.* without it\n", result.err)
    assert (result.summary["frames_sent"], result.summary["frames_lost"]) == (100, 2)
    assert result.summary["answers_unmatched"] == 0


def send_angle(bus: can.BusABC, counter: int) -> None:
    bus.send(codec.pack(EncoderState(count=10 * counter, counter=counter % 16)))


def next_frame(bus: can.BusABC, kind: type) -> codec.Frame:
    while (message := bus.recv(10)) is not None:
        if message.arbitration_id & ~15 == kind.base:
            return codec.unpack(message)
    raise AssertionError(f"no {kind.__name__}")


def test_in_lockstep_the_clock_of_a_node_waits_2_s_for_the_next_angle(tmp_path):
    """Then it runs on and the timeout passes."""
    options = ("--role", "node", "--lockstep")
    with serving(tmp_path, STEERING, *options) as (process, port), client(port) as bus:
        for counter in range(3):
            time.sleep(0.3)
            send_angle(bus, counter)
            next_frame(bus, FrictionTorque)
        begin = time.monotonic()
        while next_frame(bus, Status).state != State.STALE:
            pass
        assert time.monotonic() - begin > 2
        result = ended(tmp_path, process)
    assert (result.summary["node"]["ok"], result.summary["node"]["stale"]) == (3, 1)
    assert re.fullmatch(r"note: .* 2 s.* clock .*\n", result.err)


def test_a_stalled_node_answers_all_frames_that_have_come(tmp_path):
    """Also if a signal ends it meanwhile."""
    with serving(tmp_path, STEERING, "--role", "node") as (process, port), client(port) as bus:
        send_angle(bus, 0)
        next_frame(bus, FrictionTorque)
        process.send_signal(signal.SIGSTOP)
        for counter in range(1, 60):
            send_angle(bus, counter)
        time.sleep(0.3)  # longer than the timeout
        process.send_signal(signal.SIGTERM)
        process.send_signal(signal.SIGCONT)
        answers = [next_frame(bus, FrictionTorque) for _ in range(1, 60)]
        node = finished(tmp_path, process).summary["node"]
    assert [one.echo for one in answers] == [counter % 16 for counter in range(1, 60)]
    assert {one.state for one in answers} == {State.OK}
    assert (node["ok"], node["stale"]) == (60, 0)


def test_a_loop_ignores_foreign_answers(tmp_path):
    options = ("--wait-clients", "1", "--seconds", "1", "--nodes", "2")
    with serving(tmp_path, STEERING, *options) as (process, port), client(port) as bus:
        for i in range(200):
            message = codec.pack(FrictionTorque(0, echo=15), i % 2)
            message.data[0] ^= i % 4 < 2
            bus.send(message)
        loop.record(bus, process)  # otherwise the server would wait for its reader
        counted = finished(tmp_path, process).summary
    assert (counted["frames_lost"], counted["frames_answered"]) == (0, 2000)
    assert (counted["answers_corrupt"], counted["answers_unmatched"]) == (100, 100)


@pytest.mark.parametrize("bus", ["loopback", "socketcand:0", "joined"])
def test_a_run_in_real_time_sleeps_between_ticks(tmp_path, bus):
    """It gives the processor away at most ticks. A loop that polls would not."""
    words = [loop.program(), loop.EXAMPLE, "--role", "encoder", "--seconds", "0.5", "--bus"]
    with serving(tmp_path / "node", STEERING, "--role", "node") as (_, port):
        spec = f"socketcand:127.0.0.1:{port}" if bus == "joined" else bus
        with subprocess.Popen([*words, spec], stdout=subprocess.DEVNULL) as process:
            _, status, used = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
    assert (process.returncode, used.ru_nvcsw > 100) == (0, True)


def test_a_bus_that_goes_away_is_an_error_and_the_files_are_whole(tmp_path):
    with serving(tmp_path / "node", STEERING, "--role", "node") as (node, port):
        words = ("--role", "encoder", "--bus", f"socketcand:127.0.0.1:{port}")
        encoder = loop.start(tmp_path / "encoder", STEERING, *words)
        loop.wait_for_bytes(tmp_path / "encoder" / "run.log", 40000)
        node.send_signal(signal.SIGTERM)
        result = finished(tmp_path / "encoder", encoder)
    ticks = int(re.match(r"--bus \S+: .* (\d+) ticks", result.error(1))[1])
    assert ticks == result.summary["ticks"]
    answers = loop.torques_of(read_log(result.log))
    assert 300 < result.summary["frames_answered"] <= len(answers)


ABSENT = [  # bus, reason of the system
    ("socketcan:nosuchif0", ""),
    ("socketcand:127.0.0.1:65535", "Connection refused"),
    ("socketcand:::1:1", ""),  # the port stands behind the last colon
    (f"socketcand:{'x' * 127}:5", "Cannot assign requested address"),
    ("socketcand:255.255.255.255:1", "Network is unreachable"),
]


@pytest.mark.parametrize(("bus", "reason"), ABSENT)
def test_a_missing_bus_is_refused_with_the_reason_of_the_system(bus, reason):
    error = loop.run_alone(loop.EXAMPLE, "--bus", bus).error(1)
    assert error.startswith(f"--bus {bus}: {reason}")
    assert ("--bus socketcand:PORT" in error) == bus.startswith("socketcan:")  # the way out
