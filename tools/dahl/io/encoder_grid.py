# SPDX-License-Identifier: MIT
"""Compare the grid of an angle with encoders: confirm its unit, or ask for it.

An angle comes in whole counts, and a turn usually has a power of two or a round number of counts.
So the steps of an angle show its unit, or at least that it has another one.
"""

from __future__ import annotations

import math

import numpy as np

from dahl.errors import InputError
from dahl.io.log import HEAD_ROWS, Log, resolution_of

AGREEMENT = 0.01  # of a count
PRINTED_ERROR = 0.1  # of a count
MIN_STEPS = 20  # neighbouring angles one count apart, for a grid coarser than was given
BITS = (8, 26)  # of an encoder
POWER_TOLERANCE = 5e-4  # of a power of two
TURNS = {"deg": (360.0, "360"), "rad": (2 * math.pi, "2 pi"), "turn": (1.0, "1")}
ROUND_COUNTS, MIN_ROUND_COUNTS = 100, 200  # an encoder with lines has a multiple of this number
ROUND_ERROR = 0.1  # counts
PRINTED_STEPS = (1, 2, 5)  # times a power of ten: the last digit of a printed number
MAX_SKIPPED = 8  # counts between the angles of a log that never shows each count


def check_unit(log: Log) -> None:
    """Raise dahl.Error if a turn has the counts of an encoder in another unit only."""
    grid = resolution_of(log.theta[:HEAD_ROWS]) if log.resolution else 0.0
    if not grid or log.linear or "angle" in log.questions:
        return
    given = 0.0 if abs(grid / log.resolution - 1) < AGREEMENT else 2 * math.pi / log.resolution
    counts = 2 * math.pi / grid
    if _is_power_of_two(counts) or _skipped(counts, given):
        return
    others = [("deg", "rad", math.degrees(counts)), ("rad", "deg", math.radians(counts))]
    if np.ptp(log.theta) < math.radians(1):  # an angle of whole 2^-k deg covers more
        others.append(("turn", "deg", counts / 360))
    if np.ptp(log.theta) < 1:
        others.append(("turn", "rad", counts / (2 * math.pi)))
    for unit, stated, other in others:
        if _is_power_of_two(other) or _skipped(other, given):
            raise InputError(
                f"{log.name}: steps of {grid:.6g} rad would be {counts:.1f} counts a turn"
                f" with the angle in {stated}, but {other:.0f} in {unit}: is the angle in {unit}"
                " (--angle-unit, --trust-units)?"
            )


def question(angle: np.ndarray, assumed: str, counts_per_turn: float) -> str:
    """Return a question about the unit of an angle that no name and no option states.

    "" if the steps of the angle are those of an encoder in the assumed unit and in no other one.
    `counts_per_turn` is the number that the user gave, or 0.
    """
    grid = resolution_of(angle[:HEAD_ROWS])
    if grid == 1 and not (angle % 1).any():
        return "is the angle in counts? Its steps are whole numbers (--angle-unit counts)"
    found = _units_of(grid, counts_per_turn) if grid else {}
    if list(found) == [assumed]:
        return ""
    if not found:
        return f"is the angle in {assumed}? Neither a name nor its steps say so (--angle-unit)"
    steps = " or ".join(f"{TURNS[unit][1]}/{counts:.0f}" for unit, counts in found.items())
    return f"is the angle in {' or '.join(found)}? Its steps are {steps} (--angle-unit)"


def _units_of(grid: float, counts_per_turn: float) -> dict[str, float]:
    """Return the units in which steps are those of an encoder, each with its counts per turn."""
    counts = {unit: turn / grid for unit, (turn, _) in TURNS.items()}
    if counts_per_turn:
        return {unit: n for unit, n in counts.items() if _skipped(n, counts_per_turn)}
    digit = grid / 10 ** math.floor(math.log10(grid) + AGREEMENT)
    if min(abs(digit - one) for one in PRINTED_STEPS) < ROUND_ERROR / ROUND_COUNTS:
        return {}
    powers = {unit: n for unit, n in counts.items() if _is_power_of_two(n)}
    return powers or {unit: n for unit, n in counts.items() if _is_round(n)}


def _skipped(counts: float, given: float) -> int:
    """Return how many counts of an encoder a step has; 0 if it is not a whole number of them."""
    ratio = given / counts
    near = round(ratio)
    return near if 0 < near <= MAX_SKIPPED and abs(ratio / near - 1) < AGREEMENT else 0


def _is_round(counts: float) -> bool:
    off = abs(counts - ROUND_COUNTS * round(counts / ROUND_COUNTS))
    return counts > MIN_ROUND_COUNTS and off < ROUND_ERROR


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
    bits = round(math.log2(max(counts, 1.0)))
    return BITS[0] <= bits <= BITS[1] and abs(counts / 2**bits - 1) < POWER_TOLERANCE
