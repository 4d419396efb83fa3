# SPDX-License-Identifier: MIT
"""What a user of the verbs meets now and then: scenes of another editor, folders that moved, files
that are not what they should be, programs that hang or are not there, odd frames on a bus.
"""

from __future__ import annotations

import json
import os
import re
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

import can
import numpy as np
import pytest
from dahl import __version__
from log_reading import drawing
from loop_tools import SCENES, program

pytestmark = pytest.mark.usefixtures("library", "dahl_loop")

SEGMENTS = """[scene]
title = Lenkung ä² <b>
[friction]
sigma0 = 50
Fc = 0.5
theta_per_count = 1e-4
[motion]
kind = segments
theta1 = 40
theta2 = -25
theta3 = 30
speed = 300
"""
REPLAY = SEGMENTS.partition("[motion]")[0] + "[motion]\nkind = log\nfile = a.csv\n{}"


def refused(done: subprocess.CompletedProcess, code: int, *facts: str) -> str:
    """One line on standard error, which says this."""
    assert (done.returncode, done.stderr.count("\n")) == (code, 1), done
    assert done.stderr.startswith("error: ")
    assert [fact for fact in facts if fact not in done.stderr] == [], done.stderr
    return done.stderr


# --- scenes ---------------------------------------------------------------------------------------


def test_a_scene_of_any_editor_is_played_and_told_on_the_page(dahl, quick):
    """With a mark of its encoding, lines ended by two characters, and letters beyond ASCII."""
    Path("my.ini").write_text(SEGMENTS.replace("\n", "\r\n"), encoding="utf-8-sig", newline="")
    words = ("--scene", "my.ini", "--seconds", 0.2, "--bus", "socketcand", "--output", "out")
    done = dahl("demo", *words)
    assert done.returncode == 0, done.stderr
    assert json.loads(Path("out/summary.json").read_text())["title"] == "Lenkung ä² <b>"
    assert dahl("report", "out").returncode == 0
    page = Path("out/report.html").read_text(encoding="utf-8")
    assert "<title>Lenkung ä² &lt;b&gt;</title>" in page


