# SPDX-License-Identifier: MIT
"""Design the motion that `dahl excite` proposes for an identification.

For guessed parameters, the sensitivities of the torque to sigma0, Fc, offset, spring and viscous
friction are known along any motion. Their products, summed over the rows, give the interval that a
fit can reach (the Cramer-Rao bound). The amplitude of a sine is chosen for the least time, and the
number of cycles for the wanted interval. The strokes then get different lengths and speeds:
otherwise a delayed torque, damping or an encoder error at the turning points looks like another
sigma0. The encoder adds a uniform error of one count times the slope. Presliding must be several
counts long. If inertia and bandwidth of a position loop are known, the loop can follow the motion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dahl.errors import InputError
from dahl.identify import models

AMPLITUDES = np.geomspace(3, 30, 12)  # presliding lengths 1/a; at least 3 if the guess is wrong
MIN_ROWS_PER_LENGTH = 8.0  # in a presliding length at the highest speed
CYCLES_MARGIN = 1.5  # times the bound, since real noise is not independent
MIN_COUNTS = 4.0  # in a presliding length
QUANTILE = 1.96  # of a 95 % interval
MIN_CYCLES = 8  # six must be scored; the first and the last may be incomplete
MAX_CYCLE_ROWS = 1_000_000
PLACES = (1.0, 0.9, 0.8)  # of the amplitude, turning point by turning point
PACES = (1.0,) * 6 + (1.6,) * 6 + (2.6,) * 6  # of the rows of a stroke; few changes: no sine there
BANDWIDTH_RATIO = 5.0  # bandwidth of the loop over the frequency of the strokes
MAX_INERTIA_TORQUE = 0.5  # of Fc, at a turning point
MIN_LOOP_ERRORS = 4.0  # of a loop that friction holds back by Fc over its stiffness, in amplitudes
RELATIVE_STEP = 0.01  # of a parameter, for its sensitivity


@dataclass(frozen=True)
class Wanted:
    """Guessed parameters and the wanted interval. N m and rad, or N and m."""

    sigma0: float
    Fc: float
    theta_per_count: float
    noise: float = 0.05  # standard deviation of the torque sensor, in Fc
    within: float = 0.01  # half width of the 95 % interval of sigma0, in sigma0
    rate: float = 1000.0  # rows per s
    speed: float = math.inf  # highest, rad/s (m/s)
    inertia: float = 0.0  # of all that moves, kg m^2 (kg); 0: not limited
    bandwidth: float = math.inf  # of the position loop, Hz

    @property
    def loop_error(self) -> float:
        """How far friction holds back the loop, rad (m)."""
        stiffness = self.inertia * (2 * math.pi * self.bandwidth) ** 2
        return self.Fc / stiffness if 0 < stiffness < math.inf else 0.0


@dataclass(frozen=True)
class Motion:
    """Strokes with the shape of a sine, from its middle on."""

    amplitude: float  # largest, rad (m)
    cycles: int
    rows_per_cycle: int  # at the highest speed
    rate: float  # rows per s
    within: dict[str, float]  # expected half width of the 95 % interval, in the parameter

    @property
    def seconds(self) -> float:
        return self.rows / self.rate

    @property
    def rows(self) -> int:
        often, more = divmod(self.reversals - 1, len(PACES))
        return 2 * self._half_a_stroke + often * sum(self._strokes) + sum(self._strokes[:more])

    @property
    def reversals(self) -> int:
        return 2 * self.cycles

    def theta(self) -> np.ndarray:
        """Return the angle in rad (m), (rows + 1,)."""
        places = np.resize(PLACES, self.reversals) * np.resize((1, -1), self.reversals)
        ends = self.amplitude * np.concatenate(([0.0], places, [0.0]))
        between = np.resize(self._strokes, self.reversals - 1).tolist()
        lengths = [self._half_a_stroke, *between, self._half_a_stroke]
        strokes = [
            start + (end - start) * _share(rows, start != 0, end != 0)
            for start, end, rows in zip(ends, ends[1:], lengths, strict=False)
        ]
        return np.concatenate((*strokes, [0.0]))

    @property
    def _strokes(self) -> list[int]:
        """Rows between turning points; the list repeats."""
        return [round(self.rows_per_cycle / 2 * pace) for pace in PACES]

    @property
    def _half_a_stroke(self) -> int:
        """Rows from the middle to a turning point."""
        return round(self.rows_per_cycle / 4)


def _share(rows: int, from_rest: bool, to_rest: bool) -> np.ndarray:
    """Return the part of a stroke that is done at each row, 0 to 1: (rows,).

    A sine goes from a turning point to the next one, or from or to its middle.
    """
    phase = np.arange(rows) / rows
    if from_rest and to_rest:
        return (1 - np.cos(np.pi * phase)) / 2
    return 1 - np.cos(np.pi / 2 * phase) if from_rest else np.sin(np.pi / 2 * phase)


def propose(wanted: Wanted) -> Motion:
    """Return the motion. Raises dahl.Error if the encoder or the speed cannot do it."""
    a = wanted.sigma0 / wanted.Fc
    counts = 1 / (a * wanted.theta_per_count)
    if counts < MIN_COUNTS:
        raise InputError(
            f"presliding is {counts:.2g} counts of this encoder long (Fc/sigma0 = {1 / a:.3g});"
            f" at least {MIN_COUNTS:g} are needed to see sigma0"
        )
    amplitudes = np.maximum(AMPLITUDES / a, MIN_LOOP_ERRORS * wanted.loop_error)
    needed = _rows_per_cycle(wanted, amplitudes)
    if not needed[0] <= MAX_CYCLE_ROWS:
        raise InputError(
            f"a cycle needs {needed[0]:.3g} rows; at most {MAX_CYCLE_ROWS} were expected"
        )
    possible = amplitudes[needed <= MAX_CYCLE_ROWS].tolist()
    return min((_sine(wanted, one) for one in possible), key=lambda motion: motion.seconds)


def _rows_per_cycle(wanted: Wanted, amplitude: np.ndarray) -> np.ndarray:
    a = wanted.sigma0 / wanted.Fc
    speed = min(wanted.speed, wanted.rate / (a * MIN_ROWS_PER_LENGTH))
    by_torque = wanted.inertia * amplitude / (MAX_INERTIA_TORQUE * wanted.Fc)
    seconds = np.maximum(amplitude / speed, np.sqrt(by_torque)) * 2 * np.pi
    least: np.ndarray = np.maximum(seconds, BANDWIDTH_RATIO / wanted.bandwidth)
    return least * wanted.rate


def _sine(wanted: Wanted, amplitude: float) -> Motion:
    """Return as many cycles of one amplitude as the interval needs."""
    rows = max(math.ceil(_rows_per_cycle(wanted, np.array(amplitude))), 16)
    information = _information(wanted, amplitude, rows)
    error = np.sqrt(np.diag(np.linalg.inv(information)))[:2] / (wanted.sigma0, wanted.Fc)
    cycles = CYCLES_MARGIN * (QUANTILE * error[0] / wanted.within) ** 2
    cycles = max(math.ceil(cycles), MIN_CYCLES)
    reached = QUANTILE * error / math.sqrt(cycles)
    named = dict(zip(("sigma0", "Fc"), map(float, reached), strict=True))
    return Motion(amplitude, cycles, rows, wanted.rate, named)


def _information(wanted: Wanted, amplitude: float, rows: int) -> np.ndarray:
    """Return the Fisher information of a steady cycle about sigma0, Fc and three terms: (5, 5)."""
    theta = amplitude * np.sin(2 * np.pi * np.arange(3 * rows) / rows)
    moves, sigma0, Fc = np.diff(theta, prepend=0.0), wanted.sigma0, wanted.Fc  # noqa: N806
    up, down = 1 + RELATIVE_STEP, 1 - RELATIVE_STEP

    def torque(sigma0: float, Fc: float) -> np.ndarray:  # noqa: N803
        return Fc * models.dahl(moves, [slice(0, len(moves))], sigma0 / Fc)

    columns = [
        (torque(sigma0 * up, Fc) - torque(sigma0 * down, Fc)) / (2 * RELATIVE_STEP * sigma0),
        (torque(sigma0, Fc * up) - torque(sigma0, Fc * down)) / (2 * RELATIVE_STEP * Fc),
        np.ones(len(theta)),
        theta,
        moves,  # a speed, for viscous friction
    ]
    slope = sigma0 * (1 - np.sign(moves) * (torque(sigma0, Fc) / Fc))
    variance = (wanted.noise * Fc) ** 2 + (slope * wanted.theta_per_count) ** 2 / 12
    steady = slice(2 * rows, 3 * rows)
    weighted = np.column_stack(columns)[steady] / np.sqrt(variance[steady])[:, None]
    return weighted.T @ weighted
