# SPDX-License-Identifier: MIT
"""What a client of the served bus is promised: its place, its words, its frames, and who counts."""

from __future__ import annotations

import re
import select
import signal
import socket
import time

import pytest
from loop_tools import SCENES, finished, raw_client, read_log, run, serving, start, wait_until

STEERING = SCENES / "steering.ini"
NODE = ("--role", "node", "--set", "friction.timeout_ms=60000")


def greeted(port: int) -> socket.socket:
    """A client that was greeted and has said nothing yet."""
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


def ended(folder, process):
    process.send_signal(signal.SIGTERM)
    return finished(folder, process)


def test_all_garbage_is_counted_to_the_last_piece(tmp_path):
    """Unknown commands, other buses' names, bad frames, letters between elements; and what a
    client leaves unfinished is no garbage of the next one in its place.
    """
    with serving(tmp_path, STEERING, *NODE) as (process, port):
        peer = greeted(port)
        ask(peer, b"< subscribe 0 0 1 >", b"< error unknown command >")
        ask(peer, b"< rawmode >", b"< error unknown command >")
        ask(peer, b"< open can7 >", b"< error could not open bus >")
        peer.sendall(b"< open vca")
        peer.close()
        time.sleep(0.2)
        peer = raw_client(port)
        peer.sendall(b"abc< send 123 9 1 >< send 800 0 >\n < hello >< send 7FF 1 0 >< cut < echo >")
        assert b"< echo >" in peer.recv(1000)
        result = ended(tmp_path, process)
        peer.close()
    assert result.summary["bus_counts"]["garbage"] == 2 + 3 + 3 + 1
    assert result.summary["node"]["ignored"] == 1


def test_words_may_come_letter_by_letter(tmp_path):
    """To the server, and from one to its client."""
    with serving(tmp_path / "node", STEERING, *NODE) as (_, port):
        peer = greeted(port)
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for words, answer in ((b"< open vcan0 >", b"< ok >"), (b"< rawmode >", b"< ok >")):
            slowly(peer, words[:-1])
            ask(peer, words[-1:], answer)
        peer.close()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        spec = f"socketcand:127.0.0.1:{listener.getsockname()[1]}"
        (tmp_path / "encoder").mkdir()
        words = ("--role", "encoder", "--bus", spec, "--seconds", "0.3")
        process = start(tmp_path / "encoder", STEERING, *words)
        peer, _ = listener.accept()
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        slowly(peer, b"< hi >< ok >< ok >< frame 123 1.5 AB >< frame 123 1.500000 AB >")
        result = finished(tmp_path / "encoder", process)
        peer.close()
    assert (result.code, result.summary["bus_counts"]["garbage"]) == (0, 1)
    assert " 123#AB\n" in result.log.read_text()


def slowly(peer: socket.socket, words: bytes) -> None:
    for letter in words:
        peer.send(bytes([letter]))
        time.sleep(0.001)


def test_who_has_not_entered_raw_mode_is_not_waited_with(tmp_path):
    """Neither for the start nor for the end: greeted and opened are not yet on the bus."""
    options = ("--wait-clients", "2", "--until-idle", "--virtual", "--seconds", "0.5")
    with serving(tmp_path, STEERING, *options) as (process, port):
        one, two = greeted(port), greeted(port)
        ask(two, b"< open vcan0 >", b"< ok >")
        three = raw_client(port)
        time.sleep(0.5)
        assert process.poll() is None
        assert not (tmp_path / "summary.json").exists()
        ask(one, b"< open vcan0 >", b"< ok >")
        ask(one, b"< rawmode >", b"< ok >")
        assert finished(tmp_path, process).summary["ticks"] == 500
        for peer in (one, two, three):
            peer.close()


