# SPDX-License-Identifier: MIT
"""Laws beside that of a run, fitted to the same log: the sign of the speed, and slip elements."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dahl.binding.slip import Slip
from dahl.report import traces
from dahl.sim.scene import Scene

SLIP_LENGTHS = np.geomspace(1 / 64, 1 / 2, 8)  # at which the elements slip, of the travel


class Law(NamedTuple):
    """A law, its torque at each tick with spring and offset in N m (N), and its R2."""

    name: str
    torque: np.ndarray
    r2: float


def fitted(scene: Scene, trace: traces.Trace, measured: np.ndarray) -> list[Law]:
    """Return both laws, each with its torques and offset of least squares. Rows before `settle` of
    the scene do not count, as in the R2 of the run.
    """
    moves = trace.moves()
    use = trace.row >= scene.measured.settle
    travel = float(np.ptp(trace.count))
    if travel == 0 or len(np.unique(measured[use])) < 2:
        return []
    slips = [_slip(moves, share * travel) for share in SLIP_LENGTHS]
    bases = {"slip elements": slips, "Fc sign(v)": [_held_sign(moves)]}
    spring = scene.measured.spring * trace.angle(scene)
    found = []
    for name, basis in bases.items():
        torque = spring + _positive_fit(np.array(basis).T, measured - spring, use)
        left, spread = measured[use] - torque[use], measured[use] - measured[use].mean()
        found.append(Law(name, torque, 1 - float(left @ left) / float(spread @ spread)))
    return found


def _held_sign(moves: np.ndarray) -> np.ndarray:
    """Return the sign of the last move, as a firmware with a perfect speed sensor has it."""
    last = np.maximum.accumulate(np.where(moves != 0, np.arange(len(moves)), 0))
    return np.asarray(np.sign(moves[last]), float)


def _slip(moves: np.ndarray, counts: float) -> np.ndarray:
    """Return the torque of a slip element that slips at 1 N m after so many counts."""
    within = min(max(counts, 1.0), 2.0**30)  # the library moves a count by 2^-30 of it or more
    element = Slip(sigma0=[1.0], Fc=[1.0], theta_per_count=1 / within)
    return element.run_counts(moves).astype(float)


def _positive_fit(basis: np.ndarray, wanted: np.ndarray, use: np.ndarray) -> np.ndarray:
    """Return the sum of columns and a constant nearest to `wanted`. A torque below 0 is no
    friction, so its column is left out.
    """
    columns = np.column_stack([basis, np.ones(len(basis))])
    while True:
        weights = np.linalg.lstsq(columns[use], wanted[use], rcond=None)[0]
        kept = np.append(weights[:-1] >= 0, True)
        if kept.all():
            return np.asarray(columns @ weights)
        columns = columns[:, kept]
