# SPDX-License-Identifier: MIT
"""dahl-loop on the served bus, in real time: a witness, two processes, bad clients, Ctrl-C."""

from __future__ import annotations

import os
import random
import re
import shutil
import signal
import socket
import struct
import subprocess
import time
from pathlib import Path

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
    serving,
    setting,
    start,
    torques_of,
    wait_until,
)

STEERING = SCENES / "steering.ini"
RATE = 1000  # Hz


def check_whole(result, seconds: float) -> None:
    """Nothing lost, no tick left out. How late ticks come is a matter of the machine."""
    summary = result.summary
    assert result.code == 0, result.err
    assert summary["frames_sent"] == summary["ticks"] == seconds * RATE
    assert summary["frames_lost"] == 0
    assert summary["node"]["ok"] == summary["frames_sent"]
    assert set(summary["bus_counts"].values()) == {0}
    assert summary["max_rss_kib"] < 16 * 1024


LONG = pytest.mark.parametrize("seconds", [3, pytest.param(60, marks=pytest.mark.long)])


@LONG
@pytest.mark.timeout(120)
def test_python_can_sees_every_frame_with_the_time_of_the_simulation(tmp_path, seconds):
    """One process and a client that must see each frame of the log, with its time stamp."""
    options = ("--wait-clients", "1", *setting(f"motion.seconds={seconds}"))
    with serving(tmp_path, STEERING, *options) as (process, port):
        with client(port) as bus:
            lines = record(bus, process)
        result = finished(tmp_path, process)
    assert lines == result.log.read_text().splitlines()
    check_whole(result, seconds)


def test_time_stamps_go_forward_at_one_kilohertz(tmp_path):
    """By the wall clock. That no tick comes late is shown in test_loop_pace.py."""
    begun = time.time()
    log = read_log(run(tmp_path, STEERING, "--seconds", "2").log)
    times = [frame.time for frame in log]
    assert times == sorted(times)
    assert begun - 1 < times[0] < times[0] + 1.9 < times[-1] < time.time() + 1


def test_virtual_time_waits_for_its_clients_and_changes_nothing(tmp_path):
    alone = run(tmp_path / "alone", STEERING, "--virtual", "--seconds", "20")
    options = ("--virtual", "--wait-clients", "1", "--seconds", "20")
    with serving(tmp_path / "served", STEERING, *options) as (process, port), client(port) as bus:
        lines = record(bus, process)
        served = finished(tmp_path / "served", process)
    assert "\n".join(lines) + "\n" == alone.log.read_text() == served.log.read_text()
    assert served.summary["frames_lost"] == 0


@LONG
@pytest.mark.timeout(120)
def test_two_processes_and_a_witness_on_one_bus(tmp_path, seconds):
    end = setting(f"motion.seconds={seconds}")
    with (
        serving(tmp_path / "node", STEERING, "--role", "node", "--until-idle") as (node, port),
        client(port) as bus,
    ):
        words = ("--role", "encoder", "--bus", f"socketcand:127.0.0.1:{port}", *end)
        encoder = start_in(tmp_path / "encoder", STEERING, *words)
        lines = record(bus, encoder)
        sent = finished(tmp_path / "encoder", encoder)
        bus.shutdown()
        answered = finished(tmp_path / "node", node)
    assert sent.code == answered.code == 0, sent.err + answered.err
    assert sent.summary["frames_sent"] == seconds * RATE
    assert sent.summary["frames_lost"] == 0
    assert sent.summary["answers_unmatched"] == 0
    assert answered.summary["node"]["ok"] == seconds * RATE
    seen = [line.split(" ", 1)[1] for line in lines if " 120#" not in line]
    logged = [
        line.split(" ", 1)[1]
        for line in answered.log.read_text().splitlines()
        if " 120#" not in line
    ]
    assert seen == logged
    assert torques_of(read_log(sent.log)) == torques_of(read_log(answered.log))
    one = read_log(run(tmp_path / "one", STEERING, "--virtual", *end).log)
    assert counts_of(read_log(sent.log)) == counts_of(one)
    assert torques_of(read_log(sent.log)) == torques_of(one)
    assert max(sent.summary["max_rss_kib"], answered.summary["max_rss_kib"]) < 16 * 1024


def start_in(folder: Path, scene: Path, *options: str):
    folder.mkdir()
    return start(folder, scene, *options)


def answer_to(angle: can.Message) -> can.Message:
    """A FrictionTorque that echoes an angle; the torque is not what is looked at."""
    data = bytearray([0, angle.data[1] - 1 & 15, angle.data[1] & 15, 0, 0, 0, 0, 0])
    p02.e2e_p02_protect(data, bytes(0xC0 | counter for counter in range(16)))
    return can.Message(arbitration_id=0x110, data=data, is_extended_id=False)


