# SPDX-License-Identifier: MIT
"""Tables and CAN logs of `dahl plot` and `dahl demo`: good ones are read whole, and an error names
file, line and column.
"""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import can
import numpy as np
import pandas as pd
import pytest
from identify_tools import complaint
from log_reading import drawing, run

GOOD = "t,angle,torque\n0,15,2\n0.25,-25,3\n0.5,35,-4.5\n"
TIME, TORQUE = [0, 0.25, 0.5], [2, 3, -4.5]
SCENE = """[scene]
title = a table
[friction]
sigma0 = 100
Fc = 0.5
theta_per_count = 1e-4
[motion]
kind = log
file = log.csv
angle = angle
time = t
counts_per_unit = 1
[measured]
torque = torque
"""


@pytest.fixture(scope="module")
def played(tmp_path_factory, dahl_loop, library) -> Path:
    """A folder with a scene, its table, and the frames of its run."""
    folder = tmp_path_factory.mktemp("played")
    (folder / "scene.ini").write_text(SCENE)
    (folder / "log.csv").write_text(GOOD)
    words = [dahl_loop, "--scene", folder / "scene.ini", "--virtual", "--log", folder / "run.log"]
    subprocess.run([*words, "--seconds", "0.1"], check=True, capture_output=True, timeout=60)
    return folder


