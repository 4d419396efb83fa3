# SPDX-License-Identifier: MIT
"""One log in SI units, ready for a fit, with notes on how it was read and repaired."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

BY_ROW = ("theta", "torque", "time", "weight", "load")  # arrays of a Log, one entry for each row
HEAD_ROWS = 100_000  # first rows of a log: enough to see its grid, readings and strokes
TERMS = ("offset", "spring", "viscous", "inertia")  # that --terms may name
MIN_RESTART_ROWS = 30  # that a clock goes back if it starts anew, and between two restarts
MIN_SPAN_IN_M = 1.0  # m: a shorter linear motion is shown in mm


@dataclass
class Log:
    """Arrays have shape (rows,). Linear motion has m for rad and N for N m."""

    name: str
    theta: np.ndarray  # rad (m), unwrapped
    torque: np.ndarray  # N m (N); friction has the sign of the motion
    time: np.ndarray | None = None  # s
    linear: bool = False
    resolution: float = 0.0  # rad (m) per encoder count; 0 if it is unknown
    weight: np.ndarray | None = None  # of each row, at most 1; 0 if it has no reading
    load: np.ndarray | None = None  # that the friction may follow, in any unit
    rows_between: int = 1  # rows for each one that was recorded
    notes: list[str] = field(default_factory=list)  # what was found and repaired
    questions: dict[str, str] = field(default_factory=dict)  # about assumed units, by quantity

    @property
    def rows(self) -> int:
        return len(self.theta)

    @property
    def moves(self) -> np.ndarray:
        """rad (m) from row to row, 0 first."""
        return np.diff(self.theta, prepend=self.theta[:1])

    def part(self, rows: slice | np.ndarray, notes: list[str] | None = None) -> Log:
        """Return some rows; with these notes instead of its own, if given."""
        arrays = {name: getattr(self, name) for name in BY_ROW}
        some = {name: values[rows] for name, values in arrays.items() if values is not None}
        return replace(self, notes=list(self.notes) if notes is None else notes, **some)

    @property
    def unit(self) -> str:
        """Unit of the torque."""
        return "N" if self.linear else "N m"

    @property
    def slope_unit(self) -> str:
        """Unit of sigma0."""
        return "N/m" if self.linear else "N m/rad"

    @property
    def angle_unit(self) -> str:
        """Unit of the angle."""
        return "m" if self.linear else "rad"

    @property
    def shown_in(self) -> tuple[float, str]:
        """The unit of the angle in pictures: its size in rad (m), and its name."""
        small = self.linear and float(np.ptp(self.theta)) < MIN_SPAN_IN_M
        return (1e-3, "mm") if small else (1.0, self.angle_unit)


def restarts(time: np.ndarray) -> np.ndarray:
    """Return the rows at which a clock starts anew: it goes far back, and then on for many rows. A
    clock that goes back more often than on has none: its newest row may be the first one.
    """
    steps = np.diff(time)
    forward = steps[steps > 0]
    if len(forward) <= (steps < 0).sum():
        return np.zeros(0, dtype=int)
    rows = np.flatnonzero(steps < -MIN_RESTART_ROWS * np.median(forward)) + 1
    apart = np.diff(rows, prepend=0, append=len(time))
    return rows if np.median(apart) >= MIN_RESTART_ROWS else rows[:0]


def resolution_of(theta: np.ndarray) -> float:
    """Return the step of the grid on which all angles lie, rad (m); 0 if there is no grid.

    The smallest gap between different angles is a first guess of the step. On a grid, the gaps up
    to 20 steps are whole numbers of steps; printing with few digits moves them by at most a
    twentieth. The sum of these gaps over the number of their steps is little affected by that.
    """
    levels = np.unique(theta)
    gaps = np.diff(levels)
    gaps = gaps[gaps > 1e-9 * np.ptp(theta)] if len(gaps) else gaps
    if len(gaps) < 3:
        return 0.0
    step = float(np.median(gaps[gaps < 1.3 * gaps.min()]))
    small = gaps[gaps < 20.5 * step] / step
    whole = np.round(small)
    if len(small) < 3 or np.mean(np.abs(small - whole) < 0.1) <= 0.95:
        return 0.0
    return float(step * small.sum() / whole.sum())
