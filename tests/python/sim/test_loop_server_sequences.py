# SPDX-License-Identifier: MIT
"""Random sequences of clients on the served bus against a model of the protocol: commands in any
order and in any pieces, frames, garbage, half-closed and reset connections, a stopped server.
"""

from __future__ import annotations

import re
import signal
import socket
import struct
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from hypothesis import Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, precondition, rule
from loop_tools import SCENES, ended, serving, setting

ECHO = b"< echo >"
STATUS = b"<120#"  # the node sends one after power-on
OPTIONS = ("--role", "node", *setting("friction.timeout_ms=60000", "status.period_ms=60000"))
COMMANDS = ["open vcan0", "open can7", "open vcan", "open vcan01", "open", "rawmode", "bcmmode"]
COMMANDS += ["subscribe 0 0 1", "add 1 0 123 1 1", "statistics 100", "hello", ""]
COMMANDS += ["send 123 9 1", "send 800 0", "send 7FF", "send 7FF 1 100", "send 7FF 1"]  # bad frames
NOISE = {  # how much garbage it is, before the next <
    "abc": 3,
    "\n \t": 1,
    "> x": 2,
    "< cut ": 1,
    "<\0\0": 2,
    "<" * 500: 500,
}
FRAME = re.compile(rb"< frame (\w+) (\d+\.\d{6}) (\w*) >")


@dataclass
class Client:
    """A connection, its stage and what the server owes it."""

    peer: socket.socket
    stage: str = "greeted"  # then opened, then raw
    owed: list[bytes] = field(default_factory=list)  # answers, and frames as identifier#data

    def send(self, text: str, piece: int = 1 << 16) -> None:
        data = text.encode()
        for at in range(0, len(data), piece):
            self.peer.sendall(data[at : at + piece])

    def command(self, word: str) -> int:
        """Note the answer to a command and the new stage. Return how much garbage it is."""
        if self.stage != "raw" and word.startswith("open"):
            is_ok = word == "open vcan0"
            self.stage = "opened" if is_ok else self.stage
            self.owed.append(b"< ok >" if is_ok else b"< error could not open bus >")
            return 0
        if (self.stage, word) == ("opened", "rawmode"):
            self.stage = "raw"
            self.owed.append(b"< ok >")
            return 0
        if self.stage != "raw" or not word.startswith("send"):
            self.owed.append(b"< error unknown command >")
        return 1

    def settle(self) -> list[float]:
        """Wait until the server has read everything. Return the times of the frames that came."""
        self.send(ECHO.decode())
        text = b""
        while ECHO not in text:
            part = self.peer.recv(1 << 16)
            assert part, "the server has closed the connection"
            text += part
        times = [float(found[2]) for found in FRAME.finditer(text)]
        elements = re.findall(rb"<[^>]*>", FRAME.sub(rb"<\1#\3>", text))
        assert [one for one in elements if not one.startswith(STATUS)] == [*self.owed, ECHO]
        self.owed.clear()
        return times


def frames() -> st.SearchStrategy[list[tuple[str, bytes]]]:
    """(identifier, data) that the node ignores; eight digits are an identifier of 29 bits."""
    plain = st.integers(0x700, 0x7FF).map("{:X}".format)
    extended = st.integers(0x18000000, 0x18FFFFFF).map("{:08X}".format)
    frame = st.tuples(plain | extended, st.binary(max_size=8))
    return st.lists(frame, min_size=1, max_size=1) | st.lists(frame, min_size=2, max_size=40)


NUMBERS = st.integers(0, 9)
PIECES = st.sampled_from([1, 3, 1 << 16])  # bytes at a time


