# SPDX-License-Identifier: MIT
"""The served bus: its places, its limits in time and in bytes, its port. Clients that are slow,
silent or gone disturb neither the loop nor other clients. Random sequences of commands and frames:
test_loop_server_sequences.py.
"""

from __future__ import annotations

import contextlib
import re
import select
import signal
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from subprocess import Popen

import can
import pytest
from dahl.bus import open_bus
from loop_tools import (
    SCENES,
    Run,
    client,
    finished,
    raw_client,
    read_log,
    run,
    serving,
    start,
    wait_until,
)

STEERING = SCENES / "steering.ini"
NODE = ("--role", "node", "--set", "friction.timeout_ms=60000")


def hear(peer: socket.socket, pattern: bytes) -> bytes:
    text = b""
    while not re.search(pattern, text):
        part = peer.recv(1 << 16)
        assert part, "the server has closed the connection"
        text += part
    return text


def ended(folder: Path, process: Popen) -> Run:
    process.send_signal(signal.SIGTERM)
    return finished(folder, process)


def closed(*peers: socket.socket) -> None:
    for peer in peers:
        peer.close()


def flood(peer: socket.socket, element: bytes) -> None:
    """Send and read as much as there is room for, without waiting."""
    for action in (lambda: peer.send(element * 64), lambda: peer.recv(1 << 20)):
        try:
            action()
        except OSError:
            time.sleep(0.0005)


def spoken_angle(folder: Path) -> bytes:
    recorded = run(folder, STEERING, "--virtual", "--seconds", "0.001").log
    (angle,) = [frame.data for frame in read_log(recorded) if frame.id == 0x100]
    return f"< send 100 8 {' '.join(f'{byte:X}' for byte in angle)} >".encode()


# --- frames ---------------------------------------------------------------------------------------


def test_frames_begin_a_tenth_of_a_second_after_raw_mode_or_with_the_first_word(tmp_path):
    """python-can would read an earlier frame as a part of the answer. A client that sends has read
    the answer.
    """
    with serving(tmp_path / "a", STEERING) as (_, port):
        begun = time.monotonic()
        peer = raw_client(port)
        assert peer.recv(8) == b"< frame " and time.monotonic() - begun > 0.1
        peer.close()
    with serving(tmp_path / "b", SCENES / "segments.ini", *NODE) as (process, port):
        peer = raw_client(port)
        peer.sendall(spoken_angle(tmp_path / "r"))
        peer.close()  # an answer that waited would not be sent
        log = read_log(ended(tmp_path / "b", process).log)
    assert [frame.id for frame in log if frame.id != 0x120] == [0x100, 0x110]


def test_a_burst_beyond_the_queue_loses_no_frame(tmp_path):
    """Frames without room in the queue wait in their sockets."""
    with serving(tmp_path, STEERING, *NODE) as (process, port):
        peers = [raw_client(port) for _ in range(8)]
        for peer in peers:  # in raw mode, and no longer quiet
            peer.sendall(b"< echo >")
            hear(peer, b"< echo >")
        process.send_signal(signal.SIGSTOP)
        for peer in peers:
            peer.sendall(b"< send 7FF 0 >" * 800)
        process.send_signal(signal.SIGCONT)
        for peer in peers:
            received = b""
            while received.count(b"< frame 7FF ") < 7 * 800 or not received.endswith(b">"):
                received += peer.recv(1 << 16)
        result = ended(tmp_path, process)
        closed(*peers)
    assert result.summary["node"]["ignored"] == 8 * 800
    assert result.summary["bus_counts"]["dropped"] == 0


@pytest.mark.parametrize(("opens", "frames"), [(can.Bus, 10), (open_bus, 500)])
def test_all_frames_of_a_client_that_closes_with_unread_input_arrive(tmp_path, opens, frames):
    """Such a close is a reset. The server is stopped meanwhile, as a busy machine may do. A client
    without tcp_tune keeps Nagle's algorithm, so its kernel holds back short frames.
    """
    clients = range(0x600, 0x604)
    with serving(tmp_path, STEERING, "--set", "motion.seconds=60") as (process, port):
        for number in clients:
            with client(port, opens) as bus:
                assert bus.recv(10) is not None
                time.sleep(0.05)  # more frames come, and wait
                process.send_signal(signal.SIGSTOP)
                stat = Path(f"/proc/{process.pid}/stat")
                wait_until(lambda stat=stat: stat.read_text().split()[2] == "T")
                for i in range(frames):
                    bus.send(can.Message(0, number, is_extended_id=False, data=[i % 256]))
            process.send_signal(signal.SIGCONT)
        result = ended(tmp_path, process)
    carried = [(frame.id, frame.data[0]) for frame in read_log(result.log) if frame.id >= 0x600]
    assert carried == [(number, i % 256) for number in clients for i in range(frames)]
    assert result.err == ""


