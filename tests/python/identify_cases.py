# SPDX-License-Identifier: MIT
"""Small logs of known truth, with one thing each that a log may have: what was measured is
SIGMA0 and FC beside it. The torque comes from identify_tools, identify_truth or row by row here.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from dahl.identify.log import Log
from identify_tools import (
    COUNT,
    FC,
    SIGMA0,
    dahl_torque,
    noise_of,
    sine,
    springs,
    synthetic,
    varying_torque,
)
from scipy.signal import lfilter

A = SIGMA0 / FC
LENGTH = 1 / A  # rad, of presliding


def shaft(seed: int = 3, noise: float = 0.02, rows: int = 2400, cycles: float = 8, **more) -> Log:
    """A log with nothing wrong."""
    return synthetic(seed, noise, rows=rows, cycles=cycles, **more)


def of(theta: np.ndarray, torque: np.ndarray, noise: float = 0.02, count: float = COUNT) -> Log:
    """What a rig logs of a motion and its torque; count 0: an angle without an encoder."""
    read = np.floor(theta / count + 0.3) * count if count else theta
    noisy = torque + noise * FC * noise_of(3, len(theta))
    return Log("rig", read, noisy, np.arange(len(theta)) * 1e-3, resolution=count)


def plus(log: Log, torque: np.ndarray | float) -> Log:
    """With more torque."""
    return replace(log, torque=log.torque + torque)


def chirp(rows: int = 5000, amplitude: float = 0.05, first: float = 4, last: float = 14):
    """A motion of many speeds, rad."""
    x = np.linspace(0, 1, rows)
    return amplitude * np.sin(2 * np.pi * (first * x + (last - first) / 2 * x**2))


def late(
    rows: int, seed: int = 5, noise: float = 0.02, count: int = 3000, cycles: float = 8
) -> Log:
    """A torque that comes `rows` rows after its angle; before it where below 0."""
    theta = sine(seed, rows=count + 200, cycles=cycles * (count + 200) / count)
    torque = np.roll(dahl_torque(theta), rows)[100:-100]
    return of(theta[100:-100], torque, noise)


def without_clock(log: Log) -> Log:
    return replace(log, time=None)


def drifting(sigma0=0.0, Fc=0.0, rows: int = 4000, cycles: float = 12, noise: float = 0.01) -> Log:  # noqa: N803
    """Parameters that differ from the usual ones by these parts, row by row."""
    theta, one = sine(1, rows=rows, cycles=cycles), np.ones(rows)
    return of(theta, varying_torque(theta, SIGMA0 * (one + sigma0), FC * (one + Fc)), noise)


def ramp(rows: int = 4000) -> np.ndarray:
    return np.linspace(-0.5, 0.5, rows)


def behind(theta: np.ndarray, width: float) -> np.ndarray:
    """An angle behind a play."""
    drawn, one = [], theta[0]
    for ahead in theta:
        one = min(max(one, ahead - width / 2), ahead + width / 2)
        drawn.append(one)
    return np.array(drawn)


def lost_motion(where: str, counts: float, every: int = 1, rows: int = 5000) -> Log:
    """A play between encoder and bearing (before), or in the encoder's coupling (in)."""
    true = sine(2, rows=rows * every, amplitude=0.06)
    moved = behind(true, counts * COUNT)
    bearing, encoder = (moved, true) if where == "before" else (true, moved)
    return of(encoder[::every], dahl_torque(bearing)[::every], 0.05)


def played(
    slack: float, centre: float = 0.0, rows: int = 2400, cycles: float = 8, seed: int = 2
) -> Log:
    """Backlash: the torque rests at `centre` of Fc over `slack` rad after each reversal."""
    theta = sine(seed, rows=rows, cycles=cycles)
    return of(theta, FC * resting_ratio(theta, slack, centre), 0.01)


def resting_ratio(theta: np.ndarray, slack: float, centre: float = 0.0) -> np.ndarray:
    """F/Fc that rests at `centre` over `slack` rad after each reversal."""
    ratio, w, gap = [], 0.0, 0.0
    for move in np.diff(theta, prepend=theta[0]):
        side = np.sign(move)
        aim = w + side * (1 - side * w) * -np.expm1(-A * abs(move))
        if ((w - centre) * (aim - centre) < 0 or gap > 0) and gap < slack:
            w, gap = centre, gap + abs(move)
        else:
            w, gap = aim, 0.0
        ratio.append(w)
    return np.array(ratio)


