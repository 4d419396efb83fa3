# SPDX-License-Identifier: MIT
"""dahl.can.bus: the choice of a bus, the form of a line of run.log, and a reader that was stopped.
Then the command line of the emulator.
"""

import contextlib
import errno
import logging
import os
import signal
import struct
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import can
import pytest
from dahl import RunError, bus
from dahl.io import candump
from dahl.target import firmware
from hypothesis import given
from hypothesis import strategies as st
from identify_tools import complaint

PLAIN = {"is_extended_id": False}
FD = PLAIN | {"is_fd": True}
LINES = [  # a frame, and the end of the line that candump would write
    ({"arbitration_id": 0x123, "data": b"\xab", **PLAIN}, "123#AB"),
    ({"arbitration_id": 0x123, "data": b"\xab"}, "00000123#AB"),
    ({"arbitration_id": 1, "data": b"\2", **FD}, "001##002"),
    ({"arbitration_id": 1, "data": b"", "bitrate_switch": True, **FD}, "001##1"),
    ({"arbitration_id": 1, "data": b"\2", "error_state_indicator": True, **FD}, "001##202"),
    ({"arbitration_id": 4, "data": b"\1", "is_error_frame": True}, "20000004#01"),
    ({"arbitration_id": 5, "is_remote_frame": True, "dlc": 8, **PLAIN}, "005#R8"),
    ({"arbitration_id": 5, "is_remote_frame": True, "dlc": 0, **PLAIN}, "005#R"),
]


@pytest.mark.parametrize(("frame", "end"), LINES)
def test_a_line_of_run_log_is_as_candump_writes_it(frame, end):
    """Without a kernel that has CAN, a demo sees few of these frames: the function is called."""
    message = can.Message(timestamp=1234567890.5, **frame)
    for channel, name in ((None, "vcan0"), (3, "can3"), ("can1", "can1"), ("a rig", "a_rig")):
        message.channel = channel
        assert bus.candump_line(message) == f"(1234567890.500000) {name} {end}\n"


FRAME = st.builds(
    lambda kind, number, is_long, data, dlc, brs, esi, is_rx, time: can.Message(
        timestamp=time / 1e6,
        arbitration_id=number % (2**29 if is_long or kind == "is_error_frame" else 2**11),
        is_extended_id=is_long or kind == "is_error_frame",
        data=None if kind == "is_remote_frame" else data[: 64 if kind == "is_fd" else 8],
        dlc=dlc if kind == "is_remote_frame" else None,
        bitrate_switch=brs and kind == "is_fd",
        error_state_indicator=esi and kind == "is_fd",
        is_rx=is_rx,
        channel="can7",
        **({kind: True} if kind else {}),
    ),
    st.sampled_from(["", "is_fd", "is_remote_frame", "is_error_frame"]),
    st.integers(0, 2**29 - 1),
    st.booleans(),
    st.sampled_from([0, 1, 7, 8, 12, 64]).flatmap(lambda n: st.binary(min_size=n, max_size=n)),
    st.integers(0, 8),
    *[st.booleans()] * 3,
    st.integers(0, 4 * 10**15),
)


@given(FRAME, st.sampled_from(["", "_9", "_f"]))
def test_a_frame_is_read_from_its_line_as_it_was(frame, dlc):
    """Also with the length code that candump adds to a classic frame of 8 bytes."""
    line = candump.candump_line(frame, with_direction=True)
    back = candump.message_of(line)
    assert back.equals(frame, timestamp_delta=1e-6, check_direction=True), line
    if frame.dlc == 8 and not frame.is_fd:
        head, _, direction = line.rpartition(" ")
        assert candump.message_of(f"{head}{dlc} {direction}").equals(back, timestamp_delta=0)


@pytest.mark.parametrize(
    "line",
    [
        *("", "(1.0) can0", "(1) can0 100#00", "(1.0) can0 800#00", "(1.0) can0 100#0", "x"),
        *("(1.0) can0 40000000#00", "(1.0) can0 0100#00", "(1.0) can0 100#R9", "(1.0) can0 100#RA"),
        *("(1.0) can0 100##G", "(1.0) can0 100##", "(-1.0) can0 100#00", "(1.0) can0 100#00 X"),
        "(1.0) can0 100#" + "00" * 9,
        "(1.0) can0 100##0" + "00" * 65,
        "(1.0) can0 00123#80:00:11223344#00",  # CAN XL
    ],
)
def test_another_line_is_no_frame(line):
    assert candump.message_of(line) is None


