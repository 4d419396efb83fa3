# SPDX-License-Identifier: MIT
"""Which motion tells sigma0 and Fc best: the design of the experiment behind `dahl excite`.

For guessed parameters the sensitivities of the torque to sigma0 and Fc, and to the offset, spring
and viscous part that a log may have beside them, are known along any motion; their products, summed
over the rows, give the interval that a fit can reach (the Cramer-Rao bound). A sine is proposed:
its amplitude gives most about sigma0 per second, its number of cycles is what the wanted interval
needs. Its strokes then get different lengths and speeds, since what is the same in each of them (a
part of the torque that comes late, an encoder's error at the turning point) would pass for another
sigma0. The encoder adds noise of its own (a uniform error of one count, times the slope) and sets a
lower limit: presliding must be several counts long.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dahl.errors import Error
from dahl.identify import models

AMPLITUDES = np.geomspace(3, 30, 12)  # in presliding lengths 1/a; 3, as the guess may be off
ROWS_PER_LENGTH = 8.0  # rows in a presliding length at the highest speed, at least
MARGIN = 1.5  # cycles beyond what the bound asks for, as real noise is not independent
LEAST_COUNTS = 4.0  # counts in a presliding length
QUANTILE = 1.96
MIN_CYCLES = 8  # two more than are scored at least: the first and the last may be incomplete
CYCLE_ROWS = 1_000_000
PLACES = (1.0, 0.9, 0.8)  # of the amplitude, turning point by turning point
PACES = (1.0,) * 6 + (1.6,) * 6  # of the rows of a stroke: few changes, for a change is no sine
EDGE = 0.01  # of a parameter, for its sensitivity: seen in a float, and still straight


@dataclass(frozen=True)
class Wanted:
    """What is guessed and what is wanted. N m and rad, or N and m."""

    sigma0: float
    Fc: float
    theta_per_count: float
    noise: float = 0.05  # of the torque sensor, in Fc, standard deviation
    within: float = 0.01  # half width of the 95 % interval of sigma0, in sigma0
    rate: float = 1000.0  # rows per s
    speed: float = math.inf  # rad/s (m/s), highest


@dataclass(frozen=True)
class Motion:
    """Strokes shaped as those of a sine, from its middle on: the largest amplitude in rad (m),
    cycles, rows per cycle at the highest speed.
    """

    amplitude: float
    cycles: int
    rows_per_cycle: int
    rate: float
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
        """rad (m), one row per tick; shape (rows + 1,)."""
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
        """Rows from one turning point to the next, again and again."""
        return [round(self.rows_per_cycle / 2 * pace) for pace in PACES]

    @property
    def _half_a_stroke(self) -> int:
        """Rows from the middle to the first turning point, and from the last one back."""
        return round(self.rows_per_cycle / 4)


def _share(rows: int, from_rest: bool, to_rest: bool) -> np.ndarray:
    """0 .. 1 of a stroke, row by row, as a sine goes from a turning point to the next, or from or
    to its middle: (rows,).
    """
    phase = np.arange(rows) / rows
    if from_rest and to_rest:
        return (1 - np.cos(np.pi * phase)) / 2
    return 1 - np.cos(np.pi / 2 * phase) if from_rest else np.sin(np.pi / 2 * phase)


def propose(wanted: Wanted) -> Motion:
    """The motion. Raises dahl.Error where the encoder or the speed cannot do it."""
    a = wanted.sigma0 / wanted.Fc
    counts = 1 / (a * wanted.theta_per_count)
    if counts < LEAST_COUNTS:
        raise Error(
            f"presliding is {counts:.2g} counts of this encoder long (Fc/sigma0 = {1 / a:.3g});"
            f" at least {LEAST_COUNTS:g} are needed to see sigma0"
        )
    amplitudes = AMPLITUDES / a
    needed = _rows_per_cycle(wanted, amplitudes)
    if not needed[0] <= CYCLE_ROWS:
        raise Error(f"a cycle would take {needed[0]:.3g} rows; at most {CYCLE_ROWS} were expected")
    plans = [_sine(wanted, amplitude) for amplitude in amplitudes[needed <= CYCLE_ROWS].tolist()]
    return min(plans, key=lambda motion: motion.seconds)


def _rows_per_cycle(wanted: Wanted, amplitude: np.ndarray) -> np.ndarray:
    a = wanted.sigma0 / wanted.Fc
    speed = min(wanted.speed, wanted.rate / (a * ROWS_PER_LENGTH))
    return 2 * np.pi * amplitude / speed * wanted.rate


def _sine(wanted: Wanted, amplitude: float) -> Motion:
    """As many cycles of one amplitude as the interval needs."""
    rows = max(math.ceil(_rows_per_cycle(wanted, np.array(amplitude))), 16)
    information = _information(wanted, amplitude, rows)
    error = np.sqrt(np.diag(np.linalg.inv(information)))[:2] / (wanted.sigma0, wanted.Fc)
    cycles = MARGIN * (QUANTILE * error[0] / wanted.within) ** 2
    cycles = max(math.ceil(cycles), MIN_CYCLES)
    reached = QUANTILE * error / math.sqrt(cycles)
    named = dict(zip(("sigma0", "Fc"), map(float, reached), strict=True))
    return Motion(amplitude, cycles, rows, wanted.rate, named)


def _information(wanted: Wanted, amplitude: float, rows: int) -> np.ndarray:
    """Of one cycle in the steady loop, about sigma0, Fc and three terms: (5, 5)."""
    theta = amplitude * np.sin(2 * np.pi * np.arange(3 * rows) / rows)
    moves = np.diff(theta, prepend=0.0)

    def torque(sigma0: float, Fc: float) -> np.ndarray:  # noqa: N803
        return Fc * models.dahl(moves, [slice(0, len(moves))], sigma0 / Fc)

    step = EDGE
    columns = [
        (
            torque(wanted.sigma0 * (1 + step), wanted.Fc)
            - torque(wanted.sigma0 * (1 - step), wanted.Fc)
        )
        / (2 * step * wanted.sigma0),
        (
            torque(wanted.sigma0, wanted.Fc * (1 + step))
            - torque(wanted.sigma0, wanted.Fc * (1 - step))
        )
        / (2 * step * wanted.Fc),
        np.ones(len(theta)),
        theta,
        moves,  # as the speed, for a viscous part
    ]
    ratio = torque(wanted.sigma0, wanted.Fc) / wanted.Fc
    slope = wanted.sigma0 * (1 - np.sign(moves) * ratio)
    variance = (wanted.noise * wanted.Fc) ** 2 + (slope * wanted.theta_per_count) ** 2 / 12
    steady = slice(2 * rows, 3 * rows)
    drawn = np.column_stack(columns)[steady] / np.sqrt(variance[steady])[:, None]
    return drawn.T @ drawn
