# SPDX-License-Identifier: MIT
"""What a scene may say: each number up to its limits and not beyond, and what it then does."""

from __future__ import annotations

import math
import re
import subprocess

import numpy as np
import pytest
from loop_tools import SCENES, counts_of, read_log, run, said, setting

BIG = 2147483647
LIMITS = [  # scene, key, least and greatest value
    ("steering", "friction.node", 0, 15),
    ("steering", "friction.timeout_ms", 1, 60000),
    ("parking", "friction.gain", 0, 1),
    ("parking", "friction.limit", 0, 1),
    ("parking", "friction.ramp_ms", 0, 60000),
    ("steering", "friction.max_step", 1, BIG),
    ("steering", "status.period_ms", 1, 60000),
    ("steering", "motion.start_count", -BIG, BIG),
    ("segments", "motion.theta1", -BIG, BIG),
    ("segments", "motion.theta2", -BIG, BIG),
    ("segments", "motion.theta3", -BIG, BIG),
    ("segments", "motion.speed", 1e-9, 1e12),
    ("segments", "motion.hold_s", 0, 3600),
    ("steering", "motion.hold_s", 0, 3600),
    ("steering", "motion.amplitude", 0, 1e9),
    ("steering", "motion.sweep_s", 0.001, 3600),
    ("steering", "motion.tremor", 0, 1e9),
    ("steering", "motion.tremor_s", 0, 3600),
    ("steering", "motion.seconds", 0.001, 1e9),
    ("creep", "rotor.viscous", 0, 2000),  # above, the shaft would be too light
    ("creep", "rotor.inertia", 5e-6, 1e6),
    ("creep", "rotor.Fc", 1e-9, 1e12),
    ("creep", "motor.bias", -1e12, 1e12),
    ("creep", "motor.amplitude", 0, 1e12),
    ("creep", "motor.frequency", 0, 100),
    ("creep", "motor.seconds", 0.001, 1e9),
    ("parking", "control.kp", 0, 1e12),
    ("parking", "control.kd", 0, 1e12),
    ("parking", "control.torque_limit", 0, 1e12),
    *(
        ("fault-storm", f"faults.{kind}", 0, 0.9)  # beside the others: the sum is at most 1
        for kind in ("drop", "duplicate", "reorder", "delay", "corrupt", "length", "id")
        + ("extended", "invalid", "glitch", "babble", "silence", "bus_off", "restart")
    ),
]


def answer(scene: str, *sets: str) -> subprocess.CompletedProcess:
    words = setting(*sets)
    path = str(SCENES / f"{scene}.ini")
    return said("--scene", path, "--virtual", "--seconds", "0.001", *words)


WHOLE = re.compile(r"\.(node|max_step|start_count|theta\d)$")


def beyond(value: float, side: int, whole: bool = False) -> float:
    """The next one out that the key could be meant for."""
    if whole:
        return value + side
    step = 1 if float(value).is_integer() and abs(value) > 1 else 1e-10 if value == 0 else 0.01
    return value + side * (step if value == 0 or step == 1 else abs(value) * step)


@pytest.mark.parametrize(
    ("scene", "key", "low", "high"), LIMITS, ids=[f"{scene} {key}" for scene, key, *_ in LIMITS]
)
def test_each_number_has_its_limits(scene, key, low, high):
    for value in (low, high):
        done = answer(scene, f"{key}={value!r}")
        assert (done.returncode, done.stderr) == (0, ""), value
    whole = bool(WHOLE.search(key))
    for value in (beyond(low, -1, whole), beyond(high, 1, whole) if high != 0.9 else 0.96):
        done = answer(scene, f"{key}={value!r}")
        assert done.returncode == 2, value
        assert done.stderr.startswith("error: ")
        assert done.stderr.count("\n") == 1
        section, name = key.split(".")
        most = 1 if high == 0.9 else high
        words = (
            f"error: --set:1: [{section}] {name} = {value!r}: outside {low:.10g} to {most:.10g}\n"
        )
        if key not in ("rotor.viscous", "rotor.inertia"):
            assert done.stderr == words or "rates add up" in done.stderr


