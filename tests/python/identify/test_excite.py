# SPDX-License-Identifier: MIT
"""`dahl excite`: the proposed motion, simulated and identified, reaches the wanted interval; its
table and scene have the printed numbers.
"""

import functools
import json
import re
import tempfile
from pathlib import Path

import motor_logs
import numpy as np
import pandas as pd
import pytest
from dahl.identify import identify
from identify_tools import COUNT, FC, SIGMA0, complaint, dahl_torque, log_of, replayed, turns_of
from log_reading import run

KNOWN = ("--sigma0", SIGMA0, "--fc", FC, "--counts-per-turn", "16384")
LENGTH = FC / SIGMA0  # rad, of presliding


@functools.cache
def proposed(*words: object) -> tuple[np.ndarray, np.ndarray, np.ndarray, str]:
    with tempfile.TemporaryDirectory() as folder:
        done = run("excite", *KNOWN, *words, "-o", folder)
        assert done.returncode == 0, done.stderr
        table = np.loadtxt(Path(folder) / "excite.csv", delimiter=",", skiprows=1)
    return (*table.T, done.stdout)


def test_the_interval_asked_for_is_reached():
    """The interval is wider than the error: it covers all hypotheses and the counts."""
    _, theta, _, said = proposed("--within", 1.0)
    result = identify([log_of(theta, dahl_torque(theta), 0.05)])
    assert result.claimed == (True, True), result.verdict
    assert result.sigma0.low <= SIGMA0 <= result.sigma0.high
    assert result.sigma0.value == pytest.approx(SIGMA0, rel=0.01)
    assert result.sigma0.half_width < 0.04
    expected = float(re.search(r"sigma0 within (\S+) %", said)[1])
    assert 0.2 < expected <= 1


def test_the_expected_widths_are_the_bound_of_cramer_and_rao():
    """A sine of the printed size and pace, with the noise of the sensor and of the counts."""
    _, theta, _, said = proposed("--noise", 0.1)
    turns, far = turns_of(theta), np.abs(theta).max()
    rows = 2 * np.diff(turns).min()
    path = far * np.sin(2 * np.pi * np.arange(3 * rows) / rows)
    columns = [np.ones(len(path)), path, np.gradient(path)]
    for part in (np.array([0.01, 0.0]), np.array([0.0, 0.01])):
        up, down = (dahl_torque(path, *((1 + s * part) * (SIGMA0, FC))) for s in (1, -1))
        columns.append((up - down) / 0.02)
    slope = np.gradient(dahl_torque(path)) / np.gradient(path)
    noise = np.hypot(0.1 * FC, slope * COUNT / np.sqrt(12))
    steady = (np.column_stack(columns) / noise[:, None])[2 * rows :]
    cycles = len(turns) / 2
    error = np.sqrt(np.diag(np.linalg.inv(steady.T @ steady))[3:] / cycles)
    expected = [float(width) for width in re.findall(r"within (\S+) %", said)]
    assert expected == pytest.approx(196 * error, rel=0.1)


def test_strokes_differ_in_length_and_speed_both_ways():
    """The motion begins and ends in the middle; each side has all lengths and paces; no jumps."""
    _, theta, _, _ = proposed()
    turns = turns_of(theta)
    far, shortest = np.abs(theta).max(), np.diff(turns).min()
    assert theta[[0, -1]].tolist() == [0, 0] and 3 * LENGTH < far < 30 * LENGTH
    for side in (0, 1):
        ends, rows = theta[turns[side::2]], np.diff(turns)[side::2]
        assert np.unique(np.round(np.abs(ends) / far, 3)).tolist() == [0.8, 0.9, 1.0]
        assert set(np.round(rows / shortest, 1)) == {1.0, 1.6, 2.6}
    bend = far * (np.pi / shortest) ** 2  # of a sine
    assert np.abs(np.diff(theta, 2)).max() < 1.1 * bend
    assert np.abs(np.diff(theta)).max() < LENGTH / 7


