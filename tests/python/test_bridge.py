# SPDX-License-Identifier: MIT
"""The bridge from slcan to a served bus, both ends played by sockets of this process."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import pytest
from dahl import bridge
from hypothesis import given
from hypothesis import strategies as st

frames = st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8))


@given(frames)
def test_a_frame_keeps_its_identifier_and_data(frame: tuple[int, bytes]) -> None:
    number, data = frame
    line = bridge.to_line(b"frame %x 12.5 %s" % (number, data.hex(" ").encode()))
    assert line == b"t%03X%d%s\r" % (number, len(data), data.hex().upper().encode())
    sent = bridge.to_element(line[:-1])
    words = re.fullmatch(rb"< send ([0-9A-F]{3}) (\d) ((?:[0-9A-F]{2} ?)*) ?>", sent)
    assert words is not None
    assert int(words[1], 16) == number
    assert (int(words[2]), bytes.fromhex(words[3].decode())) == (len(data), data)


@given(st.binary(max_size=40))
def test_rubbish_is_nothing_or_a_frame(rubbish: bytes) -> None:
    assert re.fullmatch(rb"(< send [0-9A-F]{3} [0-8] [0-9A-F ]*>)?", bridge.to_element(rubbish))


@pytest.mark.parametrize(
    "element",
    [
        b"",
        b"ok",
        b"frame 1",
        b"frame 1234 1.0 00",
        b"frame 12345678 1.0 00",
        b"error x y",
        b"send 100 0",
    ],
)
def test_other_elements_do_not_reach_the_node(element: bytes) -> None:
    assert bridge.to_line(element) == b""


@pytest.mark.parametrize(
    "line", [b"", b"z", b"t1000", b"T0000010010", b"t10021", b"r1000", b"t1002AA", b"t1001AABB"]
)
def test_other_lines_do_not_reach_the_bus(line: bytes) -> None:
    assert bridge.to_element(line) in (b"", b"< send 100 0  >")
    assert (bridge.to_element(line) == b"") == (line != b"t1000")


class Peer:
    """A server for one client."""

    def __init__(self) -> None:
        self.server = socket.create_server(("127.0.0.1", 0))
        self.port = str(self.server.getsockname()[1])
        self.rest = b""

    def accept(self) -> None:
        self.link = self.server.accept()[0]
        self.link.settimeout(10)

    def until(self, mark: bytes) -> bytes:
        while mark not in self.rest:
            piece = self.link.recv(4096)
            assert piece, f"closed before {mark!r}"
            self.rest += piece
        before, _, self.rest = self.rest.partition(mark)
        return before + mark

    def close(self) -> None:
        self.link.close()
        self.server.close()


def begun() -> tuple[Peer, Peer, threading.Thread, list]:
    """Node and bus that the bridge, in a thread, has reached; its exit code."""
    node, bus, code = Peer(), Peer(), []
    ports = [node.port, bus.port]
    work = threading.Thread(target=lambda: code.append(bridge.main(ports)), daemon=True)
    work.start()
    node.accept()
    bus.accept()
    return node, bus, work, code


@pytest.fixture
def opened(monkeypatch, capsys) -> Iterator[tuple[Peer, Peer, threading.Thread, list]]:
    """Node and bus after the greeting, the bridge between them in a thread, its exit code."""
    monkeypatch.setattr(bridge.signal, "signal", lambda *_: None)  # for the main thread alone
    node, bus, work, code = begun()
    for said, heard in ((b"< hi >", b"< open vcan0 >"), (b"< ok >", b"< rawmode >")):
        bus.link.sendall(said)
        assert bus.until(b">") == heard
    bus.link.sendall(b"< ok >")
    assert node.until(b"O\r") == b"\rC\rO\r"
    bus.link.sendall(b"< frame 7FF 0.0  >")  # so `ready` was said, and capsys has it
    assert node.until(b"\r") == b"t7FF0\r"
    yield node, bus, work, code
    node.close()
    bus.close()
    work.join(10)


def test_frames_pass_both_ways_in_any_pieces(opened, capsys) -> None:
    node, bus, work, code = opened
    bus.link.sendall(b"< frame 100 0.1 01 0")
    bus.link.sendall(b"2 >< frame 110 0.2  >")
    assert node.until(b"\r") == b"t10020102\r"
    assert node.until(b"\r") == b"t1100\r"
    node.link.sendall(b"t1201F")
    node.link.sendall(b"F\r\rz\r\at1300\r")
    assert bus.until(b">") == b"< send 120 1 FF >"
    assert bus.until(b">") == b"< send 130 0  >"
    waits = []
    for _ in range(5):
        since = time.monotonic()
        node.link.sendall(b"t1300\r")
        bus.until(b">")
        waits.append(time.monotonic() - since)
    assert min(waits) < 0.02  # at once
    node.link.close()
    work.join(10)
    assert code == [0]
    assert capsys.readouterr().out == "ready\n"


def test_a_frame_does_not_wait_for_the_next_one() -> None:
    peer = Peer()
    with bridge.connect(int(peer.port)) as link:
        assert link.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
    peer.server.close()


def test_a_bus_that_hangs_up_at_the_greeting_is_one_line(monkeypatch, capsys) -> None:
    monkeypatch.setattr(bridge.signal, "signal", lambda *_: None)
    node, bus, work, code = begun()
    bus.link.close()
    work.join(10)
    node.close()
    assert code == [1]
    assert capsys.readouterr().err == "error: bridge: the bus closed the connection\n"


@pytest.mark.parametrize("ports", [["x", "y"], ["1"], ["1", "1"]])
def test_a_bridge_that_does_not_open_is_one_line(root, ports) -> None:
    words = [sys.executable, "-m", "dahl.bridge", *ports]
    done = subprocess.run(words, cwd=root / "tools", capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (1, "")
    assert re.fullmatch(r"error: bridge: [^\n]+\n", done.stderr)
