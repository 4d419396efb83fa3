# SPDX-License-Identifier: MIT
"""Read the log that a scene replays: the counts for dahl-loop, and the measurement to compare with.

[motion], [load] and [measured] of the scene name its columns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dahl.errors import InputError
from dahl.io import readers
from dahl.io.can_signals import Columns
from dahl.sim.scene import Scene

COLUMNS = {  # section and key with the name of each column
    "angle": ("motion", "angle"),
    "time": ("motion", "time"),
    "load": ("load", "column"),
    "torque": ("measured", "torque"),
}
MAX_TRAVEL = 2**31 - 1  # counts from the first row


@dataclass
class Recorded:
    """The columns of a log that are compared with the model; arrays of shape (rows,)."""

    torque: np.ndarray | None  # N m (N); None if it was not measured
    time: np.ndarray | None  # s; None if the log has no time
    rows: int


def _read(scene: Scene, log: Path, *roles: str) -> Columns:
    wanted = {role: scene.file.text(*COLUMNS[role]) for role in roles}
    return readers.read_columns(log, {role: name for role, name in wanted.items() if name})


def read_recorded(scene: Scene, log: Path) -> Recorded:
    """Read torque and time of the scene's log, and check its angle. Raises dahl.Error."""
    _, table = _read(scene, log, "angle", "torque", "time")
    _check_unwrapped(scene, log, table["angle"])
    torque = table.get("torque")
    measured = None if torque is None else torque * scene.measured.torque_scale
    return Recorded(measured, table.get("time"), len(table["angle"]))


def _check_unwrapped(scene: Scene, log: Path, angle: np.ndarray) -> None:
    """Raise dahl.Error for an angle that wraps: dahl-loop would turn the shaft back in one tick."""
    per_unit = scene.theta_per_count * scene.file.number("motion", "counts_per_unit")
    if scene.measured.unit == "N" or not per_unit > 0:
        return
    turn = 2 * math.pi / per_unit
    jumps = np.abs(np.diff(angle)) > turn / 2
    if jumps.any():
        row = int(np.argmax(jumps))
        raise InputError(
            f"{log}: the angle goes from {angle[row]:g} to {angle[row + 1]:g} in one row, more than"
            " half a turn: does it start anew at each turn? Unwrap it, as numpy.unwrap does"
        )


def counts_of(scene: Scene, log: Path) -> str:
    """Return the file of counts of a log: a count, and x if the scene has a load, for each row."""
    names, table = _read(scene, log, "angle", "time", "load")
    with np.errstate(all="ignore"):  # a number that overflows is too far as well
        angle = table["angle"] * scene.file.number("motion", "counts_per_unit")
        travel = angle - angle[0]
    far = np.flatnonzero(~(np.abs(travel) < MAX_TRAVEL))
    if len(far):
        words = f"{travel[far[0]]:.9g} counts from the first row, more than 2^31"
        raise InputError(f"{log}: column '{names['angle']}': row {far[0] + 1} is {words}")
    counts = _nearest(travel).tolist()
    if "load" not in table:
        return "".join(f"{count}\n" for count in counts)
    loads = table["load"].tolist()
    return "".join(f"{count} {x!r}\n" for count, x in zip(counts, loads, strict=True))


def _nearest(values: np.ndarray) -> np.ndarray:
    """Round to the nearest integer, halves away from zero."""
    whole: np.ndarray = np.trunc(values)
    whole += np.sign(values) * (np.abs(values - whole) >= 0.5)
    return whole.astype(np.int64)
