# SPDX-License-Identifier: MIT
"""Simulate parking at standstill: a hand turns the wheel against the sticking torque of the tyres.

docs/steering.md describes the two friction nodes and the source of each parameter. The clock is
virtual, so the numbers are the same on every machine.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import can
import numpy as np

from dahl.binding.friction import Plan
from dahl.binding.library import c
from dahl.can import codec
from dahl.can.bus import VCAN
from dahl.can.node import Node
from dahl.errors import RunError
from dahl.facts import PERIOD_US

# Steering and car
HAND_WHEEL_INERTIA = 0.046  # kg m2, with the upper column
COLUMN_DAMPING = 0.361  # N m s/rad
TORSION_BAR = 115.0  # N m/rad
PINION_RADIUS = 0.0071  # m
RACK_MASS, RACK_DAMPING = 32.0, 3620.0  # kg, N s/m
MOTOR_INERTIA, MOTOR_DAMPING = 0.00045, 0.0033  # kg m2, N m s/rad
MOTOR_RATIO = 22.0  # turns of the motor in a turn of the pinion
STEERING_RATIO = 16.5  # turns of the pinion in a turn of the road wheels
CAR_MASS, FRONT_ARM, REAR_ARM = 1296.0, 1.01, 1.56  # kg; m from the centre of mass to an axle
GRAVITY = 9.81  # m/s2
# Tyres
TYRE_GRIP = 0.7
TYRE_PRESSURE = 220e3  # Pa
TYRE_PRESLIDING = math.radians(2.0)  # rad of the road wheels: Fc/sigma0
# Hand, nodes and clock
HAND_AMPLITUDE, HAND_HZ = math.pi, 0.1  # rad
CYCLES = 1.5  # the last whole cycle is measured
GAIN = 0.8  # share of the sticking torque that the assist pushes with
COUNTS_PER_TURN = 16384
PERIOD_S = PERIOD_US / 1e6
TYRES, ASSIST = 0, 1  # numbers of the nodes

PINION_INERTIA = MOTOR_INERTIA * MOTOR_RATIO**2 + RACK_MASS * PINION_RADIUS**2  # kg m2
PINION_DAMPING = MOTOR_DAMPING * MOTOR_RATIO**2 + RACK_DAMPING * PINION_RADIUS**2  # N m s/rad
RATE = 2 * math.pi * HAND_HZ  # rad/s
HAND = {  # hand_t; three quarters of a cycle before the start, so that it starts at rest
    "stiffness": TORSION_BAR,
    "amplitude": HAND_AMPLITUDE,
    "frequency": HAND_HZ,
    "start": -0.75 / HAND_HZ,
}
THETA_PER_COUNT = 2 * math.pi / COUNTS_PER_TURN


def sticking_torque() -> float:
    """Return the largest torque of both tyres at the pinion in N m: grip/3 sqrt(W^3/p) for each."""
    load = CAR_MASS * GRAVITY * REAR_ARM / (FRONT_ARM + REAR_ARM) / 2  # N on a tyre
    return 2 * TYRE_GRIP / 3 * math.sqrt(load**3 / TYRE_PRESSURE) / STEERING_RATIO


def tyre_plan(share: float = 1.0) -> Plan:
    """Return the friction of both tyres at the pinion, for this share of the dry torque."""
    Fc = sticking_torque()  # noqa: N806
    return Plan(Fc / (TYRE_PRESLIDING * STEERING_RATIO), share * Fc, THETA_PER_COUNT)


def hand_motion(t: float) -> tuple[float, float, float]:
    """Return angle, speed and acceleration of the hand wheel in rad and s. It starts at rest."""
    sine, cosine = math.sin(RATE * t), math.cos(RATE * t)
    angle = -HAND_AMPLITUDE * cosine
    return angle, HAND_AMPLITUDE * RATE * sine, -(RATE**2) * angle


class Steering:
    """Two shafts of dahl-loop (host_sim/rotor.h): pinion, rack and motor behind the torsion bar,
    and the hand wheel. A hand leads the wheel up to `released` s; then it is free, and the torsion
    bar couples both shafts tick by tick.
    """

    def __init__(self, released: float = math.inf) -> None:
        self.pinion, self.wheel = c.new("rotor_t *"), c.new("rotor_t *")
        c.dahl_rotor_open(self.pinion, PINION_INERTIA, PINION_DAMPING, 0.0, 0.0)
        c.dahl_rotor_open(self.wheel, HAND_WHEEL_INERTIA, COLUMN_DAMPING, 0.0, 0.0)
        self._hand, self._released = c.new("hand_t *", HAND), released
        self.pinion.hand, self.pinion.theta = self._hand, hand_motion(0.0)[0]
        self._lead(0.0)

    def _lead(self, now: float) -> None:
        self.wheel.theta, self.wheel.omega, self._acceleration = hand_motion(now)
        if now >= self._released:
            self.pinion.hand = c.NULL

    def advance(self, torque: float, now: float) -> None:
        """Move from `now` s for a period under a torque in N m that is constant in it."""
        if self.pinion.hand:
            c.dahl_rotor_advance(self.pinion, torque)
            self._lead(now + PERIOD_S)
        else:
            twist = TORSION_BAR * (self.wheel.theta - self.pinion.theta)
            c.dahl_rotor_advance(self.pinion, torque + twist)
            c.dahl_rotor_advance(self.wheel, -twist)

    def hand_torque(self) -> float:
        """Return the torque in N m that the hand needs for its motion."""
        if not self.pinion.hand:
            return 0.0
        inertia = HAND_WHEEL_INERTIA * self._acceleration
        twist = c.dahl_rotor_hand_torque(self.pinion)
        return float(inertia + COLUMN_DAMPING * self.wheel.omega + twist)


class Column:
    """The sensor and the motor of the column: sends a count to each node and receives torques."""

    def __init__(self, nodes: Sequence[Node]) -> None:
        self._nodes = nodes
        self._counters = itertools.cycle(range(codec.COUNTERS))
        self.frames: list[can.Message] = []  # of the bus, with their time

    def exchange(self, angle: float, now: float) -> list[float]:
        """Return the torque over Fc of each node for an angle in rad at a time in s. Raises
        RunError if a node does not answer.
        """
        state = codec.EncoderState(round(angle / THETA_PER_COUNT), next(self._counters))
        sent = [codec.pack(state, number) for number in range(len(self._nodes))]
        pairs = zip(self._nodes, sent, strict=True)
        answers = [answer for node, one in pairs if (answer := node.receive(one, now))]
        if len(answers) < len(sent):
            raise RunError(f"a node did not answer the count at {now:.3f} s")
        for message in (frames := sent + answers):
            message.timestamp, message.channel = now, VCAN
        self.frames += frames
        return [codec.unpack(answer, codec.FrictionTorque).ratio for answer in answers]


@dataclass(frozen=True)
class Run:
    """A row per tick of angles in rad and torques in N m, and the frames of the bus."""

    time: np.ndarray
    hand_angle: np.ndarray
    pinion_angle: np.ndarray
    hand: np.ndarray
    tyres: np.ndarray
    assist: np.ndarray
    frames: list[can.Message]

    def numbers(self) -> dict[str, float]:
        """Return width and work of the last cycle. The width is that of the loop of hand torque
        over hand angle as the wheel passes straight ahead; drag is its viscous part.
        """
        quarter = _ticks(0.25 / HAND_HZ)
        cycle = slice(-4 * quarter - 1, None)
        forward, backward = self.hand[-1 - quarter], self.hand[-1 - 3 * quarter]
        return {
            "width_Nm": float(forward - backward),
            "drag_Nm": 2 * (COLUMN_DAMPING + PINION_DAMPING) * HAND_AMPLITUDE * RATE,
            "largest_hand_Nm": float(np.abs(self.hand[cycle]).max()),
            "hand_J": work(self.hand[cycle], self.hand_angle[cycle]),
            "tyres_J": work(self.tyres[cycle], self.pinion_angle[cycle]),
            "assist_J": work(self.assist[cycle], self.pinion_angle[cycle]),
        }


def work(torque: np.ndarray, angle: np.ndarray) -> float:
    """Return the work in J of a torque along an angle."""
    return float(np.trapezoid(torque, angle))


def _ticks(seconds: float) -> int:
    return round(seconds / PERIOD_S)


def simulate(
    gain: float,
    progress: Callable[[], None] = lambda: None,
    *,
    grip_share: float = 1.0,
    released: float = math.inf,
) -> Run:
    """Run the closed loop with an assist of this gain, 0 .. 1. Calls progress() after each tick.

    The tyres have this share of their dry torque: less on ice, in the air, or if the car rolls. The
    assist still takes it for dry. The hand lets go of the wheel at `released` s.
    """
    tyre, assist_plan, steering = tyre_plan(grip_share), tyre_plan(), Steering(released)
    nodes = Node(tyre, TYRES), Node(assist_plan, ASSIST, gain=gain)
    torques = tyre.Fc, assist_plan.Fc  # N m of a ratio of 1
    column, rows = Column(nodes), []
    for tick in range(count_ticks() + 1):
        now = tick * PERIOD_S
        ratios = column.exchange(steering.pinion.theta, now)
        tyres, assist = (Fc * ratio for Fc, ratio in zip(torques, ratios, strict=True))
        angles = steering.wheel.theta, steering.pinion.theta
        rows.append((now, *angles, steering.hand_torque(), tyres, assist))
        steering.advance(assist - tyres, now)
        progress()
    time, hand_angle, pinion_angle, hand, tyre_torques, assist_torques = np.array(rows).T
    return Run(time, hand_angle, pinion_angle, hand, tyre_torques, assist_torques, column.frames)


def count_ticks() -> int:
    return _ticks(CYCLES / HAND_HZ)
