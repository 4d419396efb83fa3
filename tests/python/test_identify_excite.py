# SPDX-License-Identifier: MIT
"""`dahl excite`: the proposed motion, simulated and identified, gives the interval that was asked
for.
"""

from __future__ import annotations

import json
import re
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from dahl import Error, scene
from dahl.identify import design, pipeline, variety
from dahl.identify.log import Log
from identify_tools import COUNT, FC, SIGMA0, caller, dahl_torque

pytestmark = pytest.mark.usefixtures("library")

WANTED = design.Wanted(SIGMA0, FC, COUNT)


@pytest.fixture
def run_dahl(capsys):
    return caller(capsys)


def measured(motion: design.Motion, seed: int, noise: float = 0.05) -> Log:
    """What a rig would log of the motion."""
    random = np.random.default_rng(seed)
    theta = motion.theta()
    torque = dahl_torque(theta) + noise * FC * random.normal(size=len(theta))
    read = np.floor(theta / COUNT + random.uniform()) * COUNT
    time = np.arange(len(theta)) / motion.rate
    return Log(f"seed {seed}", read, torque, time, resolution=COUNT)


@pytest.mark.parametrize("within", [0.02, 0.005])
def test_the_interval_asked_for_is_reached(within):
    """With everything to be chosen: the interval over all choices is at most twice as wide."""
    motion = design.propose(replace(WANTED, within=within))
    errors, widths = [], []
    for seed in range(5):
        result = pipeline.identify([measured(motion, seed)])
        errors.append(abs(result.estimate.sigma0 / SIGMA0 - 1))
        widths.append(result.estimate.ci95["sigma0"].relative(SIGMA0))
    assert np.median(errors) < within
    assert np.median(widths) < 2 * within
    assert motion.within["sigma0"] <= within