def recorded(folder: Path, ticks: int = 30) -> Path:
    """A scene that replays a log with a torque, and the record of its run beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    measured = "[measured]\ntorque = T\nlabel_torque = force [N]\n"
    (folder / "mine.ini").write_text(REPLAY.format("angle = a\ncounts_per_unit = 1\n") + measured)
    rows = "".join(f"{7 * n},{n}\n" for n in range(ticks))
    (folder / "a.csv").write_text("a,T\n" + rows)
    words = ["--scene", folder / "mine.ini", "--virtual", "--log", folder / "run.log"]
    subprocess.run([program(), *words], check=True, timeout=20)
    return folder / "run.log"


BAD_SCENES = [
    (b"[friction]\nsigma0 = \xff\n", ["0xff"]),
    (b"[friction]\nsigma0 = x\n", ["[friction] sigma0", "'x'"]),
    (b"[friction]\ntheta_per_count = fine\n", ["[friction] theta_per_count", "'fine'"]),
    *(
        (f"[friction]\nnode = {node}\n".encode(), ["[friction] node", node, " 0 ", " 15"])
        for node in ("16", "-1", "2.5", "nan")
    ),
    (b"[motor]\nseconds = 2 s\n", ["[motor] seconds", "'2 s'"]),
    (b"[measured]\noffset = 1,5\n", ["[measured] offset", "'1,5'"]),
    (b"[measured]\nsettle = 1.5\n", ["[measured] settle", "'1.5'"]),
    (b"[measured]\nsettle = inf\n", ["[measured] settle", "'inf'"]),
    (b"[measured]\nwheel = 1\n", ["[measured]", "'wheel'"]),
    (b"sigma0 = 1\n", ["section"]),
]


@pytest.mark.parametrize(("text", "facts"), BAD_SCENES)
def test_a_scene_that_cannot_be_read_is_one_line(dahl, text, facts):
    Path("run.log").write_text("")
    path = Path("my.ini")
    path.write_bytes(text)
    refused(dahl("plot", "run.log", "--scene", path.resolve()), 2, f"{path.resolve()}: ", *facts)


@pytest.fixture
def quick():
    """The figures drawn; they are not painted, which takes longest, but put where they go."""
    with drawing(rendered=False) as figures:
        yield figures


def test_a_shipped_scene_is_found_before_a_file_of_its_name(dahl, quick):
    log = recorded(Path("there"))
    Path("segments").write_text(SEGMENTS)
    for name, title in (
        ("segments", "Three segments of the paper"),
        (Path("segments").resolve(), "Lenkung"),
    ):
        assert title in dahl("plot", log, "--scene", name).stdout
    refused(dahl("plot", log, "--scene", "nowhere"), 2, "nowhere")


# --- own logs -------------------------------------------------------------------------------------

OWN = {"--angle": "a", "--sigma0": 40, "--fc": 0.8, "--counts-per-turn": 4096}


def own(log: object, **changed: object) -> list[object]:
    """Words of `dahl demo` for an own log; an option that is None is left out."""
    options = OWN | {f"--{name.replace('_', '-')}": value for name, value in changed.items()}
    words = [word for pair in options.items() if pair[1] is not None for word in pair]
    return ["demo", log, *words, "--bus", "socketcand", "-o", "out"]


@pytest.mark.parametrize(("time_column", "torque"), [(None, None), ("t", "T")])
def test_an_own_log_is_played_and_drawn_again_from_any_folder(
    dahl, quick, monkeypatch, time_column, torque
):
    """With the columns that there are, as its scene names them."""
    angles = 20 * np.sin(np.arange(200) / 30)
    rows = [f"{n / 1000},{5 - n % 7},{angle}" for n, angle in enumerate(angles)]
    Path("logs").mkdir()
    Path("logs/a.csv").write_text("\n".join(["t,T,a", *rows]) + "\n")
    done = dahl(*own("logs/a.csv", time=time_column, torque=torque, torque_scale=torque and -2))
    assert done.returncode == 0, done.stderr
    told = json.loads(Path("out/summary.json").read_text())
    assert (told["ticks"], told["title"]) == (200, "a.csv")
    assert (told.get("r2_measured") is None) == (torque is None)
    out = Path("out").resolve()
    (out / "elsewhere").mkdir()
    monkeypatch.chdir(out / "elsewhere")
    assert "200 ticks, a.csv" in dahl("plot", out).stdout


@pytest.mark.parametrize("column", ["angle", "torque", "time"])
@pytest.mark.parametrize("name", ["a ; b", " a", "a "])
def test_no_column_of_an_own_log_is_taken_for_another(dahl, column, name):
    names = {"angle": "x", "torque": "y", "time": "z", column: name}
    Path("a.csv").write_text(",".join(names.values()) + "\n1,2,3\n")
    refused(dahl(*own("a.csv", **names)), 2, f"'{name}'")


@pytest.mark.parametrize("name", ["a ; b.csv", ";a.csv", " a.csv", "x" * 156 + ".csv"])
def test_a_log_that_no_scene_can_name_is_one_line(dahl, name):
    """Before it is a half of its name, or a line that dahl-loop does not read."""
    Path(name).write_text("a\n1\n2\n")
    refused(dahl(*own(name)), 2, name)


def test_a_log_in_a_folder_that_no_scene_can_hold_is_played(dahl, quick):
    Path("b ;c").mkdir()
    Path("b ;c/a.csv").write_text("a\n1\n2\n")
    assert dahl(*own("b ;c/a.csv")).returncode == 0


def test_a_scene_that_replays_a_log_must_say_which_column(dahl):
    Path("my.ini").write_text(REPLAY.format("counts_per_unit = 1\n"))
    Path("a.csv").write_text("a\n1\n2\n")
    done = dahl("demo", "--scene", "my.ini", "--output", "out")
    refused(done, 2, "my.ini: [motion] angle", "a.csv")


# --- runs that were recorded ----------------------------------------------------------------------


def test_a_record_is_drawn_with_the_log_beside_its_scene(dahl, quick, monkeypatch):
    """Not with one in the folder where the verb runs, nor that of a measured set of its name."""
    log = recorded(Path("there"))
    Path("a.csv").write_text("another\n")
    done = dahl("plot", log, "--scene", "there/mine.ini")
    assert done.stdout == "there/loop.png: 30 ticks, Lenkung ä² <b>\n", done.stderr
    assert Path("there/loop.png").exists()
    monkeypatch.setenv("DAHL_DATA", str(Path("sets").resolve()))
    scene = Path("there/mine.ini")
    for folder, rows in (("sets", 9), ("there", 30)):
        (Path(folder) / "tribometer").mkdir(parents=True)
        text = "a,T\n" + "0,0\n" * rows
        (Path(folder) / "tribometer/b.tsv").write_text(text.replace(",", "\t"))
    scene.write_text(scene.read_text().replace("a.csv", "tribometer/b.tsv"))
    assert dahl("plot", log, "--scene", scene).returncode == 0
    Path("there/tribometer/b.tsv").unlink()
    refused(dahl("plot", log, "--scene", scene), 2, "30", "9")  # that of the set, of fewer rows
    scene.write_text(scene.read_text().replace("tribometer/b.tsv", "c.csv"))
    refused(dahl("plot", log, "--scene", scene), 2, "there/c.csv")


@pytest.mark.parametrize("column", ["torque", "time"])
def test_a_record_of_more_ticks_than_its_log_has_rows_is_one_line(dahl, quick, column):
    """It is of another run, whichever column of the log is drawn."""
    log = recorded(Path("there"))
    wanted = {"torque": "[measured]\ntorque = T\n", "time": "time = T\n"}[column]
    Path("there/mine.ini").write_text(REPLAY.format("angle = a\n") + wanted)
    words = ("plot", log, "--scene", "there/mine.ini")
    assert dahl(*words).returncode == 0
    Path("there/loop.png").unlink()
    rows = Path("there/a.csv").read_text().splitlines()
    Path("there/a.csv").write_text("\n".join(rows[:-1]) + "\n")
    refused(dahl(*words), 2, "there/run.log", "30", "a.csv", "29")
    assert not Path("there/loop.png").exists()


def test_a_run_remembers_its_log(dahl, quick):
    """The log of the summary is the run's, also where the scene's own is gone or the folder has
    moved; of another scene neither log nor fit is.
    """
    recorded(Path("there"))
    Path("there/other.ini").write_text(Path("there/mine.ini").read_text().replace("a.csv", "b.csv"))
    rows = Path("there/a.csv").read_text().splitlines()
    Path("there/b.csv").write_text("\n".join([rows[0], *(f"{row}000" for row in rows[1:])]))
    Path("there/a.csv").rename("moved.csv")
    known = {"scene_file": "gone/mine.ini", "log": str(Path("moved.csv").resolve())}
    Path("there/summary.json").write_text(json.dumps(known | {"r2_measured": 0.99}))
    scenes = [("--scene", name) for name in ("there/mine.ini", "there/other.ini", "segments")]
    for words in (("-o", "x.png"), *scenes):
        assert ": 30 ticks" in dahl("plot", "there", *words).stdout, words
    fits = [re.findall("R².*", figure.axes[0].get_title(loc="left")) for figure in quick]
    own_fit, same, other, none = fits
    assert own_fit == same != other and other and none == []
    assert not any("0.99" in words for found in fits for words in found)
    Path("there/another.log").write_bytes(Path("there/run.log").read_bytes())
    refused(dahl("plot", "there/another.log"), 2, "there/another.log", "--scene")
    Path("there/summary.json").unlink()
    refused(dahl("plot", "there"), 2, "there/run.log", "--scene")


@pytest.mark.parametrize("bad", [1, 2, 40])
def test_a_bad_line_of_a_candump_log_is_named_by_its_number(dahl, bad):
    lines = ["(1.000000) can0 123#R8"] * 40
    lines[bad - 1] = "(1.000000) can0 123#0"
    Path("x.log").write_text("\n".join(lines) + "\n")
    refused(dahl("plot", "x.log", "--scene", "segments"), 2, f"x.log:{bad}: ", "123#0")


def test_a_broken_mf4_is_one_line_also_when_the_program_ends(run_dahl, tmp_path):
    """Its reader, left half made, has nothing to say when it is collected."""
    whole, cut = tmp_path / "whole.mf4", tmp_path / "cut.mf4"
    with can.Logger(whole) as log:
        for n in range(50):
            log.on_message_received(can.Message(timestamp=n / 1000, arbitration_id=n, data=b"1"))
    cut.write_bytes(whole.read_bytes()[:1000])
    done = run_dahl("plot", cut, "--scene", "segments", "-o", tmp_path / "x.png")
    refused(done, 2, f"{cut}: ", " 0 frames")


# --- clients of a bus -----------------------------------------------------------------------------


def sending(channel: str, *messages: can.Message) -> threading.Thread:
    """Frames on a virtual bus, half a second from now, with a pause after the first."""

    def send() -> None:
        with can.Bus(interface="virtual", channel=channel) as bus:
            time.sleep(0.5)
            for message in messages:
                bus.send(message)
                time.sleep(0.1)

    thread = threading.Thread(target=send)
    thread.start()
    return thread


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
    """No seam brings these frames into a demo without a kernel that has CAN."""
    from dahl.bus import candump_line

    message.timestamp = 1234567890.5
    for channel, name in ((None, "vcan0"), (3, "vcan0"), ("can1", "can1")):
        message.channel = channel
        assert candump_line(message) == f"(1234567890.500000) {name} {end}\n"


def test_a_record_starts_anew_and_ends_after_the_frames_that_came(dahl):
    """What was there goes with the first frame; nothing is added to it; pauses are no frames."""
    Path("x.log").write_text("(0000000001.000000) old 100#00\n" * 9)
    sender = sending("here", *(message for message, _ in KINDS), KINDS[0][0])
    words = ("record", "-i", "virtual", "-c", "here", "-o", "x.log")
    refused(dahl(*words), 2, "x.log", "--force")
    done = dahl(*words, "--force", "--frames", len(KINDS), "--seconds", 600)
    sender.join()
    assert (done.returncode, done.stderr) == (0, "") and "4 frames in x.log" in done.stdout
    lines = [line.split() for line in Path("x.log").read_text().splitlines()]
    assert [words[2] for words in lines] == [end for _, end in KINDS]
    assert all(float(words[0].strip("()")) > 1e9 for words in lines)


def test_a_client_ends_after_its_seconds_without_a_frame(dahl):
    begun = time.monotonic()
    words = ("record", "-i", "virtual", "-c", "x", "-o", "x.log", "--frames", 9)
    done = dahl(*words, "--seconds", 0.7)
    assert 0.6 < time.monotonic() - begun < 3
    refused(done, 1, "interface=virtual channel=x", "0.7")


def test_a_bus_description_that_is_not_there_or_another_is_one_line(dahl):
    words = ("monitor", "-i", "virtual", "-c", "x", "--dbc")
    refused(dahl(*words, "none.dbc"), 2, "none.dbc: No such file or directory")
    Path("other.dbc").write_text('VERSION ""\nBU_: A\nBO_ 256 Other: 8 A\n')
    refused(dahl(*words, "other.dbc"), 2, "other.dbc: ", "'Count'", "'EncoderState'")


def test_the_best_bus_there_is_or_the_one_asked_for(dahl, monkeypatch, tmp_path):
    """No seam reaches a kernel's interfaces: what is asked of it is set here."""
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
    refused_ones = "vcan0 socketcan socketcan: socketcan:a/b socketcan:a:b socketcand:x"
    for asked in [*refused_ones.split(), "socketcand:1:2", "socketcan:a b"]:
        refused(dahl("demo", "--bus", asked), 2, f"--bus {asked}: ")


