# SPDX-License-Identifier: MIT
"""The closed loop: a rotor against an ODE solver, and what friction compensation is worth."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from loop_tools import SCENES, counts_of, read_log, run, setting, torques_of
from scipy.integrate import solve_ivp

SIGMA0, FC = 120.0, 1.8
INERTIA = 0.02
COLUMNS = ("time", "reference", "angle", "velocity", "motor", "friction", "compensation")
NAMED = ("time_s", "reference_rad", "angle_rad", "velocity_rad_s")  # in the file, with units
NAMED += ("motor_Nm", "friction_Nm", "compensation_Nm")


def traced(folder: Path, scene: str, *sets: str) -> tuple[dict[str, np.ndarray], dict]:
    """Columns of --trace, each of shape (ticks,), and the summary."""
    words = setting(*sets)
    folder.mkdir(exist_ok=True)
    trace = folder / "trace.csv"
    result = run(folder, SCENES / f"{scene}.ini", "--virtual", "--trace", str(trace), *words)
    assert result.code == 0, result.err
    table = np.loadtxt(trace, delimiter=",", skiprows=1)
    assert trace.read_text(encoding="ascii").split("\n", 1)[0] == ",".join(NAMED)
    return dict(zip(COLUMNS, table.T, strict=True)), result.summary


def solved(motor: np.ndarray, viscous: float, start: int, state: np.ndarray) -> np.ndarray:
    """(angle, velocity, friction) at each tick from `start` on, by an ODE solver.

    Each tick is solved by itself, since the motor's torque leaps between two.
    """

    def slope(_: float, y: np.ndarray, torque: float) -> tuple[float, float, float]:
        _, omega, friction = y
        bristle = SIGMA0 * (omega - abs(omega) * friction / FC)
        return omega, (torque - viscous * omega - friction) / INERTIA, bristle

    states = [state]
    for torque in motor[start:]:
        done = solve_ivp(
            slope, (0, 0.001), states[-1], args=(torque,), method="DOP853", rtol=1e-11, atol=1e-13
        )
        states.append(done.y[:, -1])
    return np.array(states[:-1])


@pytest.mark.parametrize(
    ("scene", "viscous", "ticks", "angle_limit"),
    [
        ("creep", 0.5, 1500, 3e-6),
        ("slow-reversal", 0.02, 4000, 1e-5),
        ("parking", 0.05, 4000, 1e-5),
    ],
)
def test_the_rotor_does_what_an_ode_solver_says(tmp_path, scene, viscous, ticks, angle_limit):
    """With the motor torque that the loop applied, from rest."""
    trace, _ = traced(tmp_path, scene)
    motor = trace["motor"][:ticks]
    angle, velocity, friction = solved(motor, viscous, 0, np.zeros(3)).T
    assert np.abs(angle).max() > 100 * angle_limit
    assert np.abs(trace["angle"][:ticks] - angle).max() < angle_limit
    assert np.abs(trace["velocity"][:ticks] - velocity).max() < 1e-3
    assert np.abs(trace["friction"][:ticks] - friction).max() < 1e-3 * FC


@pytest.mark.parametrize(("scene", "seen"), [("creep", "angle"), ("parking", "reference")])
def test_the_trace_is_what_was_on_the_bus(tmp_path, scene, seen):
    """Row by row: the angle that the encoder streamed, and the answer to the one before it."""
    trace, summary = traced(tmp_path, scene)
    log = read_log(tmp_path / "run.log")
    streamed = np.array(counts_of(log)) * float(np.float32(2 * np.pi / 2**24))
    answers = np.array([ratio for _, ratio in torques_of(log)]) * 2.0**-30 * float(np.float32(FC))
    helped = answers if scene == "parking" else np.zeros(len(answers))
    assert len(trace["time"]) == len(streamed) == len(answers) == summary["ticks"]
    assert np.abs(trace["time"] - np.arange(len(streamed)) * 1e-3).max() < 1e-9
    assert np.abs(trace["reference"] - streamed).max() < 1e-12
    assert np.abs(trace[seen] - streamed).max() < 2e-7  # half a count
    assert np.abs(trace["compensation"][1:] - helped[:-1]).max() < 1e-12


def test_presliding_creep(tmp_path):
    """The torque never reaches Fc. A steady one moves the shaft once; a vibration lets it creep."""
    steady, _ = traced(tmp_path / "a", "creep", "motor.amplitude=0")
    held = steady["angle"][-1]
    assert steady["friction"][-1] == pytest.approx(0.9, rel=1e-6)
    assert steady["angle"][-10000] == pytest.approx(held, abs=1e-7)
    shaken, summary = traced(tmp_path / "b", "creep")
    assert "control" not in summary
    assert np.abs(shaken["motor"]).max() < 0.75 * FC
    cycles = shaken["angle"][::500]
    assert (np.diff(cycles)[1:] > 0).all()
    assert cycles[-1] > 2 * held


@pytest.mark.parametrize("scene", ["slow-reversal", "parking"])
def test_compensation_is_worth_a_factor_of_five(tmp_path, scene):
    _, without = traced(tmp_path / "a", scene, "friction.gain=0")
    trace, with_it = traced(tmp_path / "b", scene)
    assert np.abs(trace["compensation"]).max() <= 0.95 * FC * (1 + 1e-6)
    ratio = without["control"]["rms_error_rad"] / with_it["control"]["rms_error_rad"]
    assert ratio >= 5


@pytest.mark.parametrize("scene", ["slow-reversal", "parking"])
def test_no_chatter(tmp_path, scene):
    """The motor's torque changes its sign once for each reversal of the motion, and no more."""
    trace, summary = traced(tmp_path, scene)
    control = summary["control"]
    assert control["reference_reversals"] >= 2
    assert control["torque_alternations"] <= control["reference_reversals"]
    for name in ("motor", "compensation"):
        signs = np.sign(trace[name])
        signs = signs[signs != 0]
        assert np.count_nonzero(np.diff(signs)) <= control["reference_reversals"], name
    steps = np.sign(np.diff(trace["reference"]))
    assert np.count_nonzero(np.diff(steps[steps != 0])) == control["reference_reversals"]


