# SPDX-License-Identifier: MIT
"""Compare laws of friction compensation on two simulated axes: one with a position loop, one that
a hand leads along a path. Shaft and controller are those of dahl-loop (host_sim/rotor.h,
controller.h); encoder and drive are simulated here.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np

from dahl.binding.compensator import Compensator
from dahl.binding.friction import Friction, Plan
from dahl.binding.library import c
from dahl.binding.residual import Residual
from dahl.facts import PERIOD_US

FC, SIGMA0 = 0.5, 100.0  # N m, N m/rad: true friction, a presliding length of 5 mrad
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
MOTION_S, HOLD_S, SETTLE_S = 4.5, 1.5, 0.5  # s; the reference stops at a peak of its sine
FIRST_S = 1.0  # s, left out of each RMS
SINE_HZ = 0.5
TANH_SPEED, DEAD_BAND = 0.02, 0.1  # rad/s
SPEED_FILTER_HZ = 40.0  # low-pass of the measured speed, which the usual laws need
GAIN_MEASURED = 0.9
CORNER_HZ = 15.0  # of the residual observer
LIMIT, SLEW = 1.0, 50.0  # N m, N m/s


@dataclass(frozen=True)
class Case:
    """Encoder, delay of the drive, and the friction that the laws assume over the true one."""

    name: str
    bits: int
    noise: int = 0  # counts
    delay: int = 1  # ticks
    Fc: float = 1.0
    sigma0: float = 1.0
    amplitude: float = 0.3  # rad, of the reference or of the hand
    loop: Literal["PD", "PID", "cascade"] = "PD"

    @property
    def theta_per_count(self) -> float:
        """rad."""
        return math.ldexp(2 * math.pi, -self.bits)


POSITION_CASES = (
    Case("17 bits", 17),
    Case("14 bits, noise 2, delay 3", 14, noise=2, delay=3),
    Case("17 bits, integral", 17, loop="PID"),
    Case("17 bits, cascade", 17, loop="cascade"),
    Case("Fc 30 % low", 17, Fc=0.7),
    Case("Fc 30 % high", 17, Fc=1.3),
    Case("sigma0 / 3", 17, sigma0=1 / 3),
    Case("sigma0 x 3", 17, sigma0=3),
    Case("10 mrad to and fro", 17, noise=1, delay=2, amplitude=0.005),
)
HAND_CASES = (
    Case("17 bits, noise 1", 17, noise=1),
    Case("14 bits, noise 2, delay 3", 14, noise=2, delay=3),
    Case("12 bits, noise 1", 12, noise=1),
    Case("Fc 30 % low, sigma0 / 4", 14, noise=1, Fc=0.7, sigma0=0.25),
    Case("5 mrad to and fro", 14, noise=2, amplitude=0.0025),
)
SHOWN_POSITION, SHOWN_HAND = POSITION_CASES[-1], HAND_CASES[-1]  # cases of the picture


@dataclass
class Run:
    """Traces of one law in one case, and the numbers drawn from them."""

    error: list[float] = field(default_factory=list)  # rad of tracking, or N m of the hand
    motor: list[float] = field(default_factory=list)  # N m
    added: list[float] = field(default_factory=list)  # N m, of the law alone

    def rms(self, seconds: float) -> float:
        """RMS of the error up to this time."""
        part = np.array(self.error[_ticks(FIRST_S) : _ticks(seconds)])
        return float(np.sqrt(np.mean(part**2)))

    def sign_changes(self, since: float) -> float:
        """Sign changes of the added torque in a second, from this time on."""
        signs = np.sign(self.added[_ticks(since) :])
        signs = signs[signs != 0]
        return float(np.sum(signs[1:] != signs[:-1])) / (len(self.added) * PERIOD_S - since)


def _ticks(seconds: float) -> int:
    return round(seconds / PERIOD_S)


class Law(Protocol):
    """A law of compensation: returns the torque in N m, once in each tick."""

    def torque(self, dcounts: int, reference_move: int, reference_speed: float) -> float:
        """Read the counts of encoder and reference, and the speed of the reference in rad/s."""

    def note(self, command: float) -> None:
        """Read the command in N m that follows from this torque."""


class SpeedLaw:
    """A usual law: Fc times a function of the speed."""

    def __init__(self, case: Case, shape: Callable[[float], float], by_reference: bool) -> None:
        self._Fc, self._shape, self._by_reference = case.Fc * FC, shape, by_reference
        self._per_count = case.theta_per_count / PERIOD_S
        self._share = 1 - math.exp(-2 * math.pi * SPEED_FILTER_HZ * PERIOD_S)
        self._speed = 0.0

    def torque(self, dcounts: int, reference_move: int, reference_speed: float) -> float:
        """Use the reference, or the measured speed behind a low-pass."""
        self._speed += (dcounts * self._per_count - self._speed) * self._share
        return self._Fc * self._shape(reference_speed if self._by_reference else self._speed)

    def note(self, command: float) -> None:
        """Use no command."""


class DahlLaw:
    """dahl.Compensator with either law, and dahl.Residual with that of the reference."""

    def __init__(self, case: Case, is_reference: bool) -> None:
        Fc, sigma0 = case.Fc * FC, case.sigma0 * SIGMA0  # noqa: N806
        plan = Plan(sigma0, Fc, case.theta_per_count)
        self._element, self._known = Friction(plan), 0.0
        self._is_reference = is_reference
        self._compensator = Compensator(
            plan.sigma0,
            plan.Fc,
            plan.theta_per_count,
            Fc_low=plan.Fc,
            length_long=0.999 * plan.Fc / plan.sigma0,  # a bound in float, just met
            sigma0_high=SIGMA0,
            inertia=INERTIA,
            delay=case.delay * PERIOD_S,
            reference=is_reference,
            gain=1.0 if is_reference else GAIN_MEASURED,
            noise=case.noise,
            play=max(1, 2 * case.noise),
            limit=LIMIT,
            slew=SLEW,
            period=PERIOD_S,
        )
        self._residual = Residual(
            plan.sigma0,
            plan.Fc,
            plan.theta_per_count,
            inertia=INERTIA,
            corner=CORNER_HZ,
            limit=plan.Fc,
            slew=SLEW,
            speed_gain=KD,
            period=PERIOD_S,
            delay=case.delay,
        )

    def torque(self, dcounts: int, reference_move: int, reference_speed: float) -> float:
        """Step the element by the reference, or by the measured counts behind the play."""
        move = self._compensator.move(dcounts)
        if not self._is_reference:
            return self._compensator.torque(self._element.step_counts_q30(move))
        self._known = self._compensator.torque(self._element.step_counts_q30(reference_move))
        return self._known + self._residual.torque(self._compensator, dcounts)

    def note(self, command: float) -> None:
        """Note the torque that the reference law does not explain."""
        self._residual.note(command - self._known)


def laws(case: Case, is_position: bool) -> dict[str, Law]:
    """Return new laws by name; "none" is first. A dead band always uses the measured speed."""
    return {
        "none": SpeedLaw(case, lambda v: 0.0, is_position),
        "sign": SpeedLaw(case, lambda v: float(np.sign(v)), is_position),
        "tanh": SpeedLaw(case, lambda v: math.tanh(v / TANH_SPEED), is_position),
        "dead band": SpeedLaw(case, lambda v: math.copysign(abs(v) > DEAD_BAND, v), False),
        "dahl": DahlLaw(case, is_position),
    }


class Encoder:
    """Counts of an angle. Noise within +-noise counts is added before the rounding."""

    def __init__(self, case: Case, seed: int) -> None:
        self._case, self._random = case, random.Random(seed)
        self.counts = 0

    def move(self, theta: float) -> int:
        """Return the counts since the last reading."""
        noise = self._case.noise * self._random.uniform(-1, 1)
        before, self.counts = self.counts, math.floor(theta / self._case.theta_per_count + noise)
        return self.counts - before


def reference(amplitude: float, t: float) -> tuple[float, float, float]:
    """Return angle, speed and acceleration at a time in s: a sine, then a hold at its peak."""
    w = 2 * math.pi * SINE_HZ
    angle, speed = amplitude * math.sin(w * min(t, MOTION_S)), amplitude * w * math.cos(w * t)
    return (angle, speed, -w * w * angle) if t < MOTION_S else (angle, 0.0, 0.0)


def track(case: Case, law: Law, seed: int) -> Run:
    """Run the axis with a position loop. The loop reads the angle by the encoder and the speed
    without an error."""
    run, encoder = Run(), Encoder(case, seed)
    shaft, controller = c.new("rotor_t *"), c.new("controller_t *", GAINS[case.loop])
    c.dahl_rotor_open(shaft, INERTIA, 0.0, SIGMA0, FC)
    commands = [0.0] * (case.delay + 1)  # the last acts in this tick
    reference_counts = 0
    for tick in range(_ticks(MOTION_S + HOLD_S)):
        target, target_speed, acceleration = reference(case.amplitude, tick * PERIOD_S)
        before, reference_counts = reference_counts, math.floor(target / case.theta_per_count)
        added = law.torque(encoder.move(shaft.theta), reference_counts - before, target_speed)
        error = target - encoder.counts * case.theta_per_count
        change = (target_speed - shaft.omega) * PERIOD_S
        feedback = c.dahl_controller_torque(controller, error, change)
        commands = [feedback + INERTIA * acceleration + added, *commands[:-1]]
        law.note(commands[0])
        c.dahl_rotor_advance(shaft, commands[-1])
        run.error.append(reference(case.amplitude, (tick + 1) * PERIOD_S)[0] - shaft.theta)
        run.motor.append(commands[-1])
        run.added.append(added)
    return run


def lead(case: Case, law: Law, seed: int) -> Run:
    """Run the axis that a hand leads; the error is the torque of the hand."""
    run, bearing, encoder = Run(), Friction(Plan(SIGMA0, FC)), Encoder(case, seed)
    commands = [0.0] * (case.delay + 1)
    theta = 0.0
    for tick in range(_ticks(MOTION_S + HOLD_S)):
        s = 2 * math.pi * SINE_HZ * tick * PERIOD_S
        before, theta = theta, case.amplitude * (math.sin(s) + 0.2 * math.sin(3.4 * s))
        added = law.torque(encoder.move(before), 0, 0.0)
        commands = [added, *commands[:-1]]
        run.error.append(bearing.step(theta - before) - commands[-1])
        run.motor.append(commands[-1])
        run.added.append(added)
    return run


AXES = {  # cases; how to run them; s, up to which the error counts
    "position": (POSITION_CASES, track, MOTION_S),
    "hand": (HAND_CASES, lead, MOTION_S + HOLD_S),
}


Numbers = dict[str, dict[str, dict[str, dict[str, float]]]]  # by axis, case, law and name


@dataclass(frozen=True)
class Comparison:
    """All numbers; the runs of the two cases of the picture by law."""

    numbers: Numbers
    position: dict[str, Run]
    hand: dict[str, Run]


def count_runs() -> int:
    """Return the number of runs of compare()."""
    return sum(len(laws(case, True)) for cases, *_ in AXES.values() for case in cases)


def compare(seed: int = 1, progress: Callable[[], None] = lambda: None) -> Comparison:
    """Run each law in each case. `ratio` is the RMS error over that without compensation, and
    `sign_changes_per_s` counts those of the added torque while the reference holds.
    Each run calls progress() at its end.
    """
    numbers: Numbers = {axis: {} for axis in AXES}
    shown = {}
    for axis, (cases, simulate, seconds) in AXES.items():
        for case in cases:
            runs = {}
            for name, law in laws(case, axis == "position").items():
                runs[name] = simulate(case, law, seed)
                progress()
            numbers[axis][case.name] = {
                law: _numbers(run, runs["none"], seconds) for law, run in runs.items()
            }
            shown[axis] = runs  # of the last case
    return Comparison(numbers, **shown)


def _numbers(run: Run, without: Run, seconds: float) -> dict[str, float]:
    rms = run.rms(seconds)
    found = {"rms": rms, "ratio": rms / without.rms(seconds)}
    if seconds == MOTION_S:  # the reference then holds
        found["sign_changes_per_s"] = run.sign_changes(MOTION_S + SETTLE_S)
    return found
