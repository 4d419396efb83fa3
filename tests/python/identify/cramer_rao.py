# SPDX-License-Identifier: MIT
"""How well a fit of the true law can know its parameters: the bound of Cramer and Rao."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

RELATIVE_STEP = 0.01  # of a parameter, for its sensitivity
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