# --- programs and places --------------------------------------------------------------------------


@pytest.fixture
def loop_is(monkeypatch, tmp_path):
    """A script in place of dahl-loop; $LOOP is the real one."""

    def set_up(script: str) -> Path:
        path = tmp_path / "loop"
        path.write_text(f"#!/bin/sh\nLOOP={program()}\n{script}\n")
        path.chmod(0o755)
        monkeypatch.setenv("DAHL_LOOP", str(path))
        return path

    return set_up


DEMO = ("demo", "--bus", "socketcand", "--output", "out")


def test_a_library_that_the_system_lacks_is_named(dahl, dahl_loop, loop_is):
    """A dahl-loop that asks for one that is nowhere, as its loader finds it."""
    path = loop_is("")
    path.write_bytes(dahl_loop.read_bytes().replace(b"libinih.so.1", b"libnone.so.1"))
    done = dahl(*DEMO, "--scene", "segments")
    refused(done, 1, "libnone.so.1", "apt-get install", "libinih1", "libcsv3", "libcjson1")


def test_a_target_runs_dahls_model_alone_on_a_core_that_is_known(dahl):
    words = ("demo", "--scene", "own.ini", "--target")
    sections = ("[faults]\ndrop = 0.1", "")
    for key in ("model = slip", "gain = 0.9", "limit = 0.9", "ramp_ms = 1", sections[0]):
        text = SEGMENTS.replace("[friction]\n", "[friction]\nmax_step = 9\n")
        in_section = key.startswith("[")
        text = f"{text}\n{key}" if in_section else text.replace("max_step = 9", key)
        Path("own.ini").write_text(text)
        refused(dahl(*words, "m4f"), 2, "--target", "own.ini")
    Path("own.ini").write_text(SEGMENTS)
    refused(dahl(*words, "m9"), 2, "--target m9", "m4f")


