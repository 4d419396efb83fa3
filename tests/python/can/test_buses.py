# SPDX-License-Identifier: MIT
"""The choice of a bus, the form of a line of run.log, and the command line of the emulator."""

from __future__ import annotations

import os
import struct
import time

import can
import pytest

KINDS = [  # frames, and the ends of the lines that candump would write
    (can.Message(arbitration_id=0x123, data=b"\xab", is_extended_id=False), "123#AB"),
    (can.Message(arbitration_id=0x123, data=b"\xab"), "00000123#AB"),
    (can.Message(arbitration_id=1, is_fd=True, is_extended_id=False, data=b"\2"), "001##002"),
    (
        can.Message(
            arbitration_id=1, is_fd=True, is_extended_id=False, data=b"", bitrate_switch=True
        ),
        "001##1",
    ),
]
ODD = [
    (can.Message(is_error_frame=True, arbitration_id=4, data=b"\1"), "20000004#01"),
    (can.Message(arbitration_id=5, is_remote_frame=True, dlc=8, is_extended_id=False), "005#R8"),
    (can.Message(arbitration_id=5, is_remote_frame=True, dlc=0, is_extended_id=False), "005#R"),
    (
        can.Message(
            **{"arbitration_id": 1, "is_extended_id": False, "data": b"\2", "is_fd": True},
            **{"bitrate_switch": True, "error_state_indicator": True},
        ),
        "001##302",
    ),
]


@pytest.mark.parametrize(("message", "end"), [*KINDS, *ODD])
def test_a_line_of_run_log_is_as_candump_writes_it(message, end):
    """Without a kernel that has CAN, a demo sees few of these frames: the function is called."""
    from dahl.bus import candump_line

    message.timestamp = 1234567890.5
    for channel, name in ((None, "vcan0"), (3, "vcan0"), ("can1", "can1")):
        message.channel = channel
        assert candump_line(message) == f"(1234567890.500000) {name} {end}\n"


def test_a_vcan0_that_is_up_is_chosen_unless_another_bus_is_named(monkeypatch, tmp_path):
    """The interfaces of the kernel are replaced."""
    from dahl import bus

    monkeypatch.setattr(bus, "Path", lambda path: tmp_path / path.lstrip("/"))
    monkeypatch.setattr(bus.shutil, "which", lambda _: None)
    (folder := tmp_path / "sys/class/net/vcan0").mkdir(parents=True)
    for kernel, flags, best in ((1, "0x1003", 1), (1, "0x80", 0), (1, "0xc1", 1), (0, "0xc1", 0)):
        monkeypatch.setattr(bus, "has_socketcan", lambda kernel=kernel: kernel)
        (folder / "flags").write_text(f"{flags}\n")
        assert bus.choose(None)[0] == ("socketcan:vcan0" if best else "socketcand"), flags
    for asked in ("socketcand", "socketcand:29536", "socketcan:can1", "socketcan:can-le.ft"):
        assert bus.choose(asked)[0] == asked


def test_the_emulator_gets_image_and_parameters_and_its_error_is_passed_on(monkeypatch, tmp_path):
    """The class is not public; without it an image must be cross-compiled."""
    from dahl import RunError
    from dahl.sim import firmware

    (tmp_path / "qemu-system-arm").write_text('#!/bin/sh\necho "qemu: $*" >&2\nexit 1\n')
    (tmp_path / "qemu-system-arm").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    (folder := tmp_path / "a,b").mkdir()  # QEMU wants a comma doubled
    node = firmware.Firmware("m4f", (100.0, 0.5, 0.25), folder, 3, 7000, folder / "image")
    page = struct.unpack("<I3f2I", node.page.read_bytes())
    assert page == (int.from_bytes(b"DAHL", "little"), 100.0, 0.5, 0.25, 3, 7000)
    begun = time.monotonic()
    with pytest.raises(RunError, match="qemu: ") as caught, node:
        pass
    assert time.monotonic() - begun < 5  # no wait for a program that has ended
    board = firmware.boards()["m4f"]
    for words in (
        f"-M {board.machine} ",
        "-display none -monitor none -serial tcp:127.0.0.1:",
        f"-kernel {folder}/image",
        f"-device loader,file={str(node.page).replace(',', ',,')},addr={board.page:#x},",
    ):
        assert words in str(caught.value)
