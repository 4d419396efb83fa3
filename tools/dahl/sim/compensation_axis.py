# SPDX-License-Identifier: MIT
"""Run one law of friction compensation on a simulated axis (host_sim/compare/compare.h)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from dahl.binding.library import c
from dahl.errors import RunError
from dahl.facts import PERIOD_US

FC, SIGMA0 = 0.5, 100.0  # N m, N m/rad: true friction, a presliding length of 5 mrad
BREAKAWAY, STRIBECK_SPEED, SIGMA1 = 1.4, 0.05, 0.1  # of Fc, rad/s, N m s/rad: of LuGre
INERTIA = 0.002  # kg m2
KP, KD = 30.0, 0.4  # N m/rad, N m s/rad
KI = 300.0  # N m/(rad s), of PID
CASCADE_KP, CASCADE_KI = 50.0, 8.0  # 1/s of the angle, N m/rad of the speed
GAINS = {  # of controller_t
    "PD": {"kp": KP, "kd": KD},
    "PID": {"kp": KP, "kd": KD, "ki": KI},
    "cascade": {
        "kp": CASCADE_KP * KD,
        "kd": KD,
        "ki": CASCADE_KP * CASCADE_KI,
        "ki_speed": CASCADE_KI,
    },
}
PERIOD_S = PERIOD_US / 1e6
STEPS = 5  # of the integration in a tick; with 50 the numbers are the same within their noise
SINE_HZ = 0.5
MOTION_S = 4.5  # s; the motion stops at a peak of its sine
FIRST_S, SETTLE_S = 1.0, 0.5  # s, at the start of motion and hold, that no number counts
TRIAL_HOLD_S = 1.5  # after the motion of each trial of a law that learns
TRIALS = 12  # of a law that learns


@dataclass(frozen=True)
class Case:
    """Encoder, delay, motion, true friction, and parameters that the laws assume over the right
    ones.
    """

    name: str
    bits: int = 17
    noise: int = 1  # counts
    delay: int = 1  # ticks
    Fc: float = 1.0
    sigma0: float = 1.0
    amplitude: float = 0.3  # rad, of the reference or of the hand
    loop: Literal["PD", "PID", "cascade", "hand"] = "PD"
    friction: Literal["DAHL", "LUGRE", "MAXWELL"] = "DAHL"
    second: float = 0.0  # share of a third harmonic in the motion
    hold_s: float = 30.0
    fallen_to: float = 1.0  # true Fc over that at the time of tuning and learning

    @property
    def theta_per_count(self) -> float:
        """rad."""
        return math.ldexp(2 * math.pi, -self.bits)


@dataclass(frozen=True)
class Run:
    """Traces of one law in one case: a value for each tick."""

    error: np.ndarray  # rad of tracking, or N m of the hand
    motor: np.ndarray  # N m
    added: np.ndarray  # N m, of the law alone
    feedback: np.ndarray  # N m, of the loop

    @property
    def rms(self) -> float:
        """RMS of the error in the motion."""
        moving = self.error[count_ticks(FIRST_S) : count_ticks(MOTION_S)]
        return float(np.sqrt(np.mean(moving**2)))

    @property
    def hold(self) -> float:
        """Largest error in the second half of the hold."""
        return float(np.max(np.abs(self._rest(self.error))))

    @property
    def noise(self) -> float:
        """Standard deviation of the motor torque in the same time, N m."""
        return float(np.std(self._rest(self.motor)))

    @property
    def sign_changes_per_s(self) -> float:
        """Sign changes of the added torque in a second of the hold."""
        signs = np.sign(self.added[count_ticks(MOTION_S + SETTLE_S) :])
        seconds = len(signs) * PERIOD_S
        signs = signs[signs != 0]
        return float(np.sum(signs[1:] != signs[:-1])) / seconds

    @staticmethod
    def _rest(values: np.ndarray) -> np.ndarray:
        return values[(len(values) + count_ticks(MOTION_S)) // 2 :]


def count_ticks(seconds: float) -> int:
    """Return the number of ticks in this time."""
    return round(seconds / PERIOD_S)


def run(case: Case, law: str, knob: float, seed: int, learned: np.ndarray | None = None) -> Run:
    """Run a law, named as in law_t. `learned` is a torque for each tick, and its last one goes on.
    The meaning of the knob stands at each law in host_sim/compare/rivals.c.
    """
    traces = np.zeros((4, count_ticks(MOTION_S + case.hold_s)))
    given = c.new("compare_run_t *", _values(case, law, knob, traces.shape[1], seed))
    table = np.zeros(traces.shape[1])
    if learned is not None:
        table[: len(learned)] = learned
        table[len(learned) :] = learned[-1]
    pointers = [c.from_buffer("double[]", values) for values in (table, *traces)]
    if code := c.dahl_compare_run(given, *pointers):
        raise RunError(f"{case.name}, {law}: the library returned {code}")
    return Run(*traces)


def _values(case: Case, law: str, knob: float, ticks: int, seed: int) -> dict[str, object]:
    has_stribeck = case.friction == "LUGRE"
    assumed = {
        "law": getattr(c, f"DAHL_LAW_{law}"),
        "knob": knob,
        "sigma0": case.sigma0 * SIGMA0,
        "Fc": case.Fc * FC,
        "breakaway": case.Fc * FC * (BREAKAWAY if has_stribeck else 1),
        "stribeck": STRIBECK_SPEED,
        "inertia": INERTIA,
        "speed_gain": KD,
        "theta_per_count": case.theta_per_count,
        "noise": case.noise,
        "delay": case.delay,
        "is_hand": case.loop == "hand",
        "has_integral": case.loop in ("PID", "cascade"),
    }
    true = {
        "kind": getattr(c, f"DAHL_TRUE_{case.friction}"),
        "sigma0": SIGMA0,
        "Fc": case.fallen_to * FC,
        "breakaway": BREAKAWAY * case.fallen_to * FC,
        "stribeck": STRIBECK_SPEED,
        "sigma1": SIGMA1,
    }
    return {
        "law": assumed,
        "friction": true,
        "controller": GAINS.get(case.loop, {}),
        "amplitude": case.amplitude,
        "frequency": SINE_HZ,
        "second": case.second,
        "motion_ticks": count_ticks(MOTION_S),
        "ticks": ticks,
        "steps": STEPS,
        "seed": seed,
    }


def learn(case: Case, corner: float, seed: int) -> np.ndarray:
    """Return the torque in N m for each tick that repeated trials of the motion learn. Each trial
    adds the torque of the loop, advanced by the delay. A low-pass without phase follows; `corner`
    is in Hz.
    """
    trial = replace(case, hold_s=TRIAL_HOLD_S)
    table = np.zeros(count_ticks(MOTION_S + TRIAL_HOLD_S))
    advance = case.delay + 1
    for k in range(TRIALS):
        feedback = run(trial, "LEARNED", 0.0, seed + k, table).feedback
        feedback = np.concatenate([feedback[advance:], np.repeat(feedback[-1], advance)])
        table = _smooth(table + feedback, corner)
    return table


def _smooth(values: np.ndarray, corner: float) -> np.ndarray:
    """Filter the values with a low-pass forward and back. They are extended point-symmetrically
    before the start, and constantly after the end.
    """
    n = len(values)
    padded = np.concatenate([2 * values[0] - values[:0:-1], values, np.repeat(values[-1], n)])
    spectrum = np.fft.rfft(padded) / (1 + (np.fft.rfftfreq(len(padded), PERIOD_S) / corner) ** 2)
    return np.fft.irfft(spectrum, len(padded))[n - 1 : 2 * n - 1]
