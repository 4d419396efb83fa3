# SPDX-License-Identifier: MIT
"""What the grid of an angle says of its encoder and its unit: an angle comes in whole counts, and
counts a turn are mostly a power of two.
"""

from __future__ import annotations

import math

import numpy as np

from dahl import Error
from dahl.identify.finding import Finding
from dahl.identify.log import Log, resolution_of

AGREES = 0.01  # of a count
BESIDE = 0.1  # of a count, that a printed angle may be off
LEAST_STEPS = 20  # neighbouring angles one count apart, for a grid coarser than was said
LOOKED_AT = 100_000  # rows
BITS = (8, 26)  # of an encoder
POWER = 5e-4  # of a power of two


def refuse(log: Log) -> None:
    """Raise dahl.Error where the grid contradicts the unit of the angle."""
    if log.resolution and not log.linear:
        _refuse_other_unit(log)


def finding(log: Log) -> list[Finding]:
    """The log's own grid against the counts that were given."""
    theta = log.theta[:LOOKED_AT]
    grid = resolution_of(theta) if log.resolution else 0.0
    if grid == 0 or abs(grid / log.resolution - 1) < AGREES:
        return []
    gaps = np.diff(np.unique(theta))
    coarser = grid > log.resolution
    if coarser and np.count_nonzero(np.abs(gaps / grid - 1) < BESIDE) < LEAST_STEPS:
        return []  # too few angles: some counts may never have been read
    turn, of = (1e-3, "millimetre") if log.linear else (2 * math.pi, "turn")
    words = (
        f"the angle lies on a grid of {turn / grid:.6g} counts a {of}, not of"
        f" {turn / log.resolution:.6g}: is --counts-per-turn right?"
    )
    return [Finding(words, ("sigma0",))]


def _refuse_other_unit(log: Log) -> None:
    """Degrees taken for rad, or rad for degrees: a power of two counts a turn in the other one."""
    counts = 2 * math.pi / log.resolution
    if _power_of_two(counts):
        return
    if _power_of_two(math.degrees(counts)):
        _complain(log, counts, math.degrees(counts), "deg")
    if _power_of_two(math.radians(counts)):
        _complain(log, counts, math.radians(counts), "rad")


def _complain(log: Log, counts: float, other: float, unit: str) -> None:
    taken = "rad" if unit == "deg" else "deg"
    raise Error(
        f"{log.name}: steps of {log.resolution:.6g} rad would be {counts:.1f} counts a turn with"
        f" the angle in {taken}, but {other:.0f} in {unit}: is the angle in {unit}"
        " (--angle-unit, --trust-units)?"
    )


def _power_of_two(counts: float) -> bool:
    bits = round(math.log2(counts))
    return BITS[0] <= bits <= BITS[1] and abs(counts / 2**bits - 1) < POWER
