# SPDX-License-Identifier: MIT
"""Scenes of any editor, own logs that are played and drawn again from any folder, and records whose
log has moved or changed.
"""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path

import can
import numpy as np
import pytest
from log_reading import drawing
from loop_tools import program

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
    """Check that the command ended in one line with these facts."""
    assert (done.returncode, done.stderr.count("\n")) == (code, 1), done
    assert done.stderr.startswith("error: ")
    assert [fact for fact in facts if fact not in done.stderr] == [], done.stderr
    return done.stderr


# --- scenes ---------------------------------------------------------------------------------------


def test_a_scene_of_any_editor_is_played_and_shown(dahl, quick):
    """With a byte order mark, CR LF and letters beyond ASCII."""
    Path("my.ini").write_text(SEGMENTS.replace("\n", "\r\n"), encoding="utf-8-sig", newline="")
    words = ("--scene", "my.ini", "--seconds", 0.2, "--bus", "socketcand", "--output", "out")
    done = dahl("demo", *words)
    assert done.returncode == 0, done.stderr
    assert json.loads(Path("out/summary.json").read_text())["title"] == "Lenkung ä² <b>"
    assert dahl("report", "out").returncode == 0
    page = Path("out/report.html").read_text(encoding="utf-8")
    assert "<title>Lenkung ä² &lt;b&gt;</title>" in page


def recorded(folder: Path, ticks: int = 30) -> Path:
    """Write a scene that replays a log with a torque, and record its run there."""
    folder.mkdir(parents=True, exist_ok=True)
    measured = "[measured]\ntorque = T\nlabel_torque = force [N]\n"
    (folder / "mine.ini").write_text(REPLAY.format("angle = a\ncounts_per_unit = 1\n") + measured)
    rows = "".join(f"{7 * n},{n}\n" for n in range(ticks))
    (folder / "a.csv").write_text("a,T\n" + rows)
    words = ["--scene", folder / "mine.ini", "--virtual", "--log", folder / "run.log"]
    subprocess.run([program(), *words], check=True, timeout=20)
    return folder / "run.log"


@pytest.fixture
def quick():
    """The figures that are drawn, saved as empty files."""
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
    """Words of `dahl demo` for an own log, without the options that are None."""
    options = OWN | {f"--{name.replace('_', '-')}": value for name, value in changed.items()}
    words = [word for pair in options.items() if pair[1] is not None for word in pair]
    return ["demo", log, *words, "--bus", "socketcand", "-o", "out"]


@pytest.mark.parametrize(("time_column", "torque"), [(None, None), ("t", "T")])
def test_an_own_log_is_played_and_drawn_again_from_any_folder(
    dahl, quick, monkeypatch, time_column, torque
):
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


def test_a_folder_of_a_log_may_have_any_name(dahl, quick):
    Path("b ;c").mkdir()
    Path("b ;c/a.csv").write_text("a\n1\n2\n")
    assert dahl(*own("b ;c/a.csv")).returncode == 0


# --- runs that were recorded ----------------------------------------------------------------------


def test_a_record_is_drawn_with_the_log_beside_its_scene(dahl, quick, monkeypatch):
    """Neither with a log in the working folder nor with a measured set of the same name."""
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
    refused(dahl("plot", log, "--scene", scene), 2, "30", "9")  # the measured set has fewer rows
    scene.write_text(scene.read_text().replace("tribometer/b.tsv", "c.csv"))
    refused(dahl("plot", log, "--scene", scene), 2, "there/c.csv")


@pytest.mark.parametrize("column", ["torque", "time"])
def test_a_record_with_more_ticks_than_its_log_has_rows_is_refused(dahl, quick, column):
    """Whichever column of the log is drawn."""
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


def test_the_log_of_a_run_is_found_by_its_summary(dahl, quick):
    """Even if the log has moved. For another scene neither this log nor the fit is used."""
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


def test_a_broken_mf4_is_refused_in_one_line(run_dahl, tmp_path):
    """Its reader, half constructed, prints nothing when it is collected."""
    whole, cut = tmp_path / "whole.mf4", tmp_path / "cut.mf4"
    with can.Logger(whole) as log:
        for n in range(50):
            log.on_message_received(can.Message(timestamp=n / 1000, arbitration_id=n, data=b"1"))
    cut.write_bytes(whole.read_bytes()[:1000])
    done = run_dahl("plot", cut, "--scene", "segments", "-o", tmp_path / "x.png")
    refused(done, 2, f"{cut}: ", " 0 frames")
