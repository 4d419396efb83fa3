# SPDX-License-Identifier: MIT
"""The served bus: its places, its limits in time and in bytes, its port. Clients that are slow,
silent or gone disturb neither the loop nor other clients. Answers to commands, and random sessions
on simulated sockets: tests/port/test_socketcand.c.
"""

import contextlib
import re
import select
import signal
import socket
import time
from pathlib import Path

import can
import loop_tools as loop
import pytest
from dahl import bus
from dahl.bus import open_bus
from loop_tools import SCENES, client, ended, finished, raw_client, read_log, run, serving, start

STEERING = SCENES / "steering.ini"
MINUTE = ("--set", "motion.seconds=60")


@pytest.fixture
def connect():
    """Open clients in raw mode, which are closed after the test."""
    with contextlib.ExitStack() as stack:
        yield lambda port, **how: stack.enter_context(raw_client(port, **how))


def hear(peer: socket.socket, word: bytes, times: int = 1) -> None:
    text = b""
    while text.count(word) < times:
        part = peer.recv(1 << 16)
        assert part, "the server has closed the connection"
        text += part


# --- frames ---------------------------------------------------------------------------------------


def test_frames_begin_a_tenth_of_a_second_after_raw_mode(tmp_path, connect):
    """python-can would read an earlier frame as a part of the answer."""
    with serving(tmp_path, STEERING) as (_, port):
        begun = time.monotonic()
        assert connect(port).recv(8) == b"< frame " and time.monotonic() - begun > 0.1


def test_a_burst_beyond_the_queue_loses_no_frame(tmp_path, connect):
    """Frames without room in the queue wait in their sockets."""
    with serving(tmp_path, STEERING, "--role", "node") as (process, port):
        peers = [connect(port) for _ in range(8)]
        for peer in peers:  # in raw mode, and no longer quiet
            peer.sendall(b"< echo >")
            hear(peer, b"< echo >")
        process.send_signal(signal.SIGSTOP)
        for peer in peers:
            peer.sendall(b"< send 7FF 0 >" * 800)
        process.send_signal(signal.SIGCONT)
        for peer in peers:
            hear(peer, b"< frame 7FF ", times=7 * 800)
        summary = ended(tmp_path, process).summary
    assert summary["node"]["ignored"] == 8 * 800 and summary["bus_counts"]["dropped"] == 0


@pytest.mark.parametrize(("opens", "frames"), [(can.Bus, 10), (open_bus, 500)])
def test_all_frames_of_a_client_that_closes_with_unread_input_arrive(tmp_path, opens, frames):
    """Such a close is a reset. The server is stopped meanwhile, as a busy machine may do. A client
    without tcp_tune keeps Nagle's algorithm, so its kernel holds back short frames.
    """
    clients = range(0x600, 0x604)
    with serving(tmp_path, STEERING, *MINUTE) as (process, port):
        stat = Path(f"/proc/{process.pid}/stat")
        for number in clients:
            with client(port, opens) as bus:
                assert bus.recv(10) is not None
                time.sleep(0.05)  # more frames come, and wait
                process.send_signal(signal.SIGSTOP)
                loop.wait_until(lambda: stat.read_text().split()[2] == "T")
                for i in range(frames):
                    bus.send(can.Message(0, number, is_extended_id=False, data=[i % 256]))
            process.send_signal(signal.SIGCONT)
        result = ended(tmp_path, process)
    carried = [(frame.id, frame.data[0]) for frame in read_log(result.log) if frame.id >= 0x600]
    assert carried == [(number, i % 256) for number in clients for i in range(frames)]
    assert result.err == ""


# --- places ---------------------------------------------------------------------------------------


def test_a_client_counts_from_raw_mode_on(tmp_path, connect):
    """--wait-clients and --until-idle ignore a client that was only greeted or has only opened the
    bus. wall_s begins with the first tick, after the wait.
    """
    options = ("--wait-clients", "2", "--until-idle", "--virtual", "--seconds", "0.5")
    with serving(tmp_path, STEERING, *options) as (process, port):
        one, two = (socket.create_connection(("127.0.0.1", port), 10) for _ in range(2))
        with one, two:
            for peer in (one, two):
                hear(peer, b"< hi >")
            two.sendall(b"< open vcan0 >")
            hear(two, b"< ok >")
            connect(port)
            time.sleep(0.5)
            assert process.poll() is None and not loop.summary_of(tmp_path)
            joined = time.monotonic()
            one.sendall(b"< open vcan0 >< rawmode >")
            summary = finished(tmp_path, process).summary
    assert summary["ticks"] == 500
    assert 0 < summary["wall_s"] < time.monotonic() - joined


