# SPDX-License-Identifier: MIT
"""The bridge from slcan to a served bus as a program between two sockets, which are node and
bus: `python -m dahl.can.bridge SLCAN_PORT SOCKETCAND_PORT`.
"""

from __future__ import annotations

import random
import re
import socket
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest


class Peer:
    """A server for one client."""

    def __init__(self) -> None:
        self.server = socket.create_server(("127.0.0.1", 0))
        self.port = str(self.server.getsockname()[1])
        self.rest = b""

    def accept(self) -> None:
        self.server.settimeout(20)
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


@pytest.fixture
def begun(root) -> Iterator[tuple[Peer, Peer, subprocess.Popen]]:
    """Node and bus that the bridge has reached, and the bridge."""
    node, bus = Peer(), Peer()
    words = [sys.executable, "-m", "dahl.can.bridge", node.port, bus.port]
    with subprocess.Popen(
        words, cwd=root / "tools", stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as work:
        node.accept()
        bus.accept()
        yield node, bus, work
        work.kill()
        node.close()
        bus.close()


@pytest.fixture
def opened(begun) -> tuple[Peer, Peer, subprocess.Popen]:
    """The same after the greeting, each step of which waits for the one before."""
    node, bus, work = begun
    for said, heard in ((b"< hi >", b"< open vcan0 >"), (b"< ok >", b"< rawmode >")):
        bus.link.sendall(said)
        assert bus.until(b">") == heard
    bus.link.sendall(b"< ok >")
    assert node.until(b"O\r") == b"\rC\rO\r"
    assert work.stdout.readline() == "ready\n"
    return begun


def in_pieces(link: socket.socket, text: bytes, rng: random.Random) -> None:
    while text:
        at = rng.randrange(1, 40)
        link.sendall(text[:at])
        text = text[at:]


OTHER_ELEMENTS = b"< ok >< frame 1 >< frame 1234 1.0 00 >< frame 12345678 1.0 00 >< send 100 0 >"
OTHER_LINES = b"\rz\rT0000010010\rt10021\rr1000\rt1002AA\rt1001AABB\rt1009\r\a"


@pytest.mark.parametrize("seed", range(3))
def test_frames_pass_both_ways_with_identifier_and_data_and_nothing_else_does(opened, seed):
    """In any pieces, each at once; the bridge ends with the node's end."""
    node, bus, work = opened
    rng = random.Random(seed)
    frames = [(rng.randrange(0x800), rng.randbytes(rng.randrange(9))) for _ in range(60)]
    text = b"".join(b"< frame %x 12.5 %s >" % (i, data.hex(" ").encode()) for i, data in frames)
    in_pieces(bus.link, OTHER_ELEMENTS + text, rng)
    for number, data in frames:
        line = b"t%03X%d%s\r" % (number, len(data), data.hex().upper().encode())
        assert node.until(b"\r") == line
    text = b"".join(b"t%03X%d%s\r" % (i, len(d), d.hex().upper().encode()) for i, d in frames)
    in_pieces(node.link, OTHER_LINES + text, rng)
    for number, data in frames:
        sent = re.fullmatch(rb"< send (\w+) (\d) ((?:\w\w ?)*) ?>", bus.until(b">"))
        assert (int(sent[1], 16), int(sent[2])) == (number, len(data))
        assert bytes.fromhex(sent[3].decode()) == data
    waits = []
    for _ in range(5):
        since = time.monotonic()
        node.link.sendall(b"t1300\r")
        bus.until(b">")
        waits.append(time.monotonic() - since)
    assert min(waits) < 0.02
    node.link.close()
    assert (work.wait(10), work.stderr.read()) == (0, "")


def one_line(code: int, errors: str) -> None:
    assert code == 1 and errors.startswith("error: bridge: ") and errors.count("\n") == 1


def test_a_bus_that_hangs_up_at_the_greeting_is_one_line(begun):
    _, bus, work = begun
    bus.link.close()
    one_line(work.wait(10), work.stderr.read())


@pytest.mark.parametrize("ports", [["x", "y"], ["1"], ["1", "1"]])
def test_a_bridge_that_does_not_open_is_one_line(root, ports):
    words = [sys.executable, "-m", "dahl.can.bridge", *ports]
    done = subprocess.run(words, cwd=root / "tools", capture_output=True, text=True, check=False)
    one_line(done.returncode, done.stderr)