def test_the_summary_counts_the_turns_of_motor_and_reference_apart(tmp_path):
    """With a trembling reference these are not as many."""
    sets = ("motion.tremor=20000", "motion.tremor_s=0.2", "motion.seconds=10")
    trace, summary = traced(tmp_path, "parking", *sets)
    turns = {}
    for name, signs in (
        ("torque_alternations", np.sign(trace["motor"])),
        ("reference_reversals", np.sign(np.diff(trace["reference"]))),
    ):
        turns[name] = np.count_nonzero(np.diff(signs[signs != 0]))
    assert {name: summary["control"][name] for name in turns} == turns
    assert len(set(turns.values())) == 2 and min(turns.values()) > 2


@pytest.mark.parametrize("side", [1, -1])
def test_the_errors_of_the_summary_are_those_of_the_trace(tmp_path, side):
    """Whichever side the largest one is on."""
    ends = {"theta1": 100000, "theta2": 90000, "theta3": 100000}
    sets = [f"motion.{name}={side * count}" for name, count in ends.items()]
    trace, summary = traced(tmp_path, "slow-reversal", *sets)
    error = trace["reference"] - trace["angle"]
    assert np.sign(error[np.abs(error).argmax()]) == side
    control = summary["control"]
    assert control["max_error_rad"] == pytest.approx(np.abs(error).max(), rel=1e-9)
    assert control["rms_error_rad"] == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-9)