def test_a_quarter_of_the_motion_is_not_enough():
    motion = design.propose(replace(WANTED, within=0.005))
    part = replace(motion, cycles=motion.cycles // 4)
    results = [pipeline.identify([measured(part, seed)]) for seed in range(3)]
    widths = [one.estimate.ci95["sigma0"].relative(SIGMA0) for one in results]
    assert np.median(widths) > 0.005


def test_speed_and_reversals_are_kept():
    motion = design.propose(replace(WANTED, speed=0.02))
    assert np.abs(np.diff(motion.theta())).max() * motion.rate <= 0.02 * 1.001
    assert motion.reversals >= 10
    assert motion.seconds == pytest.approx(len(motion.theta()) / motion.rate, rel=0.01)


def test_strokes_differ_in_length_and_speed_both_ways():
    """From the middle and back to it, each side with all lengths and paces, without a jump."""
    motion = design.propose(WANTED)
    theta = motion.theta()
    turns = np.flatnonzero(np.diff(np.sign(np.diff(theta)))) + 1
    assert len(turns) == motion.reversals and theta[[0, -1]].tolist() == [0, 0]
    for side in (0, 1):
        ends, rows = theta[turns[side::2]], np.diff(turns)[side::2]
        assert np.unique(np.round(np.abs(ends) / motion.amplitude, 3)).tolist() == [0.8, 0.9, 1.0]
        assert set(np.round(rows / motion.rows_per_cycle, 1)) == {0.5, 0.8}
    assert (
        np.abs(np.diff(theta, 2)).max()
        < 1.1 * motion.amplitude * (2 * np.pi / motion.rows_per_cycle) ** 2
    )


@pytest.mark.parametrize(
    ("pace", "place", "lowest", "said"),
    [
        (1.2, 1.2, -1, "one speed: "),
        (1.4, 1.2, -1, ""),
        (1.4, 1.2, -0.05, ""),
        (1.4, 1.0, -1, "the same turning points: "),
        (1.2, 1.0, -1, "one speed: .* and the same turning points: "),
    ],
)
def test_what_strokes_hide_that_are_alike(pace, place, lowest, said):
    """Every other cycle slower, and farther, on one side or both: as of a sine, 1/a = 0.005 rad."""
    cycles = [(100, 0.05), (round(100 * pace * place), 0.05 * place)] * 4
    theta = np.concatenate([far * np.sin(2 * np.pi * np.arange(n) / n) for n, far in cycles])
    theta = np.maximum(theta, lowest)
    log = Log("", theta, theta, np.arange(len(theta)) * 1e-3)
    words = variety.note([log], SIGMA0 / FC, 0.3 * FC / SIGMA0)
    assert re.search(said, words) if said else not words


def late_by_half(torque: np.ndarray, rows: int) -> np.ndarray:
    """Half of it at once, half through a first-order lag."""
    lagging, value = [], 0.0
    for one in torque.tolist():
        value += (one - value) / rows
        lagging.append(value)
    return (torque + np.array(lagging)) / 2


def test_what_one_speed_hides_this_motion_shows():
    """Half of the torque through a lag of 30 rows: a sine of one speed takes it for a softer
    bearing and can say no more than that; with the proposed strokes nothing wrong is claimed.
    """
    motion = design.propose(WANTED)
    rows = np.arange(motion.rows + 1)
    sine = motion.amplitude * np.sin(2 * np.pi * rows / motion.rows_per_cycle)
    for theta, told in ((sine, True), (motion.theta(), False)):
        log = measured(motion, 0)
        noise = log.torque - dahl_torque(motion.theta())
        log.theta = np.round(theta / COUNT) * COUNT
        log.torque = late_by_half(dahl_torque(theta), 30) + noise
        result = pipeline.identify([log])
        ends = result.estimate.ci95["sigma0"]
        assert told or not result.verdict.sigma0 or ends.low < SIGMA0 < ends.high
        assert any("strokes have one speed" in note for note in result.notes) is told


def test_an_encoder_that_is_too_coarse():
    with pytest.raises(Error, match="presliding is 1.3 counts of this encoder long"):
        design.propose(replace(WANTED, theta_per_count=COUNT * 10))


def test_the_command(run_dahl, tmp_path, dahl_loop, monkeypatch):
    """The scene finds its table beside it, also where the folder was named from here."""
    monkeypatch.chdir(tmp_path)
    known = tmp_path / "known.json"
    known.write_text(json.dumps({"sigma0": SIGMA0, "Fc": FC}), encoding="utf-8-sig")
    done = run_dahl("excite", "--from", known, "--counts-per-turn", "16384", "-o", "out")
    assert done.returncode == 0, done.stderr
    assert "cycles" in done.stdout
    assert "expected   sigma0 within" in done.stdout
    table = np.loadtxt("out/excite.csv", delimiter=",", skiprows=1)
    assert np.allclose(table[:, 1], table[:, 2] * COUNT, atol=0.51 * COUNT, rtol=0)
    assert scene.read(Path("out/excite.ini")).sigma0 == SIGMA0
    run = subprocess.run(
        [dahl_loop, "--scene", tmp_path / "out" / "excite.ini", "--virtual"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize(
    ("option", "value", "wish"),
    [
        ("--noise", "0.2", {"noise": 0.2}),
        ("--within", "0.5", {"within": 0.005}),
        ("--rate", "5000", {"rate": 5000}),
        ("--speed", "0.05", {"speed": 0.05}),
        ("--name", "My other/1", {}),
    ],
)
def test_each_option_shapes_the_motion(run_dahl, tmp_path, option, value, wish):
    """And what is printed of it is what the table holds."""
    known = ("--sigma0", SIGMA0, "--fc", FC, "--counts-per-turn", "16384", "-o", tmp_path)
    done = run_dahl("excite", *known, option, value)
    name = "my_other_1" if option == "--name" else "excite"
    time, theta, counts = np.loadtxt(tmp_path / f"{name}.csv", delimiter=",", skiprows=1).T
    motion = design.propose(replace(WANTED, **wish))
    assert theta == pytest.approx(motion.theta(), rel=1e-7, abs=1e-12)
    assert np.diff(time) == pytest.approx(1 / wish.get("rate", 1000), abs=2e-6)
    assert counts == pytest.approx(theta / COUNT, abs=0.501)
    said = [float(word) for word in re.findall(r"(?<= )\d[\d.]*(?=\s|$)", done.stdout)]
    cycle = motion.rows_per_cycle / motion.rate
    rows, far = len(theta) - 1, np.abs(theta).max()
    shown = [0.8 * far, far, motion.cycles, cycle, 1.6 * cycle]
    shown += [motion.reversals, rows / motion.rate, rows]
    assert said[:8] == pytest.approx(shown, rel=1e-3)
    assert said[8:10] == pytest.approx([100 * part for part in motion.within.values()], rel=0.05)


def test_counts_per_millimetre(run_dahl, tmp_path):
    known = ("--sigma0", "3e4", "--fc", "2.7", "--mm", "--counts-per-turn", "10000")
    done = run_dahl("excite", *known, "-o", tmp_path)
    assert done.returncode == 0 and re.search(r"strokes of \S+ to \S+ m to", done.stdout)
    assert scene.read(tmp_path / "excite.ini").theta_per_count == pytest.approx(1e-7)


@pytest.mark.parametrize(
    ("linear", "mm", "said"), [(1, (), "give --mm"), (0, ("--mm",), "leave out")]
)
def test_newtons_are_not_taken_for_newton_metres(run_dahl, tmp_path, linear, mm, said):
    known = tmp_path / "known.json"
    known.write_text(json.dumps({"sigma0": 3e4, "Fc": 2.7, "linear": bool(linear)}))
    done = run_dahl("excite", "--from", known, "--counts-per-turn", "10000", *mm, "-o", tmp_path)
    assert done.returncode == 2
    assert said in done.stderr


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--sigma0", "100"), "a guess is needed"),
        (("--sigma0", "-1", "--fc", "1"), "-1: not a number from 1e-30 to 1e+30"),
        (("--from", "absent.json"), "absent.json: no such file"),
        (("--sigma0", "1e30", "--fc", "0.5"), "sigma0 = 1e+30 is outside 2^-64 <= sigma0 < 2^64"),
        (("--sigma0", "1e9", "--fc", "0.5"), "presliding is"),
    ],
)
def test_bad_input(run_dahl, words, said):
    done = run_dahl("excite", "--counts-per-turn", "16384", *words)
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_motion_that_is_too_long_is_refused_with_its_length(run_dahl):
    words = "--counts-per-turn 16384 --sigma0 100 --fc 0.5 --within 0.0001".split()
    done = run_dahl("excite", *words)
    cycles, seconds = re.search(r"needs (\d+) cycles, (\d+) s;", done.stderr).groups()
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert 0.1 < int(seconds) / int(cycles) < 10


@pytest.mark.parametrize("text", ["{}", '{"sigma0": 1}', "[]", "5", '{"sigma0": "x", "Fc": 1}'])
def test_a_json_that_is_no_identification_is_one_line(run_dahl, tmp_path, text):
    (tmp_path / "x.json").write_text(text)
    done = run_dahl("excite", "--from", tmp_path / "x.json", "--counts-per-turn", 1000)
    assert done.returncode == 2
    words = f"error: {tmp_path / 'x.json'}: not what dahl identify leaves (sigma0 and Fc)\n"
    assert done.stderr == words


@pytest.mark.parametrize("end", ["csv", "ini"])
def test_a_file_of_someone_else_is_spared(run_dahl, tmp_path, end):
    """A measured log or a scene of that name stays, unless it is forced; an earlier motion goes."""
    theirs = tmp_path / f"shaft.{end}"
    theirs.write_text("time_s,theta,torque\n0,0,0\n")
    known = ("--sigma0", SIGMA0, "--fc", FC, "--counts-per-turn", "16384", "-o", tmp_path)
    done = run_dahl("excite", *known, "--name", "shaft")
    assert done.returncode == 2
    words = "there already, and not written by dahl; use --name, or --force to overwrite it"
    assert done.stderr == f"error: {theirs}: {words}\n"
    assert [path.read_text() for path in tmp_path.iterdir()] == ["time_s,theta,torque\n0,0,0\n"]
    assert run_dahl("excite", *known, "--name", "shaft", "--force").returncode == 0
    assert run_dahl("excite", *known, "--name", "shaft").returncode == 0
