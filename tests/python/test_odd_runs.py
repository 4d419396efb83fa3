# SPDX-License-Identifier: MIT
"""What a user of the verbs meets now and then: scenes of another editor, folders that moved, files
that are not what they should be, words that reach a program only by a long way.
"""

from __future__ import annotations

import json
import os
import signal
import sys
from pathlib import Path

import can
import numpy as np
import pytest
from dahl import (
    Error,
    RunError,
    bus,
    by_need,
    cli,
    data,
    files,
    firmware,
    loop,
    paths,
    plots,
    report,
    scene,
)
from dahl.interrupt import Stop
from identify_tools import complaint
from log_writers import DBC
from loop_tools import wait_until
from test_monitor import frames
from test_report import Run

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


# --- scenes ---------------------------------------------------------------------------------------


def test_a_scene_of_any_editor_is_played_and_told_on_the_page(dahl):
    """With a mark of its encoding, lines ended by two characters, and letters beyond ASCII."""
    Path("my.ini").write_text(SEGMENTS.replace("\n", "\r\n"), encoding="utf-8-sig", newline="")
    words = ("--scene", "my.ini", "--seconds", 0.2, "--bus", "socketcand", "--output", "out")
    done = dahl("demo", *words)
    assert done.returncode == 0, done.stderr
    assert json.loads(Path("out/summary.json").read_text())["title"] == "Lenkung ä² <b>"
    assert dahl("report", "out").returncode == 0
    page = Path("out/report.html").read_text(encoding="utf-8")
    assert "<title>Lenkung ä² &lt;b&gt;</title>" in page


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "Is a directory"),
        (b"[friction]\nsigma0 = \xff\n", "can't decode byte 0xff"),
        (b"[friction]\nsigma0 = x\n", "[friction] sigma0 = 'x' is not a number"),
        (b"[friction]\ntheta_per_count = fine\n", "[friction] theta_per_count = 'fine' is not a"),
        (b"[friction]\nnode = 16\n", "[friction] node = 16 is not a whole number from 0 to 15"),
        (b"[friction]\nnode = -1\n", "[friction] node = -1 is not a whole number from 0 to 15"),
        (b"[friction]\nnode = 2.5\n", "[friction] node = 2.5 is not a whole number from 0 to"),
        (b"[friction]\nnode = nan\n", "[friction] node = nan is not a whole number from 0 to"),
        (b"[motor]\nseconds = 2 s\n", "[motor] seconds = '2 s' is not a number"),
        (b"[measured]\noffset = 1,5\n", "[measured] offset = '1,5' is not a number"),
        (b"[measured]\nsettle = 1.5\n", "[measured] settle = '1.5' is not a whole number"),
        (b"[measured]\nsettle = inf\n", "[measured] settle = 'inf' is not a whole number"),
        (b"[measured]\nwheel = 1\n", "[measured] has no key 'wheel'"),
        (b"sigma0 = 1\n", "no section headers"),
    ],
)
def test_a_scene_that_cannot_be_read_is_one_line(tmp_path, text, words):
    path = tmp_path / "my.ini"
    path.mkdir() if text is None else path.write_bytes(text)
    with pytest.raises(Error) as told:
        scene.read(path)
    assert str(told.value).startswith(f"{path}: ") and words in str(told.value)


def test_a_shipped_scene_is_found_before_a_file_of_its_name(dahl):
    Path("segments").write_text(SEGMENTS)
    assert scene.find("segments") == paths.SCENES / "segments.ini"
    assert scene.find(str(Path("segments").resolve())) == Path("segments").resolve()
    with pytest.raises(Error, match="no scene 'nowhere'"):
        scene.find("nowhere")


OWN = {"sigma0": 40.0, "fc": 0.8, "counts_per_turn": 4096.0}


@pytest.mark.parametrize(("time_column", "torque"), [("", ""), ("t", ""), ("", "T"), ("t", "T")])
def test_a_scene_of_an_own_log_has_the_columns_that_there_are(tmp_path, time_column, torque):
    log = tmp_path / "a.csv"
    log.write_text("t,T,a\n0,5,1\n0.5,6,2\n")
    own = scene.OwnLog(log, "a", torque, **OWN, torque_scale=-2.0, time=time_column)
    written = scene.write_own(own, tmp_path / "own.ini")
    found = scene.read_log(written, log)
    assert found.rows == 2
    assert (found.time is None) == (not time_column) and (found.torque is None) == (not torque)
    assert found.time is None or found.time.tolist() == [0, 0.5]
    assert found.torque is None or found.torque.tolist() == [-10, -12]