@pytest.mark.parametrize(
    "words", ["--noise 0.2", "--within 0.5", "--rate 5000", "--speed 0.05", "--name My-1"]
)
def test_each_option_shapes_the_motion_as_it_is_printed(words, tmp_path):
    done = run("excite", *KNOWN, *words.split(), "-o", tmp_path)
    name = "my_1" if "name" in words else "excite"
    time, theta, counts = np.loadtxt(tmp_path / f"{name}.csv", delimiter=",", skiprows=1).T
    turns = turns_of(theta)
    rate = 5000 if "rate" in words else 1000
    assert np.diff(time) == pytest.approx(1 / rate, abs=2e-6)
    assert counts == pytest.approx(theta / COUNT, abs=0.501)
    said = [float(word) for word in re.findall(r"(?<= )\d[\d.]*(?=\s|$)", done.stdout)]
    far, cycle = np.abs(theta).max(), 2 * np.diff(turns).min() / rate
    shown = [0.8 * far, far, len(turns) / 2, cycle, 2.6 * cycle, len(turns)]
    assert said[:6] == pytest.approx(shown, rel=0.02)
    assert said[6:8] == pytest.approx([time[-1], len(theta) - 1], rel=1e-3)
    usual, speed = len(proposed()[1]), rate * np.abs(np.diff(theta)).max()
    assert ("speed" in words) == (speed <= 0.05 * 1.001) and len(turns) >= 10
    assert (len(theta) > 1.5 * usual) == any(one in words for one in ("noise", "within", "speed"))


def test_the_scene_plays_the_table(tmp_path, dahl_loop):
    assert run("excite", *KNOWN, "-o", tmp_path).returncode == 0
    figure = replayed(tmp_path / "excite.ini", tmp_path)
    counts = np.loadtxt(tmp_path / "excite.csv", delimiter=",", skiprows=1)[:, 2]
    shown = figure.axes[0].lines[0].get_xdata() / COUNT
    assert shown == pytest.approx((counts - counts[0])[: len(shown)], abs=0.01)
    assert len(shown) >= len(counts) - 1


def test_linear_motion_is_in_metres_and_newtons(tmp_path):
    words = ("--counts-per-turn", "10000", "-o", tmp_path)
    done = run("excite", "--sigma0", "3e4", "--fc", "2.7", "--mm", *words)
    assert done.returncode == 0 and re.search(r"strokes of \S+ to \S+ m to", done.stdout)
    (count,) = re.findall(r"theta_per_count = (\S+)", (tmp_path / "excite.ini").read_text())
    assert float(count) == pytest.approx(1e-7)
    known = tmp_path / "known.json"
    for linear, option in ((True, ()), (False, ("--mm",))):
        claims = {"sigma0": True, "Fc": True}
        kept = {"sigma0": 3e4, "Fc": 2.7, "linear": linear, "identifiable": claims}
        known.write_text(json.dumps(kept))
        code, line = complaint(run("excite", "--from", known, *option, *words))
        assert code == 2 and str(known) in line and "--mm" in line


@pytest.mark.parametrize("claimed", [(True, True), (False, True), (True, False)])
def test_numbers_that_are_not_claimed_are_no_start(claimed, tmp_path):
    known, given = tmp_path / "known.json", []
    claims = dict(zip(("sigma0", "Fc"), claimed, strict=True))
    known.write_text(json.dumps({"sigma0": 36114.0, "Fc": FC, "identifiable": claims}))
    words = ("excite", "--from", known, "--counts-per-turn", 2**22, "-o", tmp_path)
    for (name, is_claimed), option in zip(claims.items(), ("--sigma0", "--fc"), strict=True):
        if not is_claimed:
            code, line = complaint(run(*words))
            assert code == 2 and name in line and option in line
            given += [option, FC if option == "--fc" else SIGMA0]
        else:
            assert "one guess" in complaint(run(*words, *given, option, 1))[1]
    assert run(*words, *given).returncode == 0


@pytest.mark.parametrize(("inertia", "bandwidth"), [(1e-3, 20), (2e-4, 3), (0.05, 50)])
def test_a_position_loop_can_follow_the_motion(inertia, bandwidth):
    """Friction holds the loop back by less than a quarter; its strokes are slow and light."""
    time, theta, _, _ = proposed("--inertia", inertia, "--bandwidth", bandwidth)
    far, step = np.abs(theta).max(), time[1] - time[0]
    seconds = 2 * np.pi * 0.9 * far / (np.abs(np.diff(theta)).max() / step)  # of the fastest cycle
    held_back = FC / (inertia * (2 * np.pi * bandwidth) ** 2)
    assert seconds >= 4.4 / bandwidth and far >= 3.9 * held_back
    torque = inertia * np.abs(np.diff(theta, 2)).max() / step**2
    assert torque < 0.56 * FC


