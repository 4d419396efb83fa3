# SPDX-License-Identifier: MIT
"""dahl-loop on a CAN socket, with a socketpair in place of the kernel. A real kernel:
can/test_socketcan.py.
"""

import errno
import os
import re
import signal
import struct
from collections import Counter
from contextlib import ExitStack
from pathlib import Path

import pytest
from can_socket import BUS_OFF, ERROR, EXTENDED, REMOTE, STEERING, build_can_library, frame, joined
from loop_tools import finished, read_log, run, setting


@pytest.fixture(scope="module")
def planted(tmp_path_factory) -> Path:
    return build_can_library(tmp_path_factory.mktemp("can"))


@pytest.fixture
def join(tmp_path, planted):
    """Start dahl-loop on a CAN socket. Returns the program and the bus, closed after the test."""
    with ExitStack() as stack:

        def start(*options, log=True):
            process, bus = joined(tmp_path, planted, *options, log=log)
            return process, stack.enter_context(bus)

        yield start


def test_a_node_answers_angles_and_counts_other_frames(tmp_path, join):
    alone = read_log(run(tmp_path / "alone", STEERING, "--virtual", "--seconds", "0.02").log)
    angles = [f.data for f in alone if f.id == 0x100]
    process, bus = join("--role", "node", "--set", "friction.timeout_ms=60000")
    bus.send(b"short")
    for data, answer in zip(angles, (f.data for f in alone if f.id == 0x110), strict=True):
        bus.send(frame(0x100, data))
        assert frame(0x110, answer) in iter(lambda: bus.recv(100), b"")
    process.send_signal(signal.SIGSTOP)
    for wrong in (
        frame(EXTENDED | 0x100, angles[0]),
        frame(REMOTE | 0x100, angles[0]),
        frame(REMOTE | 0x101, b""),
        struct.pack("=IB3x64s", 0x100, 8, angles[0]),  # struct canfd_frame
        frame(0x123, angles[0]),
        frame(ERROR | BUS_OFF, bytes(8)),
    ):
        bus.send(wrong)
    for number in range(3):  # after bus-off a node is silent for its timeout of 60 s
        bus.send(frame(0x100, angles[number]))
    bus.send(frame(0x130, b"no"))
    process.send_signal(signal.SIGTERM)  # earlier frames are still counted
    process.send_signal(signal.SIGCONT)
    result, data = finished(tmp_path, process), angles[0].hex().upper()
    node, counts = result.summary["node"], result.summary["bus_counts"]
    assert (node["ok"], node["format"], node["ignored"], node["bus_off"]) == (20, 4, 2, 1)
    assert (node["rearm"], node["crc"], node["lost"]) == (3, 0, 0)
    assert (counts["garbage"], counts["error_frames"], counts["dropped"]) == (1, 1, 0)
    text = result.log.read_text()
    assert all(f" can0 {line}\n" in text for line in ("100#R8", "101#R", f"100##0{data}"))


def test_frames_of_can_fd_are_logged_with_their_flags_or_counted(tmp_path, join):
    """A line with 8 of 64 bytes would be that of another frame."""
    process, bus = join("--role", "node", "--seconds", "0.3")
    for flags, size in ((0, 8), (1, 0), (2, 5), (7, 8), (1, 12), (3, 64)):  # 4 marks CAN FD
        bus.send(struct.pack("=IBB2x64s", 0x321, size, flags, bytes(range(64))))
    result = finished(tmp_path, process)
    seen = [line.split()[2] for line in result.log.read_text().splitlines() if "321#" in line]
    eight, five = "0001020304050607", "0001020304"
    assert seen == [f"321##0{eight}", "321##1", f"321##2{five}", f"321##3{eight}"]
    assert result.summary["bus_counts"]["long_fd_frames"] == 2
    assert result.code == 0 and re.match(r"note: --log: 2 .*8 bytes", result.err)


def test_only_the_bus_off_of_error_frames_reaches_the_nodes(tmp_path, join, monkeypatch):
    """CAN_ERR_RESTARTED has the number of an EncoderState. The log has the time stamps of the
    kernel.
    """
    monkeypatch.setenv("CAN_STAMP", "1234567890")
    process, bus = join("--role", "node", "--nodes", "2", "--seconds", "0.3")
    kinds = (0x100, 0x004, 0x100 | BUS_OFF)
    for kind in kinds:
        bus.send(frame(ERROR | kind, bytes(8)))
    bus.send(frame(0x123, bytes(8)))
    result = finished(tmp_path, process)
    assert Counter(result.summary["node"]) == Counter(bus_off=2)
    assert result.summary["bus_counts"]["error_frames"] == 3
    seen = [line for line in result.log.read_text().splitlines() if "can0 2" in line]
    at = "(1234567890.654321) can0"
    assert seen == [f"{at} {ERROR | kind:08X}#{'00' * 8}" for kind in kinds]


