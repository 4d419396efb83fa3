# SPDX-License-Identifier: MIT
"""Rare ends of the commands: kernels with and without SocketCAN, programs that hang or are not
there, disks that fill up, files that are not what they should be.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import can
import numpy as np
import pytest
from dahl import (
    Error,
    RunError,
    bus,
    cli,
    data,
    firmware,
    loop,
    paths,
    plan_header,
    report,
    scene,
)
from dahl.commands import demo, identify
from dahl.identify import fit, folder_runs, follow, output, pipeline, readers, sweep
from dahl.identify.log import Log
from dahl.interrupt import Stop
from identify_tools import caller, synthetic
from log_writers import DBC

pytestmark = pytest.mark.usefixtures("library")


@pytest.fixture
def run_dahl(capsys):
    return caller(capsys)


# --- buses ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kernel", "up", "kind"),
    [(False, False, "socketcand"), (True, False, "socketcand"), (True, True, "socketcan:vcan0")],
)
def test_the_bus_is_the_best_that_is_there(monkeypatch, kernel, up, kind):
    monkeypatch.setattr(bus, "has_socketcan", lambda: kernel)
    monkeypatch.setattr(bus, "vcan_is_up", lambda: up)
    chosen, why = bus.choose(None)
    assert chosen == kind
    assert "SocketCAN" in why or "vcan0" in why


@pytest.mark.parametrize("refuses", [True, False])
def test_socketcan_is_what_the_kernel_opens(monkeypatch, refuses):
    def opened(*_: int) -> SimpleNamespace:
        if refuses:
            raise OSError(97, "Address family not supported by protocol")
        return SimpleNamespace(close=lambda: None)

    monkeypatch.setattr(bus.socket, "socket", opened)
    assert bus.has_socketcan() is not refuses


@pytest.mark.parametrize(("flags", "up"), [("0x10041\n", True), ("0x80\n", False), ("?", False)])
def test_vcan_is_made_where_we_may_and_seen_when_up(monkeypatch, tmp_path, flags, up):
    """`ip` is played by a program that leaves the flags the kernel would."""
    asked = []

    def made(command: list[str], **_: object) -> None:
        asked.append(command[:3])
        (tmp_path / "flags").write_text(flags)

    monkeypatch.setattr(bus.shutil, "which", lambda _: "ip")
    monkeypatch.setattr(bus.subprocess, "run", made)
    folder = tmp_path / "absent"
    monkeypatch.setattr(
        bus, "Path", lambda path: tmp_path / "flags" if path.endswith("flags") else folder
    )
    assert bus.vcan_is_up() is up
    assert asked == [["ip", "link", "add"], ["ip", "link", "set"]]
    (tmp_path / "flags").unlink()
    monkeypatch.setattr(bus.shutil, "which", lambda _: None)
    assert bus.vcan_is_up() is False


def test_a_bus_is_tried_again_while_there_is_patience(monkeypatch):
    tries = []

    def opened(**_: object) -> str:
        tries.append(1)
        if len(tries) < 3:
            raise OSError("not yet")
        return "a bus"

    monkeypatch.setattr(can, "Bus", opened)
    assert bus.open_bus(10.0, interface="x") == "a bus"


def test_an_interface_that_fails_while_it_receives_is_one_line():
    def fail(_: float) -> None:
        raise can.CanOperationError("cable out")

    with pytest.raises(RunError, match="the bus has gone: cable out"):
        next(bus.received(SimpleNamespace(recv=fail), Stop()))


@pytest.mark.parametrize(
    ("error", "gone"), [(BlockingIOError, False), (OSError, True), (None, True)]
)
def test_a_server_that_hung_up_is_seen_by_its_socket(error, gone):
    def peek(*_: int) -> bytes:
        if error:
            raise error
        return b""

    one = SimpleNamespace(_SocketCanDaemonBus__socket=SimpleNamespace(recv=peek))
    assert bus._hung_up(one) is gone


def test_error_frames_are_logged_as_candump_does():
    frame = can.Message(is_error_frame=True, arbitration_id=4, data=b"\x01", is_extended_id=False)
    assert bus.candump_line(frame) == "(0000000000.000000) vcan0 20000004#01\n"


# --- programs -------------------------------------------------------------------------------------


class Deaf:
    """A process that no signal ends."""

    def __init__(self, code: int | None = None) -> None:
        self.returncode, self.killed = code, False

    def poll(self) -> int | None:
        return self.returncode

    def send_signal(self, _: int) -> None:
        """Not heard."""

    def terminate(self) -> None:
        """Not heard."""

    def kill(self) -> None:
        self.killed, self.returncode = True, -9

    def wait(self, patience: float | None = None) -> int:
        if patience is not None and self.returncode is None:
            raise subprocess.TimeoutExpired("x", patience)
        return self.returncode or 0


def program_of(process: Deaf, folder: Path, said: str = "") -> loop.Program:
    made = loop.Program.__new__(loop.Program)
    made.role, made.summary, made.process = "node", folder / "node.json", process
    made.errors = (folder / "node.err").open("w")
    made.errors.write(said)
    made.errors.flush()
    return made


def test_a_program_that_hears_nothing_is_killed(tmp_path):
    deaf = Deaf()
    program = program_of(deaf, tmp_path)
    assert not program.ends()
    program.end()
    assert deaf.killed
    assert program_of(Deaf(0), tmp_path).ends()


def test_a_program_that_says_no_port_is_named(tmp_path):
    with pytest.raises(RunError, match="did not say which port"):
        program_of(Deaf(0), tmp_path, "hello\n").port()
    with pytest.raises(Error, match="scene: no such key"):
        program_of(Deaf(2), tmp_path, "error: scene: no such key\n").port()


def test_no_frame_for_long_ends_a_run(tmp_path, monkeypatch):
    monkeypatch.setattr(loop, "SILENCE", -1.0)
    monkeypatch.setattr(loop, "received", lambda *_: iter([None]))
    program = program_of(Deaf(), tmp_path)
    with pytest.raises(RunError, match="no frame on the bus"):
        loop._record(None, None, program, program, Stop(), lambda _: None)


def test_a_summary_that_is_no_json_counts_as_none(tmp_path):
    program = program_of(Deaf(0), tmp_path)
    assert program.numbers() == {}
    program.summary.write_text("{")
    assert program.numbers() == {}


def test_programs_that_are_not_built_are_named(monkeypatch, tmp_path):
    monkeypatch.setenv("DAHL_BUILD_DIR", str(tmp_path))
    monkeypatch.delenv("DAHL_LOOP", raising=False)
    with pytest.raises(RunError, match="dahl-loop is not there; build it"):
        paths.loop_program()


def test_the_bus_description_or_header_that_is_gone_is_named(monkeypatch, tmp_path):
    monkeypatch.setattr(paths, "DBC", tmp_path / "gone.dbc")
    monkeypatch.setattr(paths, "ROOT", tmp_path)
    with pytest.raises(RunError, match=r"gone\.dbc: No such file"):
        report.database.__wrapped__()
    with pytest.raises(RunError, match=r"dahl\.h: No such file"):
        plan_header.plan_type.__wrapped__()
    with pytest.raises(RunError, match="no struct dahl_plan_t"):
        plan_header._structure("typedef struct { int x; } other_t;", "dahl_plan_t")


# --- firmware -------------------------------------------------------------------------------------


def test_firmware_that_cannot_be_built_is_one_line(monkeypatch):
    with pytest.raises(Error, match="--target m9: one of m0"):
        firmware.build("m9")
    failed = SimpleNamespace(returncode=1, stderr="first\nno compiler\n", stdout="")
    monkeypatch.setattr(firmware.subprocess, "run", lambda *_, **__: failed)
    with pytest.raises(RunError, match="image for m0 could not be built: no compiler"):
        firmware.build("m0")


def test_absent_tools_of_firmware_are_named(monkeypatch, tmp_path):
    def absent(*_: object, **__: object) -> None:
        raise FileNotFoundError

    monkeypatch.setattr(firmware.subprocess, "run", absent)
    monkeypatch.setattr(firmware.subprocess, "Popen", absent)
    with pytest.raises(RunError, match="cmake is not installed"):
        firmware.build("m0")
    node = firmware.Firmware("m0", None, tmp_path, image=tmp_path / "image")
    with pytest.raises(RunError, match="qemu-system-arm is missing"):
        node.__enter__()
    assert (tmp_path / "params.m0.bin").read_bytes() == bytes(24)


def test_an_emulator_that_ends_at_once_is_quoted(monkeypatch, tmp_path):
    def started(*_: object, stderr, **__: object) -> Deaf:
        stderr.write("loading\nno such machine\n")
        return Deaf(1)

    monkeypatch.setattr(firmware.subprocess, "Popen", started)
    node = firmware.Firmware("m3", (1.0, 1.0, 0.1), tmp_path, image=tmp_path / "image")
    with pytest.raises(RunError, match="QEMU did not start: no such machine"):
        node.__enter__()


def test_an_emulator_that_hears_nothing_is_killed(tmp_path):
    node = firmware.Firmware("m3", None, tmp_path, image=tmp_path / "image")
    node.process = Deaf()
    node.__exit__()
    assert node.process.killed


def test_a_bridge_that_does_not_open_is_named(monkeypatch, tmp_path):
    node = SimpleNamespace(port=1)

    class Running:
        def __init__(self, *_: object) -> None:
            """No emulator."""

        def __enter__(self) -> SimpleNamespace:
            return node

        def __exit__(self, *_: object) -> None:
            """Nothing runs."""

    monkeypatch.setattr(firmware, "Firmware", Running)
    opened = firmware.attached("m3", (1.0, 1.0, 0.1), tmp_path, 1)
    with pytest.raises(RunError, match="bridge from slcan"), opened:
        pytest.fail("it opened")


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


def test_a_fault_of_the_program_itself_is_not_hidden(monkeypatch):
    def fail(_: object) -> None:
        raise OSError("no file is to blame")

    parser = SimpleNamespace(parse_args=lambda _: argparse.Namespace(run=fail))
    monkeypatch.setattr(cli, "build_parser", lambda: parser)
    with pytest.raises(OSError, match="no file is to blame"):
        cli.main([])


def test_ctrl_c_before_anything_runs_is_130(monkeypatch):
    def stop(_: object) -> None:
        raise KeyboardInterrupt

    parser = SimpleNamespace(parse_args=lambda _: argparse.Namespace(run=stop))
    monkeypatch.setattr(cli, "build_parser", lambda: parser)
    assert cli.main([]) == 130


def test_data_of_a_set_in_reach_is_its_folder(run_dahl, monkeypatch, tmp_path):
    (tmp_path / "tribometer").mkdir()
    monkeypatch.setenv("DAHL_DATA", str(tmp_path))
    assert run_dahl("data", "tribometer").stdout == f"{tmp_path / 'tribometer'}\n"
    assert str(tmp_path / "tribometer") in run_dahl("data").stdout
    with pytest.raises(Error, match="no such file in the measured set"):
        data.find_log("tribometer/none.csv", tmp_path)
    (tmp_path / "tribometer" / "there.csv").write_text("x")
    assert data.find_log("tribometer/there.csv", tmp_path).name == "there.csv"


def test_frames_lost_are_noted_under_the_table(monkeypatch, tmp_path, root):
    played = scene.read(scene.find("steering"))
    said = []
    console = SimpleNamespace(print=lambda words, **_: said.append(str(words)))
    numbers = {"bus": "socketcand", "interrupted": False, "frames_lost": 3}
    known = {"r2_measured": None, "rmse_measured": None, "max_error_ulp_Fc": None}
    monkeypatch.setattr(report, "summary", lambda *_: known)
    monkeypatch.setattr("dahl.plots.draw", lambda *_: None)
    trace = SimpleNamespace(row=np.arange(4))
    demo._keep(tmp_path, played, trace, None, numbers, console)
    assert said[-1].startswith("note    3 frames had no answer")


# --- identification -------------------------------------------------------------------------------


def test_a_log_beyond_memory_is_one_line(run_dahl, monkeypatch, tmp_path):
    def full(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(pipeline, "identify", full)
    monkeypatch.setattr(identify, "_readable", lambda *_: ([synthetic(1, rows=100)], []))
    done = run_dahl("identify", tmp_path / "x.csv")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "error: 100 rows do not fit into memory (100 bytes a row)\n"


def test_a_look_too_early_is_no_end(tmp_path):
    (tmp_path / "bus.dbc").write_text(DBC)
    source = readers.Source("Angle", "Torque", dbc=tmp_path / "bus.dbc")
    result, why = follow._look(follow.signals_of(source), source, pipeline.Options())
    assert result is None
    assert "valid frames" in why


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


def test_moves_without_the_travel_of_backlash():
    log = Log("x", np.arange(4.0), np.zeros(4), free_moves=np.array([0.0, 1.0, 0.5, 1.0]))
    assert log.moves_of(slice(1, 3)).tolist() == [1.0, 0.5]
    assert synthetic(1, rows=200).head(500).rows == 200


def test_no_term_where_none_fits(monkeypatch):
    monkeypatch.setattr(fit, "fits_in", lambda *_: False)
    log = synthetic(1, rows=600, cycles=3)
    found = sweep.sweep([log], 8, np.geomspace(20, 500, 8))
    assert fit.choose_terms(found, ["offset"]) == []
