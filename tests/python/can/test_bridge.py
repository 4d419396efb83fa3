# SPDX-License-Identifier: MIT
"""The bridge from slcan to a served bus, `python -m dahl.can.bridge SLCAN_PORT SOCKETCAND_PORT`,
between two sockets of the test.
"""

from __future__ import annotations

import contextlib
import random
import re
import socket
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest


class Peer:
    def __init__(self) -> None:
        self.server = socket.create_server(("127.0.0.1", 0))
        self.server.settimeout(60)
        self.port = str(self.server.getsockname()[1])
        self.rest = b""

    def accept(self) -> None:
        self.link = self.server.accept()[0]
        self.link.settimeout(60)

    def until(self, mark: bytes) -> bytes:
        while mark not in self.rest:
            piece = self.link.recv(4096)
            assert piece, f"closed before {mark!r}"
            self.rest += piece
        before, _, self.rest = self.rest.partition(mark)
        return before + mark

    def send_in_pieces(self, text: bytes, rng: random.Random) -> None:
        while text:
            at = rng.randrange(1, 40)
            self.link.sendall(text[:at])
            text = text[at:]
            time.sleep(0.002)  # so that the bridge reads some pieces alone


def bridge(*ports: str) -> subprocess.Popen:
    words = [sys.executable, "-m", "dahl.can.bridge", *ports]
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@contextlib.contextmanager
def connected() -> Iterator[tuple[Peer, Peer, subprocess.Popen]]:
    node, bus = Peer(), Peer()
    with bridge(node.port, bus.port) as work:
        try:
            node.accept()
            bus.accept()
            yield node, bus, work
        finally:
            work.kill()
    for peer in (node, bus):
        peer.link.close()
        peer.server.close()


def is_one_error(work: subprocess.Popen) -> bool:
    _, errors = work.communicate(timeout=60)
    is_line = errors.startswith("error: bridge: ") and errors.count("\n") == 1
    return work.returncode == 1 and is_line


OTHER_ELEMENTS = b"< ok >< frame 1 >< frame 1234 1.0 00 >< frame 12345678 1.0 00 >< send 100 0 >"
OTHER_LINES = b"\rz\rT0000010010\rt10021\rr1000\rt1002AA\rt1001AABB\rt1009\r\a"


def test_only_data_frames_pass_and_in_both_directions():
    rng = random.Random(1)
    frames = [(rng.randrange(0x800), rng.randbytes(rng.randrange(9))) for _ in range(100)]
    elements = [b"< frame %x 12.5 %s >" % (i, data.hex(" ").encode()) for i, data in frames]
    lines = [b"t%03X%d%s\r" % (i, len(d), d.hex().upper().encode()) for i, d in frames]
    with connected() as (node, bus, work):
        for line, received in ((b"< hi >", b"< open vcan0 >"), (b"< ok >", b"< rawmode >")):
            bus.link.sendall(line)
            assert bus.until(b">") == received
        bus.link.sendall(b"< ok >")
        assert node.until(b"O\r") == b"\rC\rO\r"
        assert work.stdout.readline() == "ready\n"
        bus.send_in_pieces(OTHER_ELEMENTS + b"".join(elements), rng)
        assert [node.until(b"\r") for _ in lines] == lines
        node.send_in_pieces(OTHER_LINES + b"".join(lines), rng)
        for number, data in frames:
            sent = re.fullmatch(rb"< send (\w+) (\d) ((?:\w\w ?)*) ?>", bus.until(b">"))
            assert (int(sent[1], 16), int(sent[2])) == (number, len(data))
            assert bytes.fromhex(sent[3].decode()) == data
        node.link.close()
        assert (work.wait(60), work.stderr.read()) == (0, "")


def test_a_bus_that_closes_at_the_greeting_is_an_error():
    with connected() as (_, bus, work):
        bus.link.close()
        assert is_one_error(work)


@pytest.mark.parametrize("ports", [["x", "y"], ["1"], ["1", "1"]])
def test_bad_ports_are_an_error(ports):
    with bridge(*ports) as work:
        assert is_one_error(work)
