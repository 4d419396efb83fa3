# SPDX-License-Identifier: MIT
"""The slcan line reader of port/slcan under any bytes, and beside python-can. What it accepts, what
it refuses and how it counts that, line by line: tests/port/test_slcan.c.
"""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path
from types import SimpleNamespace

import can
import codec_tools
import pytest
from hypothesis import given
from hypothesis import strategies as st

ROOT = Path(__file__).resolve().parents[2]
COUNTS = ("too_long", "cut", "not_hex", "wrong_length", "unknown", "closed")
LINE_MAX, TEXT_MAX = 138, 28
EXTENDED, REMOTE, FD = 1, 2, 8


class Frame(codec_tools.Frame):
    """The same, comparable."""

    def key(self) -> tuple[int, int, bytes]:
        return self.id, self.flags, bytes(self.data[: self.length])


class Slcan(ctypes.Structure):
    """slcan_t."""

    _fields_ = [(name, ctypes.c_uint32) for name in COUNTS]
    _fields_ += [("length", ctypes.c_uint32), ("open", ctypes.c_bool), ("refused", ctypes.c_bool)]
    _fields_ += [("line", ctypes.c_char * LINE_MAX), ("guard", ctypes.c_uint8 * 8)]


@pytest.fixture(scope="module")
def reader(tmp_path_factory) -> ctypes.CDLL:
    """port/slcan/slcan.c as it is, with the sanitizer that needs no special start of Python."""
    library = tmp_path_factory.mktemp("slcan") / "slcan.so"
    source = ROOT / "port/slcan/slcan.c"
    flags = [
        "-std=c99",
        "-pedantic",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-O1",
        "-fsanitize=undefined",
        "-shared",
        "-fPIC",
        f"-I{ROOT}/lib/include",
    ]
    subprocess.run(["gcc", *flags, "-fno-sanitize-recover=all", "-o", library, source], check=True)
    return ctypes.CDLL(str(library))


class Line:
    """An adapter, fed with text."""

    def __init__(self, reader: ctypes.CDLL) -> None:
        self.reader, self.state = reader, Slcan()
        self.state.guard[:] = [0xA5] * 8
        assert self.feed(b"O\r") == (b"\r", [])

    def feed(self, data: bytes) -> tuple[bytes, list[Frame]]:
        """All answers, and all frames."""
        said, frames, text = b"", [], ctypes.create_string_buffer(TEXT_MAX)
        for byte in data:
            frame = Frame()
            event = self.reader.slcan_take(
                ctypes.byref(self.state), byte, ctypes.byref(frame), text
            )
            said += text.value if event else b""
            frames += [frame] if event == 2 else []
        assert bytes(self.state.guard) == b"\xa5" * 8, "wrote past the line"
        return said, frames

    def counts(self) -> dict[str, int]:
        return {name: getattr(self.state, name) for name in COUNTS if getattr(self.state, name)}


@given(st.binary(max_size=400))
def test_any_bytes(reader, data: bytes) -> None:
    """Every line gets exactly one answer, every refusal is counted once, and the next good frame
    comes through.
    """
    adapter = Line(reader)
    said, frames = adapter.feed(data + b"\r")
    assert said.count(b"\a") == sum(adapter.counts().values())
    assert said.count(b"\a") + said.count(b"\r") == data.count(b"\r") + 1
    adapter.feed(b"O\r")
    assert adapter.feed(b"t1230\r")[1][0].key() == (0x123, 0, b"")


def test_python_can_agrees(reader) -> None:
    """python-can's own writer of lines: what it would send is what is read here."""
    from can.interfaces.slcan import slcanBus

    sent: list[str] = []
    bus = slcanBus.__new__(slcanBus)
    bus._write = sent.append
    bus.serialPortOrig = SimpleNamespace(write_timeout=None)
    bus._is_shutdown = True
    messages = [
        can.Message(arbitration_id=0x100, data=range(8), is_extended_id=False),
        can.Message(arbitration_id=0x1ABCDEF0, data=b"\xfe", is_extended_id=True),
        can.Message(arbitration_id=5, is_extended_id=False, is_remote_frame=True, dlc=3),
        can.Message(arbitration_id=0x100, data=range(64), is_extended_id=False, is_fd=True),
        can.Message(arbitration_id=7, data=range(12), is_fd=True, bitrate_switch=True),
    ]
    for message in messages:
        slcanBus.send(bus, message)
    _, frames = Line(reader).feed("".join(text + "\r" for text in sent).encode())
    for message, frame in zip(messages, frames, strict=True):
        data = bytes(3) if message.is_remote_frame else bytes(message.data[:8])
        flags = message.is_extended_id * EXTENDED + message.is_remote_frame * REMOTE
        flags += message.is_fd * FD
        assert frame.key() == (message.arbitration_id, flags, data)
