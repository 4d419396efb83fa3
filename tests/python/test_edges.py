# SPDX-License-Identifier: MIT
"""Rare ends of the commands: kernels with and without SocketCAN, programs that hang or are not
there, disks that fill up, files that are not what they should be.
"""

from __future__ import annotations

import subprocess
import sys
from types import SimpleNamespace

import can
import pytest
from dahl import (
    Error,
    RunError,
    bus,
    data,
    paths,
    plan_header,
    scene,
)
from dahl.identify import folder_runs, output, pipeline
from dahl.interrupt import Stop
from identify_tools import caller, synthetic

pytestmark = pytest.mark.usefixtures("library")


@pytest.fixture
def run_dahl(capsys):
    return caller(capsys)


# --- buses ----------------------------------------------------------------------------------------


def test_an_interface_that_fails_while_it_receives_is_one_line():
    def fail(_: float) -> None:
        raise can.CanOperationError("cable out")

    with pytest.raises(RunError, match="the bus has gone: cable out"):
        next(bus.received(SimpleNamespace(recv=fail), Stop()))


def test_error_frames_are_logged_as_candump_does():
    frame = can.Message(is_error_frame=True, arbitration_id=4, data=b"\x01", is_extended_id=False)
    assert bus.candump_line(frame) == "(0000000000.000000) vcan0 20000004#01\n"


@pytest.mark.parametrize(("switch", "passive", "flags"), [(1, 0, 1), (0, 1, 2), (1, 1, 3)])
def test_frames_of_can_fd_are_logged_as_candump_does(switch, passive, flags):
    kind = {"is_fd": True, "bitrate_switch": switch, "error_state_indicator": passive}
    frame = can.Message(arbitration_id=0x123, data=b"\xab", is_extended_id=False, **kind)
    assert bus.candump_line(frame) == f"(0000000000.000000) vcan0 123##{flags}AB\n"


# --- programs -------------------------------------------------------------------------------------


def test_programs_that_are_not_built_are_named(monkeypatch, tmp_path):
    monkeypatch.setenv("DAHL_BUILD_DIR", str(tmp_path))
    monkeypatch.delenv("DAHL_LOOP", raising=False)
    with pytest.raises(RunError, match="dahl-loop is not there; build it"):
        paths.loop_program()


# --- firmware -------------------------------------------------------------------------------------


# --- the command line -----------------------------------------------------------------------------


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


def test_data_of_a_set_in_reach_is_its_folder(run_dahl, monkeypatch, tmp_path):
    (tmp_path / "tribometer").mkdir()
    monkeypatch.setenv("DAHL_DATA", str(tmp_path))
    assert run_dahl("data", "tribometer").stdout == f"{tmp_path / 'tribometer'}\n"
    assert str(tmp_path / "tribometer") in run_dahl("data").stdout
    with pytest.raises(Error, match="no such file in the measured set"):
        data.find_log("tribometer/none.csv", tmp_path)
    (tmp_path / "tribometer" / "there.csv").write_text("x")
    assert data.find_log("tribometer/there.csv", tmp_path).name == "there.csv"


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
