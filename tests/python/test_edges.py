# SPDX-License-Identifier: MIT
"""Rare ends of the commands: kernels with and without SocketCAN, programs that hang or are not
there, disks that fill up, files that are not what they should be.
"""

from __future__ import annotations

import os
import struct
import subprocess
import sys
import time

import can
import pytest
from dahl import Error, RunError, __version__, bus, commands, firmware, paths, plan_header, scene
from dahl.identify import folder_runs, output, pipeline
from identify_tools import synthetic

pytestmark = pytest.mark.usefixtures("library")


# --- buses ----------------------------------------------------------------------------------------


def test_error_frames_are_logged_as_candump_does():
    frame = can.Message(is_error_frame=True, arbitration_id=4, data=b"\x01", is_extended_id=False)
    assert bus.candump_line(frame) == "(0000000000.000000) vcan0 20000004#01\n"


@pytest.mark.parametrize(("switch", "passive", "flags"), [(1, 0, 1), (0, 1, 2), (1, 1, 3)])
def test_frames_of_can_fd_are_logged_as_candump_does(switch, passive, flags):
    kind = {"is_fd": True, "bitrate_switch": switch, "error_state_indicator": passive}
    frame = can.Message(arbitration_id=0x123, data=b"\xab", is_extended_id=False, **kind)
    assert bus.candump_line(frame) == f"(0000000000.000000) vcan0 123##{flags}AB\n"


@pytest.mark.parametrize(
    ("flags", "up"), [("0x1003", True), ("0x80", False), ("0xc1", True), (None, False)]
)
def test_an_interface_that_is_there_may_be_down(monkeypatch, tmp_path, flags, up):
    """As ip link has it: 1 of its flags. Nothing is made here."""
    monkeypatch.setattr(bus, "Path", lambda path: tmp_path / path.lstrip("/"))
    monkeypatch.setattr(bus.shutil, "which", lambda _: None)
    folder = tmp_path / "sys/class/net/vcan7"
    folder.mkdir(parents=True)
    if flags:
        (folder / "flags").write_text(f"{flags}\n")
    assert bus.vcan_is_up("vcan7") == up


def test_an_interface_that_is_not_there_is_made_and_set_up(monkeypatch, tmp_path):
    monkeypatch.setattr(bus, "Path", lambda path: tmp_path / path.lstrip("/"))
    net = tmp_path / "sys/class/net"
    (tmp_path / "ip").write_text(
        f'#!/bin/sh\ncase "$*" in\n"link add dev vcan7 type vcan") mkdir -p {net}/vcan7;'
        f" echo 0x80 >{net}/vcan7/flags;;\n"
        f'"link set vcan7 up") echo 0xc1 >{net}/vcan7/flags;;\nesac\n'
    )
    (tmp_path / "ip").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    assert bus.vcan_is_up("vcan7")


def test_a_bus_that_opens_late_is_waited_for(monkeypatch):
    tries = []

    def late(**settings: object) -> str:
        tries.append(settings)
        if len(tries) < 3:
            raise OSError("not yet")
        return "the bus"

    monkeypatch.setattr(can, "Bus", late)
    assert bus.open_bus(5.0, interface="virtual", channel="x") == "the bus"
    assert tries == [{"interface": "virtual", "channel": "x"}] * 3
    tries.clear()
    with pytest.raises(RunError, match=r"\(interface=virtual channel=x\): not yet"):
        bus.open_bus(interface="virtual", channel="x")
    assert len(tries) == 1


@pytest.mark.parametrize(
    ("wanted", "kernel", "up", "chosen"),
    [
        (None, True, True, "socketcan:vcan0"),
        (None, True, False, "socketcand"),
        (None, False, True, "socketcand"),
        ("socketcand", True, True, "socketcand"),
        ("socketcand:29536", True, True, "socketcand:29536"),
        ("socketcan:can1", False, False, "socketcan:can1"),
        ("socketcan:can0.1", True, True, "socketcan:can0.1"),
        ("socketcan:can-left", True, True, "socketcan:can-left"),
    ],
)
def test_the_best_bus_there_is_or_the_one_asked_for(monkeypatch, wanted, kernel, up, chosen):
    monkeypatch.setattr(bus, "has_socketcan", lambda: kernel)
    monkeypatch.setattr(bus, "vcan_is_up", lambda: up)
    assert bus.choose(wanted)[0] == chosen
    refused = ("vcan0", "socketcan", "socketcan:", "socketcan:a/b", "socketcan:a b")
    for wrong in (*refused, "socketcan:a:b", "socketcand:x", "socketcand:1:2"):
        with pytest.raises(Error, match=f"--bus {wrong}: socketcan:INTERFACE, socketcand or"):
            bus.choose(wrong)