def test_sixteen_clients_fit_and_the_next_is_refused(tmp_path, connect):
    """python-can and dahl-loop show the reason. A place that a client leaves is free again."""
    refused = "16 clients are here, no more"
    with serving(tmp_path, STEERING, "--role", "node") as (process, port):
        inside = [connect(port) for _ in range(16)]
        with pytest.raises(can.CanError, match=f"got: '< error {refused} >'"), client(port):
            pass
        with socket.create_connection(("127.0.0.1", port), 10) as last:
            text = b"".join(iter(lambda: last.recv(100), b""))  # until it is closed
        assert text == f"< error {refused} >".encode()
        bus = f"socketcand:127.0.0.1:{port}"
        error = loop.run_alone(loop.EXAMPLE, "--bus", bus).error(1)
        assert error.startswith(f"--bus {bus}: ")
        inside.pop().close()
        loop.wait_until(lambda: has_place(port), 20)
        result = ended(tmp_path, process)
    assert {line[:6] for line in result.err.splitlines()} == {"note: "} and "16" in result.err


def has_place(port: int) -> bool:
    """The server may notice a moment later that a client has left."""
    with contextlib.suppress(AssertionError, OSError), raw_client(port):
        return True
    return False


def test_a_server_that_is_silent_for_5_s_is_refused(tmp_path):
    """One accepts the connection and sends nothing. The queue of the other one is full."""
    begun = time.monotonic()
    with (
        socket.create_server(("127.0.0.1", 0)) as mute,
        socket.create_server(("127.0.0.1", 0), backlog=0) as full,
        socket.create_connection(full.getsockname()),
    ):
        buses = [f"socketcand:127.0.0.1:{one.getsockname()[1]}" for one in (mute, full)]
        joining = [start(tmp_path / bus, STEERING, "--bus", bus) for bus in buses]
        errors = [
            finished(tmp_path / bus, each).error(1)
            for bus, each in zip(buses, joining, strict=True)
        ]
    assert errors[0].startswith(f"--bus {buses[0]}: Protocol error")
    assert errors[1].startswith(f"--bus {buses[1]}: Connection timed out")
    assert time.monotonic() - begun > 4.5


def test_a_frame_of_can_fd_reaches_the_other_clients_whole(tmp_path):
    """The server keeps 8 of its bytes, so its own log leaves it out, with a note."""
    data = bytes(range(100, 164))
    with serving(tmp_path, STEERING, "--role", "node") as (process, port):
        with client(port) as one, client(port) as other:
            for size in (12, 64):
                message = can.Message(arbitration_id=0x321, data=data[:size], is_fd=True)
                one.send(message)
                while (got := bus.receive(other, 10)).arbitration_id != 0x321:
                    pass
                assert (got.data, got.is_fd, got.is_extended_id) == (data[:size], True, True)
        result = ended(tmp_path, process)
    assert result.summary["bus_counts"]["long_fd_frames"] == 2
    assert "00000321#" not in result.log.read_text()
    assert result.code == 0 and re.match(r"note: --log: 2 .*8 bytes", result.err)


# --- slow clients ---------------------------------------------------------------------------------


def test_a_client_that_reads_too_slowly_is_dropped_and_its_place_is_clean(tmp_path, connect):
    """The note names the place and the unread bytes, at most one frame below the limit. No unread
    byte reaches the next client.
    """
    with serving(tmp_path, STEERING, "--nodes", "16", *MINUTE) as (process, port):
        peer, deaf = connect(port), connect(port, receive_buffer=4096)
        while not select.select([process.stderr], [], [], 0)[0]:
            assert peer.recv(1 << 20)
        place, left = re.match(r"note: \D*(\d+) .*?(\d+) bytes", process.stderr.readline()).groups()
        assert place == "2" and 262144 - 80 < int(left) <= 262144
        peer.close()
        deaf.close()
        connect(port), connect(port)
        result = ended(tmp_path, process)
    summary = result.summary
    assert result.code == 0 and summary["bus_counts"]["dropped"] == 1
    assert summary["wall_s"] - summary["ticks"] / 1000 < 5  # the ticks did not wait for it


