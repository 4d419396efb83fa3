# SPDX-License-Identifier: MIT
"""The simulated axis of the scene compensation and the rival laws, each against a closed form, an
integration by scipy or another plant.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from dahl.binding.library import c
from dahl.sim import compensation_axis
from dahl.sim.compensation_axis import FC, GAINS, INERTIA, KD, PERIOD_S, SIGMA0, Case, learn, run
from scipy.integrate import solve_ivp
from scipy.signal import filtfilt

STEP_S = 1e-4
KINDS = ("DAHL", "LUGRE", "MAXWELL")
LAW = {"sigma0": 100.0, "Fc": 0.5, "breakaway": 0.5, "stribeck": 0.05, "inertia": INERTIA}
COUNT = 1e-5  # rad


@pytest.mark.parametrize("kind", GAINS)
def test_the_controller_has_the_torque_of_its_textbook(kind: str) -> None:
    """PD, PID, or a PI controller of the speed that a P controller of the angle asks for."""
    error, speed = np.random.default_rng(1).normal(size=(2, 50))
    asked = 50.0 * error + speed
    due = {
        "PD": 30 * error + 0.4 * speed,
        "PID": 30 * error + 0.4 * speed + 300 * np.cumsum(error) * 1e-3,
        "cascade": 0.4 * asked + 8 * np.cumsum(asked) * 1e-3,
    }
    controller = c.new("controller_t *", GAINS[kind])
    steps = zip(error, speed * 1e-3, strict=True)
    found = [c.dahl_controller_torque(controller, *step) for step in steps]
    assert found == pytest.approx(due[kind], rel=1e-12)


# --- true friction --------------------------------------------------------------------------------


def friction_over(kind: str, angles: np.ndarray) -> np.ndarray:
    """Torque after each angle, one step of 0.1 ms apart."""
    given = {"kind": getattr(c, f"DAHL_TRUE_{kind}"), "sigma0": SIGMA0, "Fc": FC}
    given |= {"breakaway": 1.4 * FC, "stribeck": 0.05, "sigma1": 0.1}
    params, friction = c.new("true_friction_params_t *", given), c.new("true_friction_t *")
    c.dahl_true_friction_open(params, friction)
    found = []
    for dtheta in np.diff(angles, prepend=0.0):
        c.dahl_true_friction_move(params, friction, dtheta, STEP_S)
        found.append(friction.torque)
    return np.array(found)


def test_dahl_friction_has_the_closed_form_of_each_branch() -> None:
    out = np.linspace(0, 0.01, 501)[1:]
    back = 0.01 - out
    torque = friction_over("DAHL", np.concatenate([out, back]))
    end = FC * (1 - math.exp(-SIGMA0 * 0.01 / FC))
    assert torque[:500] == pytest.approx(FC * (1 - np.exp(-SIGMA0 * out / FC)))
    assert torque[500:] == pytest.approx(-FC + (end + FC) * np.exp(-SIGMA0 * out / FC))


def test_maxwell_slip_follows_masing_and_slips_after_three_lengths() -> None:
    """A way back from A is twice the curve from rest, at half the travel (Masing)."""
    out = np.linspace(0, 0.015, 601)[1:]  # three lengths of 5 mrad
    torque = friction_over("MAXWELL", np.concatenate([out, 0.015 - out, -out]))
    assert torque[599] == pytest.approx(FC)
    half = np.interp(out / 2, [0, *out], [0, *torque[:600]])
    assert torque[600:1200] == pytest.approx(FC - 2 * half)
    assert torque[1199] > -FC and torque[-1] == pytest.approx(-FC)
    dahl = FC * (1 - np.exp(-SIGMA0 * out / FC)) / (1 - math.exp(-3))
    assert np.max(np.abs(torque[:600] - dahl)) < 0.03 * FC


def test_lugre_friction_solves_its_equations() -> None:
    def speed(t: float) -> float:
        return 0.3 * math.sin(2 * math.pi * 2 * t)

    def sliding(v: float) -> float:
        return FC * (1 + 0.4 * math.exp(-((v / 0.05) ** 2)))

    def rate(t: float, z: np.ndarray) -> np.ndarray:
        v = speed(t)
        return v - SIGMA0 * abs(v) / sliding(v) * z

    times = np.arange(1, 10_001) * STEP_S
    z = solve_ivp(rate, (0, 1), [0.0], t_eval=times, rtol=1e-8, atol=1e-12, max_step=1e-3).y[0]
    exact = SIGMA0 * z + 0.1 * np.array([rate(t, x) for t, x in zip(times, z, strict=True)])
    angle = 0.3 / (4 * math.pi) * (1 - np.cos(4 * math.pi * times))
    assert np.max(np.abs(friction_over("LUGRE", angle) - exact)) < 0.01 * FC


# --- axis -----------------------------------------------------------------------------------------


def test_the_shaft_is_that_of_dahl_loop_under_the_same_torque() -> None:
    """rotor.c integrates the friction of the library in steps of 20 us."""
    case = Case("", hold_s=1.0)
    found = run(case, "TANH", 0.03, 1)
    shaft = c.new("rotor_t *")
    c.dahl_rotor_open(shaft, INERTIA, 0.0, SIGMA0, FC)
    for tick, torque in enumerate(found.motor[:4000]):
        c.dahl_rotor_advance(shaft, torque)
        target = 0.3 * math.sin(math.pi * (tick + 1) * PERIOD_S)
        assert target - shaft.theta == pytest.approx(found.error[tick], abs=2e-4), tick


@pytest.mark.parametrize("kind", KINDS)
def test_the_step_is_fine_enough(kind: str, monkeypatch) -> None:
    case = Case("", friction=kind, hold_s=2.0)
    coarse = [run(case, law, 15.0, 1).rms for law in ("NONE", "DISTURBANCE", "DAHL")]
    monkeypatch.setattr(compensation_axis, "STEPS", 100)
    fine = [run(case, law, 15.0, 1).rms for law in ("NONE", "DISTURBANCE", "DAHL")]
    assert coarse == pytest.approx(fine, rel=0.03)


def test_the_loop_reads_only_the_encoder() -> None:
    """If a count is a turn, its torque is that of the reference alone, until the first count."""
    found = run(Case("", bits=0, noise=0, hold_s=0.0), "NONE", 0.0, 1)
    t = np.arange(len(found.feedback)) * PERIOD_S
    w = math.pi
    due = 30 * 0.3 * np.sin(w * t) + KD * 0.3 * w * np.cos(w * t)
    assert found.feedback[:100] == pytest.approx(due[:100], abs=1e-9)


def test_a_trial_adds_the_smooth_torque_of_the_loop(monkeypatch) -> None:
    """The first trial, by another filter that runs forward and back."""
    monkeypatch.setattr(compensation_axis, "TRIALS", 1)
    case = Case("", hold_s=0.0)
    found = learn(case, 20.0, 5)
    feedback = run(replace(case, hold_s=1.5), "NONE", 0.0, 5).feedback
    share = 2 * math.sin(math.pi * 20.0 * PERIOD_S)
    share = share * (math.sqrt(1 + share**2 / 4) - share / 2)  # of one pass at this corner
    due = filtfilt([share], [1, share - 1], feedback[2:])
    assert found[300:5000] == pytest.approx(due[300:5000], abs=5e-3)


# --- rivals ---------------------------------------------------------------------------------------


def torques(law: str, knob: float, ticks: int, is_hand: int = 0, **values) -> np.ndarray:
    """Torque in each tick; `values`: of LAW, or of each reading."""
    own = {key: values.pop(key) for key in LAW if key in values}
    given = LAW | own | {"law": getattr(c, f"DAHL_LAW_{law}"), "knob": knob}
    params = c.new("law_params_t *", given | {"theta_per_count": COUNT, "is_hand": is_hand})
    state, found = c.new("rival_t *"), []
    for tick in range(ticks):
        now = {key: value(tick) if callable(value) else value for key, value in values.items()}
        found.append(c.dahl_rival_torque(params, state, c.new("reading_t *", now)))
    return np.array(found)


@pytest.mark.parametrize("speed", [-0.2, -0.01, 0.0, 0.03, 0.5])
def test_laws_of_the_speed_have_their_formula(speed: float) -> None:
    """By the speed of the reference, or on a hand axis by the measured one after its low-pass."""
    due = {"SIGN": 0.5 * np.sign(speed), "TANH": 0.5 * math.tanh(speed / 0.1)}
    due |= {"DEAD_BAND": 0.5 * np.sign(speed) * (abs(speed) > 0.1), "NONE": 0.0}
    counts = round(speed * PERIOD_S / COUNT)
    for law, torque in due.items():
        for is_hand in (0, 1):
            found = torques(law, 0.1, 500, is_hand, dcounts=counts, target_speed=speed)
            assert found[-1] == pytest.approx(torque, abs=1e-9), law


def test_the_reversal_rule_has_its_time_constant() -> None:
    found = torques("REVERSAL", 0.04, 2000, target_speed=lambda k: 1.0 if k < 1000 else -0.2)
    after = np.arange(1, 1001) * PERIOD_S
    assert found[1000:] == pytest.approx(0.5 * (2 * np.exp(-after / 0.04) - 1), abs=1e-9)


def test_the_lugre_observer_is_lugre_at_constant_speed() -> None:
    """Without a low-pass; sigma0 z of the closed form. On a hand axis 0.9 of it."""
    angle = np.arange(1, 301) * 3 * COUNT
    for breakaway in (0.5, 0.7):
        g = 0.5 + (breakaway - 0.5) * math.exp(-((0.03 / 0.05) ** 2))
        due = g * (1 - np.exp(-100.0 * angle / g))
        for is_hand, gain in ((0, 1.0), (1, 0.9)):
            found = torques("LUGRE", 1e9, 300, is_hand, dcounts=3, breakaway=breakaway)
            assert found == pytest.approx(gain * due)


def test_the_disturbance_observer_returns_what_the_inertia_does_not_explain() -> None:
    """At rest all of the torque that acted; 1 N m at most. A negative knob adds a second pole."""
    fall = np.exp(-2 * math.pi * 10.0 * np.arange(1, 301) * PERIOD_S)
    for knob, due in ((10.0, 1 - fall), (-10.0, 1 - 2 * fall + fall**2)):
        still = torques("DISTURBANCE", knob, 300, acted=0.3)
        assert still == pytest.approx(0.3 * due, abs=0.01)
        moved = torques("DISTURBANCE", knob, 300, acted=0.3, dcounts=lambda k: 10 * k)  # 100 rad/s2
        assert moved[-1] == pytest.approx(0.3 - 100 * INERTIA, abs=1e-5)
        assert torques("DISTURBANCE", knob, 300, acted=-5.0)[-1] == -1.0


def test_a_learned_torque_is_that_of_the_table() -> None:
    assert [*torques("LEARNED", 0.0, 3, learned=lambda k: k / 7)] == [0, 1 / 7, 2 / 7]