def low_passed(kind: str, rows: int = 10) -> Log:
    theta = sine(1, rows=4000, cycles=8)
    taps = {
        "first order": ([1 / rows], [1, 1 / rows - 1]),
        "mean": (np.ones(rows) / rows, [1]),
        "none": ([1], [1]),
    }
    return of(theta, lfilter(*taps[kind], dahl_torque(theta)), 0.05)


def shaky(counts: float, noise: float = 0.02, seed: int = 1) -> Log:
    """Independent errors on the angle, in counts."""
    theta = sine(seed, rows=3000, cycles=8)
    return of(theta + counts * COUNT * noise_of(seed + 50, 3000), dahl_torque(theta), noise)


def in_steps(steps: float, noise: float) -> Log:
    """A torque sensor of so many steps in Fc, with noise over a step."""
    theta = sine(5, rows=3000, cycles=6.3)
    step = FC / steps
    torque = dahl_torque(theta) + noise * step * noise_of(1, 3000)
    return replace(of(theta, torque), torque=np.round(torque / step) * step)


def between_rows(seed: int, rows_a_cycle: float, noise: float = 0.01) -> Log:
    """A shaft that turns between the rows: 16 steps of the truth in each."""
    phase = 2 * np.pi * np.arange(2400 * 16) / (16 * rows_a_cycle) + seed
    theta = 4 * LENGTH * np.sin(phase)
    return of(theta[::16], dahl_torque(theta)[::16], noise)


def rippled(amplitude: float, waves: float, viscous: float = 0.0) -> Log:
    """A tenth of Fc that depends on the angle, the same both ways."""
    log = synthetic(4, 0.02, rows=3000, cycles=8, amplitude=amplitude)
    more = 0.1 * FC * np.sin(waves * log.theta + 0.3) + viscous * np.gradient(log.theta, 1e-3)
    return plus(log, more)


def resting(seed: int) -> Log:
    """A shaft that rests between two counts, at the same angle each time."""
    draw = np.random.default_rng(seed)
    phase = (np.arange(5000) * 6 / 5000 + draw.uniform()) % 1
    theta = draw.uniform(0.03, 0.07) * np.interp(phase, [0, 0.3, 0.5, 0.8, 1], [-1, 1, 1, -1, -1])
    return of(theta, dahl_torque(theta), 0.01)


def with_gaps(log: Log, *cuts: tuple[int, int]) -> Log:
    """Without the rows of these cuts; the clock goes on."""
    kept = np.ones(log.rows, dtype=bool)
    for start, end in cuts:
        kept[start:end] = False
    return replace(log, theta=log.theta[kept], torque=log.torque[kept], time=log.time[kept])


def with_a_long_step(steps: float) -> Log:
    """One step of the clock that is so many times as long as the others."""
    log = shaft()
    log.time[1200:] += (steps - 1) * 1e-3
    return log


def repeating(count: int) -> Log:
    """So many rows of 2400 come twice."""
    log = shaft(noise=0.05)
    again = np.linspace(10, 2390, count).astype(int)
    rows = np.sort(np.concatenate((np.arange(2400), again)))
    time = np.arange(len(rows)) * 1e-3
    return replace(log, theta=log.theta[rows], torque=log.torque[rows], time=time)


def wrapping(counts: int) -> Log:
    """A counter that starts again after so many."""
    log = shaft()
    return replace(log, theta=np.round(log.theta / COUNT) % counts * COUNT)


