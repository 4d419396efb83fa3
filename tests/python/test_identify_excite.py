# SPDX-License-Identifier: MIT
"""`dahl excite`: the proposed motion, simulated and identified, reaches the wanted interval; its
table and scene have the printed numbers.
"""

from __future__ import annotations

import configparser
import functools
import json
import re
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pytest
from dahl.identify import Log, identify
from identify_tools import COUNT, FC, SIGMA0, complaint, dahl_torque
from log_reading import drawing, run

pytestmark = pytest.mark.usefixtures("library")

KNOWN = ("--sigma0", SIGMA0, "--fc", FC, "--counts-per-turn", "16384")
LENGTH = FC / SIGMA0  # rad, of presliding


@functools.cache
def proposed(*words: object) -> tuple[np.ndarray, np.ndarray, np.ndarray, str]:
    """Return time, angle and counts of the motion, and the printed text."""
    with tempfile.TemporaryDirectory() as folder:
        done = run("excite", *KNOWN, *words, "-o", folder)
        assert done.returncode == 0, done.stderr
        table = np.loadtxt(Path(folder) / "excite.csv", delimiter=",", skiprows=1)
    return (*table.T, done.stdout)


def measured(theta: np.ndarray, seed: int, torque: np.ndarray | None = None) -> Log:
    """Return the log of a rig at 1 kHz, with noise of 5 % of Fc."""
    random = np.random.default_rng(seed)
    noise = 0.05 * FC * random.normal(size=len(theta))
    torque = (dahl_torque(theta) if torque is None else torque) + noise
    read = np.floor(theta / COUNT + random.uniform()) * COUNT
    return Log(f"seed {seed}", read, torque, np.arange(len(theta)) * 1e-3, resolution=COUNT)


@pytest.mark.parametrize("percent", [2.0, 1.0])
def test_the_interval_asked_for_is_reached(percent):
    """The interval is wider than the error: it covers all hypotheses and the counts."""
    _, theta, _, said = proposed("--within", percent)
    errors = []
    for seed in range(2):
        result = identify([measured(theta, seed)])
        assert result.claimed == (True, True), result.verdict
        assert result.sigma0.low <= SIGMA0 <= result.sigma0.high
        assert result.sigma0.half_width < 4 * percent / 100
        errors.append(abs(result.sigma0.value / SIGMA0 - 1))
    assert min(errors) < percent / 100
    expected = float(re.search(r"sigma0 within (\S+) %", said)[1])
    assert 0.2 * percent < expected <= percent


def test_strokes_differ_in_length_and_speed_both_ways():
    """The motion begins and ends in the middle; each side has all lengths and paces; no jumps."""
    _, theta, _, _ = proposed()
    turns = np.flatnonzero(np.diff(np.sign(np.diff(theta)))) + 1
    far, shortest = np.abs(theta).max(), np.diff(turns).min()
    assert theta[[0, -1]].tolist() == [0, 0] and 3 * LENGTH < far < 30 * LENGTH
    for side in (0, 1):
        ends, rows = theta[turns[side::2]], np.diff(turns)[side::2]
        assert np.unique(np.round(np.abs(ends) / far, 3)).tolist() == [0.8, 0.9, 1.0]
        assert set(np.round(rows / shortest, 1)) == {1.0, 1.6}
    bend = far * (np.pi / shortest) ** 2  # of a sine
    assert np.abs(np.diff(theta, 2)).max() < 1.1 * bend
    assert np.abs(np.diff(theta)).max() < LENGTH / 7


def late_by_half(torque: np.ndarray, rows: int) -> np.ndarray:
    """Return half of the torque at once, half through a first-order lag."""
    lagging, value = [], 0.0
    for one in torque.tolist():
        value += (one - value) / rows
        lagging.append(value)
    return (torque + np.array(lagging)) / 2


def test_strokes_of_several_speeds_show_a_torque_that_is_late():
    """At one speed this looks like a softer bearing; at two speeds no claim is false."""
    _, theta, _, _ = proposed()
    result = identify([measured(theta, 0, late_by_half(dahl_torque(theta), 30))])
    for parameter, truth in ((result.sigma0, SIGMA0), (result.Fc, FC)):
        assert not parameter.claimed or parameter.low <= truth <= parameter.high


@pytest.mark.parametrize(
    "words", ["--noise 0.2", "--within 0.5", "--rate 5000", "--speed 0.05", "--name My-1"]
)
def test_each_option_shapes_the_motion_as_it_is_printed(words, tmp_path):
    done = run("excite", *KNOWN, *words.split(), "-o", tmp_path)
    name = "my_1" if "name" in words else "excite"
    time, theta, counts = np.loadtxt(tmp_path / f"{name}.csv", delimiter=",", skiprows=1).T
    turns = np.flatnonzero(np.diff(np.sign(np.diff(theta)))) + 1
    rate = 5000 if "rate" in words else 1000
    assert np.diff(time) == pytest.approx(1 / rate, abs=2e-6)
    assert counts == pytest.approx(theta / COUNT, abs=0.501)
    said = [float(word) for word in re.findall(r"(?<= )\d[\d.]*(?=\s|$)", done.stdout)]
    far, cycle = np.abs(theta).max(), 2 * np.diff(turns).min() / rate
    shown = [0.8 * far, far, len(turns) / 2, cycle, 1.6 * cycle, len(turns)]
    assert said[:6] == pytest.approx(shown, rel=0.02)
    assert said[6:8] == pytest.approx([time[-1], len(theta) - 1], rel=1e-3)
    usual, speed = len(proposed()[1]), rate * np.abs(np.diff(theta)).max()
    assert ("speed" in words) == (speed <= 0.05 * 1.001) and len(turns) >= 10
    assert (len(theta) > 1.5 * usual) == any(one in words for one in ("noise", "within", "speed"))