@pytest.mark.parametrize("changed", ["angle", "torque", "time"])
@pytest.mark.parametrize("name", ["a ; b", " a", "a "])
def test_no_column_of_an_own_log_is_taken_for_another(tmp_path, changed, name):
    columns = {"angle": "x", "torque": "y", "time": "z", changed: name}
    own = scene.OwnLog(Path("x.csv"), **columns, **OWN)
    with pytest.raises(Error, match=f"column '{name}': a scene file cannot hold this name"):
        scene.write_own(own, tmp_path / "own.ini")


def test_a_scene_of_an_own_log_finds_it_from_any_folder(dahl, tmp_path):
    Path("logs").mkdir()
    Path("out").mkdir()
    log = Path("logs/a.csv")
    log.write_text("a\n1\n")
    written = scene.write_own(scene.OwnLog(log, "a", "", **OWN), Path("out/own.ini"))
    assert written.title == "a.csv"
    assert data.find_log(written.log, Path("out")) == tmp_path / log


def test_a_path_that_no_scene_can_hold_is_left_out(tmp_path):
    for folder in (tmp_path / ("x" * 150), tmp_path / "a ;b"):
        own = scene.OwnLog(folder / "a.csv", "a", "", **OWN)
        assert scene.write_own(own, tmp_path / "own.ini").log == "a.csv"


@pytest.mark.parametrize("name", ["a ; b.csv", ";a.csv", " a.csv", "a\n.csv", "x" * 156 + ".csv"])
def test_a_log_that_no_scene_can_name_is_one_line(dahl, name):
    """Before it is a half of its name, or a line that dahl-loop does not read."""
    own = scene.OwnLog(Path(name), "a", "", **OWN)
    with pytest.raises(
        Error, match="(?s)log '.*': a scene file cannot hold this name; rename the log"
    ):
        scene.write_own(own, Path("own.ini"))
    assert not Path("own.ini").exists()


@pytest.mark.parametrize("counts", [0.0, -1.0, float("nan"), float("inf")])
def test_counts_of_a_turn_are_a_number_above_0(tmp_path, counts):
    own = scene.OwnLog(Path("x.csv"), "a", "", **OWN | {"counts_per_turn": counts})
    with pytest.raises(Error, match="--counts-per-turn .*: a number above 0 was expected"):
        scene.write_own(own, tmp_path / "own.ini")
    assert not (tmp_path / "own.ini").exists()


REPLAY = SEGMENTS.partition("[motion]")[0] + "[motion]\nkind = log\nfile = a.csv\n{}"


def test_a_scene_that_replays_a_log_must_say_which_column(dahl):
    Path("my.ini").write_text(REPLAY.format("counts_per_unit = 1\n"))
    Path("a.csv").write_text("a\n1\n2\n")
    told = "my.ini: [motion] angle is missing: which column of a.csv holds the angle?"
    assert complaint(dahl("demo", "--scene", "my.ini", "--output", "out")) == (2, told)


# --- runs that were recorded ----------------------------------------------------------------------


def write_run(folder: Path, dbc: Path) -> None:
    """A record of 30 ticks, and a scene whose log lies beside it."""
    run = Run(dbc)
    run.tick(0, 0, state=6, used=False)
    for n in range(1, 30):
        run.tick(n, 7 * n)
    folder.mkdir()
    (folder / "run.log").write_text("".join(map(bus.candump_line, run.frames)))
    measured = "[measured]\ntorque = T\nlabel_torque = force [N]\n"
    (folder / "mine.ini").write_text(REPLAY.format("angle = a\n") + measured)
    (folder / "a.csv").write_text("a,T\n" + "".join(f"{7 * n},{n}\n" for n in range(30)))


@pytest.fixture
def quick(monkeypatch):
    """Pictures are not painted, which takes longest; they are put where they go."""
    monkeypatch.setattr(plots, "save", lambda figure, path: path.touch())


