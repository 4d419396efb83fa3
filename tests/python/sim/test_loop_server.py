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


def greeted(port: int) -> socket.socket:
    """A client that was greeted and has sent no command yet."""
    peer = socket.create_connection(("127.0.0.1", port))
    peer.settimeout(10)
    assert peer.recv(100) == b"< hi >"
    return peer


def ask(peer: socket.socket, words: bytes, answer: bytes) -> None:
    peer.sendall(words)
    got = b""
    while len(got) < len(answer):
        got += peer.recv(100)
    assert got == answer


def hear(peer: socket.socket, pattern: bytes) -> bytes:
    """Read until something comes that matches."""
    text = b""
    while not re.search(pattern, text):
        text += peer.recv(1 << 16)
    return text


def ended(folder, process):
    process.send_signal(signal.SIGTERM)
    return finished(folder, process)


def closed(*peers: socket.socket) -> None:
    for peer in peers:
        peer.close()


def test_a_client_reads_words_letter_by_letter_and_logs_the_time_of_the_server(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as listener:
        spec = f"socketcand:127.0.0.1:{listener.getsockname()[1]}"
        words = ("--role", "encoder", "--bus", spec, "--seconds", "0.3")
        process = start(tmp_path / "encoder", STEERING, *words)
        peer, _ = listener.accept()
        for letter in b"< hi >< ok >< ok >< frame 123 1.5 AB >< frame 123 1.500000 AB >":
            peer.send(bytes([letter]))
            time.sleep(0.001)
        result = finished(tmp_path / "encoder", process)
        peer.close()
    assert (result.code, result.summary["bus_counts"]["garbage"]) == (0, 1)
    assert "(0000000001.500000) vcan0 123#AB\n" in result.log.read_text()


def test_frames_begin_a_tenth_of_a_second_after_raw_mode_or_with_the_first_word(tmp_path):
    """python-can would read an earlier frame as a part of the answer. A client that sends has read
    the answer.
    """
    recorded = run(tmp_path / "r", STEERING, "--virtual", "--seconds", "0.001").log
    (angle,) = [frame.data for frame in read_log(recorded) if frame.id == 0x100]
    spoken = f"< send 100 8 {' '.join(f'{byte:X}' for byte in angle)} >".encode()
    with serving(tmp_path / "a", STEERING) as (_, port):
        silent = min(wait_for_a_frame(port, b"") for _ in range(4))
    with serving(tmp_path / "b", SCENES / "segments.ini", *NODE) as (_, port):
        assert min(wait_for_a_frame(port, spoken) for _ in range(5)) < 0.08 < silent


def wait_for_a_frame(port: int, words: bytes) -> float:
    """Seconds until the first frame comes to a new client that sends these words."""
    peer = raw_client(port)
    begun = time.monotonic()
    peer.sendall(words)
    assert peer.recv(8) == b"< frame "
    waited = time.monotonic() - begun
    peer.close()
    return waited


def test_a_burst_beyond_the_queue_loses_no_frame(tmp_path):
    """Frames without room in the queue wait in their sockets."""
    with serving(tmp_path, STEERING, *NODE) as (process, port):
        peers = [raw_client(port) for _ in range(8)]
        time.sleep(0.3)
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


def stop(process: Popen) -> None:
    process.send_signal(signal.SIGSTOP)
    wait_until(lambda: Path(f"/proc/{process.pid}/stat").read_text().split()[2] == "T")


@pytest.mark.parametrize(("opens", "frames"), [(can.Bus, 10), (open_bus, 500)])
def test_all_frames_of_a_client_that_closes_with_unread_input_arrive(tmp_path, opens, frames):
    """Such a close is a reset. The server is stopped meanwhile, as a busy machine may do. A client
    without tcp_tune keeps Nagle's algorithm, so its kernel holds back short frames.
    """
    clients = range(0x600, 0x608)
    with serving(tmp_path, STEERING, "--set", "motion.seconds=60") as (process, port):
        for number in clients:
            with client(port, opens) as bus:
                assert bus.recv(10) is not None
                time.sleep(0.05)  # more frames come, and wait
                stop(process)
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
        one, two = greeted(port), greeted(port)
        ask(two, b"< open vcan0 >", b"< ok >")
        three = raw_client(port)
        time.sleep(0.5)
        assert process.poll() is None and not (tmp_path / "summary.json").exists()
        joined = time.monotonic()
        ask(one, b"< open vcan0 >", b"< ok >")
        ask(one, b"< rawmode >", b"< ok >")
        summary = finished(tmp_path, process).summary
        closed(one, two, three)
    assert summary["ticks"] == 500
    assert 0 < summary["wall_s"] < time.monotonic() - joined


def test_until_idle_starts_with_the_first_client_and_ends_with_the_last(tmp_path):
    with serving(tmp_path, STEERING, "--role", "node", "--until-idle") as (process, port):
        time.sleep(0.5)
        assert process.poll() is None
        one, other = raw_client(port), raw_client(port)
        time.sleep(0.3)
        one.close()
        time.sleep(0.5)
        assert process.poll() is None
        other.close()
        assert finished(tmp_path, process, 10).code == 0


def test_sixteen_clients_fit_and_the_next_is_refused(tmp_path):
    """A stopped server refuses none of the sixteen. python-can and dahl-loop show the reason of a
    refusal. A place that a client leaves is free again.
    """
    refused = "16 clients are here, no more"
    with serving(tmp_path, STEERING, "--role", "node") as (process, port):
        process.send_signal(signal.SIGSTOP)
        inside = [socket.create_connection(("127.0.0.1", port), timeout=0.8) for _ in range(16)]
        process.send_signal(signal.SIGCONT)
        for peer in inside:
            peer.settimeout(10)
            assert peer.recv(100) == b"< hi >"
            for words in (b"< open vcan0 >", b"< rawmode >"):
                ask(peer, words, b"< ok >")
        with pytest.raises(can.CanError, match=f"got: '< error {refused} >'"), client(port):
            pass
        joined = start(tmp_path / "joined", STEERING, "--bus", f"socketcand:127.0.0.1:{port}")
        assert joined.communicate(timeout=20)[1].startswith("error: --bus socketcand:127.0.0.1:")
        assert joined.returncode == 1
        inside.pop().close()
        time.sleep(0.1)
        inside.append(raw_client(port))
        result = ended(tmp_path, process)
        closed(*inside)
    assert [line[:6] for line in result.err.splitlines()] == ["note: "] * 2 and "16" in result.err


@contextlib.contextmanager
def joining_a_silent_server(folder: Path) -> Iterator[list[tuple[str, Popen, str]]]:
    """(bus, program, reason) of two programs that join: one server accepts and stays silent, the
    queue of the other is full.
    """
    with socket.create_server(("127.0.0.1", 0)) as silent, socket.socket() as full:
        full.bind(("127.0.0.1", 0))
        full.listen(0)
        waiting = socket.create_connection(full.getsockname())
        buses = [f"socketcand:127.0.0.1:{one.getsockname()[1]}" for one in (silent, full)]
        programs = [start(folder / bus, STEERING, "--bus", bus) for bus in buses]
        yield [*zip(buses, programs, ("Protocol error", "Connection timed out"), strict=True)]
        waiting.close()


def check_silent_clients_are_dropped(silent: list[socket.socket], begun: float) -> None:
    """Fifteen clients that send nothing or half a greeting lose their places after 5 s."""
    for peer in silent[:8]:
        peer.sendall(b"< open vcan0 >")
    for peer in silent:
        peer.settimeout(20)
        while peer.recv(100):
            pass
    assert time.monotonic() - begun > 4.5


def test_server_and_client_drop_a_silent_peer_after_5_s(tmp_path):
    begun = time.monotonic()
    serves = serving(tmp_path / "server", STEERING, "--role", "node")
    with joining_a_silent_server(tmp_path) as joining, serves as (process, port):
        speaks = raw_client(port)
        silent = [socket.create_connection(("127.0.0.1", port)) for _ in range(15)]
        check_silent_clients_are_dropped(silent, begun)
        for bus, joined, why in joining:
            refused = finished(tmp_path / bus, joined, 20)
            assert time.monotonic() - begun > 4.5
            assert (refused.code, refused.err.count("\n")) == (1, 1)
            assert refused.err.startswith(f"error: --bus {bus}: {why}")
        time.sleep(0.6)
        speaks.sendall(b"< echo >")
        hear(speaks, b"< echo >")
        raw_client(port).close()
        result = ended(tmp_path / "server", process)
        speaks.close()
    assert result.code == 0
    assert sorted(map(int, re.findall(r"client (\d+)", result.err))) == [*range(2, 17)]


def pending(process) -> str:
    """The next line of stderr, or nothing."""
    ready, _, _ = select.select([process.stderr], [], [], 0)
    return process.stderr.readline() if ready else ""


def test_a_client_that_reads_too_slowly_is_dropped_and_its_place_is_clean(tmp_path):
    """The note names the place and the unread bytes, at most one frame below the limit. No unread
    byte reaches the next client.
    """
    with serving(tmp_path, STEERING, "--set", "motion.seconds=60") as (process, port):
        listener, deaf = raw_client(port), raw_client(port, receive_buffer=4096)
        flood = b"< send 7FF 8 1 2 3 4 5 6 7 8 >" * 100
        listener.setblocking(False)
        until = time.monotonic() + 20
        while (note := pending(process)) == "" and time.monotonic() < until:
            for action in (lambda: listener.send(flood), lambda: listener.recv(1 << 20)):
                try:
                    action()
                except BlockingIOError:
                    time.sleep(0.001)
        place, left = re.match(r"note: \D*(\d+) .*?(\d+) bytes", note).groups()
        assert place == "2" and 262144 - 80 < int(left) <= 262144
        closed(listener, deaf)
        time.sleep(0.2)
        closed(*[raw_client(port) for _ in range(2)])
        result = ended(tmp_path, process)
    assert result.summary["bus_counts"]["dropped"] == 1
    assert result.summary["beat_late_us"]["max"] < 2e6  # real time does not wait for a client


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
    """Before they have come, and in virtual time while they do not read."""
    options = ("--virtual", "--wait-clients", "2", "--nodes", "16")
    with serving(tmp_path, STEERING, *options) as (process, port):
        peers = [raw_client(port, receive_buffer=4096) for _ in range(clients)]
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        result = finished(tmp_path, process, 8)
        closed(*peers)
    assert result.code == 0
    assert 0 < result.summary["ticks"] < 30000 if clients else result.summary["ticks"] == 0
    assert (read_log(result.log) == []) == (clients == 0)


def test_neither_a_flood_nor_a_slow_client_stops_the_loop(tmp_path):
    options = ("--wait-clients", "2", "--seconds", "2")
    with serving(tmp_path, STEERING, *options) as (process, port):
        slow, peer = raw_client(port, receive_buffer=4096), raw_client(port)
        assert peer.recv(8) == b"< frame "  # both clients count: the run has begun
        peer.setblocking(False)
        flood = b"< send 7FF 1 0 >" * 64
        while process.poll() is None:
            for action in (lambda: peer.send(flood), lambda: peer.recv(65536)):
                try:
                    action()
                except OSError:
                    time.sleep(0.0005)
        result = finished(tmp_path, process)
        closed(slow, peer)
    assert result.code == 0, result.err
    assert result.summary["max_rss_kib"] < 16 * 1024
    node = result.summary["node"]
    assert (result.summary["frames_lost"], node["ok"], node["ignored"] > 1000) == (0, 2000, True)


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
        wait_until(lambda: process.poll() is not None, 4.5)  # before its limit for a silent peer
        result = finished(tmp_path, process)
        peer.close()
    assert (result.code, result.summary, result.err.count("\n")) == (1, {}, 1)
    assert result.err.startswith(f"error: --bus {bus}: Protocol error")


def can_bind(address: str) -> bool:
    try:
        socket.create_server((address, 0), family=socket.AF_INET6).close()
    except OSError:
        return False
    return True


@pytest.mark.skipif(
    not (socket.has_ipv6 and can_bind("::1")),
    reason="unproven: a bus at an address with colons: this machine has no ::1",
)
def test_a_bus_can_be_at_an_ipv6_address(tmp_path):
    with socket.create_server(("::1", 0), family=socket.AF_INET6) as listener:
        port = listener.getsockname()[1]
        process = start(tmp_path, STEERING, "--bus", f"socketcand:::1:{port}", "--seconds", "0.1")
        listener.settimeout(10)
        peer, _ = listener.accept()
        peer.sendall(b"< hi >< ok >< ok >")
        result = finished(tmp_path, process)
        peer.close()
    assert (result.code, result.err, result.summary["frames_sent"]) == (0, "", 100)
