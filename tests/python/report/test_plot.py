# SPDX-License-Identifier: MIT
"""`dahl plot` of recorded runs: which scene and which log belong to a record, records whose log has
moved or changed, and records of several buses.
"""

import json
import re
from pathlib import Path
from typing import Any

import can
import pytest
from identify_tools import complaint
from log_reading import drawing
from loop_tools import REPLAY

MEASURED = "[measured]\ntorque = T\n"


@pytest.fixture
def figures():
    with drawing(rendered=False) as drawn:
        yield drawn


@pytest.fixture
def log(dahl, figures) -> Path:
    """The record of a scene that replays a log with a torque; all files are in folder `there`."""
    (folder := Path("there")).mkdir()
    (folder / "mine.ini").write_text(REPLAY + MEASURED)
    (folder / "a.csv").write_text("a,T\n" + "".join(f"{7 * n},{n}\n" for n in range(30)))
    words = ["--scene", folder / "mine.ini", "--virtual", "--log", folder / "run.log"]
    assert dahl("loop", *words).returncode == 0
    return folder / "run.log"


def refused(done: Any, *facts: str) -> None:
    code, line = complaint(done)
    assert code == 2 and [fact for fact in facts if fact not in line] == [], line


def test_a_shipped_scene_is_found_before_a_file_of_its_name(dahl, log):
    Path("segments").write_text(REPLAY.replace("a.csv", str(log.with_name("a.csv").resolve())))
    for name, title in (("segments", "Three segments"), (Path("segments").resolve(), "mine")):
        assert title in dahl("plot", log, "--scene", name).stdout
    refused(dahl("plot", log, "--scene", "nowhere"), "nowhere")


def test_a_record_is_drawn_with_the_log_beside_its_scene(dahl, log, monkeypatch):
    Path("a.csv").write_text("another\n")
    done = dahl("plot", log, "--scene", "there/mine.ini")
    assert done.stdout == "there/loop.png: 30 ticks, mine\n", done.stderr
    assert Path("there/loop.png").exists()
    monkeypatch.setenv("DAHL_DATA", str(Path("sets").resolve()))
    for folder, rows in (("sets", 9), ("there", 30)):
        (Path(folder) / "tribometer").mkdir(parents=True)
        (Path(folder) / "tribometer/b.tsv").write_text("a\tT\n" + "0\t0\n" * rows)
    scene = Path("there/mine.ini")
    scene.write_text(scene.read_text().replace("a.csv", "tribometer/b.tsv"))
    assert dahl("plot", log, "--scene", scene).returncode == 0
    Path("there/tribometer/b.tsv").unlink()
    refused(dahl("plot", log, "--scene", scene), "30", "9")  # the measured set has fewer rows
    scene.write_text(scene.read_text().replace("tribometer/b.tsv", "c.csv"))
    refused(dahl("plot", log, "--scene", scene), "there/c.csv")


@pytest.mark.parametrize("wanted", [MEASURED, "[motion]\ntime = T\n"])
def test_a_record_with_more_ticks_than_its_log_has_rows_is_refused(dahl, log, wanted):
    scene = log.with_name("mine.ini")
    scene.write_text(REPLAY.replace("[motion]\n", wanted) if "time" in wanted else REPLAY + wanted)
    assert dahl("plot", log, "--scene", scene).returncode == 0
    Path("there/loop.png").unlink()
    rows = Path("there/a.csv").read_text().splitlines()
    Path("there/a.csv").write_text("\n".join(rows[:-1]) + "\n")
    refused(dahl("plot", log, "--scene", scene), "there/run.log", "30", "a.csv", "29")
    assert not Path("there/loop.png").exists()