def test_a_record_is_drawn_with_the_log_beside_its_scene(dahl, dbc, quick):
    """A bare record, whose scene says where its log is: beside the scene, wherever one stands."""
    write_run(Path("there"), dbc)
    done = dahl("plot", "there/run.log", "--scene", "there/mine.ini")
    assert done.stdout == "there/loop.png: 30 ticks, Lenkung ä² <b>\n", done.stderr
    assert Path("there/loop.png").exists()
    Path("there/a.csv").unlink()
    code, said = complaint(dahl("plot", "there/run.log", "--scene", "there/mine.ini"))
    assert (code, said) == (2, "there/a.csv: no such file")


@pytest.mark.parametrize("column", ["torque", "time"])
def test_a_record_of_more_ticks_than_its_log_has_rows_is_one_line(dahl, dbc, quick, column):
    """It is of another run, whichever column of the log is drawn."""
    write_run(Path("there"), dbc)
    wanted = {"torque": "[measured]\ntorque = T\n", "time": "time = T\n"}[column]
    Path("there/mine.ini").write_text(REPLAY.format("angle = a\n") + wanted)
    words = ("plot", "there/run.log", "--scene", "there/mine.ini")
    assert dahl(*words).returncode == 0
    rows = Path("there/a.csv").read_text().splitlines()
    Path("there/a.csv").write_text("\n".join(rows[:-1]) + "\n")
    Path("there/loop.png").unlink()
    code, said = complaint(dahl(*words))
    assert (code, said) == (2, "there/run.log: 30 ticks, but a.csv has 29 rows: another run?")
    assert not Path("there/loop.png").exists()


def test_a_log_of_the_same_name_elsewhere_is_not_taken(dahl, dbc, monkeypatch):
    """Not one in the folder where the verb runs, nor that of a measured set of that name."""
    write_run(Path("there"), dbc)
    Path("a.csv").write_text("another\n")
    assert data.find_log("a.csv", Path("there")) == Path("there/a.csv")
    monkeypatch.setenv("DAHL_DATA", str(Path("sets").resolve()))
    for folder in ("sets/tribometer", "there/tribometer"):
        Path(folder).mkdir(parents=True)
        Path(folder, "b.tsv").write_text("t\n")
    assert data.find_log("tribometer/b.tsv", Path("there")) == Path("there/tribometer/b.tsv")
    assert data.find_log("tribometer/b.tsv", Path()) == Path("sets/tribometer/b.tsv").resolve()


@pytest.fixture
def drawn(monkeypatch):
    """The fit that stands on each picture, which is not painted."""
    fits = []
    monkeypatch.setattr(plots, "draw", lambda *words: fits.append(words[4].get("r2_measured")))
    return fits


def test_a_run_remembers_its_log(dahl, dbc, drawn):
    """The log of the summary is the run's, also where the scene's own is gone or the folder has
    moved; of another scene neither log nor fit is.
    """
    write_run(Path("there"), dbc)
    Path("there/other.ini").write_text(Path("there/mine.ini").read_text().replace("a.csv", "b.csv"))
    rows = Path("there/a.csv").read_text().splitlines()
    Path("there/b.csv").write_text("\n".join([rows[0], *(f"{row}000" for row in rows[1:])]))
    Path("there/a.csv").rename("moved.csv")
    known = {"scene_file": "gone/mine.ini", "log": str(Path("moved.csv").resolve())}
    Path("there/summary.json").write_text(json.dumps(known | {"r2_measured": 0.99}))
    for words in (("-o", "x.png"), ("--scene", "there/mine.ini"), ("--scene", "there/other.ini")):
        assert dahl("plot", "there", *words).stdout.split(": ")[1].startswith("30 ticks"), words
    own, same, other = drawn
    assert own == same != other and 0.99 not in drawn
    assert dahl("plot", "there", "--scene", "segments").returncode == 0 and drawn[-1] is None
    Path("there/another.log").write_bytes(Path("there/run.log").read_bytes())
    code, said = complaint(dahl("plot", "there/another.log"))
    assert code == 2 and said.startswith("there/another.log: which parameters did this run have?")
    Path("there/summary.json").unlink()
    code, said = complaint(dahl("plot", "there"))
    assert code == 2 and said.startswith("there/run.log: which parameters did this run have?")