def viscous_by(rows: int) -> Log:
    """A viscous part of .05 N m s/rad, and a clock that goes on every so many rows."""
    theta = sine(1, rows=2400, cycles=8)
    log = of(theta, dahl_torque(theta) + 0.05 * np.gradient(theta, 1e-3))
    return replace(log, time=np.arange(2400) // rows * rows * 1e-3)


def spiked(spikes: int, angle: float = 0.0, torque: float = 0.0) -> Log:
    """So many rows, each alone, with another angle (rad) or torque (Fc)."""
    log = shaft(4, rows=3000, cycles=6, noise=0.02 if angle else 0.05)
    hit = np.random.default_rng(0).choice(log.rows - 2, spikes, replace=False) + 1
    log.theta[hit] += angle
    log.torque[hit] += torque * FC
    return log


def beside(term: str, size: float) -> Log:
    """A term beside the friction, on a motion of many speeds."""
    theta = chirp()
    speed = np.gradient(theta, 1e-3)
    columns = {
        "offset": np.ones_like(theta),
        "spring": theta - theta[0],
        "viscous": speed,
        "inertia": np.gradient(speed, 1e-3),
    }
    return of(theta, dahl_torque(theta) + size * columns[term], count=0.0)


def late_by_a_row_of(lengths: float) -> Log:
    """A torque that comes a row before its angle, in rows of so many presliding lengths."""
    rows = int(0.05 * 40 / lengths / LENGTH)
    theta = sine(5, rows=rows + 2)
    return of(theta[1:-1], np.roll(dahl_torque(theta), -1)[1:-1])


def odd_cycles(count: int) -> Log:
    """So many of 23 whole cycles have 30 % more Fc, from one turning point to the next but one."""
    speed = np.diff(sine(1, rows=6000, cycles=24))
    turns = np.flatnonzero(speed[1:] * speed[:-1] < 0)[::2]
    more = np.zeros(6000)
    for start, end in zip(turns[3::5][:count], turns[4::5][:count], strict=True):
        more[start + 20 : end - 20] = 0.3
    return drifting(Fc=more, rows=6000, cycles=24)


def resting_first() -> Log:
    """Two thousand rows of a shaft at rest, with a torque of the other sign that flickers."""
    log = shaft(3, 0.05, rows=3000, cycles=6)
    still = np.zeros(2000)
    theta = np.concatenate((still + log.theta[0], log.theta))
    torque = np.concatenate((still + 0.01 * FC * np.resize([1, -1, 2], 2000), log.torque))
    return replace(log, theta=theta, torque=-torque, time=np.arange(5000) * 1e-3)


def late_between_rows(rows: float, count: int = 3000) -> Log:
    """A torque that comes late by parts of a row: ten steps of the truth in each."""
    theta = sine(5, rows=10 * (count + 200), cycles=8)
    torque = np.roll(dahl_torque(theta), round(10 * rows))
    kept = slice(1000, -1000, 10)
    return of(theta[kept], torque[kept])


def late_and_springy(rows: int, spring: float) -> Log:
    theta = chirp(5200)
    torque = np.roll(dahl_torque(theta) + spring * (theta - theta[100]), rows)
    return of(theta[100:-100], torque[100:-100])


def late_in_coarse_cycles(cycle: int, rows: int) -> Log:
    """60 cycles of few rows; a quarter of a cycle late, friction looks like inertia."""
    theta = 0.05 * np.sin(2 * np.pi * np.arange(60 * cycle + rows) / cycle + 0.3)
    return of(theta[rows:], dahl_torque(theta)[: 60 * cycle])


def of_two_elements(cycles: float) -> Log:
    """Two springs that slip, which together have SIGMA0 and FC."""
    theta = sine(3, rows=900, cycles=cycles)
    parts = ((0.6 * SIGMA0, 0.4 * FC), (0.4 * SIGMA0, 0.6 * FC))
    return of(theta, springs(theta, *parts), 0.02)


def by_edges() -> Log:
    """Written at each edge of the encoder, without a clock."""
    counts = np.floor(sine(3, rows=64_000, cycles=8) / COUNT)
    theta = counts[1:][np.diff(counts) != 0] * COUNT
    torque = dahl_torque(theta) + 0.02 * FC * noise_of(1, len(theta))
    return Log("edges", theta, torque, resolution=COUNT)


def of_quiet_noise(shared: float = 0.95, Fc: np.ndarray | float = 0.0) -> Log:  # noqa: N803
    """Noise of 5 % whose neighbouring rows share most of it."""
    log = drifting(Fc=Fc, noise=0.0, rows=6000)
    return plus(log, 0.05 * FC * noise_of(2, 6000, shared))