def test_a_vcan0_that_is_up_is_chosen_unless_another_bus_is_named(monkeypatch, tmp_path):
    monkeypatch.setattr(bus, "Path", lambda path: tmp_path / path.lstrip("/"))
    monkeypatch.setattr(bus.shutil, "which", lambda _: None)
    (folder := tmp_path / "sys/class/net/vcan0").mkdir(parents=True)
    for kernel, flags, best in ((1, "0x1003", 1), (1, "0x80", 0), (1, "0xc1", 1), (0, "0xc1", 0)):
        monkeypatch.setattr(bus, "has_socketcan", lambda kernel=kernel: kernel)
        (folder / "flags").write_text(f"{flags}\n")
        assert bus.choose(None)[0] == ("socketcan:vcan0" if best else "socketcand"), flags
    for asked in ("socketcand", "socketcand:29536", "socketcan:can1", "socketcan:can-le.ft"):
        assert bus.choose(asked)[0] == asked


def test_a_kernel_without_can_is_seen(monkeypatch):
    def refuse(*_: object) -> None:
        raise OSError(97, "Address family not supported by protocol")

    monkeypatch.setattr(bus.socket, "socket", refuse)
    assert not bus.has_socketcan()


def test_vcan0_is_made_if_it_is_absent(monkeypatch):
    made: list[str] = []
    monkeypatch.setattr(bus, "Path", lambda path: Path("nowhere") / path.lstrip("/"))
    monkeypatch.setattr(bus.shutil, "which", lambda name: name)
    monkeypatch.setattr(bus.subprocess, "run", lambda words, **_: made.append(" ".join(words)))
    assert not bus.vcan_is_up()
    assert made == ["ip link add dev vcan0 type vcan", "ip link set vcan0 up"]