@pytest.mark.parametrize(("pause", "seconds"), [(2, 30), (0.7, 2)])
def test_virtual_time_waits_for_a_slow_client(tmp_path, connect, pause, seconds):
    """With more frames than any buffer holds, and with frames that wait after the end."""
    options = ("--virtual", "--wait-clients", "1", "--seconds", seconds)
    with serving(tmp_path, STEERING, *options) as (process, port):
        peer = connect(port, receive_buffer=4096)
        time.sleep(pause)
        text = b"".join(iter(lambda: peer.recv(65536), b""))
        result = finished(tmp_path, process)
    assert (result.code, result.err) == (0, "")
    assert text.count(b"< frame ") == len(read_log(result.log)) > 2000 * seconds
    assert result.summary["bus_counts"]["dropped"] == 0


@pytest.mark.parametrize("clients", [0, 2])
def test_ctrl_c_ends_the_wait_for_clients(tmp_path, connect, clients):
    """Otherwise virtual time waits 10 s for each client that does not read."""
    options = ("--virtual", "--wait-clients", "2", "--nodes", "16")
    with serving(tmp_path, STEERING, *options) as (process, port):
        for _ in range(clients):
            connect(port, receive_buffer=4096)
        time.sleep(0.5)
        asked = time.monotonic()
        result = ended(tmp_path, process)
    assert result.code == 0 and time.monotonic() - asked < 9
    assert 0 < result.summary["ticks"] < 30000 if clients else result.summary["ticks"] == 0


# --- ports and other servers ----------------------------------------------------------------------


def test_a_bus_is_served_on_the_loopback_address_only(tmp_path, connect):
    """A second server on the port is refused. After the first one has ended, the port can be used
    again at once, even if the server closed a connection first.
    """
    with serving(tmp_path / "a", STEERING, "--role", "node") as (process, port):
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.2", port), timeout=5)
        words = ("--bus", f"socketcand:{port}", "--seconds", "0.01")
        error = loop.run_alone(loop.EXAMPLE, *words).error(1)
        assert error.startswith(f"--bus socketcand:{port}: Address already in use")
        connect(port)
        assert ended(tmp_path / "a", process).code == 0
    result = run(tmp_path / "b", STEERING, *words)
    assert (result.code, result.err) == (0, "")
    assert result.out == f"socketcand 127.0.0.1:{port} vcan0\n"


@pytest.mark.parametrize("greeting", [b"HTTP/1.1 200 OK\r\n", b"< hello >", b"< hi >< no >", b""])
def test_a_peer_with_another_protocol_is_refused_at_its_first_word(tmp_path, greeting):
    """The last peer closes the connection instead."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        bus = f"socketcand:127.0.0.1:{listener.getsockname()[1]}"
        process = start(tmp_path, STEERING, "--bus", bus)
        with listener.accept()[0] as peer:
            peer.sendall(greeting)
            if not greeting:
                peer.close()
            result = finished(tmp_path, process)
    assert result.error(1).startswith(f"--bus {bus}: Protocol error") and result.summary == {}


def test_a_bus_of_any_name_is_joined(tmp_path):
    """The log has its name."""
    asked = b""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        spec = f"socketcand:127.0.0.1:{listener.getsockname()[1]}/slcan-7.b"
        process = start(tmp_path, STEERING, "--bus", spec, "--role", "node", "--seconds", "0.2")
        with listener.accept()[0] as peer:
            for word in (b"< hi >", b"< ok >", b"< ok >< frame 7FF 1.000000 01 >"):
                peer.sendall(word)
                asked += peer.recv(100)
            result = finished(tmp_path, process)
    assert asked.startswith(b"< open slcan-7.b >< rawmode >") and result.code == 0
    assert "(0000000001.000000) slcan-7.b 7FF#01\n" in result.log.read_text()


@pytest.mark.parametrize("channel", ["", "a b", "a<", ">", "\t", "\x7f", "ä", "x" * 32])
def test_a_channel_that_the_protocol_cannot_name_is_refused(channel):
    spec = f"socketcand:127.0.0.1:1/{channel}"
    error = loop.run_alone(loop.EXAMPLE, "--bus", spec).error(2)
    assert error.startswith("--bus socketcand:127.0.0.1:1/") and "1 to 31" in error


@pytest.mark.parametrize(
    "address", ["28600/can1", "/can1", ":1/can1", "h:/can1", "h:0/can1", "h:x"]
)
def test_a_server_takes_no_channel_and_a_client_needs_host_and_port(address):
    error = loop.run_alone(loop.EXAMPLE, "--bus", f"socketcand:{address}").error(2)
    assert error.startswith(f"--bus socketcand:{address}: ") and "HOST:PORT[/CHANNEL]" in error
