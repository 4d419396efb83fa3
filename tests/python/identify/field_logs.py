# SPDX-License-Identifier: MIT
"""Logs of known truth as users record them: other rigs, recorders and motions than in
hostile_logs.py. The truth is always SIGMA0 (slope at rest) and FC (full slip at speed).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from dahl.io.log import Log
from hostile_logs import LEAD, LENGTH, ROWS, STEP, Rig
from identify_tools import FC, SIGMA0, behind_play, dahl_torque, noise_of
from scipy.signal import lfilter


def clock_reset(rig: Rig) -> Log:
    """The recorder starts its clock anew in the middle."""
    log = rig.log(rig.friction() + 0.1 * FC * rig.speed / rig.fastest)
    return replace(log, time=np.where(log.time < 2, log.time, log.time - 1.99))


def clipped_sensor(rig: Rig) -> Log:
    """The amplifier ends at 1.0 to 1.1 of Fc, within the noise."""
    log = rig.log(noise=0.04)
    end = rig.random.uniform(1.0, 1.1) * FC
    return replace(log, torque=np.clip(log.torque, -end, end))


def end_stops(rig: Rig) -> Log:
    """Soft stops beyond 95 % of the stroke, on both sides."""
    far = np.abs(rig.theta).max()
    beyond = np.sign(rig.theta) * np.maximum(np.abs(rig.theta) - 0.95 * far, 0)
    return rig.log(rig.friction() + 1.5 * FC * beyond / (0.05 * far))


def relaxing_rests(rig: Rig) -> Log:
    """Rests at each turn, in which the torque creeps down by a tenth."""
    rig.along(rig.amplitude * LENGTH * np.clip(1.3 * np.sin(rig.phase), -1, 1))
    still = np.abs(np.diff(rig.theta, prepend=rig.theta[0])) < 1e-9
    rested = np.zeros(len(still))
    for k in range(1, len(still)):
        rested[k] = rested[k - 1] + 1 if still[k] else 0.0
    return rig.log(rig.friction() * (1 - 0.1 * (1 - np.exp(-rested / 30))))


def two_speeds_stribeck(rig: Rig) -> Log:
    """A slow half and a fast half; 25 % more friction at slow speed."""
    pace = np.where(np.sin(rig.phase / 6) > 0, 1.0, 0.35)
    phase = np.cumsum(pace) / pace.sum() * np.ptp(rig.phase) + rig.phase[0]
    rig.along(rig.stroke(phase, rig.seed % 3))
    slow = np.exp(-((rig.speed / (0.1 * rig.fastest)) ** 2))
    return rig.log(dahl_torque(rig.theta, Fc=FC * (1 + 0.25 * slow)))


def belt_resonance(rig: Rig) -> Log:
    """A belt between encoder and bearing that rings at 40 Hz and gives .5 % of a length."""
    torque = rig.friction()
    pole = np.exp((-0.1 + 1j) * 2 * np.pi * 40 * STEP)
    a = np.array([1.0, -2 * pole.real, abs(pole) ** 2])
    return rig.log(torque, theta=rig.theta + 0.005 * LENGTH / FC * lfilter([a.sum()], a, torque))


def merged_buses(rig: Rig) -> Log:
    """The torque comes from another bus every four rows and is held; its clock starts elsewhere."""
    log, first = rig.log(), int(rig.random.integers(4))
    rows = np.maximum((np.arange(ROWS) - first) // 4 * 4 + first, 0)
    return replace(log, torque=log.torque[rows])


def swinging_door(rig: Rig) -> Log:
    """Gravity on a leaning axis, six times as large as friction."""
    return rig.log(rig.friction() + 6 * FC * np.sin(rig.theta + 0.4))


def preloaded_play(rig: Rig) -> Log:
    """A play of a fifth of a presliding length in a drive that pulls one way."""
    return rig.log(dahl_torque(behind_play(rig.theta, 0.2 * LENGTH)) + 0.3 * FC)


def growing(rig: Rig) -> Log:
    return rig.along(rig.theta * np.linspace(0.15, 1.0, len(rig.theta))).log()


def one_way_slow(rig: Rig) -> Log:
    """Strokes that return four times as fast."""
    x = rig.phase / (2 * np.pi) % 1
    ramp = np.where(x < 0.8, x / 0.8, (1 - x) / 0.2)
    smooth = np.convolve(2 * ramp - 1, np.ones(15) / 15, "same")
    return rig.along(rig.amplitude * LENGTH * smooth).log()


def trapezoids(rig: Rig) -> Log:
    way = np.clip(2.5 * np.sin(rig.phase), -1, 1)
    theta = np.cumsum(way)
    theta -= (theta.max() + theta.min()) / 2
    return rig.along(rig.amplitude * LENGTH * theta / np.abs(theta).max()).log()


def random_strokes(rig: Rig) -> Log:
    """Strokes of 2 to 14 lengths with dwells between them."""
    parts, at = [], 0.0
    for side in np.resize([1.0, -1.0], 60):
        end = side * rig.random.uniform(2, 14) * LENGTH
        share = (1 - np.cos(np.pi * np.linspace(0, 1, int(rig.random.integers(60, 220))))) / 2
        dwell = np.full(int(rig.random.integers(0, 40)), end)
        parts.append(np.append(at + (end - at) * share, dwell))
        at = end
    return rig.along(np.concatenate(parts)[: len(rig.theta)]).log()


def stuck_recorder(rig: Rig) -> Log:
    """All columns stand still for 30 rows, six times, then jump to the present."""
    log = rig.log()
    rows = np.arange(ROWS)
    for start in rig.random.integers(100, ROWS - 100, size=6):
        rows[start : start + 30] = start
    return replace(log, theta=log.theta[rows], torque=log.torque[rows])


def spikes(rig: Rig) -> Log:
    log = rig.log()
    hit = rig.random.choice(ROWS, ROWS // 500, replace=False)
    log.torque[hit] += rig.random.choice([-50, 50], len(hit)) * FC
    return log


def coarse_torque(rig: Rig) -> Log:
    log = rig.log()
    return replace(log, torque=np.round(log.torque / FC * 12) * FC / 12)


def quick_strokes(rig: Rig) -> Log:
    """A sine of 15 to 58 rows a cycle at 200 Hz, of either sign, late by up to two rows."""
    phase = 2 * np.pi * rig.rows / rig.random.uniform(15, 58)
    torque = rig.along(rig.stroke(phase, 0)).friction()
    return rig.log(np.roll(rig.random.choice([1, -1]) * torque, int(rig.random.integers(3))))


def one_speed(rig: Rig) -> Log:
    """A triangle: viscous friction is the same torque but for the turns."""
    return rig.along(rig.amplitude * LENGTH * np.arcsin(np.sin(rig.phase)) * 2 / np.pi).log()


def coarse_clock(rig: Rig) -> Log:
    """Times in steps of 16 ms, as of an operating system."""
    log = rig.log(rig.friction() + 0.15 * FC * rig.speed / rig.fastest)
    return replace(log, time=np.floor(log.time / 0.016) * 0.016)


def pause(rig: Rig) -> Log:
    """The recorder pauses, then repeats the last row five times."""
    log = rig.log()
    kept = np.r_[0:1500, 1900:ROWS]
    log = log.part(kept)
    log.theta[1500:1505], log.torque[1500:1505] = log.theta[1499], log.torque[1499]
    return log


def shifted_rows(rig: Rig) -> Log:
    """The torque is early by some rows, since the angle goes through a slow bus."""
    return rig.log(np.roll(rig.friction(), -int(rig.random.integers(1, 12))))


MAKERS: dict[str, Callable[[Rig], Log]] = {
    "flipped torque": lambda rig: rig.log(-rig.friction() - 0.1 * FC),
    "clock reset": clock_reset,
    "clipped sensor": clipped_sensor,
    "end stops": end_stops,
    "rests with relaxation": relaxing_rests,
    "two speeds, Stribeck": two_speeds_stribeck,
    "belt resonance": belt_resonance,
    "merged buses": merged_buses,
    "swinging door": swinging_door,
    "preloaded play": preloaded_play,
    "growing strokes": growing,
    "one way slow": one_way_slow,
    "trapezoids": trapezoids,
    "random strokes": random_strokes,
    "stuck recorder": stuck_recorder,
    "spikes": spikes,
    "coarse torque": coarse_torque,
    "quick strokes": quick_strokes,
    "one speed": one_speed,
    "coarse clock": coarse_clock,
    "pause": pause,
    "early torque": shifted_rows,
    # an inverter's ripple of 6 % of Fc in alternate rows
    "PWM ripple": lambda rig: rig.log(rig.friction() + 0.06 * FC * (-1.0) ** rig.rows),
    # 24 cogs in each stroke, with 8 % of Fc
    "cogging": lambda rig: rig.log(
        rig.friction() + 0.08 * FC * np.sin(2 * np.pi * rig.theta / (np.ptp(rig.theta) / 24))
    ),
    # the zero of the torque sensor drifts by 30 % of Fc
    "drifting zero": lambda rig: rig.log(rig.friction() + 0.3 * FC * rig.rows / ROWS),
    # noise of the torque that is correlated over 50 rows
    "slow noise": lambda rig: rig.log(
        rig.friction() + 0.06 * FC * noise_of(rig.seed, LEAD + ROWS, 0.98), noise=0.01
    ),
    # a tenth more friction one way than the other
    "asymmetric": lambda rig: rig.log(
        dahl_torque(rig.theta, SIGMA0, FC * (1 + 0.1 * np.sign(rig.speed)))
    ),
    # a coarse encoder: six counts in a presliding length
    "six counts": lambda rig: replace(
        rig.log(),
        theta=np.floor(rig.theta[LEAD:] / (LENGTH / 6)) * LENGTH / 6,
        resolution=LENGTH / 6,
    ),
}
KINDS: dict[str, Callable[[int], Log]] = {
    kind: lambda seed, make=make: make(Rig(seed)) for kind, make in MAKERS.items()
}
