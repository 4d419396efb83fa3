# SPDX-License-Identifier: MIT
"""An axis that dahl.Commission moves: a plant, real or simulated, and the position loop of a host.

The simulated shaft is that of dahl-loop (host_sim/rotor.h) under gravity, with an encoder and a
delay of one tick.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from dahl.binding.commission import Command, Commission
from dahl.binding.friction import Friction, Plan
from dahl.binding.library import c
from dahl.errors import RunError
from dahl.facts import PERIOD_US

PERIOD_S = PERIOD_US / 1e6
STAGES = ("rest", "sweeps", "cycle", "breakaway", "inertia", "kick")
FC, SIGMA0, VISCOUS = 0.5, 100.0, 0.01  # N m, N m/rad, N m s/rad: a presliding length of 5 mrad
INERTIA, GRAVITY = 0.002, 0.15  # kg m2, N m at the first angle
COUNTS_PER_TURN = 65536
TORQUE_LIMIT = 10 * FC  # N m
TRAVEL = 0.35  # rad
BANDWIDTH_HZ = 35.0  # of the position loop
MAX_BANDWIDTH_TICKS = 0.035  # bandwidth times period: a faster loop is unstable with its delay
SPEED_FILTER_HZ = 150.0


class Plant(Protocol):
    """An axis behind a drive."""

    def move(self, torque: float) -> int:
        """Apply a torque in N m for a tick. Return the counts that the axis moved in it."""


class Shaft:
    """A simulated axis. A torque acts in the tick after its command."""

    theta_per_count = 2 * math.pi / COUNTS_PER_TURN

    def __init__(self, gravity: float = GRAVITY, hand: float = 0.0) -> None:
        self.rotor = c.new("rotor_t *")
        c.dahl_rotor_open(self.rotor, INERTIA, VISCOUS, SIGMA0, FC)
        self.gravity, self.hand = gravity, hand  # N m
        self._next = 0.0
        self._counts = 0

    def move(self, torque: float) -> int:
        acting, self._next = self._next, torque
        load = self.gravity * math.cos(self.rotor.theta)
        c.dahl_rotor_advance(self.rotor, acting + self.hand - load)
        before, self._counts = self._counts, math.floor(self.rotor.theta / self.theta_per_count)
        return self._counts - before


class PositionLoop:
    """Cascade of position and speed with feed-forward of the inertia. Its integral stops at the
    torque limit.
    """

    def __init__(
        self, period: float, theta_per_count: float, inertia: float, bandwidth: float = BANDWIDTH_HZ
    ) -> None:
        self._period, self._theta_per_count, self._inertia = period, theta_per_count, inertia
        rate = 2 * math.pi * min(bandwidth, MAX_BANDWIDTH_TICKS / period)  # 1/s
        self._kp, self._kd = rate / 5, inertia * rate
        self._ki = self._kd * rate / 6 * period
        self._share = 1 - math.exp(-2 * math.pi * SPEED_FILTER_HZ * period)
        self._speed = self._integral = self._torque = 0.0
        self._is_tracking = False
        self.counts = 0

    @property
    def angle(self) -> float:
        """rad from the start."""
        return self.counts * self._theta_per_count

    def read(self, moved: int) -> None:
        """Take the counts of a tick."""
        self.counts += moved
        speed = moved * self._theta_per_count / self._period
        self._speed += (speed - self._speed) * self._share

    def torque(self, command: Command) -> float:
        """Return the torque of a tick in N m, within command.torque_limit."""
        self._torque = self._track(command) if command.mode == "track" else command.torque
        self._is_tracking = command.mode == "track"
        return self._torque

    def _track(self, command: Command) -> float:
        asked = self._kp * (command.angle - self.angle) + command.speed - self._speed
        if not self._is_tracking:
            self._integral = self._torque - self._kd * asked
        integral = self._integral + self._ki * asked
        torque = integral + self._kd * asked + self._inertia * command.acceleration
        if abs(torque) > command.torque_limit:
            return math.copysign(command.torque_limit, torque)
        self._integral = integral
        return torque


@dataclass
class Trace:
    """Each tick of a run."""

    period: float
    stage: list[str] = field(default_factory=list)
    mode: list[str] = field(default_factory=list)
    reference: list[float] = field(default_factory=list)  # rad, of "track"
    angle: list[float] = field(default_factory=list)  # rad, at the start of the tick
    torque: list[float] = field(default_factory=list)  # N m, sent in the tick

    def append(self, command: Command, angle: float, torque: float) -> None:
        self.stage.append(command.stage)
        self.mode.append(command.mode)
        self.reference.append(command.angle)
        self.angle.append(angle)
        self.torque.append(torque)


@dataclass
class Commissioned:
    """An axis after its run, finished or refused."""

    axis: Commission
    trace: Trace


def commission(
    axis: Commission,
    plant: Plant,
    bandwidth: float = BANDWIDTH_HZ,
    watch: Callable[[Command], object] = lambda command: None,
) -> Commissioned:
    """Run an axis to its end. watch(command) is called in each tick. A refusal is not raised."""
    loop = PositionLoop(axis.period, axis.theta_per_count, axis.inertia, bandwidth)
    trace = Trace(axis.period)

    def drive(command: Command) -> tuple[int, float]:
        torque = loop.torque(command)
        trace.append(command, loop.angle, torque)
        moved = plant.move(torque)
        loop.read(moved)
        watch(command)
        return moved, torque

    try:
        axis.run(drive)
    except RunError:
        if axis.stage != "refused" or axis.refusal_code == "ABORTED":
            raise
    return Commissioned(axis, trace)


def each_stage(advance: Callable[[], None]) -> Callable[[Command], None]:
    """Return a `watch` of commission() that calls advance() at the end of each stage."""
    last = STAGES[0]

    def watch(command: Command) -> None:
        nonlocal last
        if command.stage != last:
            last = command.stage
            advance()

    return watch


def simulated(travel: float = TRAVEL) -> Commission:
    """Return a new Commission for the simulated shaft. Its inertia is 20 % too large."""
    return Commission(
        period=PERIOD_S,
        theta_per_count=Shaft.theta_per_count,
        inertia=1.2 * INERTIA,
        torque_limit=TORQUE_LIMIT,
        travel=travel,
    )


TRACKING_BANDWIDTH_HZ = 20.0
TRACKING_RAD, TRACKING_HZ, TRACKING_S = 0.05, 0.5, 5.0
FIRST_S = 1.0  # left out of the RMS


@dataclass
class Tracking:
    """A position loop that follows a sine."""

    time: np.ndarray  # s
    reference: np.ndarray  # rad
    error: np.ndarray  # rad

    @property
    def rms(self) -> float:
        """rad, after the first second."""
        return float(np.sqrt(np.mean(self.error[self.time >= FIRST_S] ** 2)))


def track(axis: Commission, is_compensated: bool) -> Tracking:
    """Follow a sine with the simulated shaft. With compensation, the load table and the torque of
    the reference law are added to that of the loop.
    """
    shaft = Shaft()
    loop = PositionLoop(axis.period, axis.theta_per_count, axis.inertia, TRACKING_BANDWIDTH_HZ)
    time = np.arange(round(TRACKING_S / axis.period)) * axis.period
    reference, error = [], []
    added = _compensation(axis) if is_compensated else lambda moved, angle, wanted: 0.0
    w, moved = 2 * math.pi * TRACKING_HZ, 0
    for t in time.tolist():
        sine, cosine = (TRACKING_RAD * wave(w * t) for wave in (math.sin, math.cos))
        command = Command("track", sine, w * cosine, -w * w * sine, 0.0, TORQUE_LIMIT, "")
        torque = loop.torque(command) + added(moved, loop.angle, sine)
        reference.append(sine)
        error.append(sine - shaft.rotor.theta)
        moved = shaft.move(torque)
        loop.read(moved)
    return Tracking(time, np.array(reference), np.array(error))


def _compensation(axis: Commission) -> Callable[[int, float, float], float]:
    """Return a function of moved counts, angle and reference (rad) that returns a torque in N m."""
    law = axis.reference_compensator()
    element = Friction(Plan(law.sigma0, law.Fc, law.theta_per_count))
    reference_counts = 0

    def torque(moved: int, angle: float, wanted: float) -> float:
        nonlocal reference_counts
        before, reference_counts = reference_counts, math.floor(wanted / axis.theta_per_count)
        law.move(moved)
        ratio = element.step_counts_q30(reference_counts - before)
        return axis.load(angle) + law.torque(ratio)

    return torque