# --- programs -------------------------------------------------------------------------------------


def test_programs_that_are_not_built_are_named(monkeypatch, tmp_path):
    monkeypatch.setenv("DAHL_BUILD_DIR", str(tmp_path))
    monkeypatch.delenv("DAHL_LOOP", raising=False)
    with pytest.raises(RunError, match="dahl-loop is not there; build it"):
        paths.loop_program()


# --- firmware -------------------------------------------------------------------------------------


def test_qemu_gets_image_and_parameters_and_its_complaint_is_told(monkeypatch, tmp_path):
    (tmp_path / "qemu-system-arm").write_text('#!/bin/sh\necho "qemu: $*" >&2\nexit 1\n')
    (tmp_path / "qemu-system-arm").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    node = firmware.Firmware("m4f", (100.0, 0.5, 0.25), tmp_path, 3, 7000, tmp_path / "image")
    page = struct.unpack("<I3f2I", node.page.read_bytes())
    assert page == (int.from_bytes(b"DAHL", "little"), 100.0, 0.5, 0.25, 3, 7000)
    begun = time.monotonic()
    with pytest.raises(RunError, match="QEMU did not start: qemu: ") as caught, node:
        pass
    assert time.monotonic() - begun < firmware.PATIENCE / 2  # what has ended is not waited for
    board = firmware.boards()["m4f"]
    loader = f"loader,file={node.page},addr={board.page:#x},force-raw=on"
    quiet = "-display none -monitor none -serial tcp:127.0.0.1:"
    for words in (f"-M {board.machine} {quiet}", f"-kernel {tmp_path}/image", f"-device {loader}"):
        assert words in str(caught.value)


def test_a_folder_with_a_comma_is_one_value_of_an_option_of_qemu(monkeypatch, tmp_path):
    (tmp_path / "qemu-system-arm").write_text('#!/bin/sh\necho "qemu: $*" >&2\nexit 1\n')
    (tmp_path / "qemu-system-arm").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    folder = tmp_path / "a,b,c"
    folder.mkdir()
    node = firmware.Firmware("m4f", None, folder, image=folder / "image")
    with pytest.raises(RunError) as caught, node:
        pass
    assert f"loader,file={tmp_path}/a,,b,,c/params.m4f.bin,addr=" in str(caught.value)
    assert f"-kernel {folder}/image" in str(caught.value)  # a word of its own is taken as it is


# --- the command line -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fault", "code", "words"),
    [
        (MemoryError(), 1, "not enough memory"),
        (PermissionError(13, "Permission denied", "a.csv"), 1, "a.csv: Permission denied"),
        (RunError("gone"), 1, "gone"),
        (Error("odd"), 2, "odd"),
    ],
)
def test_what_goes_wrong_has_its_code(dahl_here, monkeypatch, fault, code, words):
    def fail(_: object) -> None:
        raise fault

    monkeypatch.setattr(commands.data, "run", fail)
    done = dahl_here("data")
    assert (done.returncode, done.stderr) == (code, f"error: {words}\n")


def test_the_version_is_said(dahl_here):
    assert dahl_here("--version").stdout == f"dahl {__version__}\n"


def test_a_reader_that_stops_early_is_no_error(root):
    """`dahl data | head -0`: the pipe is closed before anything is written."""
    code = "import sys, time; time.sleep(1); from dahl.cli import main; sys.exit(main(['data']))"
    with subprocess.Popen(
        [sys.executable, "-u", "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=root
    ) as process:
        process.stdout.close()
        errors = process.stderr.read()
        process.wait(60)
    assert (process.returncode, errors) == (0, b"")


# --- identification -------------------------------------------------------------------------------


def test_numbers_without_a_log_are_not_identified(tmp_path):
    with pytest.raises(Error, match="no such folder"):
        folder_runs.logs_in(tmp_path / "none")
    (tmp_path / "notes.md").write_text("no log")
    with pytest.raises(Error, match="no logs in it"):
        folder_runs.logs_in(tmp_path)


def test_a_name_without_letters_is_refused():
    with pytest.raises(Error, match="letters, digits and _"):
        plan_header.identifier("--")


def test_a_plan_and_a_scene_of_a_log_without_an_encoder(tmp_path):
    log = synthetic(1, rows=3000, cycles=5)
    log.resolution = 0.0
    result = pipeline.identify([log])
    result.logs[0].resolution = 0.0
    assert "no encoder: this plan is for dahl_step()" in output.header(result, "bare")
    output.write_scene(result, "bare", tmp_path)
    assert scene.read(tmp_path / "bare.ini").theta_per_count > 0
