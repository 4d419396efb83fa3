# SPDX-License-Identifier: MIT
"""One log in SI units, ready for a fit, and what was found in it on the way."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

BY_ROW = (
    "theta",
    "torque",
    "time",
    "weight",
    "free_moves",
    "load",
)  # arrays of a Log, one entry a row
SMALL = 1.0  # m: a linear motion of less is shown in mm


@dataclass
class Log:
    """Arrays have shape (rows,). Linear motion has m for rad and N for N m."""

    name: str
    theta: np.ndarray  # rad (m), unwrapped
    torque: np.ndarray  # N m (N), with the sign of the motion where it is friction
    time: np.ndarray | None = None  # s
    linear: bool = False
    resolution: float = 0.0  # rad (m) per encoder count; 0: none was found
    weight: np.ndarray | None = None  # of each row, 1 at most; 0 where nothing was read
    free_moves: np.ndarray | None = None  # rad (m) from row to row without the travel of backlash
    load: np.ndarray | None = None  # what the friction may follow, in whatever unit it came in
    zero: float = 0.0  # rad (m), the angle at which a spring is taken to be relaxed
    notes: list[str] = field(default_factory=list)  # what was found and how it was handled

    @property
    def rows(self) -> int:
        return len(self.theta)

    @property
    def moves(self) -> np.ndarray:
        """rad (m) from row to row, 0 first."""
        return np.diff(self.theta, prepend=self.theta[:1])

    def moves_of(self, rows: slice) -> np.ndarray:
        """rad (m) from row to row for some rows, without the travel of backlash."""
        if self.free_moves is not None:
            return self.free_moves[rows]
        start = rows.start or 0
        return np.diff(self.theta[rows], prepend=self.theta[max(start - 1, 0)])

    def head(self, rows: int) -> Log:
        """The first rows, at most so many; itself where it is no longer."""
        if self.rows <= rows:
            return self
        arrays = {name: getattr(self, name) for name in BY_ROW}
        shorter = {name: all_[:rows] for name, all_ in arrays.items() if all_ is not None}
        return replace(self, **shorter)

    @property
    def unit(self) -> str:
        """Of the torque."""
        return "N" if self.linear else "N m"

    @property
    def slope_unit(self) -> str:
        """Of sigma0."""
        return "N/m" if self.linear else "N m/rad"

    @property
    def angle_unit(self) -> str:
        return "m" if self.linear else "rad"

    @property
    def shown_in(self) -> tuple[float, str]:
        """Of pictures, by the motion: a unit's size in rad (m), and its name."""
        small = self.linear and float(np.ptp(self.theta)) < SMALL
        return (1e-3, "mm") if small else (1.0, self.angle_unit)


def resolution_of(theta: np.ndarray) -> float:
    """The step of the grid on which all angles lie, rad (m); 0 where they lie on none.

    The smallest gap between different angles is tried as the step: on a grid, the gaps up to 20
    steps are whole numbers of it (printing with few digits may move them by a twentieth). All these
    gaps over all these steps are the answer, which printing moves by little.
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