def test_a_picture_that_cannot_be_read_is_one_line(dahl):
    Path("summary.json").write_text('{"scene_file": "x"}')
    Path("loop.png").mkdir()
    assert complaint(dahl("report", ".")) == (2, "loop.png: Is a directory")


def test_a_broken_mf4_is_one_line_also_when_the_program_ends(run_dahl, tmp_path):
    """Its reader, left half made, has nothing to say when it is collected."""
    whole, cut = tmp_path / "whole.mf4", tmp_path / "cut.mf4"
    with can.Logger(whole) as log:
        for n in range(50):
            log.on_message_received(can.Message(timestamp=n / 1000, arbitration_id=n, data=b"1"))
    cut.write_bytes(whole.read_bytes()[:1000])
    done = run_dahl("plot", cut, "--scene", "segments", "-o", tmp_path / "x.png")
    code, said = complaint(done)
    assert code == 2 and said.startswith(f"{cut}: broken or cut off after 0 frames (")


# --- clients of a bus -----------------------------------------------------------------------------


class Feed:
    """A bus that gives these frames, None between them."""

    def __init__(self, *given: object) -> None:
        self.given = list(given)

    def recv(self, _: float) -> object:
        return self.given.pop(0) if self.given else None


def test_a_client_ends_after_the_frames_that_came_not_after_pauses():
    one, two, three = (can.Message(arbitration_id=n) for n in (1, 2, 3))
    came = bus.received(Feed(None, one, None, two, three), Stop(), frames=2)
    assert list(came) == [None, one, None, two]


def test_a_client_ends_after_its_seconds_or_when_it_is_asked(monkeypatch):
    clock = [100.0]
    monkeypatch.setattr(bus.time, "monotonic", lambda: clock[0])
    came = []
    for message in bus.received(Feed(), Stop(), seconds=2.5):
        came.append(message)
        clock[0] += 1.0
    assert came == [None] * 3
    stop = Stop()
    endless = bus.received(Feed(), stop)
    next(endless)
    stop.asked = True
    assert list(endless) == []


def test_a_bus_description_that_is_not_there_is_one_line(dahl):
    words = ("monitor", "-i", "virtual", "-c", "x", "--dbc", "none.dbc")
    assert complaint(dahl(*words)) == (2, "none.dbc: No such file or directory")
    Path("other.dbc").write_text(DBC)
    code, said = complaint(dahl(*words[:-1], "other.dbc"))
    assert code == 2 and said.startswith("other.dbc: no signal 'Count' in a message 'EncoderState'")


def test_a_record_starts_anew_and_keeps_times_and_channels(dahl, dbc, monkeypatch):
    """What was there goes with the first frame; nothing is added to it."""
    angle = {"Valid": 1, "Count": 5}
    sent = list(frames(dbc, *[("EncoderState", 1e9 + n, {**angle, "Counter": n}) for n in (1, 2)]))
    for frame in sent:
        frame.channel = "can7"
    feed = Feed(None, *sent)
    feed.__class__ = type("Bus", (Feed,), {"__enter__": lambda s: s, "__exit__": lambda *_: None})
    monkeypatch.setattr(can, "Bus", lambda **_: feed)
    Path("x.log").write_text("(0000000001.000000) old 100#00\n" * 9)
    done = dahl("record", "-i", "virtual", "-o", "x.log", "--force", "--frames", 2)
    assert (done.returncode, done.stdout) == (0, "2 frames in x.log\n")
    lines = Path("x.log").read_text().splitlines()
    assert [line.split()[:2] for line in lines] == [
        ["(1000000001.000000)", "can7"],
        ["(1000000002.000000)", "can7"],
    ]


