# SPDX-License-Identifier: MIT
"""Logs of motor currents: a joint in a position loop, with LuGre friction, cogging and a current
filter, integrated by steps of a tenth of a row. No code of the package is in the torque.

The motion is that of `dahl excite`, for guesses that are wrong by up to 3. The truth is always
SIGMA0 and FC: the slope at rest, and the torque in sliding at speed.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from cramer_rao import half_widths
from dahl.identify import design
from dahl.io.log import Log
from identify_tools import FC, SIGMA0, dahl_torque
from scipy.signal import lfilter

RATE, STEPS = 1000.0, 10  # rows per s, steps of the integration per row
LENGTH = FC / SIGMA0  # rad
MAX_ROWS = 25_000
WRONG = (1.0, 3.0, 1 / 3)  # factors of a guess, by the seed


def motion_of(draw: np.random.Generator, inertia: float, bandwidth: float, count: float):
    """The motion that is proposed for a guess, rad."""
    sigma0, limit = (x * draw.choice(WRONG) for x in (SIGMA0, FC))
    guess = design.Wanted(
        sigma0, limit, count, within=0.02, rate=RATE, inertia=inertia, bandwidth=bandwidth
    )
    theta = design.propose(guess).theta()[:MAX_ROWS]
    return np.concatenate((np.zeros(100), theta))


@dataclass(frozen=True)
class Joint:
    """Parameters of a joint and of its drive; torques in N m, times in rows."""

    inertia: float
    sigma1: float
    viscous: float
    peak: float  # Stribeck's, of Fc
    slow: float  # rad/s, below which it acts
    cogging: float
    teeth: int
    noise: float
    filter: float  # time constant of the current

    def filtered(self, torque: np.ndarray, time_constant: float) -> np.ndarray:
        pole = math.exp(-1 / time_constant)
        return lfilter([1 - pole], [1, -pole], torque)


def log(seed: int) -> Log:
    return _recorded(seed)[0]


def known_to(seed: int) -> dict[str, float]:
    """Half widths of sigma0 and Fc, in both, to which a fit of the true law knows a log.

    It knows the motion up to the counts, and that the noise goes through the current filter.
    """
    log, theta, joint = _recorded(seed)
    speed = np.gradient(theta) * RATE
    acceleration = np.gradient(speed) * RATE
    pole = math.exp(-1 / joint.filter)

    def white(sigma0, Fc, sigma1, viscous, cogging, inertia, offset, filter):  # noqa: N803
        limit = Fc * (1 + joint.peak * np.exp(-((speed / joint.slow) ** 2)))
        friction = dahl_torque(theta, sigma0, limit)
        rise = speed - np.abs(speed) / limit * friction
        torque = friction + sigma1 * rise + viscous * speed + inertia * acceleration + offset
        current = joint.filtered(torque + cogging * np.sin(joint.teeth * theta), filter)
        return lfilter([1, -pole], [1 - pole], current)

    names = ("sigma1", "viscous", "cogging", "inertia", "filter")
    values = {"sigma0": SIGMA0, "Fc": FC, "offset": 0.0}
    values |= {name: getattr(joint, name) for name in names}
    hidden = SIGMA0 * log.resolution / math.sqrt(12)  # torque of a count, at most
    return half_widths(white, values, math.hypot(joint.noise, hidden))


def _recorded(seed: int) -> tuple[Log, np.ndarray, Joint]:
    """The log, the true angle of each row, rad, and the joint."""
    draw = np.random.default_rng([seed, 33])
    count = 2 * math.pi / 2 ** int(draw.choice([16, 18, 20]))
    length_s = draw.uniform(0.02, 0.06)  # sqrt(inertia / sigma0) is the period of presliding / 2 pi
    inertia = SIGMA0 * length_s**2 / 40
    bandwidth = draw.uniform(15, 40)  # Hz
    wanted = motion_of(draw, inertia, bandwidth, count)
    has_integral = draw.choice([0.0, 1.0])
    joint = Joint(
        inertia,
        sigma1=draw.uniform(0.2, 1.0) * math.sqrt(SIGMA0 * inertia),
        viscous=draw.uniform(0, 0.2) * FC / 2.0,
        peak=draw.choice([0.0, 0.1]),
        slow=draw.uniform(0.05, 0.25) * np.percentile(np.abs(np.gradient(wanted)), 98) * RATE,
        cogging=draw.uniform(0, 0.04) * FC,
        teeth=int(draw.choice([21, 42, 84])),
        noise=draw.uniform(0.01, 0.04) * FC,
        filter=0.0,
    )
    torque, theta = _run(joint, wanted, bandwidth, has_integral, count)
    noise = joint.noise * draw.normal(size=len(wanted))
    joint = replace(joint, filter=draw.uniform(0.5, 4))
    current = joint.filtered(torque + noise, joint.filter)
    time = np.arange(len(wanted)) / RATE
    read = np.floor(theta / count) * count
    return Log(f"seed {seed}", read, current, time, resolution=count), theta, joint


def _run(
    joint: Joint, wanted: np.ndarray, bandwidth: float, has_integral: float, count: float
) -> tuple[np.ndarray, np.ndarray]:
    """The torque of the motor and the angle of each row."""
    omega, inertia = 2 * math.pi * bandwidth, joint.inertia
    stiff, damp = inertia * omega**2, 1.6 * inertia * omega
    integral = stiff * omega / 8 * has_integral
    step = 1 / RATE / STEPS
    theta = speed = z = held = before = 0.0
    speeds = np.gradient(wanted) * RATE
    torques, angles = [], []
    for goal, goal_speed in zip(wanted.tolist(), speeds.tolist(), strict=True):
        seen = math.floor(theta / count) * count
        held += integral * (goal - seen) / RATE
        rate, before = (seen - before) * RATE, seen
        torque = stiff * (goal - seen) + held + damp * (goal_speed - rate)
        torques.append(torque)
        angles.append(theta)
        for _ in range(STEPS):
            limit = FC * (1 + joint.peak * math.exp(-((speed / joint.slow) ** 2)))
            rise = speed - SIGMA0 * abs(speed) / limit * z
            friction = SIGMA0 * z + joint.sigma1 * rise + joint.viscous * speed
            force = torque - friction - joint.cogging * math.sin(joint.teeth * theta)
            speed += force / inertia * step
            z += rise * step
            theta += speed * step
    return np.array(torques), np.array(angles)