def test_in_lockstep_a_slow_node_loses_nothing(tmp_path):
    """The node takes 5 ms for an answer and once does not answer: that one angle is lost."""
    options = ("--role", "encoder", "--lockstep", "--wait-clients", "1", "--seconds", "0.2")
    waiting, pauses = [], []
    with serving(tmp_path, STEERING, *options) as (process, port), client(port) as bus:
        for tick in range(200):
            begun = time.monotonic()
            angle = bus.recv(10)
            pauses.append(time.monotonic() - begun)
            time.sleep(0.005)
            waiting.append(bus.recv(0))
            if tick != 20:
                bus.send(answer_to(angle))
        result = finished(tmp_path, process)
    assert waiting == [None] * 200
    assert 1.9 < pauses[21] < 2.9
    assert result.err == "note: an angle had no answer for 2 s; it is counted as lost\n"
    assert (result.summary["frames_sent"], result.summary["frames_lost"]) == (200, 1)
    assert result.summary["answers_unmatched"] == 0


def test_a_log_that_python_can_replays_gives_the_same_torques(tmp_path):
    """python-can reads the log as it is and keeps its times. To the node the old answers are
    foreign.
    """
    scene, patience = SCENES / "segments.ini", setting("friction.timeout_ms=60000")
    recorded = run(tmp_path / "recorded", scene, "--virtual", "--seconds", "2").log
    options = ("--role", "node", "--until-idle", *patience)
    with serving(tmp_path / "node", scene, *options) as (process, port):
        with client(port) as bus:
            for message in can.MessageSync(can.LogReader(recorded)):
                bus.send(message)
            heard = 0
            while heard < 2000:
                heard += bus.recv(10).arbitration_id == 0x110
        again = finished(tmp_path / "node", process)
    assert again.summary["node"]["ok"] == 2000
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


@pytest.mark.skipif(shutil.which("log2asc") is None, reason="can-utils are not here")
@pytest.mark.parametrize("bus", ["loopback", "socketcand:0", "joined"])
def test_between_two_ticks_the_processor_rests(tmp_path, bus):
    """A tick and its answer cost some 50 us; who asked again and again would need all there is."""
    words = [program(), "--scene", str(STEERING), "--role", "encoder", "--seconds", "1", "--bus"]
    with serving(tmp_path / "node", STEERING, "--role", "node") as (_, port):
        spec = f"socketcand:127.0.0.1:{port}" if bus == "joined" else bus
        with subprocess.Popen([*words, spec], stdout=subprocess.DEVNULL) as process:
            _, status, used = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0
    assert used.ru_utime + used.ru_stime < 0.3


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


def test_ctrl_c_while_waiting_for_clients(tmp_path):
    with serving(tmp_path, STEERING, "--wait-clients", "2") as (process, _):
        process.send_signal(signal.SIGINT)
        result = finished(tmp_path, process, 10)
    assert result.code == 0
    assert result.summary["ticks"] == 0
    assert read_log(result.log) == []


def test_ctrl_c_in_virtual_time_with_clients_that_do_not_read(tmp_path):
    """It ends the patience with all of them."""
    options = ("--virtual", "--wait-clients", "2", "--nodes", "16")
    with serving(tmp_path, STEERING, *options) as (process, port):
        peers = [raw_client(port, receive_buffer=4096) for _ in range(2)]
        time.sleep(1)
        process.send_signal(signal.SIGINT)
        result = finished(tmp_path, process, 8)
        for peer in peers:
            peer.close()
    assert result.code == 0
    assert 0 < result.summary["ticks"] < 30000


def test_a_slow_client_is_dropped_and_the_beat_goes_on(tmp_path):
    with serving(tmp_path, STEERING, "--wait-clients", "2", "--seconds", "8") as (process, port):
        slow = raw_client(port, receive_buffer=4096)
        with client(port) as bus:
            lines = record(bus, process)
        result = finished(tmp_path, process)
        slow.close()
    assert re.fullmatch(
        r"note: socketcand client \d+ dropped: it reads too slowly, \d+ bytes wait for it\n",
        result.err,
    )
    assert len(lines) == len(result.log.read_text().splitlines())
    assert result.summary["frames_lost"] == 0
    assert result.summary["max_rss_kib"] < 16 * 1024


def reset(peer: socket.socket) -> None:
    """Leave with a TCP reset instead of an orderly end."""
    peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    peer.close()


def annoy(port: int, rng: random.Random) -> None:
    """Garbage, half lines, endless lines, early leaving."""
    peer = raw_client(port) if rng.random() < 0.5 else socket.create_connection(("127.0.0.1", port))
    pieces = [
        rng.randbytes(rng.randrange(1, 3000)),
        b"< send 123 8 1 2",
        b"<" * 500,
        b"< send 12 " + b"1 " * 4000,
        b"< open >",
        b"< open can7 >",
        b"< rawmode >",
        b"< subscribe 0 0 123 >",
        b"\x00" * 100,
    ]
    for piece in rng.sample(pieces, 4):
        try:
            peer.sendall(piece)
        except OSError:
            break
        time.sleep(0.005)
    if rng.random() < 0.5:
        reset(peer)
    else:
        peer.close()


