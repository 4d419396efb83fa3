# SPDX-License-Identifier: MIT
"""port/slcan against the slcan bus of python-can. Bad lines: tests/port/test_slcan.c."""

from __future__ import annotations

import subprocess
from pathlib import Path
from types import SimpleNamespace

import can
import pytest
from can.interfaces.slcan import slcanBus
from conftest import ROOT
from hypothesis import given
from hypothesis import strategies as st

ADAPTER = r"""
#include <stdio.h>
#include "slcan.h"
int main(void)
{
    static slcan_t adapter;
    dahl_can_frame_t frame;
    char text[SLCAN_TEXT_MAX];
    for (int c; (c = getchar()) != EOF;) {
        if (slcan_take(&adapter, (uint8_t)c, &frame, text) == SLCAN_FRAME) {
            printf("%X %u", (unsigned)frame.id, (unsigned)frame.flags);
            for (int i = 0; i < frame.length; i++) {
                printf(" %02X", (unsigned)frame.data[i]);
            }
            printf(" %s\n", slcan_write(&frame, text) > 0 ? text : "");
        }
    }
    return 0;
}
"""
EXTENDED, REMOTE, FD = 1, 2, 8


@pytest.fixture(scope="module")
def adapter(tmp_path_factory) -> Path:
    program = tmp_path_factory.mktemp("slcan") / "adapter"
    flags = "-std=c99 -pedantic -Wall -Wextra -Werror -O1 -fsanitize=address,undefined".split()
    folders = [f"-I{ROOT}/lib/include", f"-I{ROOT}/port/slcan", f"{ROOT}/port/slcan/slcan.c"]
    words = ["gcc", *flags, "-fno-sanitize-recover=all", "-o", program, "-x", "c", "-", *folders]
    subprocess.run(words, input=ADAPTER, text=True, check=True)
    return program


def heard(adapter: Path, text: str) -> list[str]:
    done = subprocess.run([adapter], input=text.encode(), capture_output=True, check=True)
    return done.stdout.decode().replace("\r", "").splitlines()


def other_end() -> tuple[slcanBus, list[str]]:
    bus, written = slcanBus.__new__(slcanBus), []
    bus._write = written.append
    bus.serialPortOrig = SimpleNamespace(write_timeout=None)
    bus._is_shutdown = True
    return bus, written


LENGTHS = [*range(9), 12, 16, 20, 24, 32, 48, 64]


@st.composite
def messages(draw) -> can.Message:
    extended, fd = draw(st.booleans()), draw(st.booleans())
    remote = not fd and draw(st.booleans())
    length = draw(st.sampled_from(LENGTHS if fd else LENGTHS[:9]))
    data = None if remote else draw(st.binary(min_size=length, max_size=length))
    identifier = draw(st.integers(0, 0x1FFFFFFF if extended else 0x7FF))
    return can.Message(
        arbitration_id=identifier,
        is_extended_id=extended,
        is_remote_frame=remote,
        is_fd=fd,
        bitrate_switch=fd and draw(st.booleans()),
        dlc=length if remote else None,
        data=data,
    )


@given(st.lists(messages(), min_size=1, max_size=20))
def test_python_can_agrees(adapter, sent: list[can.Message]) -> None:
    bus, written = other_end()
    for message in sent:
        slcanBus.send(bus, message)
    frames = heard(adapter, "O\r" + "".join(line + "\r" for line in written))
    for message, line, frame in zip(sent, written, frames, strict=True):
        data = bytes(min(message.dlc, 8)) if message.is_remote_frame else message.data[:8]
        flags = message.is_extended_id * EXTENDED + message.is_remote_frame * REMOTE
        flags += message.is_fd * FD
        words = [f"{message.arbitration_id:X}", str(flags), *(f"{byte:02X}" for byte in data)]
        assert frame.split() == words + ([] if message.is_fd else [line.rstrip("\r")])