@pytest.mark.parametrize(
    ("interface", "number", "words"),
    [
        ("socketcan", errno.EAFNOSUPPORT, ["-i socketcand", "tools/vm.sh"]),
        ("socketcan", errno.EPROTONOSUPPORT, ["-i socketcand", "tools/vm.sh"]),
        ("socketcan", errno.ENODEV, ["-i socketcand", "type vcan"]),
        ("socketcan", errno.EPERM, []),
        ("slcan", errno.ENODEV, []),
    ],
)
def test_a_missing_socketcan_names_the_way_out(monkeypatch, dahl, interface, number, words):
    def refuse(**_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(can, "Bus", refuse)
    code, line = complaint(dahl("monitor", "-i", interface, "-c", "can9"))
    assert code == 1 and "can9" in line and os.strerror(number) in line
    assert [word for word in ("-i socketcand", "tools/vm.sh", "type vcan") if word in line] == words


def test_a_bus_that_is_not_ready_is_tried_again(monkeypatch):
    tries = iter([OSError("not yet"), OSError("not yet"), "open"])

    def try_once(**_: object) -> object:
        if isinstance(found := next(tries), OSError):
            raise found
        return found

    monkeypatch.setattr(can, "Bus", try_once)
    with pytest.raises(RunError, match="not yet"):
        bus.open_bus()
    assert bus.open_bus(60) == "open"


class Stopped:
    """A bus with a frame each ms by its own clock. The process stops at 0.2 s for 2 s."""

    def __init__(self, last: int, at_stop: Callable[[], None], at_end: Callable[[], None]) -> None:
        self.now_s, self.frames, self.last = 0.0, 0, last
        self.at_stop, self.at_end = at_stop, at_end

    def recv(self, seconds: float) -> can.Message | None:
        arrival = self.frames / 1000
        if arrival > self.now_s + seconds or self.frames == self.last:
            self.now_s += seconds
            if self.frames == self.last:
                self.at_end()
            return None
        self.now_s = max(self.now_s, arrival)
        self.frames += 1
        if self.frames == 200:
            self.now_s += 2
            self.at_stop()
        return can.Message(timestamp=arrival, arbitration_id=0x7FF, is_extended_id=False)


@pytest.fixture
def stopped(dahl, monkeypatch):
    def run(verb: str, *words: object, last=10**9, at_stop=lambda: None, at_end=lambda: None):
        link = Stopped(last, at_stop, at_end)
        monkeypatch.setattr(bus, "time", SimpleNamespace(monotonic=lambda: link.now_s))
        monkeypatch.setattr(can, "Bus", lambda **_: contextlib.nullcontext(link))
        return dahl(verb, "-i", "virtual", "-c", "x", *words)

    return run


@pytest.mark.parametrize(
    ("words", "at_stop", "frames"),
    [
        (("--seconds", 1), lambda: None, 1000),
        ((), lambda: os.kill(os.getpid(), signal.SIGINT), 2200),  # all that came meanwhile
    ],
)
def test_a_recorder_that_was_stopped_records_the_frames_before_its_end(
    stopped, words, at_stop, frames
):
    done = stopped("record", *words, "-o", "run.log", at_stop=at_stop)
    held = [round(frame.timestamp * 1000) for frame in can.LogReader("run.log")]
    assert held == [*range(len(held))] and len(held) in (frames, frames + 1)
    assert (done.returncode, done.stdout) == (0, f"{len(held)} frames in run.log\n")


def test_ctrl_c_is_the_usual_end_of_the_monitor(stopped):
    done = stopped("monitor", at_stop=lambda: os.kill(os.getpid(), signal.SIGINT))
    assert (done.returncode, done.stderr) == (0, "") and "other frames  2200" in done.stdout


def test_a_recorder_that_loses_its_bus_reports_its_delay(stopped):
    def lose() -> None:
        raise can.CanOperationError("cable out")

    done = stopped("record", "-o", "run.log", last=201, at_end=lose)
    late = "the bus has gone: cable out, and reading was up to 2.0 s late"
    assert (complaint(done), done.stdout) == ((1, late), "201 frames in run.log\n")
    assert complaint(stopped("monitor", last=201, at_end=lose)) == (1, late)


def test_a_slow_reader_is_told_that_its_server_has_dropped_it(stopped, monkeypatch):
    """The end of the connection is seen only after all frames that it still held."""

    def hang_up() -> None:
        monkeypatch.setattr(bus, "_hung_up", lambda _: True)

    for verb in (("monitor",), ("record", "-o", "run.log")):
        monkeypatch.setattr(bus, "_hung_up", lambda _: False)
        code, said = complaint(stopped(*verb, last=201, at_end=hang_up))
        assert code == 1 and "closed the connection" in said
        assert "2.0 s late" in said and "slow" in said


@pytest.mark.parametrize(
    ("words", "last", "now_s", "most_s"),
    [
        (("--frames", 3000), 10**9, "0.0", "2.0"),
        (("--frames", 201), 10**9, "2.0", "2.0"),
        (("--seconds", 9), 201, "0.0", "2.0"),  # the bus is silent after the stop
        (("--frames", 100), 10**9, "0.0", "0.0"),
    ],
)
def test_the_monitor_shows_how_far_it_was_behind(stopped, words, last, now_s, most_s):
    logging.getLogger("can").setLevel(logging.NOTSET)
    done = stopped("monitor", *words, last=last)
    assert f"behind  {now_s} s, at most {most_s} s" in done.stdout and done.returncode == 0
    assert not logging.getLogger("can").isEnabledFor(logging.WARNING)  # of split frames


def test_the_emulator_gets_image_and_parameters_and_its_error_is_passed_on(monkeypatch, tmp_path):
    (tmp_path / "qemu-system-arm").write_text('#!/bin/sh\necho "qemu: $*" >&2\nexit 1\n')
    (tmp_path / "qemu-system-arm").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    monkeypatch.setattr(firmware, "QEMU_START_TIMEOUT_S", 3600)  # it does not wait if QEMU ends
    (folder := tmp_path / "a,b").mkdir()  # QEMU wants a comma doubled
    node = firmware.Firmware("m4f", (100.0, 0.5, 0.25), folder, 3, 7000, folder / "image")
    page = struct.unpack("<I3f2I", node.page.read_bytes())
    assert page == (int.from_bytes(b"DAHL", "little"), 100.0, 0.5, 0.25, 3, 7000)
    with pytest.raises(RunError, match="qemu: ") as caught, node:
        pass
    for words in (
        f"-M {node.machine} ",
        "-display none -monitor none -serial tcp:127.0.0.1:",
        f"-kernel {folder}/image",
        f"-device loader,file={str(node.page).replace(',', ',,')},addr={node.page_address:#x},",
    ):
        assert words in str(caught.value)