def test_a_client_that_speaks_is_answered_at_once(tmp_path):
    """The pause after the greeting is for who only listens. The best of five."""
    recorded = run(tmp_path / "r", STEERING, "--virtual", "--seconds", "0.001").log
    (angle,) = [frame.data for frame in read_log(recorded) if frame.id == 0x100]
    words = f"< send 100 8 {' '.join(f'{byte:X}' for byte in angle)} >".encode()
    waits = []
    with serving(tmp_path / "node", SCENES / "segments.ini", *NODE) as (_, port):
        for _ in range(5):
            other = raw_client(port)
            begun = time.monotonic()
            other.sendall(words)
            other.recv(1000)
            waits.append(time.monotonic() - begun)
            other.close()
    assert min(waits) < 0.05


def test_frames_of_clients_carry_the_time_of_the_bus(tmp_path):
    with serving(tmp_path, STEERING, *NODE) as (process, port):
        one, other = raw_client(port), raw_client(port)
        before = time.time()
        one.sendall(b"< send 7AA 1 5 >")
        text = b""
        while not (found := re.search(rb"< frame 7AA (\d+\.\d{6}) 05 >", text)):
            text += other.recv(1000)
        after = time.time()
        result = ended(tmp_path, process)
        one.close()
        other.close()
    assert before - 0.01 < float(found[1]) < after + 0.01
    assert f"({float(found[1]):017.6f}) vcan0 7AA#05" in result.log.read_text().splitlines()


def test_a_burst_of_many_clients_is_taken_whole(tmp_path):
    """More than the queue holds, all there at once: what has no room waits in its socket."""
    with serving(tmp_path, STEERING, *NODE) as (process, port):
        peers = [raw_client(port) for _ in range(8)]
        time.sleep(0.3)
        process.send_signal(signal.SIGSTOP)
        for peer in peers:
            peer.sendall(b"< send 7FF 0 >" * 800)
        process.send_signal(signal.SIGCONT)
        for peer in peers:
            hear_frames(peer, 7 * 800)
        result = ended(tmp_path, process)
        for peer in peers:
            peer.close()
    assert result.summary["node"]["ignored"] == 8 * 800
    assert result.summary["bus_counts"]["dropped"] == 0


def hear_frames(peer: socket.socket, frames: int) -> None:
    """Read so many frames of the others."""
    heard = b""
    while heard.count(b"< frame 7FF ") < frames or not heard.endswith(b">"):
        heard += peer.recv(1 << 16)


def test_sixteen_may_come_at_once(tmp_path):
    """While the server looks elsewhere none is turned away, nor has to knock twice."""
    with serving(tmp_path, STEERING, *NODE) as (process, port):
        process.send_signal(signal.SIGSTOP)
        peers = [socket.create_connection(("127.0.0.1", port), timeout=0.8) for _ in range(16)]
        process.send_signal(signal.SIGCONT)
        for peer in peers:
            peer.settimeout(10)
            assert peer.recv(100) == b"< hi >"
            peer.close()


def test_the_place_of_a_client_that_was_dropped_is_free_and_clean(tmp_path):
    """The note names the place that the client had; nothing that waited for it reaches the next."""
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
        said = re.fullmatch(
            r"note: socketcand client 2 dropped: it reads too slowly, (\d+) bytes wait for it\n",
            note,
        )
        assert 262144 - 80 < int(said[1]) <= 262144  # what it may leave, less than one frame
        listener.close()
        deaf.close()
        time.sleep(0.2)
        for peer in [raw_client(port) for _ in range(2)]:
            peer.close()
        result = ended(tmp_path, process)
    assert result.summary["bus_counts"]["dropped"] == 1


def pending(process) -> str:
    """A line of stderr, if there is one."""
    ready, _, _ = select.select([process.stderr], [], [], 0)
    return process.stderr.readline() if ready else ""


def test_the_bus_is_served_to_this_machine_alone(tmp_path):
    """On 127.0.0.1 and no other address of its own."""
    with serving(tmp_path, STEERING, *NODE) as (_, port):
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.2", port), timeout=5)
        raw_client(port).close()