@pytest.mark.parametrize(
    ("option", "least", "greatest", "wrong"),
    [
        ("--seconds", "0.001", "1e9", ("0.000999", "1.0001e9", "5m", "")),
        ("--seed", "0", "18446744073709551615", ("-1", "18446744073709551616", "1x", "")),
        ("--nodes", "1", "16", ("0", "17", "2.5")),
        ("--bitrate", "10000", "1000000", ("9999", "1000001", "500k")),
        ("--with-parent", "1", "2147483647", ("0", "2147483648", "1 2")),
        ("--wait-clients", "0", "0", ("-1", "17", "1.0")),  # more of them need a served bus
    ],
)
def test_each_option_has_its_limits(option, least, greatest, wrong):
    scene = ["--scene", SCENES / "steering.ini", "--virtual"]
    short = [*scene, "--set", "motion.seconds=0.001"]
    what = "a number" if option == "--seconds" else "an integer"
    most = "16" if option == "--wait-clients" else greatest
    taken = [least, greatest][option == "--with-parent" :]  # process 1 runs, and is no parent
    for value in (*taken, *wrong):
        done = said(*short, option, value)
        words = f"error: {option} {value}: not {what} from {least} to {most}\n"
        assert (done.returncode, done.stderr) == ((2, words) if value in wrong else (0, ""))


def test_rates_may_fill_one_and_no_more():
    calm = [f"faults.{key.partition('.')[2]}=0" for _, key, *_ in LIMITS if key[:6] == "faults"]
    assert answer("fault-storm", *calm, "faults.drop=0.5", "faults.id=0.5").returncode == 0
    done = answer("fault-storm", *calm, "faults.drop=0.5", "faults.id=0.51")
    assert (done.returncode, "add up to 1.01: above 1" in done.stderr) == (2, True)


@pytest.mark.parametrize("kilo", [0.999e-5, 1.0])
def test_travel_of_a_count_has_its_limits(kilo):
    """sigma0/Fc*theta: dahl_prepare's own."""
    done = answer("steering", f"friction.theta_per_count={kilo * 1.8 / 120 * 2e-4!r}")
    assert (done.returncode, done.stderr) == (0, "")
    for wrong in (1e-15, 1e9):
        assert answer("steering", f"friction.theta_per_count={wrong!r}").returncode == 2


def played(folder, scene: str, *sets: str) -> np.ndarray:
    """Counts of a whole run, unwrapped, shape (ticks,)."""
    words = setting(*sets)
    log = read_log(run(folder, SCENES / f"{scene}.ini", "--virtual", *words).log)
    return np.array(counts_of(log))


def test_segments_go_at_their_speed_and_rest_as_long_as_said(tmp_path):
    counts = played(tmp_path, "segments", "motion.speed=1000", "motion.hold_s=0.05")
    assert (counts[0], counts.max(), counts.min(), counts[-1]) == (0, 313, -104, 313)
    moves = np.diff(counts)
    assert set(moves.tolist()) == {-1, 0, 1}
    rests = [len(part) for part in "".join("r" if m == 0 else " " for m in moves).split()]
    assert len(rests) == 3
    assert all(abs(rest - 50) <= 1 for rest in rests)


def test_steering_keeps_its_amplitude_its_pace_and_its_tremor(tmp_path):
    quiet = ["motion.tremor=0", "motion.hold_s=0", "motion.sweep_s=1", "motion.amplitude=10000"]
    counts = played(tmp_path / "a", "steering", *quiet, "motion.seconds=60")
    assert len(counts) == 60000
    assert 9000 < np.abs(counts).max() <= 10000
    ends = counts[1:-1][np.diff(np.sign(np.diff(counts))) != 0]
    assert (np.abs(ends[np.abs(ends) > 100]) >= 3999).all()
    sides = np.sign(counts[np.abs(counts) > 3000])
    sweeps = np.count_nonzero(np.diff(sides))
    assert 60 / 1.4 - 3 < sweeps < 60 / 0.6 + 3


