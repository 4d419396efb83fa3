# SPDX-License-Identifier: MIT
"""One log in SI units, ready for a fit, and what was found in it on the way."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

BY_ROW = ("theta", "torque", "time", "weight", "load")  # arrays of a Log, one entry for each row
TERMS = ("offset", "spring", "viscous", "inertia")  # that --terms may name
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
    load: np.ndarray | None = None  # what the friction may follow, in whatever unit it came in
    notes: list[str] = field(default_factory=list)  # what was found and how it was handled

    @property
    def rows(self) -> int:
        return len(self.theta)

    @property
    def moves(self) -> np.ndarray:
        """rad (m) from row to row, 0 first."""
        return np.diff(self.theta, prepend=self.theta[:1])

    def part(self, rows: slice | np.ndarray, notes: list[str] | None = None) -> Log:
        """Some rows; with these notes instead of its own, if given."""
        arrays = {name: getattr(self, name) for name in BY_ROW}
        some = {name: values[rows] for name, values in arrays.items() if values is not None}
        return replace(self, notes=list(self.notes) if notes is None else notes, **some)

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