def test_a_served_bus_is_joined_by_name(tmp_path):
    """Whichever address of the name comes first, and whether one is served there or not."""
    with serving(tmp_path / "node", STEERING, *NODE) as (_, port):
        words = ("--role", "encoder", "--seconds", "0.2", "--bus", f"socketcand:localhost:{port}")
        result = run(tmp_path / "encoder", STEERING, *words)
    assert (result.code, result.err) == (0, "")
    assert (result.summary["frames_sent"], result.summary["frames_lost"]) == (200, 0)


def test_a_port_can_be_served_again_at_once(tmp_path):
    """Also where the server was the first to close a connection."""
    with serving(tmp_path / "a", STEERING, *NODE) as (process, port):
        peer = raw_client(port)
        assert ended(tmp_path / "a", process).code == 0
        peer.close()
    (tmp_path / "b").mkdir()
    words = ("--bus", f"socketcand:{port}", "--seconds", "0.01")
    result = finished(tmp_path / "b", start(tmp_path / "b", STEERING, *words))
    assert (result.code, result.err) == (0, "")
    assert result.out == f"socketcand 127.0.0.1:{port} vcan0\n"


@pytest.mark.parametrize("greeting", [b"HTTP/1.1 200 OK\r\n", b"< hello >", b"< hi >< no >", b""])
def test_a_peer_that_is_none_is_known_as_soon_as_it_speaks(tmp_path, greeting):
    """Or leaves."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        process = start(tmp_path, STEERING, "--bus", f"socketcand:127.0.0.1:{port}")
        peer, _ = listener.accept()
        begun = time.monotonic()
        peer.sendall(greeting)
        if not greeting:
            peer.close()
        wait_until(lambda: process.poll() is not None)
        assert time.monotonic() - begun < 3
        result = finished(tmp_path, process)
        peer.close()
    assert (result.code, result.summary) == (1, {})
    words = "Protocol error (no socketcand server with bus vcan0)"
    assert result.err == f"error: --bus socketcand:127.0.0.1:{port}: {words}\n"


def test_a_bus_may_be_at_an_address_with_colons(tmp_path):
    if not socket.has_ipv6 or not can_bind("::1"):
        pytest.skip("unproven: a bus at an address with colons: this machine has no ::1")
    with socket.create_server(("::1", 0), family=socket.AF_INET6) as listener:
        port = listener.getsockname()[1]
        process = start(tmp_path, STEERING, "--bus", f"socketcand:::1:{port}", "--seconds", "0.1")
        listener.settimeout(10)
        peer, _ = listener.accept()
        peer.sendall(b"< hi >< ok >< ok >")
        result = finished(tmp_path, process)
        peer.close()
    assert (result.code, result.err) == (0, "")
    assert result.summary["frames_sent"] == 100


def can_bind(address: str) -> bool:
    try:
        socket.create_server((address, 0), family=socket.AF_INET6).close()
    except OSError:
        return False
    return True


def test_a_peer_that_says_nothing_is_given_up_after_5_s(tmp_path):
    """Whether it takes the connection or not: the queue of the second is full."""
    words = {
        "silent": "Protocol error (no socketcand server with bus vcan0)",
        "full": "Connection timed out",
    }
    with socket.create_server(("127.0.0.1", 0)) as silent, socket.socket() as full:
        full.bind(("127.0.0.1", 0))
        full.listen(0)
        ports = {"silent": silent.getsockname()[1], "full": full.getsockname()[1]}
        waiting = socket.create_connection(("127.0.0.1", ports["full"]))
        begun = time.monotonic()
        started = {}
        for name, port in ports.items():
            (tmp_path / name).mkdir()
            spec = f"socketcand:127.0.0.1:{port}"
            started[name] = start(tmp_path / name, STEERING, "--bus", spec)
        for name, process in started.items():
            result = finished(tmp_path / name, process, 20)
            assert 4.5 < time.monotonic() - begun < 7.5
            assert result.code == 1
            assert result.err == f"error: --bus socketcand:127.0.0.1:{ports[name]}: {words[name]}\n"
        waiting.close()