def test_the_log_of_a_run_is_found_by_its_summary(dahl, log, figures):
    Path("there/other.ini").write_text(Path("there/mine.ini").read_text().replace("a.csv", "b.csv"))
    rows = Path("there/a.csv").read_text().splitlines()
    Path("there/b.csv").write_text("\n".join([rows[0], *(f"{row}000" for row in rows[1:])]))
    Path("there/a.csv").rename("moved.csv")
    known = {"scene_file": "gone/mine.ini", "log": str(Path("moved.csv").resolve())}
    Path("there/summary.json").write_text(json.dumps(known | {"r2_measured": 0.99}))
    scenes = [("--scene", name) for name in ("there/mine.ini", "there/other.ini", "segments")]
    for words in (("-o", "x.png"), *scenes):
        assert ": 30 ticks" in dahl("plot", "there", *words).stdout, words
    legends = [figure.axes[0].get_legend().get_texts() for figure in figures]
    fits = [re.findall("dahl.*(R².*)", "\n".join(t.get_text() for t in texts)) for texts in legends]
    own, same, other, none = fits
    assert own == same != other and other and none == []
    assert not any("0.99" in words for found in fits for words in found)
    third = Path("there/third.ini")  # its log is missing, and that of the run is of another scene
    third.write_text(Path("there/mine.ini").read_text().replace("a.csv", "c.csv"))
    refused(dahl("plot", "there", "--scene", third), "there/c.csv")
    Path("there/another.log").write_bytes(Path("there/run.log").read_bytes())
    refused(dahl("plot", "there/another.log"), "there/another.log", "--scene")
    Path("there/summary.json").unlink()
    refused(dahl("plot", "there"), "there/run.log", "--scene")


def test_the_scene_of_a_run_is_its_file_if_that_is_still_there_else_the_one_beside(dahl, log):
    Path("kept.ini").write_text(REPLAY.replace("title = mine", "title = kept"))
    for scene, title in (("kept.ini", "kept"), ("gone/mine.ini", "mine")):
        known = {"scene_file": str(Path(scene).resolve()), "log": str(log.with_name("a.csv"))}
        Path("there/summary.json").write_text(json.dumps(known))
        Path("there/kept.ini").write_text(REPLAY)
        assert dahl("plot", "there").stdout.endswith(f", {title}\n")


def test_the_frames_are_those_of_the_node_of_the_scene(dahl, log):
    words = ["--scene", "there/mine.ini", "--set", "friction.node=3", "--virtual", "--log", "3.log"]
    assert dahl("loop", *words).returncode == 0
    (scene := Path("there/three.ini")).write_text(REPLAY.replace("[motion]", "node = 3\n[motion]"))
    assert ": 30 ticks" in dahl("plot", "3.log", "--scene", scene).stdout
    refused(dahl("plot", "3.log", "--scene", "there/mine.ini"), "EncoderState")


def test_a_log_of_two_buses_needs_the_name_of_one(dahl, log):
    """Node 0 of each bus may be another machine."""
    lines = log.read_text().splitlines(keepends=True)
    few = [line.replace(" vcan0 ", " can1 ") for line in lines[:20]]
    both = [line for pair in zip(lines, few, strict=False) for line in pair] + lines[len(few) :]
    Path("two.log").write_text("".join(both))
    scene = ("--scene", "segments")
    refused(dahl("plot", "two.log", *scene), "two.log: ", "-c", "can1", "vcan0")
    refused(dahl("plot", "two.log", *scene, "-c", "can7"), "two.log: ", "'can7'", "can1", "vcan0")
    assert not Path("loop.png").exists()
    for bus, ticks in (("vcan0", 30), ("can1", sum(" 110#" in line for line in few))):
        done = dahl("plot", "two.log", *scene, "-c", bus)
        assert (done.returncode, done.stderr) == (0, "") and Path("loop.png").exists()
        assert f": {ticks} ticks, " in done.stdout
    with can.LogReader("two.log") as frames, can.Logger("two.asc") as numbered:
        for frame in frames:
            frame.channel = int(frame.channel == "can1")
            numbered.on_message_received(frame)
    done = dahl("plot", "two.asc", *scene, "-c", "1")  # a number, no name
    assert f": {ticks} ticks, " in done.stdout, done.stderr


def test_a_broken_mf4_is_refused_in_one_line(run_dahl, tmp_path):
    whole, cut = tmp_path / "whole.mf4", tmp_path / "cut.mf4"
    with can.Logger(whole) as log:
        for n in range(50):
            log.on_message_received(can.Message(timestamp=n / 1000, arbitration_id=n, data=b"1"))
    cut.write_bytes(whole.read_bytes()[:1000])
    done = run_dahl("plot", cut, "--scene", "segments", "-o", tmp_path / "x.png")
    refused(done, f"{cut}: ", " 0 frames")
