# SPDX-License-Identifier: MIT
"""The bridge from slcan to a served bus, `python -m dahl.can.bridge SLCAN_PORT SOCKETCAND_PORT`,
between two sockets of the test.
"""

from __future__ import annotations

import random
import re
import socket
import subprocess
import sys
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
    """Node, bus and the bridge, which has connected to both."""
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
    """The same after the greeting."""
    node, bus, work = begun
    for line, received in ((b"< hi >", b"< open vcan0 >"), (b"< ok >", b"< rawmode >")):
        bus.link.sendall(line)
        assert bus.until(b">") == received
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
def test_only_data_frames_pass_and_in_both_directions(opened, seed):
    """In pieces of any length. The bridge ends with the node."""
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
    node.link.close()
    assert (work.wait(10), work.stderr.read()) == (0, "")


def check_error(code: int, errors: str) -> None:
    assert code == 1 and errors.startswith("error: bridge: ") and errors.count("\n") == 1


def test_a_bus_that_closes_at_the_greeting_is_an_error(begun):
    _, bus, work = begun
    bus.link.close()
    check_error(work.wait(10), work.stderr.read())


@pytest.mark.parametrize("ports", [["x", "y"], ["1"], ["1", "1"]])
def test_bad_ports_are_an_error(root, ports):
    words = [sys.executable, "-m", "dahl.can.bridge", *ports]
    done = subprocess.run(words, cwd=root / "tools", capture_output=True, text=True, check=False)
    check_error(done.returncode, done.stderr)