# --- places ---------------------------------------------------------------------------------------


def test_a_client_counts_from_raw_mode_on(tmp_path):
    """--wait-clients and --until-idle ignore a client that was only greeted or has only opened the
    bus. wall_s begins with the first tick, after the wait.
    """
    options = ("--wait-clients", "2", "--until-idle", "--virtual", "--seconds", "0.5")
    with serving(tmp_path, STEERING, *options) as (process, port):
        one, two = (socket.create_connection(("127.0.0.1", port), 10) for _ in range(2))
        for peer in (one, two):
            hear(peer, b"< hi >")
        two.sendall(b"< open vcan0 >")
        hear(two, b"< ok >")
        three = raw_client(port)
        time.sleep(0.5)
        assert process.poll() is None and not (tmp_path / "summary.json").exists()
        joined = time.monotonic()
        one.sendall(b"< open vcan0 >< rawmode >")
        summary = finished(tmp_path, process).summary
        closed(one, two, three)
    assert summary["ticks"] == 500
    assert 0 < summary["wall_s"] < time.monotonic() - joined


def test_sixteen_clients_fit_and_the_next_is_refused(tmp_path):
    """python-can and dahl-loop show the reason. A place that a client leaves is free again."""
    refused = "16 clients are here, no more"
    with serving(tmp_path, STEERING, "--role", "node") as (process, port):
        inside = [raw_client(port) for _ in range(16)]
        with pytest.raises(can.CanError, match=f"got: '< error {refused} >'"), client(port):
            pass
        with socket.create_connection(("127.0.0.1", port), 10) as last:
            text = b"".join(iter(lambda: last.recv(100), b""))  # until it is closed
        assert text == f"< error {refused} >".encode()
        joined = run(tmp_path / "joined", STEERING, "--bus", f"socketcand:127.0.0.1:{port}")
        assert joined.code == 1 and joined.err.startswith("error: --bus socketcand:127.0.0.1:")
        inside.pop().close()
        inside.append(next(raw_clients(port)))
        result = ended(tmp_path, process)
        closed(*inside)
    assert {line[:6] for line in result.err.splitlines()} == {"note: "} and "16" in result.err


def raw_clients(port: int) -> Iterator[socket.socket]:
    """The server may notice a moment later that a client has left."""
    until = time.monotonic() + 20
    while time.monotonic() < until:
        with contextlib.suppress(AssertionError, OSError):
            yield raw_client(port)
        time.sleep(0.05)


def test_server_and_client_drop_a_silent_peer_after_5_s(tmp_path):
    """Clients that send nothing or half a greeting; a server that accepts and stays silent, and one
    whose queue is full.
    """
    begun = time.monotonic()
    serves = serving(tmp_path / "server", STEERING, "--role", "node")
    with (
        socket.create_server(("127.0.0.1", 0)) as mute,
        socket.create_server(("127.0.0.1", 0), backlog=0) as full,
        socket.create_connection(full.getsockname()),
        serves as (process, port),
    ):
        buses = [f"socketcand:127.0.0.1:{one.getsockname()[1]}" for one in (mute, full)]
        joining = [start(tmp_path / bus, STEERING, "--bus", bus) for bus in buses]
        speaks = raw_client(port)
        silent = [socket.create_connection(("127.0.0.1", port), 20) for _ in range(4)]
        silent[0].sendall(b"< open vcan0 >")
        for peer in silent:
            while peer.recv(100):
                pass
        for bus, joined, why in zip(
            buses, joining, ("Protocol error", "Connection timed out"), strict=True
        ):
            refused = finished(tmp_path / bus, joined)
            assert (refused.code, refused.err.count("\n")) == (1, 1)
            assert refused.err.startswith(f"error: --bus {bus}: {why}")
        assert time.monotonic() - begun > 4.5
        speaks.sendall(b"< echo >")
        hear(speaks, b"< echo >")
        result = ended(tmp_path / "server", process)
        closed(speaks, *silent)
    assert result.code == 0
    assert sorted(map(int, re.findall(r"client (\d+)", result.err))) == [2, 3, 4, 5]