# --- programs and places --------------------------------------------------------------------------
@pytest.fixture
def started(monkeypatch, tmp_path):
    """Start one dahl-loop, played by a script, with files of a run before in its folder."""
    out = tmp_path / "out"
    out.mkdir()
    for name in ("node.json", "encoder.json"):
        (out / name).write_text('{"ticks": 99}')
    (out / "node.err").write_text("error: of a run before\n")

    def start(script: str, role: str, **setup: object) -> loop.Program:
        (tmp_path / "loop").write_text(f"#!/bin/sh\n{script}\n")
        (tmp_path / "loop").chmod(0o755)
        monkeypatch.setenv("DAHL_LOOP", str(tmp_path / "loop"))
        return loop.Program(loop.Setup(Path("a.ini"), "x", out, **setup), role, "the bus", "--more")

    # A run in the background may ignore Ctrl-C, and so would what it starts.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield start
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("left", ["", "echo '{' >out/node.json;", "echo '{}' >out/node.json;"])
def test_what_a_run_before_left_is_not_taken_for_this_one(started, tmp_path, monkeypatch, left):
    monkeypatch.chdir(tmp_path)
    node = started(f"{left} exit 0", "node")
    assert node.ends() and node.ended()
    node.end()
    node.check()
    assert (node.numbers(), node.words()) == ({}, "")


def test_each_program_gets_its_part_of_the_set_up(started, tmp_path):
    """The motion is the encoder's; whose child it is, both are told."""
    motion = {"log": Path("b.csv"), "seconds": 2.5, "seed": 0, "lockstep": True}
    common = f"--scene a.ini --role {{}} --bus the bus --summary {tmp_path}/out/{{}}.json"
    common += f" --with-parent {os.getpid()}"
    more = {
        "node": " --more",
        "encoder": " --log-file b.csv --seconds 2.5 --seed 0 --lockstep --more",
    }
    for role, words in more.items():
        program = started('echo "$*"', role, **motion)
        assert program.ends()
        program.end()
        assert program.words() == f"{common.format(role, role)}{words}\n"
    bare = started('echo "$*"', "both")
    assert bare.ends()
    bare.end()
    assert bare.words().endswith(f"--with-parent {os.getpid()} --more\n")


def test_a_library_that_the_system_lacks_is_named(dahl_loop, tmp_path, monkeypatch):
    """A dahl-loop that asks for one that is nowhere, as its loader finds it."""
    program = tmp_path / "dahl-loop"
    program.write_bytes(dahl_loop.read_bytes().replace(b"libinih.so.1", b"libnone.so.1"))
    program.chmod(0o755)
    monkeypatch.setenv("DAHL_LOOP", str(program))
    started = loop.Program(
        loop.Setup(paths.SCENES / "steering.ini", "loopback", tmp_path), "both", "x"
    )
    assert started.ends()
    started.end()
    packages = "libinih1 libcsv3 libcjson1"
    with pytest.raises(RunError, match=f"needs libnone.so.1, not here: apt-get install {packages}"):
        started.check()


def test_a_program_that_is_told_to_end_has_not_failed(started, monkeypatch):
    """By Ctrl-C in order; one that does not hear it is made to."""
    program = started("exec sleep 50", "node")
    program.end()
    assert program.told and program.process.returncode == -signal.SIGINT
    program.check()
    monkeypatch.setattr(loop, "PATIENCE", 0.3)
    deaf = started("trap '' INT; echo on; sleep 50 & wait; wait", "node")
    wait_until(lambda: deaf.words() == "on\n")
    deaf.end()
    assert deaf.process.returncode == -signal.SIGKILL
    with pytest.raises(RunError, match="ended with code -9"):
        deaf.check()


@pytest.mark.parametrize(
    ("words", "port"),
    [("socketcand 127.0.0.1:29536 vcan0", 29536), ("warming up\nsocketcand 10.0.0.1:7 can", 7)],
)
def test_the_port_is_the_one_that_is_said(started, words, port):
    program = started(f"printf '%s\\n' '{words}'; exec sleep 50", "node")
    assert program.port() == port
    program.end()