def test_qemu_gets_image_and_parameters_and_its_complaint_is_told(monkeypatch, tmp_path):
    """A class that docs/python.md does not name: without it an image has to be cross-compiled."""
    from dahl import RunError
    from dahl.sim import firmware

    (tmp_path / "qemu-system-arm").write_text('#!/bin/sh\necho "qemu: $*" >&2\nexit 1\n')
    (tmp_path / "qemu-system-arm").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    (folder := tmp_path / "a,b").mkdir()  # a comma is doubled in a value of an option
    node = firmware.Firmware("m4f", (100.0, 0.5, 0.25), folder, 3, 7000, folder / "image")
    page = struct.unpack("<I3f2I", node.page.read_bytes())
    assert page == (int.from_bytes(b"DAHL", "little"), 100.0, 0.5, 0.25, 3, 7000)
    begun = time.monotonic()
    with pytest.raises(RunError, match="qemu: ") as caught, node:
        pass
    assert time.monotonic() - begun < 5  # what has ended is not waited for
    board = firmware.boards()["m4f"]
    for words in (
        f"-M {board.machine} ",
        "-display none -monitor none -serial tcp:127.0.0.1:",
        f"-kernel {folder}/image",
        f"-device loader,file={str(node.page).replace(',', ',,')},addr={board.page:#x},",
    ):
        assert words in str(caught.value)