def test_a_sweep_takes_0_6_to_1_4_times_as_long_as_said(tmp_path):
    """Without rests there is one tick without a move at each end: 100 of them, drawn evenly."""
    quiet = ["motion.tremor=0", "motion.hold_s=0", "motion.sweep_s=1", "motion.amplitude=1e8"]
    counts = played(tmp_path, "steering", *quiet, "motion.seconds=100")
    ticks = np.diff(np.flatnonzero(np.diff(counts) == 0))
    assert 599 <= ticks.min() < 650 and 1350 < ticks.max() <= 1403
    assert ticks.mean() == pytest.approx(1000, rel=0.1)


def test_a_sweep_begins_and_ends_at_rest(tmp_path):
    """No jerk: 6 times its way over the square of its time, and half a count of each of three."""
    quiet = ["motion.tremor=0", "motion.hold_s=0.2", "motion.sweep_s=1", "motion.amplitude=1e6"]
    counts = played(tmp_path, "steering", *quiet, "motion.seconds=30")
    assert np.abs(np.diff(counts)).max() > 1500
    assert np.abs(np.diff(counts, 2)).max() < 6 * 2e6 / 600**2 + 2


def rests_of(counts: np.ndarray) -> list[int]:
    """Lengths in ticks of all stretches of 20 ticks and more without a move."""
    still = "".join("r" if move == 0 else " " for move in np.diff(counts)).split()
    return [len(part) for part in still if len(part) >= 20]


def test_steering_rests_at_its_ends_and_between_tremors(tmp_path):
    """As long as said, drawn evenly: hold_s from 0 to 1 of it, tremor_s from 0 to 2 of it."""
    held = ["motion.tremor=0", "motion.hold_s=2", "motion.sweep_s=0.1", "motion.amplitude=100000"]
    rests = rests_of(played(tmp_path / "a", "steering", *held, "motion.seconds=100"))
    assert max(rests) <= 2010
    assert np.mean(rests) == pytest.approx(1000, rel=0.3)
    bumps = ["motion.tremor=50000", "motion.tremor_s=0.5", "motion.amplitude=0"]
    shaken = played(tmp_path / "b", "steering", *bumps, "motion.seconds=60")
    assert 30000 < np.abs(shaken).max() <= 50000
    assert shaken.min() < 0 < shaken.max()
    rests = rests_of(shaken)
    assert max(rests) <= 1020
    assert np.mean(rests) == pytest.approx(500, rel=0.3)
    assert len(rests) == pytest.approx(60 / (0.5 + 0.07), rel=0.2)  # a tremor takes 20 to 120 ms


@pytest.mark.parametrize(("max_step", "used"), [(2, True), (1, False)])
def test_a_move_beyond_max_step_is_a_jump(tmp_path, max_step, used):
    """Two counts a tick."""
    words = setting("motion.speed=2000", f"friction.max_step={max_step}")
    result = run(tmp_path, SCENES / "segments.ini", "--virtual", *words)
    assert (result.summary["node"]["jump"] == 0) == used


def test_a_driven_shaft_ends_when_its_motor_does(tmp_path):
    for ticks in (1500, 1300, 9):
        words = setting(f"motor.seconds={ticks / 1000}")
        assert run(tmp_path, SCENES / "creep.ini", "--virtual", *words).summary["ticks"] == ticks


def test_the_motor_does_what_the_scene_says(tmp_path):
    trace = tmp_path / "trace.csv"
    words = setting("motor.bias=0.2", "motor.amplitude=0.3", "motor.frequency=5", "motor.seconds=1")
    run(tmp_path, SCENES / "creep.ini", "--virtual", "--trace", str(trace), *words)
    table = np.loadtxt(trace, delimiter=",", skiprows=1)
    due = 0.2 + 0.3 * np.sin(2 * math.pi * 5 * table[:, 0])
    assert np.abs(table[:, 4] - due).max() < 1e-9