def test_a_target_runs_dahls_model_alone_on_a_core_that_is_known(dahl, monkeypatch):
    done = dahl("demo", "--scene", "segments", "--target", "m9", "--output", "out")
    known = f"--target m9: one of {' '.join(firmware.boards())} was expected"
    assert complaint(done) == (2, known)
    monkeypatch.setattr(firmware, "build", lambda core: pytest.fail("built for nothing"))
    for key in ("model = slip", "gain = 0.9", "limit = 0.9", "ramp_ms = 1", "[faults]\ndrop = 0.1"):
        own = SEGMENTS.replace("[friction]\n", "[friction]\nmax_step = 9\n")
        Path("own.ini").write_text(
            f"{own}\n{key}" if key[0] == "[" else own.replace("max_step = 9", key)
        )
        code, said = complaint(dahl("demo", "--scene", "own.ini", "--target", "m4f"))
        assert (code, "--target runs" in said, "own.ini" in said) == (2, True, True), key


def test_the_build_is_the_hosts_unless_another_is_named(monkeypatch, tmp_path):
    monkeypatch.delenv("DAHL_BUILD_DIR", raising=False)
    assert paths.build_folder() == paths.ROOT / "build" / "host"
    monkeypatch.setenv("DAHL_BUILD_DIR", str(tmp_path))
    monkeypatch.setenv("DAHL_LIBRARY", "")  # as if it were not set
    with pytest.raises(RunError, match=f"{tmp_path}/lib/libdahl.so is not there; build it"):
        paths.library()
    (tmp_path / "mine.so").touch()
    monkeypatch.setenv("DAHL_LIBRARY", str(tmp_path / "mine.so"))
    assert paths.library() == tmp_path / "mine.so"
    monkeypatch.setenv("DAHL_LIBRARY", str(tmp_path / "none.so"))
    with pytest.raises(RunError, match=r"none\.so is not there; build it .* or set DAHL_LIBRARY"):
        paths.library()


def test_a_verb_and_its_words_are_what_is_brought_and_started_again(dahl, monkeypatch):
    asked = []
    monkeypatch.setattr(by_need, "bring", lambda *words: asked.append(words))
    assert dahl("data", "nothing").returncode == 2
    monkeypatch.setattr(sys, "argv", ["dahl", "data", "nothing else"])
    assert cli.main() == 2
    assert asked == [("data", ["data", "nothing"]), ("data", ["data", "nothing else"])]


def test_text_that_no_encoding_holds_is_written_all_the_same(tmp_path):
    """A file's name may be any bytes; it stands on pages and in headers."""
    files.keep(tmp_path / "x.txt", "ä \udcff\n")
    assert (tmp_path / "x.txt").read_bytes() == "ä ?\n".encode()
    assert [path.name for path in tmp_path.iterdir()] == ["x.txt"]


@pytest.mark.parametrize("mode", [0o600, 0o664, 0o755])
def test_a_file_that_is_replaced_keeps_its_mode(tmp_path, mode):
    """Behind a link, which stays one."""
    (path := tmp_path / "x.txt").write_text("old")
    path.chmod(mode)
    (link := tmp_path / "y.txt").symlink_to(path)
    files.keep(link, "new")
    assert (path.read_text(), path.stat().st_mode & 0o777) == ("new", mode) and link.is_symlink()


def test_a_loop_of_links_is_one_line(dahl):
    Path("loop.h").symlink_to("loop.h")
    known = ("--sigma0", "1", "--fc", "1", "--theta-per-count", "1")
    code, said = complaint(dahl("plan", *known, "-o", "loop.h"))
    assert (code, said) == (1, "loop.h: Too many levels of symbolic links")
    assert Path("loop.h").is_symlink()


def test_empty_rows_of_a_measured_set_are_left_out():
    rows = "t\tx\n8.6\t1\n\n8.7\t2\n\n"
    assert data.cut_tribometer(rows.encode()) == b"t\tx\n8.6\t1\n8.7\t2\n"


def test_a_project_without_its_bus_description_is_a_failed_run(dahl, monkeypatch):
    """Not bad input of the user's: code 1."""
    monkeypatch.setattr(paths, "DBC", Path("none.dbc"))
    report.database.cache_clear()
    try:
        assert complaint(dahl("dbc")) == (1, "none.dbc: No such file or directory")
    finally:
        report.database.cache_clear()


def test_the_states_that_start_anew_are_those_of_the_bus_description():
    named = report.state_counts(np.array([0, 0, 6, 99]))
    assert named == {"OK": 2, "Init": 1, "99": 1}
    assert report.new_start_states() == {3, 5, 6}
