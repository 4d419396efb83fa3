# SPDX-License-Identifier: MIT
"""Connect a node behind slcan to a served bus: `python -m dahl.can.bridge SLCAN_PORT
SOCKETCAND_PORT`

Frames are forwarded as text in both directions until one side closes: python-can would need more
than a millisecond for each. It prints `ready` when both sides are open.
"""

from __future__ import annotations

import re
import select
import signal
import socket
import sys
import time

ELEMENT = re.compile(rb"<\s*([^<>]*?)\s*>")
LINE = re.compile(rb"t([0-9A-F]{3})([0-8])((?:[0-9A-F]{2})*)\Z")
GATHER_S = 2e-4  # wait that lets single bytes of an emulated UART become a line
HANDSHAKE = (b"< open vcan0 >", b"< rawmode >")


def connect(port: int) -> socket.socket:
    link = socket.create_connection(("127.0.0.1", port), timeout=10)
    link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return link


def to_line(element: bytes) -> bytes:
    """Return `frame ID TIME DATA` of socketcand as a line of slcan; b"" for another element."""
    words = element.split()
    if len(words) < 3 or words[0] != b"frame" or len(words[1]) > 3:
        return b""
    data = b"".join(words[3:]).upper()
    return b"t%03X%d%s\r" % (int(words[1], 16), len(data) // 2, data)


def to_element(line: bytes) -> bytes:
    """Return a line of slcan as `send` of socketcand; b"" for acknowledgements and for frames that
    the node never sends.
    """
    found = LINE.match(line)
    if not found or len(found[3]) != 2 * int(found[2]):
        return b""
    data = found[3]
    return b"< send %s %s %s >" % (
        found[1],
        found[2],
        b" ".join(data[n : n + 2] for n in range(0, len(data), 2)),
    )


class Side:
    """One connection, and the incomplete end of its input."""

    def __init__(self, link: socket.socket) -> None:
        self.link, self.rest = link, b""

    def read(self) -> bool:
        piece = self.link.recv(65536)
        self.rest += piece
        return bool(piece)

    def elements(self) -> list[bytes]:
        whole, mark, self.rest = self.rest.rpartition(b">")
        return ELEMENT.findall(whole + mark)

    def lines(self) -> list[bytes]:
        *whole, self.rest = re.split(rb"[\r\a]", self.rest)
        return whole


def join(bus: Side) -> None:
    """Do the handshake of socketcand: each step waits for its answer."""
    for step in (*HANDSHAKE, b""):
        while not bus.elements():
            if not bus.read():
                raise OSError("the bus closed the connection")
        bus.link.sendall(step)


def forward(node: Side, bus: Side) -> None:
    """Forward frames until one side closes."""
    while True:
        for link in select.select([node.link, bus.link], [], [])[0]:
            side = node if link is node.link else bus
            if side is node:
                time.sleep(GATHER_S)
            if not side.read():
                return
        out = b"".join(map(to_line, bus.elements()))
        if out:
            node.link.sendall(out)
        out = b"".join(map(to_element, node.lines()))
        if out:
            bus.link.sendall(out)


def main(arguments: list[str]) -> int:
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        node, bus = (Side(connect(int(port))) for port in arguments)
        join(bus)
        node.link.sendall(b"\rC\rO\r")
        for side in (node, bus):
            side.link.settimeout(None)
        print("ready", flush=True)
        forward(node, bus)
    except (OSError, ValueError) as error:
        print(f"error: bridge: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