PLAN = ("plan", "--sigma0", "1", "--fc", "1", "--theta-per-count", "1", "-o", "x.h")


@pytest.mark.parametrize(
    ("variable", "named", "words"),
    [
        ("DAHL_LIBRARY", "none.so", PLAN),
        ("DAHL_BUILD_DIR", "lib/libdahl.so", PLAN),
        ("DAHL_BUILD_DIR", "dahl-loop", ("demo", "--scene", "segments")),
    ],
)
def test_what_is_not_built_is_named(run_dahl, tmp_path, variable, named, words):
    left = {k: v for k, v in os.environ.items() if k not in ("DAHL_LIBRARY", "DAHL_LOOP")}
    left |= {"DAHL_LIBRARY": "", variable: str(tmp_path / ("none.so" * (variable[-1] == "Y")))}
    if named == "dahl-loop":
        left["DAHL_LIBRARY"] = os.environ["DAHL_LIBRARY"]
    left["PYTHONPATH"] = str(SCENES.parents[1] / "tools")
    refused(run_dahl(*words, env=left, cwd=tmp_path), 1, f"{tmp_path}/", named, "build")


@pytest.mark.parametrize("mode", [0o600, 0o664, 0o755])
def test_a_file_that_is_replaced_keeps_its_mode(dahl, mode):
    """Behind a link, which stays one; a loop of links is one line."""
    assert dahl(*PLAN).returncode == 0
    whole = Path("x.h").read_text()
    Path("x.h").rename("real.h")
    Path("x.h").symlink_to("real.h")
    Path("real.h").write_text(whole + "\n")
    Path("real.h").chmod(mode)
    assert dahl(*PLAN).returncode == 0
    assert (Path("real.h").read_text(), Path("x.h").is_symlink()) == (whole, True)
    assert Path("real.h").stat().st_mode & 0o777 == mode
    Path("x.h").unlink()
    Path("x.h").symlink_to("x.h")
    refused(dahl(*PLAN), 1, "x.h: Too many levels of symbolic links")
    assert Path("x.h").is_symlink()


def test_a_page_of_what_is_not_there_is_one_line(dahl):
    refused(dahl("report", "."), 2, "summary.json")
    Path("summary.json").write_text('{"scene_file": "x"}')
    Path("loop.png").mkdir()
    refused(dahl("report", "."), 2, "loop.png: Is a directory")


def test_the_version_is_said(dahl):
    assert dahl("--version").stdout == f"dahl {__version__}\n"


def test_not_enough_memory_is_one_line(root):
    """Where a log of a gigabyte has to be held in a quarter of it."""
    code = (
        "import resource, sys, numpy; from dahl.cli import main; from dahl.commands import data;"
        "resource.setrlimit(resource.RLIMIT_AS, (1 << 31, 1 << 31));"
        "data.run = lambda _: numpy.ones(1 << 30); sys.exit(main(['data']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=root
    )
    assert re.fullmatch(r"error: [^\n]*memory[^\n]*\n", done.stderr) and done.returncode == 1
