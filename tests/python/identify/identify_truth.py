# SPDX-License-Identifier: MIT
"""Logs whose truth is known, one kind for each thing that can spoil an identification. The torque
comes from recurrences, row by row, with no code of the package in it.

Each maker takes a seed and gives a log; the truth is always SIGMA0 and FC: the slope at rest and
the friction at full slip, of all elements together, without what a kind adds to them.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from dahl.io.log import Log
from identify_tools import COUNT, FC, SCALE, SIGMA0, dahl_torque, noise_of
from scipy.signal import butter, lfilter, sosfilt

ROWS, STEP = 10_000, 1e-3  # s
LEAD = 200  # rows before the log, so that a late torque has something to show
NOISE = 0.05  # of Fc, unless a kind says otherwise


class Motion:
    """A different sine for each seed, from LEAD rows before the log on."""

    def __init__(self, seed: int, length: float | None = None) -> None:
        draw = np.random.default_rng([seed, 7])
        cycles, phase = draw.uniform(8, 14), draw.uniform(0, 2 * np.pi)
        amplitude = (length or draw.uniform(6, 15)) * FC / SIGMA0  # in presliding lengths
        rows = np.arange(-LEAD, ROWS)
        self.seed = seed
        self.theta = amplitude * np.sin(2 * np.pi * cycles * rows / ROWS + phase)
        self.speed = np.gradient(self.theta, STEP)
        self.shift = draw.uniform()  # of the counts

    def log(self, torque: np.ndarray, part: float = NOISE, shared: float = 0.0) -> Log:
        """The rows of the log, with noise of `part` of Fc, by a 14-bit encoder."""
        theta = np.floor(self.theta[LEAD:] / COUNT + self.shift) * COUNT
        noise = part * FC * noise_of(self.seed, ROWS, shared)
        time = np.arange(ROWS) * STEP
        return Log(f"seed {self.seed}", theta, torque[LEAD:] + noise, time, resolution=COUNT)


Maker = Callable[[int], Log]


def of_torque(torque: Callable[[Motion], np.ndarray], length: float | None = None) -> Maker:
    """A log of this torque along the motion of each seed; strokes of `length`."""

    def make(seed: int) -> Log:
        motion = Motion(seed, length)
        return motion.log(torque(motion))

    return make


def general(theta: np.ndarray, exponent: float) -> np.ndarray:
    """Dahl's model of 1968, dw/du = |1 - s w|^exponent, in closed form."""
    w, left, drawn = 0.0, 1 - exponent, []
    limit = SCALE["Fc"] * FC
    a = SCALE["sigma0"] * SIGMA0 / limit
    for move in np.diff(theta, prepend=theta[0]).tolist():
        side, u = math.copysign(1.0, move), a * abs(move)
        gap = max(1 - side * w, 1e-12)
        w = side * (1 - max(gap**left - left * u, 0.0) ** (1 / left))
        drawn.append(limit * w)
    return np.array(drawn)


def plain(seed: int, part: float = NOISE, shared: float = 0.0) -> Log:
    motion = Motion(seed)
    return motion.log(dahl_torque(motion.theta), part, shared)


