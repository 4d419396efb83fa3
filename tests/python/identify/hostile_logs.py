# SPDX-License-Identifier: MIT
"""Logs of known truth that the hypotheses of `dahl identify` do not describe, or describe late.

Each kind has one thing that real rigs have: a sensor, a mechanism, a recorder or a motion. The
torque has no code of the package in it. The truth is always
SIGMA0 (slope at rest) and FC (full slip; the mean, if Fc varies), of all friction together.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np
from dahl.io.log import Log
from identify_tools import COUNT, FC, SIGMA0, dahl_torque, springs
from scipy.signal import filtfilt, lfilter

LENGTH = FC / SIGMA0  # rad, of presliding
ROWS, STEP = 4000, 1e-3  # s
LEAD = 300  # rows before the log


@dataclass
class Rig:
    """A different motion for each seed, with LEAD rows before the log."""

    seed: int
    cycles: float = 0.0  # 0: 9 to 15
    amplitude: float = 0.0  # presliding lengths; 0: 6 to 14

    def __post_init__(self) -> None:
        self.random = np.random.default_rng([self.seed, 77])
        self.cycles = self.cycles or self.random.uniform(9, 15)
        self.amplitude = self.amplitude or self.random.uniform(6, 14)
        self.rows = np.arange(-LEAD, ROWS)
        self.phase = 2 * np.pi * (self.cycles * self.rows / ROWS + self.random.uniform())
        self.theta = self.stroke(self.phase, self.seed % 3)

    def stroke(self, phase: np.ndarray, kind: int) -> np.ndarray:
        """A sine, two sines, or a rounded triangle; rad."""
        shapes = (
            np.sin(phase),
            0.75 * np.sin(phase) + 0.35 * np.sin(2.3 * phase),
            np.arcsin(0.97 * np.sin(phase)) / 1.32,
        )
        return self.amplitude * LENGTH * shapes[kind]

    @property
    def speed(self) -> np.ndarray:
        return np.gradient(self.theta, STEP)

    @property
    def fastest(self) -> float:
        return np.abs(self.speed).max()

    def friction(self, factor: np.ndarray | None = None) -> np.ndarray:
        """Eq. 1 along the motion; with a factor of Fc for each row its mean is FC."""
        limit = FC if factor is None else FC * factor / factor[LEAD:].mean()
        return dahl_torque(self.theta, Fc=limit)

    def noise(self, part: float) -> np.ndarray:
        return part * FC * self.random.normal(size=len(self.theta))

    def along(self, theta: np.ndarray) -> Self:
        """The rig with another motion."""
        self.theta = theta
        return self

    def log(
        self,
        torque: np.ndarray | None = None,
        noise: float = 0.03,
        theta: np.ndarray | None = None,
    ) -> Log:
        """The recorded log, usually of the friction alone: 14 bits, every millisecond."""
        torque = self.friction() if torque is None else torque
        seen = self.theta if theta is None else theta
        read = np.round((seen + self.random.uniform() * COUNT) / COUNT) * COUNT
        measured = torque + self.noise(noise)
        time = STEP * np.arange(ROWS)
        return Log(f"seed {self.seed}", read[LEAD:], measured[LEAD:], time, resolution=COUNT)


# --- sensors --------------------------------------------------------------------------------------


def noise_bursts(rig: Rig) -> Log:
    """Three tenths of a second with thirty times the noise."""
    extra = np.zeros(len(rig.theta))
    for start in rig.random.integers(LEAD, ROWS - 300, size=3):
        extra[start : start + 100] = 1.0
    return rig.log(rig.friction() + rig.noise(0.9) * extra)


def dead_band(rig: Rig) -> Log:
    """A converter that reads 0 within 4 % of Fc."""
    torque = rig.friction() + rig.noise(0.01)
    return rig.log(np.where(np.abs(torque) < 0.04 * FC, 0.0, torque), noise=0.003)


def ringing(rig: Rig) -> Log:
    """A torque cell on a shaft that rings: a second order of 15 rows with little damping."""
    pole = np.exp((-0.3 + 1j * np.sqrt(1 - 0.09)) * 2 * np.pi / 15)
    a = np.array([1.0, -2 * pole.real, abs(pole) ** 2])
    return rig.log(lfilter([a.sum()], a, rig.friction()))


def offset_jumps(rig: Rig) -> Log:
    """The offset jumps by up to 6 % of Fc, four times."""
    torque = rig.friction()
    for start in rig.random.integers(LEAD, ROWS, size=4):
        torque[start:] += rig.random.uniform(-0.06, 0.06) * FC
    return rig.log(torque)


# --- recorders ------------------------------------------------------------------------------------


def interpolated_rows(rig: Rig) -> Log:
    """Both channels come every four rows and are interpolated."""
    log = rig.log()
    known = np.arange(0, ROWS, 4)
    theta, torque = (np.interp(np.arange(ROWS), known, x[known]) for x in (log.theta, log.torque))
    return Log(log.name, theta, torque, log.time)


def jittering_clock(rig: Rig) -> Log:
    """Times that are wrong by up to .4 of a row; a viscous part that needs them."""
    log = rig.log(rig.friction() + 0.15 * FC * rig.speed / rig.fastest)
    log.time = log.time + STEP * rig.random.uniform(-0.4, 0.4, size=ROWS)
    return log


def drifting_clocks(rig: Rig) -> Log:
    """Two recorders: the torque is late by 0 rows at the start and by 3 at the end."""
    late = np.maximum(rig.rows, 0) * 3 / ROWS
    places = np.arange(len(rig.theta))
    return rig.log(np.interp(places - late, places, rig.friction()))


def missed_counts(rig: Rig) -> Log:
    """The counter loses a count in each third or fourth reversal, by the seed."""
    turns = np.flatnonzero(np.diff(np.sign(np.diff(rig.theta)))) + 1
    lost = np.zeros(len(rig.theta))
    for turn in turns[:: 4 - rig.seed % 2]:
        lost[turn:] += COUNT
    return rig.log(theta=rig.theta - lost)


def late_packets(rig: Rig) -> Log:
    """One torque in ten is lost; the recorder repeats the one before."""
    log = rig.log()
    arrived = np.where(rig.random.random(ROWS) < 0.9, np.arange(ROWS), 0)
    log.torque = log.torque[np.maximum.accumulate(arrived)]
    return log


# --- mechanisms -----------------------------------------------------------------------------------


def adhesion_after_rest(rig: Rig) -> Log:
    """Rests at each turn, then a peak of 15 % of Fc two presliding lengths later."""
    rig.theta = rig.amplitude * LENGTH * np.clip(1.4 * np.sin(rig.phase), -1, 1)
    moves = np.diff(rig.theta, prepend=rig.theta[0])
    since, peak = 1e9, []
    rested = 0
    for move in moves.tolist():
        rested = rested + 1 if abs(move) < 1e-12 else rested
        if abs(move) >= 1e-12:
            since = 0.0 if rested > 5 else since + abs(move) / LENGTH
            rested = 0
        peak.append(
            0.15 * FC * np.sign(move) * (since / 2) ** 2 * np.exp(2 - since) if since < 50 else 0.0
        )
    return rig.log(rig.friction() + np.array(peak))


def eight_elements(rig: Rig) -> Log:
    """A rolling bearing: eight slip elements from stiff to soft."""
    limits = np.full(8, FC / 8)
    stiffness = limits / np.geomspace(0.3, 3.0, 8)
    stiffness *= SIGMA0 / stiffness.sum()
    return rig.log(springs(rig.theta, *zip(stiffness, limits, strict=True)))


def lever_spring_with_play(rig: Rig) -> Log:
    """A spring that acts only beyond half of the stroke."""
    beyond = np.sign(rig.theta) * np.maximum(np.abs(rig.theta) - 0.5 * np.abs(rig.theta).max(), 0)
    return rig.log(rig.friction() + 0.4 * FC * beyond / np.abs(beyond).max())


def heavy_rotor(rig: Rig) -> Log:
    """An inertia whose torque is as large as Fc, on a motion of many speeds."""
    x = np.linspace(0, 1, len(rig.theta))
    rig.theta = rig.amplitude * LENGTH * np.sin(2 * np.pi * (5 * x + 5 * x**2) + rig.seed)
    acceleration = np.gradient(rig.speed, STEP)
    return rig.log(rig.friction() + FC * acceleration / np.abs(acceleration).max())


# --- motions --------------------------------------------------------------------------------------


def moved_by_hand(rig: Rig) -> Log:
    """Strokes of all lengths and speeds; the torque is a row late."""
    steps = rig.random.normal(size=len(rig.theta))
    pole = np.exp(-1 / 60)
    for _ in range(3):
        steps = lfilter([1 - pole], [1, -pole], steps)
    rig.theta = 8 * LENGTH * (steps - steps.mean()) / np.std(steps)
    return rig.log(np.roll(rig.friction(), 1))


def stick_slip(rig: Rig) -> Log:
    """The shaft jumps: it rests, then catches up within a few rows."""
    held, moved = rig.theta[0], []
    for target in rig.theta.tolist():
        if abs(target - held) > 1.5 * LENGTH:
            held = target
        moved.append(held)
    return rig.along(filtfilt([0.4], [1, -0.6], np.array(moved))).log()


def stops_within_strokes(rig: Rig) -> Log:
    pace = np.where(np.sin(3.7 * rig.phase + 1) > 0.5, 0.0, 1.0)
    phase = np.cumsum(pace) / pace.sum() * np.ptp(rig.phase) + rig.phase[0]
    return rig.along(rig.stroke(phase, rig.seed % 3)).log()


MAKERS: dict[str, Callable[[Rig], Log]] = {
    # a sine of 10 % of Fc that has nothing to do with the motion
    "mains hum": lambda rig: rig.log(
        rig.friction() + 0.1 * FC * np.sin(2 * np.pi * rig.rows * 0.0507 + rig.seed)
    ),
    "noise with speed": lambda rig: rig.log(
        rig.friction() + rig.noise(0.15) * (np.abs(rig.speed) / rig.fastest)
    ),
    "noise bursts": noise_bursts,
    "dead band of the sensor": dead_band,
    "ringing torque cell": ringing,
    "offset jumps": offset_jumps,
    # the angle goes through a filter of two rows, so that the torque seems early
    "filtered angle": lambda rig: rig.log(
        theta=lfilter([1 - np.exp(-0.5)], [1, -np.exp(-0.5)], rig.theta)
    ),
    # an error of three counts once per turn, on strokes of a small part of a turn
    "eccentric encoder": lambda rig: rig.log(
        theta=rig.theta + 3 * COUNT * np.sin(rig.theta + rig.seed)
    ),
    # the torque was smoothed forward and backward before it was written
    "zero-phase filter": lambda rig: rig.log(
        filtfilt([0.35], [1, -0.65], rig.friction() + rig.noise(0.05)), noise=0.0
    ),
    "interpolated rows": interpolated_rows,
    "jittering clock": jittering_clock,
    "clocks that drift apart": drifting_clocks,
    "missed counts": missed_counts,
    # a weight on the shaft: 30 % of Fc times the sine of a large angle
    "unbalanced shaft": lambda rig: rig.log(
        rig.friction() + 0.3 * FC * np.sin(12 * rig.theta + rig.seed)
    ),
    # Fc falls by 12 % within the first third of the log; the truth is its mean
    "wearing in 12 %": lambda rig: rig.log(
        rig.friction(1 + 0.12 * np.exp(-np.maximum(rig.rows, 0) / (ROWS / 3)))
    ),
    "Fc by angle 12 %": lambda rig: rig.log(
        dahl_torque(rig.theta, Fc=FC * (1 + 0.12 * np.sin(rig.theta / (2 * LENGTH) + rig.seed)))
    ),
    "adhesion after rests": adhesion_after_rest,
    "eight elements": eight_elements,
    "spring beyond half": lever_spring_with_play,
    "heavy rotor": heavy_rotor,
    "moved by hand": moved_by_hand,
    "stick-slip motion": stick_slip,
    "stops within strokes": stops_within_strokes,
    # five long strokes, then many of .8 presliding lengths
    "two lengths": lambda rig: rig.along(
        rig.theta * np.where(rig.rows < ROWS * 0.4, 1.0, 0.8 / rig.amplitude)
    ).log(),
    # each cycle goes a third further than it comes back
    "ratchet": lambda rig: rig.along(
        rig.theta + 0.35 * 2 * rig.amplitude * LENGTH * rig.cycles * (rig.rows / ROWS)
    ).log(),
    # a vibration of two counts on top of each stroke, faster than the motion
    "dithered motion": lambda rig: rig.along(
        rig.theta + 2 * COUNT * np.sin(2 * np.pi * 0.043 * rig.rows)
    ).log(),
    "repeated packets": late_packets,
    # a viscous torque of 40 % of Fc that halves as the grease warms
    "warming grease": lambda rig: rig.log(
        rig.friction()
        + 0.4 * FC * (1 - 0.5 * np.maximum(rig.rows, 0) / ROWS) * rig.speed / rig.fastest
    ),
    # Fc grows by 4 % of its mean for each factor e of speed, as dry contacts do
    "Fc by log of speed": lambda rig: rig.log(
        rig.friction(
            1 + 0.04 * np.log(np.maximum(np.abs(rig.speed) / np.abs(rig.speed).mean(), 0.03))
        )
    ),
    # a torque of 5 % of Fc at each tooth; each stroke passes 40
    "gear teeth": lambda rig: rig.log(
        rig.friction()
        + 0.05 * FC * np.sin(2 * np.pi * rig.theta / (np.ptp(rig.theta) / 40) + rig.seed)
    ),
}
MOTIONS = {
    "unbalanced shaft": {"amplitude": 60.0, "cycles": 8.4},
    "two lengths": {"cycles": 16.2},
}


def maker(kind: str) -> Callable[[int], Log]:
    return lambda seed: MAKERS[kind](Rig(seed, **MOTIONS.get(kind, {})))


KINDS: dict[str, Callable[[int], Log]] = {kind: maker(kind) for kind in MAKERS}
