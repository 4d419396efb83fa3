# SPDX-License-Identifier: MIT
"""Compare the grid of an angle with the encoder and the unit that the user gave.

An angle comes in whole counts, and a turn usually has a power of two counts.
"""

from __future__ import annotations

import math

import numpy as np

from dahl.errors import Error
from dahl.io.log import HEAD_ROWS, Log, resolution_of

AGREEMENT = 0.01  # of a count
PRINTED_ERROR = 0.1  # of a count
MIN_STEPS = 20  # neighbouring angles one count apart, for a grid coarser than was given
BITS = (8, 26)  # of an encoder
POWER_TOLERANCE = 5e-4  # of a power of two


def check_unit(log: Log) -> None:
    """Raise dahl.Error if a turn has a power of two counts in another unit only."""
    if not log.resolution or log.linear:
        return
    counts = 2 * math.pi / log.resolution
    if _is_power_of_two(counts):
        return
    for unit, given, other in (
        ("deg", "rad", math.degrees(counts)),
        ("rad", "deg", math.radians(counts)),
    ):
        if _is_power_of_two(other):
            raise Error(
                f"{log.name}: steps of {log.resolution:.6g} rad would be {counts:.1f} counts a turn"
                f" with the angle in {given}, but {other:.0f} in {unit}: is the angle in {unit}"
                " (--angle-unit, --trust-units)?"
            )


def contradiction(log: Log) -> str:
    """Return one line if the angle lies on another grid than that of the counts, else ""."""
    theta = log.theta[:HEAD_ROWS]
    grid = resolution_of(theta) if log.resolution else 0.0
    if grid == 0 or abs(grid / log.resolution - 1) < AGREEMENT:
        return ""
    steps = np.diff(np.unique(theta)) / grid
    coarser = grid > log.resolution
    if coarser and np.count_nonzero(np.abs(steps - 1) < PRINTED_ERROR) < MIN_STEPS:
        return ""  # too few angles: some counts may never have been read
    turn, of = (1e-3, "millimetre") if log.linear else (2 * math.pi, "turn")
    return (
        f"the angle lies on a grid of {turn / grid:.6g} counts a {of}, not of"
        f" {turn / log.resolution:.6g}: is --counts-per-turn right?"
    )


def _is_power_of_two(counts: float) -> bool:
    bits = round(math.log2(counts))
    return BITS[0] <= bits <= BITS[1] and abs(counts / 2**bits - 1) < POWER_TOLERANCE
