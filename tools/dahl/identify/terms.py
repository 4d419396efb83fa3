# SPDX-License-Identifier: MIT
"""What may act on the shaft beside friction: the one table of terms that a fit can take.

A term is a coefficient, which a fit finds, times a column that a log gives row by row. All else
that is asked of a term stands in its row: its unit, whether it needs a clock, what a coefficient
below 0 means. A further term is a further row.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from dahl.identify.log import Log

SMOOTH = 9  # rows over which speed and its change are taken


@dataclass(frozen=True)
class Motion:
    """What a column is made of; arrays of shape (rows,)."""

    way: np.ndarray  # rad (m) from where a spring is taken to be relaxed
    speed: np.ndarray  # rad/s (m/s)
    change: np.ndarray  # of the speed, rad/s2 (m/s2)


@dataclass(frozen=True)
class Term:
    """One row of the table."""

    column: Callable[[Motion], np.ndarray]
    unit: str  # of the coefficient, by {torque} and {angle}
    timed: bool = False  # needs a clock, and resembles a torque that comes late
    drives: bool = False  # a coefficient below 0 drives the motion
    impossible: bool = False  # there is none below 0


TERMS = {
    "offset": Term(lambda motion: np.ones_like(motion.way), "{torque}"),
    "spring": Term(lambda motion: motion.way, "{torque}/{angle}", drives=True),
    "viscous": Term(lambda motion: motion.speed, "{torque} s/{angle}", timed=True, drives=True),
    "inertia": Term(
        lambda motion: motion.change, "{torque} s2/{angle}", timed=True, impossible=True
    ),
}
TIMED = frozenset(name for name, term in TERMS.items() if term.timed)
UNTIMED = tuple(name for name in TERMS if name not in TIMED)
_PLACES = {name: place for place, name in enumerate(TERMS)}


def place_of(name: str) -> int:
    """Which column is a term's."""
    return _PLACES[name]


def places_of(names: Iterable[str]) -> list[int]:
    return [_PLACES[name] for name in names]


def unit_of(name: str, log: Log) -> str:
    """The unit of a term's coefficient."""
    return TERMS[name].unit.format(torque=log.unit, angle=log.angle_unit)


def columns_of(log: Log, rows: slice = slice(None)) -> np.ndarray:
    """The terms and the torque: (rows, len(TERMS) + 1)."""
    motion = Motion(log.theta[rows] - log.zero, *speed_of(log, rows))
    return np.column_stack((*(term.column(motion) for term in TERMS.values()), log.torque[rows]))


def torque_of(log: Log, coefficients: Mapping[str, float]) -> np.ndarray:
    """The torque of these terms together: (rows,) N m (N)."""
    columns = columns_of(log)
    parts = (value * columns[:, place_of(name)] for name, value in coefficients.items())
    return sum(parts, np.zeros(log.rows))


def speed_of(log: Log, rows: slice = slice(None)) -> tuple[np.ndarray, np.ndarray]:
    """Speed and its change, smoothed over SMOOTH rows; zeros where the log has no time."""
    start, end, _ = rows.indices(log.rows)
    if log.time is None or log.rows < 3 * SMOOTH:
        return np.zeros(end - start), np.zeros(end - start)
    first, last = max(start - 2 * SMOOTH, 0), min(end + 2 * SMOOTH, log.rows)
    time = log.time[first:last]
    speed = _smooth(_slope(log.theta[first:last], time))
    change = _smooth(_slope(speed, time))
    return speed[start - first : end - first], change[start - first : end - first]


def _slope(values: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Central differences; rows with one and the same time borrow their neighbour's."""
    rows = np.arange(len(time))
    ahead, behind = np.minimum(rows + 1, len(time) - 1), np.maximum(rows - 1, 0)
    step = time[ahead] - time[behind]
    least = 1e-3 * max(time[-1] - time[0], 1e-12) / len(time)
    slope: np.ndarray = (values[ahead] - values[behind]) / np.maximum(step, least)
    return slope


def _smooth(values: np.ndarray) -> np.ndarray:
    padded = np.pad(values, SMOOTH // 2, mode="edge")
    return np.convolve(padded, np.full(SMOOTH, 1 / SMOOTH), mode="valid")