class Server(RuleBasedStateMachine):
    """dahl-loop serves a bus on which only these clients send."""

    def __init__(self) -> None:
        super().__init__()
        self.stack = ExitStack()
        self.folder = Path(self.stack.enter_context(tempfile.TemporaryDirectory()))
        serves = serving(self.folder, SCENES / "segments.ini", *OPTIONS)
        self.process, self.port = self.stack.enter_context(serves)
        self.clients: list[Client] = []
        self.garbage = 0
        self.sent: list[bytes] = []  # identifier#data of all frames, in order

    def pick(self, number: int, stage: str = "") -> Client | None:
        fitting = [one for one in self.clients if stage in ("", one.stage)]
        return fitting[number % len(fitting)] if fitting else None

    @precondition(lambda self: len(self.clients) < 5)
    @rule(enters=st.booleans())
    def connect(self, enters: bool) -> None:
        client = Client(socket.create_connection(("127.0.0.1", self.port), timeout=10))
        assert client.peer.recv(100) == b"< hi >"
        self.clients.append(client)
        for word in ("open vcan0", "rawmode") if enters else ():
            self.command(len(self.clients) - 1, word, 1 << 16)

    @precondition(lambda self: self.clients)
    @rule(number=NUMBERS, word=st.sampled_from(COMMANDS), piece=PIECES)
    def command(self, number: int, word: str, piece: int) -> None:
        client = self.pick(number)
        self.garbage += client.command(word)
        client.send(f"< {word} >", piece)
        client.settle()

    @precondition(lambda self: self.clients)
    @rule(number=NUMBERS, noise=st.sampled_from([*NOISE]))
    def send_noise(self, number: int, noise: str) -> None:
        self.garbage += NOISE[noise]
        self.pick(number).send(noise)
        self.pick(number).settle()

    @precondition(lambda self: self.pick(0, "raw"))
    @rule(number=NUMBERS, frames=frames(), piece=PIECES, stops=st.booleans())
    def send(self, number: int, frames: list[tuple[str, bytes]], piece: int, stops: bool) -> None:
        """Send frames, perhaps while the server is stopped."""
        client, begun = self.pick(number, "raw"), time.time()
        if stops:
            self.process.send_signal(signal.SIGSTOP)
        for identifier, data in frames:
            client.send(f"< send {identifier} {len(data)} {data.hex(' ')} >", piece)
            self.sent.append(f"{identifier}#{data.hex().upper()}".encode())
            for other in self.clients:
                if other is not client and other.stage == "raw":
                    other.owed.append(b"<" + self.sent[-1] + b">")
        self.process.send_signal(signal.SIGCONT)
        client.settle()
        self.settle_all(begun)

    def settle_all(self, begun: float) -> None:
        for client in self.clients:
            assert all(begun - 0.1 < moment < time.time() + 0.1 for moment in client.settle())

    @precondition(lambda self: self.clients)
    @rule(number=NUMBERS, how=st.sampled_from(["half", "close", "cut", "reset"]))
    def leave(self, number: int, how: str) -> None:
        """An element that a client leaves unfinished is no garbage of the next client."""
        client = self.pick(number)
        self.clients.remove(client)
        if how == "cut":
            client.send("< send 7FF 8 1 2")
        if how == "reset":
            linger = struct.pack("ii", 1, 0)
            client.peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
        if how == "half":
            client.peer.shutdown(socket.SHUT_WR)
            while client.peer.recv(1 << 16):
                pass
        client.peer.close()

    def teardown(self) -> None:
        with self.stack:
            self.settle_all(0)
            result = ended(self.folder, self.process)
            for client in self.clients:
                client.peer.close()
            counts = result.summary["bus_counts"]
            assert (result.code, result.err) == (0, "")
            assert (counts["garbage"], counts["dropped"]) == (self.garbage, 0)
            assert result.summary["node"]["ignored"] == len(self.sent)
            words = [line.split()[2].encode() for line in result.log.read_text().splitlines()]
            assert [word for word in words if not word.startswith(b"120#")] == self.sent


# A failing example waits for frames that never come, so it is not shrunk.
PHASES = (Phase.generate,)
Server.TestCase.settings = settings(max_examples=12, stateful_step_count=20, phases=PHASES)
TestServer = Server.TestCase