@pytest.mark.parametrize(("kp", "kd"), [(60, 0), (0, 2)])
def test_the_controller_is_proportional_and_derivative(tmp_path, kp, kd):
    """On a heavy shaft, which hardly follows. What is made of the error's rate adds up to it, by
    the filter 4 ticks later.
    """
    sets = ("rotor.inertia=1e6", "friction.gain=0", "control.torque_limit=1e9")
    trace, _ = traced(tmp_path, "parking", *sets, f"control.kp={kp}", f"control.kd={kd}")
    error = trace["reference"] - trace["angle"]
    made = trace["motor"] if kp else np.cumsum(trace["motor"]) * 1e-3
    late, bound = (0, 60 * 2e-7) if kp else (4, 5e-4)  # half a count; how the speed changes
    assert np.abs(error).max() > 1
    due = np.concatenate([np.zeros(late), (kp + kd) * error])[: len(made)]
    assert np.abs(made - due).max() < bound


def test_a_motor_without_torque_is_traced_as_such(tmp_path):
    """Once the reference is back at a shaft that is too heavy to have moved a count."""
    ends = [f"motion.theta{n + 1}={count}" for n, count in enumerate((800, 0, 0))]
    sets = ("rotor.inertia=1e6", "friction.gain=0", "control.kd=0", *ends)
    trace, _ = traced(tmp_path, "slow-reversal", *sets)
    assert np.array_equal(trace["motor"] > 0, trace["reference"] > 0)


def test_the_motor_gives_no_more_than_its_limit(tmp_path):
    """With the compensation, which alone would ask for more; and that has a limit of its own."""
    trace, _ = traced(tmp_path, "parking", "control.torque_limit=1.5")
    assert np.abs(trace["compensation"]).max() > 1.6
    assert np.abs(trace["motor"]).max() == 1.5
    trace, _ = traced(tmp_path, "parking", "friction.limit=0.5")
    assert np.abs(trace["compensation"]).max() == pytest.approx(0.5 * FC, rel=1e-6)


def test_the_ramp_takes_its_time(tmp_path):
    """2 s from 0 to 1: half of the friction after a second, while the shaft slides."""
    trace, _ = traced(tmp_path, "slow-reversal", "friction.ramp_ms=2000")
    assert trace["compensation"][1000] == pytest.approx(0.5 * FC, rel=0.05)


def test_too_much_compensation_runs_ahead(tmp_path):
    """A third too much: while it slides the shaft is ahead of its reference, not behind."""
    behind, _ = traced(tmp_path / "a", "slow-reversal")
    ahead, summary = traced(tmp_path / "b", "over-compensation")
    at = slice(1000, 1600)
    lag = behind["reference"][at] - behind["angle"][at]
    lead = ahead["angle"][at] - ahead["reference"][at]
    assert (lag > 0).all()
    assert (lead > 0).all()
    assert lead.mean() == pytest.approx((2.4 - FC) / 60, rel=0.1)
    assert summary["control"]["rms_error_rad"] > 2 * np.sqrt(np.mean(lag**2))


def test_the_loop_survives_a_storm(tmp_path):
    """The same manoeuvre with a tenth of the frames spoiled: the tracking is hardly worse."""
    storm = [f"faults.{kind}=0.02" for kind in ("drop", "corrupt", "delay", "duplicate", "glitch")]
    _, calm = traced(tmp_path / "a", "parking")
    _, rough = traced(tmp_path / "b", "parking", "friction.max_step=100000", *storm)
    assert rough["node"]["crc"] > 100
    assert rough["faults"]["expected"]["ok"] == rough["node"]["ok"]
    assert rough["control"]["rms_error_rad"] < 1.3 * calm["control"]["rms_error_rad"]


def test_a_scene_without_a_rotor_has_none(tmp_path):
    plain = run(tmp_path, SCENES / "segments.ini", "--virtual")
    assert not {"control", "faults", "bus_load"} & plain.summary.keys()


