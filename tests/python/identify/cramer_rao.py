# SPDX-License-Identifier: MIT
"""How well a fit of the true law can know its parameters: the bound of Cramer and Rao."""

from collections.abc import Callable, Mapping

import numpy as np
from dahl.io.log import Log
from identify_tools import SCALE

RELATIVE_STEP = 0.01  # of a parameter, for its sensitivity
PARTS = 20  # of a log, whose errors are independent
KNOWN = 0.1  # half width of an interval, in its parameter: a log that shows less is not counted


def half_widths(
    torque: Callable[..., np.ndarray], values: Mapping[str, float], noise: np.ndarray | float
) -> dict[str, float]:
    """Two standard errors of each parameter, in its value (of a value 0: in its unit).

    torque(**values) is the torque of each row, without noise; `noise` is the standard deviation of
    its white noise.
    """
    columns = []
    for name, value in values.items():
        step = RELATIVE_STEP * (value or 1.0)
        up, down = (torque(**{**values, name: value + side * step}) for side in (1, -1))
        columns.append((up - down) / (2 * RELATIVE_STEP) / noise)
    table = np.column_stack(columns)
    size = np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    covariance = np.linalg.pinv((table / size).T @ (table / size), rcond=1e-12)
    error = 2 * np.sqrt(np.diag(covariance)) / size
    return dict(zip(values, error.tolist(), strict=True))


def half_widths_of(make: Callable[[], Log]) -> dict[str, float]:
    """Two standard errors of sigma0 and Fc, in their values, of a log that make() makes anew.

    The torque is linear in ln sigma0, ln Fc, an offset, angle, speed and acceleration. The changes
    with both parameters add up to the friction itself. The standard errors are those of the errors
    of PARTS of the log, which may be correlated within a part.
    """
    log = make()
    changes = [_change(make, name) for name in SCALE]
    speed = np.gradient(log.theta)
    others = np.ones(log.rows), log.theta - log.theta.mean(), speed, np.gradient(speed)
    table = np.column_stack((*changes, *others))
    size = np.abs(table).max(axis=0)
    table /= size
    residual = log.torque - table @ np.linalg.lstsq(table, log.torque, rcond=None)[0]
    inverse = np.linalg.pinv(table.T @ table)
    parts = np.array_split(np.arange(log.rows), PARTS)
    errors = np.array([inverse @ table[rows].T @ residual[rows] for rows in parts]) / size
    return dict(zip(SCALE, (2 * np.linalg.norm(errors, axis=0)).tolist(), strict=False))


def _change(make: Callable[[], Log], name: str) -> np.ndarray:
    """The change of the torque with the logarithm of a parameter of all friction."""
    torques = []
    for side in (1, -1):
        SCALE[name] = 1 + side * RELATIVE_STEP
        torques.append(make().torque)
    SCALE[name] = 1.0
    return (torques[0] - torques[1]) / (2 * RELATIVE_STEP)