def test_the_scene_plays_the_table(tmp_path, dahl_loop, monkeypatch):
    """The guess is a JSON of dahl identify. The table is found next to the scene."""
    monkeypatch.chdir(tmp_path)
    found = json.dumps({"sigma0": SIGMA0, "Fc": FC})
    Path("known.json").write_text(found, encoding="utf-8-sig")
    words = ("--from", "known.json", "--counts-per-turn", "16384", "-o", "out")
    assert run("excite", *words).returncode == 0
    scene = configparser.ConfigParser()
    scene.read("out/excite.ini")
    friction = {name: float(scene["friction"][name]) for name in ("sigma0", "fc")}
    assert friction == {"sigma0": SIGMA0, "fc": FC}
    assert float(scene["friction"]["theta_per_count"]) == pytest.approx(COUNT)
    played = [dahl_loop, "--scene", tmp_path / "out/excite.ini", "--virtual", "--log", "run.log"]
    subprocess.run(played, cwd=tmp_path, capture_output=True, timeout=60, check=True)
    with drawing(rendered=False) as figures:
        assert run("plot", "run.log", "--scene", "out/excite.ini").returncode == 0
    counts = np.loadtxt("out/excite.csv", delimiter=",", skiprows=1)[:, 2]
    shown = figures[0].axes[0].lines[0].get_xdata() / COUNT
    assert shown == pytest.approx((counts - counts[0])[: len(shown)], abs=0.01)
    assert len(shown) >= len(counts) - 1


def test_linear_motion_is_in_metres_and_newtons(tmp_path):
    """A JSON of the other kind of motion is refused."""
    words = ("--counts-per-turn", "10000", "-o", tmp_path)
    done = run("excite", "--sigma0", "3e4", "--fc", "2.7", "--mm", *words)
    assert done.returncode == 0 and re.search(r"strokes of \S+ to \S+ m to", done.stdout)
    (count,) = re.findall(r"theta_per_count = (\S+)", (tmp_path / "excite.ini").read_text())
    assert float(count) == pytest.approx(1e-7)
    known = tmp_path / "known.json"
    for linear, option in ((True, ()), (False, ("--mm",))):
        known.write_text(json.dumps({"sigma0": 3e4, "Fc": 2.7, "linear": linear}))
        code, line = complaint(run("excite", "--from", known, *option, *words))
        assert code == 2 and str(known) in line and "--mm" in line


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        ("--sigma0 100", ("--sigma0", "--fc", "--from")),
        ("--sigma0 -1 --fc 1", ("-1", "1e-30", "1e+30")),
        ("--from absent.json", ("absent.json: no such file",)),
        ("--sigma0 1e30 --fc 0.5", ("sigma0 = 1e+30", "2^64")),
        ("--sigma0 1e9 --fc 0.5", ("presliding is 1.3e-06 counts",)),
        ("--sigma0 1000 --fc 0.5", ("presliding is 1.3 counts",)),
        ("--sigma0 100 --fc 0.5 --speed 1e-6", ("1000000",)),
    ],
)
def test_bad_values_are_one_line(words, parts):
    code, line = complaint(run("excite", "--counts-per-turn", "16384", *words.split()))
    assert code == 2 and all(part in line for part in parts), line


def test_a_motion_that_is_too_long_is_refused_with_its_length():
    code, line = complaint(run("excite", *KNOWN, "--within", "0.0001"))
    cycles, seconds = re.search(r"needs (\d+) cycles, (\d+) s;", line).groups()
    assert code == 2 and 0.1 < int(seconds) / int(cycles) < 10


def test_a_json_that_is_no_identification_is_one_line(tmp_path):
    path = tmp_path / "x.json"
    for text in ("{}", '{"sigma0": 1}', "[]", "5", '{"sigma0": "x", "Fc": 1}', "{"):
        path.write_text(text)
        code, line = complaint(run("excite", "--from", path, "--counts-per-turn", 1000))
        assert code == 2 and line.startswith(f"{path}:"), text


@pytest.mark.parametrize("end", ["csv", "ini"])
def test_a_file_of_someone_else_is_spared(tmp_path, end):
    """--force overwrites it; a motion of dahl is always overwritten."""
    theirs, text = tmp_path / f"shaft.{end}", "time_s,theta,torque\n0,0,0\n"
    theirs.write_text(text)
    words = ("excite", *KNOWN, "-o", tmp_path, "--name", "shaft")
    code, line = complaint(run(*words))
    assert code == 2 and line.startswith(f"{theirs}: ") and "--name" in line and "--force" in line
    assert [path.read_text() for path in tmp_path.iterdir()] == [text]
    assert run(*words, "--force").returncode == 0
    assert run(*words).returncode == 0