# --- slow clients ---------------------------------------------------------------------------------


def test_a_client_that_reads_too_slowly_is_dropped_and_its_place_is_clean(tmp_path):
    """The note names the place and the unread bytes, at most one frame below the limit. No unread
    byte reaches the next client.
    """
    with serving(tmp_path, STEERING, "--set", "motion.seconds=60") as (process, port):
        peer, deaf = raw_client(port), raw_client(port, receive_buffer=4096)
        peer.setblocking(False)
        until = time.monotonic() + 60
        while not select.select([process.stderr], [], [], 0)[0] and time.monotonic() < until:
            flood(peer, b"< send 7FF 8 1 2 3 4 5 6 7 8 >")
        place, left = re.match(r"note: \D*(\d+) .*?(\d+) bytes", process.stderr.readline()).groups()
        assert place == "2" and 262144 - 80 < int(left) <= 262144
        closed(peer, deaf)
        closed(*[raw_client(port) for _ in range(2)])
        result = ended(tmp_path, process)
    assert result.code == 0 and result.summary["bus_counts"]["dropped"] == 1


@pytest.mark.parametrize(("pause", "seconds"), [(2, 30), (0.7, 2)])
def test_virtual_time_waits_for_a_slow_client(tmp_path, pause, seconds):
    """With more frames than any buffer holds, and with frames that wait after the end."""
    options = ("--virtual", "--wait-clients", "1", "--seconds", seconds)
    with serving(tmp_path, STEERING, *options) as (process, port):
        peer = raw_client(port, receive_buffer=4096)
        time.sleep(pause)
        text = b"".join(iter(lambda: peer.recv(65536), b""))
        result = finished(tmp_path, process)
    assert (result.code, result.err) == (0, "")
    assert text.count(b"< frame ") == len(read_log(result.log)) > 2000 * seconds
    assert result.summary["bus_counts"]["dropped"] == 0


@pytest.mark.parametrize("clients", [0, 2])
def test_ctrl_c_ends_the_wait_for_clients(tmp_path, clients):
    """Otherwise virtual time waits 10 s for each client that does not read."""
    options = ("--virtual", "--wait-clients", "2", "--nodes", "16")
    with serving(tmp_path, STEERING, *options) as (process, port):
        peers = [raw_client(port, receive_buffer=4096) for _ in range(clients)]
        time.sleep(0.5)
        asked = time.monotonic()
        result = ended(tmp_path, process)
        closed(*peers)
    assert result.code == 0 and time.monotonic() - asked < 9
    assert 0 < result.summary["ticks"] < 30000 if clients else result.summary["ticks"] == 0


# --- ports and other servers ----------------------------------------------------------------------


def test_a_bus_is_served_on_the_loopback_address_only(tmp_path):
    """A second server on the port is refused. After the first one has ended, the port can be used
    again at once, even if the server closed a connection first.
    """
    with serving(tmp_path / "a", STEERING, *NODE) as (process, port):
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.2", port), timeout=5)
        words = ("--bus", f"socketcand:{port}", "--seconds", "0.01")
        second = run(tmp_path / "second", STEERING, *words)
        assert (second.code, second.err.count("\n")) == (1, 1)
        assert second.err.startswith(f"error: --bus socketcand:{port}: Address already in use")
        peer = raw_client(port)
        assert ended(tmp_path / "a", process).code == 0
        peer.close()
    result = run(tmp_path / "b", STEERING, *words)
    assert (result.code, result.err) == (0, "")
    assert result.out == f"socketcand 127.0.0.1:{port} vcan0\n"


@pytest.mark.parametrize("greeting", [b"HTTP/1.1 200 OK\r\n", b"< hello >", b"< hi >< no >", b""])
def test_a_peer_with_another_protocol_is_refused_at_its_first_word(tmp_path, greeting):
    """The last peer closes the connection instead."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        bus = f"socketcand:127.0.0.1:{listener.getsockname()[1]}"
        process = start(tmp_path, STEERING, "--bus", bus)
        peer, _ = listener.accept()
        peer.sendall(greeting)
        if not greeting:
            peer.close()
        result = finished(tmp_path, process)
        peer.close()
    assert (result.code, result.summary, result.err.count("\n")) == (1, {}, 1)
    assert result.err.startswith(f"error: --bus {bus}: Protocol error")