def test_in_virtual_time_a_tick_ends_after_the_last_echo(tmp_path, join, monkeypatch):
    """The log is that of the loopback. No echo comes before the loop waits."""
    options = ("--virtual", "--seconds", "0.02")
    alone = read_log(run(tmp_path / "alone", STEERING, *options).log)
    monkeypatch.setenv("CAN_ECHO", "1")
    process, bus = join(*options)
    for wire in iter(lambda: bus.recv(100), b""):
        bus.send(wire)
    result = finished(tmp_path, process)
    assert [(f.id, f.data) for f in read_log(result.log)] == [(f.id, f.data) for f in alone]


KINDS = {
    "encoder": (0x110,),
    "node": (0x100, 0x130, 0x150),
    "both": (0x100, 0x110, 0x130, 0x150),
}
LOOKS = [  # numbers of the nodes, options, with a log, filtered
    (range(1, 3), (), False, True),
    (range(16), (), False, True),
    (range(1, 3), ("--virtual",), False, False),
    (range(1, 3), (), True, False),
]


@pytest.mark.parametrize("role", KINDS)
def test_the_kernel_filters_by_the_identifiers_of_the_role(tmp_path, join, role):
    """Without a filter if a log needs every frame, and in virtual time."""
    for numbers, options, log, filtered in LOOKS:
        words = ("--role", role, "--nodes", len(numbers), "--seconds", "0.02", *options)
        words += ("--set", f"friction.node={numbers[0]}")
        process, bus = join(*words, log=log)
        first = bus.recv(1000)
        finished(tmp_path, process)
        asked = sorted(struct.iter_unpack("=II", first))
        due = sorted((kind | number, 0x7FF) for kind in KINDS[role] for number in numbers)
        assert (asked == due) == filtered, (numbers, options, log)


FILTER, ERR_FILTER, OWN_MSGS, FD_FRAMES = "1245"  # linux/can/raw.h
REFUSALS = [("CAN_REFUSES", option) for option in (FILTER, ERR_FILTER, OWN_MSGS, FD_FRAMES)]
REFUSALS += [("CAN_NONE", str(n)) for n in (errno.EPERM, errno.EACCES, errno.EAFNOSUPPORT)]


@pytest.mark.parametrize(("what", "number"), REFUSALS)
def test_an_error_of_the_kernel_is_reported(tmp_path, join, monkeypatch, what, number):
    monkeypatch.setenv(what, number)
    process, _ = join("--seconds", "0.01", log=False)
    result = finished(tmp_path, process)
    why = os.strerror(errno.EINVAL if what == "CAN_REFUSES" else int(number))
    hinted = (what, number) == ("CAN_REFUSES", FILTER) or number == str(errno.EAFNOSUPPORT)
    assert result.error(1).startswith(f"--bus socketcan:can0: {why}")
    assert (result.summary, "(" in result.err) == ({}, hinted)


def test_extended_and_short_frames_are_sent(tmp_path, join):
    words = [f"faults.{kind}=0.3" for kind in ("extended", "length")]
    sets = setting(*words, "friction.max_step=2000")
    process, bus = join("--role", "encoder", "--seconds", "0.1", *sets)
    sent = list(iter(lambda: bus.recv(100), b""))
    injected = finished(tmp_path, process).summary["faults"]["injected"]
    forms = Counter(struct.unpack("=IB", wire[:5]) for wire in sent)
    short = {form: number for form, number in forms.items() if form[1] < 8}
    assert {identifier for identifier, _ in short} == {0x100} and len(short) > 4
    assert sum(short.values()) == injected["length"] > 10
    assert forms[EXTENDED | 0x100, 8] == injected["extended"] > 10


def test_a_full_queue_is_retried_then_the_frame_is_dropped(tmp_path, join):
    """No node acknowledges. The ticks go on."""
    process, _ = join("--role", "encoder", "--seconds", "0.3")
    result = finished(tmp_path, process)
    counts = result.summary["bus_counts"]
    assert result.summary["ticks"] == result.summary["frames_sent"] == 300
    assert 100 < counts["dropped"] == counts["send_failed"] < 300
    assert counts["retries"] == 5 * counts["dropped"]


RECEIVE = [(errno.ENETDOWN, 1), (errno.ENODEV, 1), (errno.EAGAIN, 0), (errno.ENOBUFS, 0)]


@pytest.mark.parametrize(("error", "gone"), RECEIVE)
def test_a_listener_sees_the_interface_go_down(tmp_path, join, monkeypatch, error, gone):
    """A temporary error does not end the run."""
    monkeypatch.setenv("CAN_RECEIVE_FAILS", str(error))
    process, _ = join("--role", "node", "--seconds", "0.2")
    result = finished(tmp_path, process)
    assert (result.code, result.err.count("\n")) == (gone, gone)
    assert (result.summary["ticks"] < 200) == gone


def test_a_bus_that_goes_away_is_an_error(tmp_path, join):
    process, bus = join("--role", "encoder")
    bus.recv(100)
    bus.close()
    result = finished(tmp_path, process)
    error = result.error(1)
    assert error.startswith("--bus socketcan:can0: ") and f" {result.summary['ticks']} " in error