@pytest.fixture
def plotted(played, tmp_path, monkeypatch):
    """Draw the run with another table, or another log of frames."""
    for path in played.iterdir():
        shutil.copy(path, tmp_path)
    monkeypatch.chdir(tmp_path)

    def plot(text: str | bytes | None = None, frames: str = "run.log"):
        if text is not None:
            Path("log.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
        with drawing(rendered=False) as figures:
            return run("plot", frames, "--scene", "scene.ini", "-o", "x.png"), figures

    return plot


@pytest.mark.parametrize(
    "text",
    [
        GOOD.replace(",", "\t").replace("\n", "\r\n"),
        ("Rig 3\n\nDate;24.11.2026\n" + GOOD.replace(",", ";").replace(".", ",")).encode("utf-16"),
        GOOD + "\n,,\n",
        "x,t,x,angle,torque\n1,0,1,15,2\n1,0.25,1,-25,3\n1,0.5,1,35,-4.5\n",
    ],
    ids=range(4),
)
def test_a_good_table_is_read_whole(plotted, text):
    """Over the angle, and over the time of the table."""
    done, (figure,) = plotted(text)
    assert done.returncode == 0, done.stderr
    curves = [panel.lines[0].get_data() for panel in figure.axes[:2]]
    assert [torque.tolist() for _, torque in curves] == [TORQUE, TORQUE]
    assert curves[0][0] == pytest.approx(1e-4 * np.array([0, -40, 20]))
    assert curves[1][0].tolist() == TIME


BAD = [  # a table, and parts of the error; test_log_tables.py has more
    ("", ("log.csv: empty",)),
    ("t,angle,torque\n", ("log.csv:1: ",)),
    (GOOD.replace("angle", "Angel"), ("log.csv:1: ", "'angle'", "'Angel'?", "t, Angel, torque")),
    ("angle,t,torque, angle\n1,2,3,4\n", ("log.csv:1: ", "2 columns 'angle'")),
    ("t,angle,torque\n0,1,2\n1,abc,2\n", ("log.csv:3: ", "'angle'", "'abc'")),
    ("t,angle,torque\n0,1,\n", ("log.csv:2: ", "'torque'", "nan")),
    ("t,angle,torque\n0,1,1e999\n", ("log.csv:2: ", "'torque'", "inf")),
    ("t,angle,torque\n1,1,2\n2,1,2\n1.5,1,2\n", ("log.csv:4: ", "'t'", "1.5 after 2")),
    ("angle,t,torque\n1," + "1" * 200_000, ("log.csv:",)),
    ('angle,t,torque\n1,"' + "2\n" * 60_000, ("log.csv:",)),
]


@pytest.mark.parametrize(("text", "parts"), BAD, ids=range(len(BAD)))
def test_a_bad_table_is_named_by_file_line_and_column(plotted, text, parts):
    code, line = complaint(plotted(text)[0])
    assert code == 2 and len(line) < 300 and not Path("x.png").exists()
    for part in parts:
        assert part in line


OWN_FORMS = {  # the same log as other programs write it
    "plain.csv": ("time_s,angle_deg,torque_Nm\n", "{},{},{}\n"),
    "german.csv": ("Prüfstand;3\n\nZeit [s];Winkel [°];Drehmoment [Nm]\n", "{};{};{}\n"),
    "units.txt": ("# rig\n# time angle torque\n# s deg Nm\n", "{} {} {}\n"),
}
OWN_MODEL = "--sigma0 40 --fc 0.8 --counts-per-turn 4096 --bus canopy".split()


def own_table(*words: object) -> tuple[np.ndarray, str]:
    """The table that `dahl demo LOG` replays, and its scene; the bus is refused after that."""
    assert complaint(run("demo", *words, *OWN_MODEL))[0] == 2
    return np.loadtxt("out/own.csv", delimiter=",", skiprows=1), Path("out/own.ini").read_text()


@pytest.mark.parametrize("name", OWN_FORMS)
def test_the_demo_reads_what_identify_reads(name, dahl_loop, library, tmp_path, monkeypatch):
    """A column by its number, name, or name without unit; decimal commas; UTF-16."""
    monkeypatch.chdir(tmp_path)
    rows = [(k / 8, 7 * k % 5 + 0.25, k % 3 - 0.5) for k in range(40)]
    head, form = OWN_FORMS[name]
    text = head + "".join(form.format(*row) for row in rows)
    is_german = name == "german.csv"
    encoded = text.replace(".", ",").encode("utf-16") if is_german else text.encode()
    Path(name).write_bytes(encoded)
    angle = "Winkel" if is_german else "2"
    table, scene = own_table(name, "--angle", angle, "--torque", 3, "--time", 1, "-o", "out")
    assert table.tolist() == [[angle, torque, time] for time, angle, torque in rows]
    assert "counts_per_unit = 11.37" in scene and "[deg]" in scene


def test_the_demo_uses_the_units_of_names_and_unwraps(dahl_loop, library, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    gone = np.arange(100) * 0.03
    frame = pd.DataFrame({"angle [turn]": gone % 1, "T_mNm": 1e3 * gone})
    frame.to_parquet("x.parquet")
    table, scene = own_table("x.parquet", "--angle", 1, "--torque", "T_mNm", "-o", "out")
    np.testing.assert_allclose(table, np.column_stack((gone, gone)), atol=1e-12)
    assert "counts_per_unit = 4096" in scene
    table, _ = own_table(
        *("x.parquet", "--angle", 1, "--torque", "T_mNm", "--torque-scale", -2, "-o", "out")
    )
    np.testing.assert_allclose(table[:, 1], -2e3 * gone)
    words = ("--angle", 1, "--torque", 1, *OWN_MODEL, "-o", "out")
    assert "different columns" in complaint(run("demo", "x.parquet", *words))[1]


def test_a_table_that_is_not_there_or_a_folder_is_named(plotted):
    Path("log.csv").unlink()
    assert "log.csv: no such file" in complaint(plotted()[0])[1]
    Path("log.csv").mkdir()
    assert "log.csv: " in complaint(plotted()[0])[1]


@pytest.mark.parametrize(
    ("name", "text", "parts"),
    [
        ("a.log", "(0.1) v 100#00\n(0.2) v 100#0\n", ("a.log:2: ", "(0.2) v 100#0")),
        ("a.log", "(0.1) v 100#00\nhello\n", ("a.log:2: ", "hello")),
        ("a.log", "(zero) v 100#00\n", ("a.log:1: ",)),
        ("a.log", "", ("a.log: no frames",)),
        ("a.asc", 0, ("a.asc: no frames",)),
        ("a.blf", 20, ("a.blf: ", " 20 frames")),  # of which python-can has no word
        ("a.txt", "", ("a.txt: ", ".asc, .blf, .log")),
    ],
    ids=range(7),
)
def test_a_log_without_frames_or_with_a_broken_one_is_named(plotted, name, text, parts):
    if isinstance(text, str):
        Path(name).write_text(text)
    else:
        with can.Logger(name) as log:
            for n in range(text):
                log.on_message_received(can.Message(timestamp=n, arbitration_id=n, data=b"1"))
        Path(name).write_bytes(Path(name).read_bytes()[: -1 if text else None])
    code, line = complaint(plotted(frames=name)[0])
    assert code == 2
    for part in parts:
        assert part in line