def outliers(seed: int) -> Log:
    log, draw = plain(seed), np.random.default_rng([seed, 8])
    hit = draw.choice(ROWS, ROWS // 10, replace=False)
    log.torque[hit] += draw.normal(size=len(hit)) * 5 * FC
    return log


def loaded(motion: Motion) -> np.ndarray:
    """A spring and an offset of a fifth of Fc each, and a viscous torque of a tenth."""
    spring = 0.2 * FC * motion.theta / np.abs(motion.theta).max()
    viscous = 0.1 * FC * motion.speed / np.abs(motion.speed).max()
    return dahl_torque(motion.theta) + spring + viscous + 0.2 * FC


def stribeck(motion: Motion) -> np.ndarray:
    """A third more friction at slow speed."""
    slow = np.exp(-((motion.speed / (0.2 * np.abs(motion.speed).max())) ** 2))
    return dahl_torque(motion.theta, Fc=FC * (1 + 0.3 * slow))


def low_passed(motion: Motion) -> np.ndarray:
    """A filter of the first or the second order, or a running mean: by the seed."""
    filters = (
        lambda x: lfilter([0.1], [1, -0.9], x),
        lambda x: lfilter(np.ones(15) / 15, [1], x),
        lambda x: sosfilt(butter(2, 0.04, output="sos"), x),
    )
    return filters[motion.seed % 3](dahl_torque(motion.theta))


def shaky(seed: int) -> Log:
    """Independent errors of five counts on the angle."""
    motion, log = Motion(seed), plain(seed)
    errors = 5 * COUNT * noise_of(seed + 5000, ROWS)
    return replace(log, theta=np.floor((motion.theta[LEAD:] + errors) / COUNT) * COUNT)


def under_load(seed: int) -> Log:
    """sigma0 and Fc follow a load that swings by half, unrelated to the strokes. At a load of 1
    both have their true values.
    """
    motion, draw = Motion(seed), np.random.default_rng([seed, 10])
    phase = 2 * np.pi * (draw.uniform(0.5, 8) * np.arange(LEAD + ROWS) / ROWS + draw.uniform())
    load = 1 + 0.5 * np.sin(phase)
    torque = dahl_torque(motion.theta, load * SIGMA0, load * FC, is_reduced=True)
    return replace(motion.log(torque), load=load[LEAD:])


def aliased(seed: int) -> Log:
    """Cycles of a whole number of rows, 60 to 400: the counts are the same in each."""
    motion, draw = Motion(seed), np.random.default_rng([seed, 11])
    cycle = int(np.exp(draw.uniform(np.log(60), np.log(400))))
    phase = 2 * np.pi * (np.arange(-LEAD, ROWS) % cycle / cycle + draw.uniform())
    motion.theta = draw.uniform(6, 15) * FC / SIGMA0 * np.sin(phase)
    return motion.log(dahl_torque(motion.theta), 0.01)


def stale(seed: int) -> Log:
    """The angle is read every ten rows, the torque in each."""
    log = plain(seed)
    return replace(log, theta=log.theta[np.arange(ROWS) // 10 * 10])


def seldom(seed: int) -> Log:
    """The torque is read every 20 rows and held, or interpolated: by the seed."""
    log, rows = plain(seed), np.arange(ROWS)
    read = rows[::20]
    held, straight = log.torque[rows // 20 * 20], np.interp(rows, read, log.torque[read])
    return replace(log, torque=held if seed % 2 else straight)


def gaps(seed: int) -> Log:
    """Some of the log is lost: a tenth of a second here and there."""
    draw, kept = np.random.default_rng([seed, 9]), np.ones(ROWS, dtype=bool)
    for start in draw.integers(0, ROWS - 300, size=6):
        kept[start : start + int(draw.integers(80, 300))] = False
    return plain(seed).part(kept)


def wrapped(seed: int) -> Log:
    """A counter of 10 bits less than the motion needs; centred so that it does wrap."""
    motion = Motion(seed, length=30)
    log = motion.log(dahl_torque(motion.theta))
    return replace(log, theta=np.mod(log.theta + 128 * COUNT, 512 * COUNT))


def late(rows: int) -> Maker:
    return of_torque(lambda m: np.roll(dahl_torque(m.theta), rows))  # the lead rolls round


def changing(factor: np.ndarray) -> Maker:
    whole = FC * np.concatenate((np.ones(LEAD), factor))
    return of_torque(lambda m: dahl_torque(m.theta, Fc=whole))


RAMP, HALF = np.linspace(-0.1, 0.1, ROWS), np.arange(ROWS) >= ROWS // 2

KINDS: dict[str, Maker] = {
    "white 1 %": lambda seed: plain(seed, 0.01),
    "white 5 %": plain,
    "white 20 %": lambda seed: plain(seed, 0.2),
    "AR .95, 5 %": lambda seed: plain(seed, NOISE, 0.95),
    "outliers 10 %": outliers,
    "delay of 1 row": late(1),
    "delay of 3 rows": late(3),
    "delay of 10 rows": late(10),
    "delay of 60 rows": late(60),
    "spring and viscous": of_torque(loaded),
    "a A = 1.5": of_torque(lambda m: dahl_torque(m.theta), length=1.5),  # strokes that hardly slip
    "exponent .3": of_torque(lambda m: general(m.theta, 0.3)),
    "exponent 1.6": of_torque(lambda m: general(m.theta, 1.6)),
    "Stribeck 30 %": of_torque(stribeck),
    # two elements, of which one slips three times as early
    "two elements": of_torque(
        lambda m: (
            dahl_torque(m.theta, 0.75 * SIGMA0, FC / 2) + dahl_torque(m.theta, SIGMA0 / 4, FC / 2)
        )
    ),
    "low-passed torque": of_torque(low_passed),
    "angle noise, 5 counts": shaky,
    "Fc trend 20 %": changing(1 + RAMP),
    "Fc step 20 %": changing(np.where(HALF, 1.1, 0.9)),
    "load that swings by half": under_load,
    "encoder aliasing, 1 %": aliased,
    "angle read every 10 rows": stale,
    "torque read every 20 rows": seldom,
    "gaps": gaps,
    "wrap": wrapped,
}
MUST_CLAIM = ("white 1 %", "white 5 %", "AR .95, 5 %", "outliers 10 %")
