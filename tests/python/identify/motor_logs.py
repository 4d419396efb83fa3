# SPDX-License-Identifier: MIT
"""Logs of motor currents: a joint in a position loop, with LuGre friction, cogging and a current
filter, integrated by steps of a tenth of a row. No code of the package is in the torque.

The motion is that of `dahl excite`, for guesses that are wrong by up to 3. The truth is always
SIGMA0 and FC: the slope at rest, and the torque in sliding at speed.
"""

from __future__ import annotations

import math

import numpy as np
from dahl.identify import design
from dahl.io.log import Log
from identify_tools import FC, SIGMA0
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


def log(seed: int) -> Log:
    draw = np.random.default_rng([seed, 33])
    count = 2 * math.pi / 2 ** int(draw.choice([16, 18, 20]))
    length_s = draw.uniform(0.02, 0.06)  # sqrt(inertia / sigma0) is the period of presliding / 2 pi
    inertia = SIGMA0 * length_s**2 / 40
    bandwidth = draw.uniform(15, 40)  # Hz
    wanted = motion_of(draw, inertia, bandwidth, count)
    torque, theta = _joint(draw, wanted, inertia, bandwidth, count)
    noise = draw.uniform(0.01, 0.04) * FC * draw.normal(size=len(wanted))
    pole = math.exp(-1 / draw.uniform(0.5, 4))  # of the current filter, rows
    current = lfilter([1 - pole], [1, -pole], torque + noise)
    time = np.arange(len(wanted)) / RATE
    read = np.floor(theta / count) * count
    return Log(f"seed {seed}", read, current, time, resolution=count)


def _joint(
    draw: np.random.Generator, wanted: np.ndarray, inertia: float, bandwidth: float, count: float
) -> tuple[np.ndarray, np.ndarray]:
    """The torque of the motor and the angle of each row."""
    omega = 2 * math.pi * bandwidth
    stiff, damp = inertia * omega**2, 1.6 * inertia * omega
    integral = stiff * omega / 8 * draw.choice([0.0, 1.0])
    sigma1 = draw.uniform(0.2, 1.0) * math.sqrt(SIGMA0 * inertia)
    viscous = draw.uniform(0, 0.2) * FC / 2.0
    peak = draw.choice([0.0, 0.1])  # Stribeck's, of Fc, below a speed
    slow = draw.uniform(0.05, 0.25) * np.percentile(np.abs(np.gradient(wanted)), 98) * RATE
    cogging, teeth = draw.uniform(0, 0.04) * FC, int(draw.choice([21, 42, 84]))
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
            limit = FC * (1 + peak * math.exp(-((speed / slow) ** 2)))
            rise = speed - SIGMA0 * abs(speed) / limit * z
            friction = SIGMA0 * z + sigma1 * rise + viscous * speed
            force = torque - friction - cogging * math.sin(teeth * theta)
            speed += force / inertia * step
            z += rise * step
            theta += speed * step
    return np.array(torques), np.array(angles)
