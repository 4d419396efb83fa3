# SPDX-License-Identifier: MIT
"""Inertia and bandwidth of a position loop, from a log of it: for the motion of `dahl excite`.

In sliding, the torque less friction is inertia times acceleration. The torque of a loop is its
stiffness times the error of the angle, and terms of the speed and of the integral of the error.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import savgol_filter

from dahl.errors import InputError
from dahl.io.log import Log

SMOOTH_ROWS, ORDER = 15, 3  # of a polynomial through angle, reference and torque alike
SLIDING = 0.4  # of fast motion; presliding near a turn looks like inertia
KNOTS = 17  # of a torque that depends on the angle
PARTS = 12  # of a log, that are left out one by one
MIN_FREE = 0.01  # of a column, that the others do not explain
MAX_ERROR = 0.2  # two standard errors of a coefficient, in it


def inertia_of(log: Log) -> float:
    """Return the inertia of all that moves, kg m^2 (kg). Raises dahl.Error if it does not show."""
    period = _period_of(log)
    theta, speed, acceleration = (_smooth(log.theta, period, order) for order in (0, 1, 2))
    knots = np.linspace(theta.min(), theta.max(), KNOTS)
    by_angle = [np.interp(theta, knots, hat) for hat in np.eye(KNOTS)]  # cogging, gravity, springs
    slides = np.abs(speed) > SLIDING * np.percentile(np.abs(speed), 98)
    table = np.column_stack((acceleration, np.sign(speed), speed, *by_angle))[slides]
    step = "record quicker strokes in the loop, of several speeds, or give --inertia"
    return _first(log, "inertia", table, _smooth(log.torque, period)[slides], step)


def bandwidth_of(log: Log, reference: np.ndarray, inertia: float) -> float:
    """Return the bandwidth of a loop on this inertia, Hz. Raises dahl.Error if it does not show.

    `reference` has the wanted angle of each row, rad (m).
    """
    period = _period_of(log)
    error = reference - log.theta
    terms = error, np.cumsum(error) * period
    columns = [
        *(_smooth(x, period) for x in terms),
        *(_smooth(x, period, 1) for x in (error, reference)),
        _smooth(reference, period, 2),
        np.ones(log.rows),
    ]
    step = "record strokes in which the loop is behind its reference, or give --bandwidth"
    torque = _smooth(log.torque, period)
    stiffness = _first(log, "stiffness of the loop", np.column_stack(columns), torque, step)
    return math.sqrt(stiffness / inertia) / (2 * math.pi)


def _period_of(log: Log) -> float:
    period = 0.0 if log.time is None else float(np.median(np.diff(log.time)))
    if not period > 0:
        raise InputError(f"{log.name}: inertia and bandwidth need times of the rows")
    if log.rows < PARTS * SMOOTH_ROWS:
        raise InputError(f"{log.name}: {log.rows} rows are too few to see inertia and bandwidth")
    return period


def _smooth(x: np.ndarray, period: float, derivative: int = 0) -> np.ndarray:
    found: np.ndarray = savgol_filter(x, SMOOTH_ROWS, ORDER, deriv=derivative, delta=period)
    return found


def _first(log: Log, name: str, table: np.ndarray, torque: np.ndarray, step: str) -> float:
    """Return the first coefficient of least squares, if parts of the log agree on it."""
    rows = np.arange(len(torque))
    kept = [rows, *(np.delete(rows, part) for part in np.array_split(rows, PARTS))]
    whole, *left_out = (np.linalg.lstsq(table[r], torque[r], rcond=None)[0][0] for r in kept)
    error = 2 * math.sqrt((PARTS - 1) * np.var(left_out))
    first, others = table[:, 0], table[:, 1:]
    free = first - others @ np.linalg.lstsq(others, first, rcond=None)[0]
    is_free = free @ free > MIN_FREE**2 * (first @ first)
    if not (is_free and error < MAX_ERROR * whole):
        raise InputError(f"{log.name}: the log does not show the {name}; {step}")
    return float(whole)