@pytest.mark.parametrize(
    ("scene", "sets"),
    [
        ("creep", ["motor.bias=1e12", "rotor.inertia=5e-6"]),
        ("slow-reversal", ["control.kp=1e12", "control.torque_limit=1e12", "rotor.inertia=3e-7"]),
    ],
)
def test_a_shaft_that_runs_away_is_told(tmp_path, scene, sets):
    """Beyond 2^53 counts: an error, and what was sent before is in the log."""
    result = run(tmp_path, SCENES / f"{scene}.ini", "--virtual", *setting(*sets))
    assert result.code == 2
    start = r"error: \[rotor\] after 0\.\d+ s: the shaft is at \S+ rad, "
    assert re.fullmatch(start + r"\S+ counts: outside \+-2\^53\n", result.err)
    assert len(list(read_log(result.log))) > result.summary["ticks"] > 0


def test_a_shaft_may_go_as_far_as_its_limit(tmp_path):
    """At a thousandth of the way a tick, the one that is told is just beyond."""
    fast = setting("motor.bias=2e9")  # against the viscous friction: 4e9 rad/s
    result = run(tmp_path, SCENES / "creep.ini", "--virtual", *fast)
    counts = float(re.search(r"(\S+) counts: outside", result.err)[1])
    assert 2**53 < counts < 1.002 * 2**53


ROTOR = """[friction]
sigma0 = 120
Fc = 1.8
theta_per_count = 3.7e-7
[rotor]
inertia = {inertia!r}
viscous = {viscous!r}
sigma0 = {sigma0!r}
Fc = 1.8
[motor]
bias = 1
amplitude = 2
frequency = 5
seconds = 2
"""


@pytest.mark.parametrize("viscous", [0.0, 1e-4, 0.5, 100.0])
@pytest.mark.parametrize("sigma0", [10.0, 120.0, 314.159265358, 1e6])
def test_a_shaft_too_light_for_the_step_is_refused_and_the_lightest_is_stable(
    tmp_path, viscous, sigma0
):
    """At the limit that the message names no speed and no friction grows beyond what drives it."""
    path = tmp_path / "scene.ini"
    path.write_text(ROTOR.format(inertia=1e-9, viscous=viscous, sigma0=sigma0))
    refused = run(tmp_path, path, "--virtual")
    assert refused.code == 2
    assert refused.err.startswith(f"error: {path}:6: [rotor] inertia = 1e-09: below ")
    least = float(re.search(r"below (\S+),", refused.err)[1])
    path.write_text(ROTOR.format(inertia=least, viscous=viscous, sigma0=sigma0))
    trace = tmp_path / "trace.csv"
    done = run(tmp_path, path, "--virtual", "--trace", str(trace))
    if viscous == 0 and "outside" in done.err:
        return  # free and light: it does fly away
    assert done.code == 0, done.err
    table = np.loadtxt(trace, delimiter=",", skiprows=1)
    assert np.isfinite(table).all()
    assert np.abs(table[:, 5]).max() <= 1.8 * (1 + 1e-6)
    if viscous >= 0.5:  # overdamped: the speed follows the torque
        assert np.abs(table[:, 3]).max() <= 1.05 * (3 + 1.8) / viscous


def test_a_receiver_that_hears_nothing_for_3_periods_takes_0(tmp_path):
    """The drive uses the last torque for three ticks after its frame, and none after that."""
    sets = ("friction.max_step=100000", "faults.drop=0.45", "friction.ramp_ms=0")
    trace, _ = traced(tmp_path, "parking", *sets)
    log = read_log(tmp_path / "run.log")
    answered = {round(frame.time * 1000) for frame in log if frame.id == 0x110}
    used = [any(tick - age in answered for age in (1, 2, 3)) for tick in range(len(trace["time"]))]
    moving = slice(1000, None)  # from where on the node's torque is not 0 by itself
    assert ((trace["compensation"] != 0)[moving] == np.array(used)[moving]).all()
    assert 100 < used[1000:].count(False) < len(used) / 2