INERTIA, BANDWIDTH = 0.002, 25.0  # kg m^2, Hz


def loop_log(path: Path, seconds: float) -> Path:
    """Write strokes of a loop around LuGre friction; the fastest takes that many seconds."""
    joint = motor_logs.Joint(INERTIA, 0.2, 0.02, 0.1, 0.3, 0.02, 42, 0.01 * FC, 1.0)
    rate = np.linspace(0.3, 1, 8000) / (2 * seconds)
    wanted = 0.12 * np.sin(2 * np.pi * np.cumsum(rate) / motor_logs.RATE)
    torque, theta = motor_logs._run(joint, wanted, BANDWIDTH, 1.0, 2 * np.pi / 2**16)
    torque += joint.noise * np.random.default_rng(1).normal(size=len(torque))
    table = pd.DataFrame({"time_s": np.arange(8000) / motor_logs.RATE, "angle_rad": theta})
    table.assign(target_rad=wanted, current_A=torque / 0.1).to_csv(path, index=False)
    return path


def test_a_log_of_the_loop_shows_inertia_and_bandwidth(tmp_path):
    words = "--loop", loop_log(tmp_path / "jog.csv", 0.12), "--torque-constant", 0.1
    _, theta, _, said = proposed(*words, "--reference", "target_rad")
    inertia, bandwidth = map(float, re.search(r"inertia (\S+) kg m\^2, (\S+) Hz", said).groups())
    assert inertia == pytest.approx(INERTIA, rel=0.1)
    assert bandwidth == pytest.approx(BANDWIDTH, rel=0.1)
    _, same, _, _ = proposed("--inertia", INERTIA, "--bandwidth", BANDWIDTH)
    assert len(theta) == pytest.approx(len(same), rel=0.1)
    assert "25 Hz" in proposed(*words, "--bandwidth", 25)[3]


@pytest.mark.parametrize(
    ("seconds", "words", "parts"),
    [
        (2.0, "--reference target_rad --torque-constant 0.1", ("the inertia", "--inertia")),
        (0.12, "--reference target_rad", ("current_A", "--torque-constant")),
        (0.12, "--torque-constant 0.1", ("--reference", "--bandwidth")),
        (0.12, "--reference angle_rad --torque-constant 0.1", ("the stiffness", "--bandwidth")),
    ],
)
def test_a_log_that_does_not_show_the_loop_is_refused(seconds, words, parts, tmp_path):
    path = loop_log(tmp_path / "jog.csv", seconds)
    code, line = complaint(run("excite", *KNOWN, "--loop", path, *words.split(), "-o", tmp_path))
    assert code == 2 and all(part in line for part in (str(path), *parts)), line


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        ("--sigma0 100", ("--sigma0", "--fc", "--from")),
        ("--sigma0 1e30 --fc 0.5", ("sigma0 = 1e+30", "2^64")),
        ("--sigma0 1000 --fc 0.5", ("presliding is 1.3 counts", "4 ")),
        ("--sigma0 100 --fc 0.5 --within 0.0001", (" cycles, ", " s;")),
    ],
)
def test_a_guess_that_no_motion_can_serve_is_refused(words, parts, tmp_path):
    words = (*words.split(), "--counts-per-turn", "16384", "-o", tmp_path)
    code, line = complaint(run("excite", *words))
    assert code == 2 and all(part in line for part in parts), line
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("end", ["csv", "ini"])
def test_a_foreign_file_is_not_overwritten(tmp_path, end):
    theirs, text = tmp_path / f"shaft.{end}", "time_s,theta,torque\n0,0,0\n"
    theirs.write_text(text)
    words = ("excite", *KNOWN, "-o", tmp_path, "--name", "shaft")
    code, line = complaint(run(*words))
    assert code == 2 and line.startswith(f"{theirs}: ") and "--name" in line and "--force" in line
    assert [path.read_text() for path in tmp_path.iterdir()] == [text]
    assert run(*words, "--force").returncode == 0
    assert run(*words).returncode == 0