def test_bad_clients_do_not_disturb_the_loop(tmp_path):
    rng = random.Random(1)
    with (
        serving(tmp_path, STEERING, "--wait-clients", "1", "--seconds", "4") as (process, port),
        client(port) as bus,
    ):
        for _ in range(40):
            annoy(port, rng)
        lines = record(bus, process)
        result = finished(tmp_path, process)
    assert result.code == 0
    assert len(lines) == len(result.log.read_text().splitlines())
    assert result.summary["frames_lost"] == 0
    assert result.summary["bus_counts"]["garbage"] > 0
    assert result.summary["bus_counts"]["dropped"] == 0


def test_a_flood_of_foreign_frames_does_not_stop_the_beat(tmp_path):
    with serving(tmp_path, STEERING, "--wait-clients", "1", "--seconds", "3") as (process, port):
        peer = raw_client(port)
        peer.setblocking(False)
        flood = b"< send 7FF 1 0 >" * 64
        while process.poll() is None:
            for action in (lambda: peer.send(flood), lambda: peer.recv(65536)):
                try:
                    action()
                except OSError:
                    time.sleep(0.0005)
        result = finished(tmp_path, process)
        peer.close()
    assert result.code == 0, result.err
    assert result.summary["frames_lost"] == 0
    assert result.summary["node"]["ok"] == 3000
    assert result.summary["node"]["ignored"] > 1000


def test_more_clients_than_there_is_room_for(tmp_path):
    """python-can says why, and so does `dahl`; a place that is left is free again."""
    refused = "16 clients are here, no more"
    with serving(tmp_path, STEERING, "--role", "node") as (process, port):
        inside = [raw_client(port) for _ in range(16)]
        with pytest.raises(can.CanError, match=f"got: '< error {refused} >'"), client(port):
            pass
        with socket.create_connection(("127.0.0.1", port), 5) as peer:
            assert b"".join(iter(lambda: peer.recv(99), b"")) == f"< error {refused} >".encode()
        joined = start(tmp_path / "joined", STEERING, "--bus", f"socketcand:127.0.0.1:{port}")
        assert joined.communicate(timeout=20)[1].startswith("error: --bus socketcand:127.0.0.1:")
        assert joined.returncode == 1
        inside.pop().close()
        time.sleep(0.1)
        inside.append(raw_client(port))
        process.send_signal(signal.SIGTERM)
        result = finished(tmp_path, process)
        for peer in inside:
            peer.close()
    assert result.err == "note: socketcand client refused: 16 are here, no more\n" * 3


def hear(peer: socket.socket, word: bytes) -> bytes:
    """Read until a word comes."""
    text = b""
    while word not in text:
        text += peer.recv(4096)
    return text


def test_frames_begin_a_tenth_of_a_second_after_the_greeting(tmp_path):
    """Whenever a client joins: before, python-can would take a frame for a part of the answer."""
    with serving(tmp_path, STEERING) as (_, port):
        waited = []
        for _ in range(4):
            peer = raw_client(port)
            begun = time.monotonic()
            assert peer.recv(8) == b"< frame "
            waited.append(time.monotonic() - begun)
            peer.close()
            time.sleep(0.15)
    assert 0.08 < min(waited) and max(waited) < 0.7


def test_frames_go_to_all_but_their_sender(tmp_path):
    with serving(tmp_path, SCENES / "segments.ini", "--role", "node") as (_, port):
        one, other = raw_client(port), raw_client(port)
        one.sendall(b"< send 18FF1234 3 1 2 AB >")
        assert re.search(rb"< frame 18FF1234 \d+\.\d{6} 0102AB >", hear(other, b"0102AB >"))
        other.sendall(b"< send 7AA 0 >")
        assert b"18FF1234" not in hear(one, b"< frame 7AA ")
        one.close()
        other.close()


def test_the_bus_going_away_is_told_and_the_files_are_whole(tmp_path):
    with serving(tmp_path / "node", STEERING, "--role", "node") as (node, port):
        words = ("--role", "encoder", "--bus", f"socketcand:127.0.0.1:{port}")
        encoder = start_in(tmp_path / "encoder", STEERING, *words)
        log = tmp_path / "encoder" / "run.log"
        wait_until(log.exists)
        time.sleep(1)
        node.send_signal(signal.SIGTERM)
        result = finished(tmp_path / "encoder", encoder, 10)
    assert result.code == 1
    assert re.fullmatch(r"error: --bus \S+: the bus is gone after \d+ ticks\n", result.err)
    assert result.summary["frames_answered"] > 300
    assert read_log(result.log)


def test_a_port_in_use_is_told(tmp_path):
    with serving(tmp_path / "first", STEERING, "--role", "node") as (_, port):
        result = run(tmp_path / "second", STEERING, "--bus", f"socketcand:{port}")
    assert result.code == 1
    assert result.err == f"error: --bus socketcand:{port}: Address already in use\n"
