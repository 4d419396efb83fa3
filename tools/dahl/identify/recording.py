# SPDX-License-Identifier: MIT
"""What the recording did to a log, put right before any fit and named: rows that repeat the row
before, a counter that wraps, an angle that is read more seldom than the torque or a torque more
seldom than the angle, a clock with gaps or coarser than the rows.

Each step takes a log and gives it back mended, with a note; a log that cannot be mended is refused.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dahl import Error
from dahl.identify.clean import MIN_ROWS
from dahl.identify.log import BY_ROW, Log, resolution_of

REPEATED = 0.01  # of the rows
AT_REST = 0.9  # of the rows: beyond it a log has no motion to tell from
BY_CHANCE = 0.1  # of the repeated rows: so many torques stay while the angle moves
NOISELESS = 1e-4  # of the range of the torque: a change of slope that no sensor resolves
JUMP = 1.5  # counts in a row: a motion so fast shows another count in the row before, too
HELD = 0.5  # of the travel, by jumps after rows at rest
SMOOTH_SPAN = 16.0  # the range of a wrapping angle over its largest true move
NEAR_WHOLE = 0.01  # of a period
LOOKED_AT = 100_000  # rows, before all of them
TOLD = 12  # steps from reading to reading, that are no chance
EVEN = 0.9  # of the steps from reading to reading: whole multiples of the usual one
CROOKED = 0.5  # of the steps, that their usual change may be between readings: white noise has 1.7
BESIDE = 0.1  # of the spread of the torque, that it lies beside the lines between readings
STRAIGHT = 10.0  # times the usual change of slope: a bend of a torque drawn straight between two
ROUNDING = 1e-10  # of the range of a torque drawn straight
LONG_STEP, USUAL = 5.0, 95  # times the USUAL-th percentile of the clock's steps
EVENTS = 0.9  # of the moving rows by one count: a log written at each edge of the encoder


def mended(log: Log, trust_units: bool = False) -> list[Log]:
    """The log as pieces without a gap, wrap, repeated or stale row. Raises dahl.Error."""
    whole = unwrapped(without_repeats(log), trust_units)
    pieces = split_at_gaps(with_torque_readings(without_stale_angles(whole)))
    return [evened(piece) for piece in pieces]


def taken(log: Log, rows: np.ndarray | slice, notes: list[str]) -> Log:
    """Some rows of a log, with these notes."""
    arrays = {name: getattr(log, name) for name in BY_ROW}
    some = {name: values[rows] for name, values in arrays.items() if values is not None}
    return replace(log, notes=notes, **some)


# --- repeated rows --------------------------------------------------------------------------------


def without_repeats(log: Log) -> Log:
    """Without the rows that give angle and torque of the row before once more, where the torque
    never stands still while the angle moves.
    """
    still, same = np.diff(log.theta) == 0, np.diff(log.torque) == 0
    if log.load is not None:
        same &= np.diff(log.load) == 0
    repeated = np.concatenate(([False], still & same))
    share = float(repeated.mean())
    if share < REPEATED or still.mean() > AT_REST or same[~still].mean() > BY_CHANCE * share:
        return log
    if _noiseless(log.torque[~repeated]):
        return log  # a computed torque stands still with its angle
    words = f"{repeated.sum()} of {log.rows} rows repeat the row before: left out"
    return taken(log, ~repeated, [*log.notes, words])


def _noiseless(torque: np.ndarray) -> bool:
    return bool(np.median(np.abs(np.diff(torque, 2))) < NOISELESS * np.ptp(torque))


# --- an angle that is read more seldom than the torque --------------------------------------------


def without_stale_angles(log: Log) -> Log:
    """Without the rows between two readings of the angle, which have the torque of another angle.
    Raises dahl.Error where too few are left.
    """
    changes = np.flatnonzero(np.diff(log.theta)) + 1
    every = rows_of_a_reading(log.theta, changes, log.resolution)
    if every < 2:
        return log
    rows = np.diff(changes, append=log.rows)  # of one angle: of several readings, where it is slow
    readings = np.maximum(np.rint(rows / every).astype(int), 1)
    number = np.concatenate([np.arange(count) for count in readings])
    fresh = np.minimum(np.repeat(changes, readings) + every * number, log.rows - 1)
    words = f"the angle has a new reading every {every} rows only"
    if len(fresh) < MIN_ROWS:
        few = f"{len(fresh)} readings, at least {MIN_ROWS} were expected"
        raise Error(f"{log.name}: {words}: {few}")
    left = log.rows - len(fresh)
    return taken(log, fresh, [*log.notes, f"{words}: the {left} rows between are left out"])


def rows_of_a_reading(values: np.ndarray, changes: np.ndarray, resolution: float) -> int:
    """The usual number of rows from one reading of a signal to the next, where it jumps after rows
    at rest; 0 where it does not.
    """
    rows, moved = np.diff(changes), np.abs(np.diff(values[changes]))
    held = (rows > 1) & (moved >= JUMP * resolution)
    if moved[held].sum() < HELD * moved.sum() or not held.any():
        return 0
    return round(float(np.median(rows[held])))


# --- a torque that is read more seldom than the angle ---------------------------------------------


def with_torque_readings(log: Log) -> Log:
    """Where the torque is read more seldom than the angle and held, or drawn straight, from one
    reading to the next: with weight at its readings only, and straight between them.
    Raises dahl.Error where they are too few.
    """
    if len(torque_readings(log.torque[:LOOKED_AT])) == 0:
        return log
    readings = torque_readings(log.torque)
    if len(readings) == 0:
        return log
    every = round(float(np.median(np.diff(readings))))
    words = f"the torque has a new reading every {every} rows only"
    if len(readings) < MIN_ROWS:
        few = f"{len(readings)} readings, at least {MIN_ROWS} were expected"
        raise Error(f"{log.name}: {words}: {few}")
    rows, weight = np.arange(log.rows), np.zeros(log.rows)
    weight[readings] = 1.0
    torque = np.interp(rows, readings, log.torque[readings])
    notes = [*log.notes, f"{words}: the {log.rows - len(readings)} rows between weigh nothing"]
    return replace(log, torque=torque, weight=weight, notes=notes)


def torque_readings(torque: np.ndarray) -> np.ndarray:
    """The rows at which a torque was read that is held or drawn straight between; none where each
    row has a reading of its own.
    """
    changes = np.flatnonzero(np.diff(torque)) + 1
    stands = 2 * len(changes) < len(torque)
    readings = _of_a_held(torque, changes) if stands else _of_a_straight(torque)
    return readings if _evenly(readings) else readings[:0]


def _of_a_held(torque: np.ndarray, changes: np.ndarray) -> np.ndarray:
    """Where it jumps, by more than its last digit and to more levels than dry friction has."""
    jumps = rows_of_a_reading(torque, changes, resolution_of(torque)) > 1
    return changes if jumps and len(np.unique(torque)) > TOLD else changes[:0]


def _of_a_straight(torque: np.ndarray) -> np.ndarray:
    """Where it bends, each bend alone, and lies on the lines between; friction itself bends at many
    rows after a reversal.
    """
    step, bend = np.diff(torque), np.abs(np.diff(torque, 2))
    if np.median(bend) > CROOKED * np.median(np.abs(step)):
        return np.zeros(0, dtype=int)
    rounding = max(float(np.median(bend)), ROUNDING * float(np.ptp(torque)))
    bends = np.flatnonzero(bend > STRAIGHT * rounding) + 1
    readings = bends[np.diff(bends, prepend=-2) > 1]  # one between two rows bends at both
    if len(bends) == 0 or 2 * len(readings) < len(bends):
        return readings[:0]
    beside = torque - np.interp(np.arange(len(torque)), readings, torque[readings])
    return readings if beside.std() < BESIDE * torque.std() else readings[:0]


def _evenly(readings: np.ndarray) -> bool:
    """Whether readings come every so many rows, save that some are the same as the one before."""
    rows = np.diff(readings)
    usual = float(np.median(rows)) if len(rows) >= TOLD else 0.0
    if usual < 2:
        return False
    off = np.abs(rows - usual * np.rint(rows / usual))
    return bool(np.mean((rows > usual / 2) & (off <= usual // 4)) > EVEN)


# --- wraps ----------------------------------------------------------------------------------------


def unwrapped(log: Log, trust_units: bool = False) -> Log:
    """With the jumps of a counter that wraps taken out. Raises dahl.Error where there are jumps of
    that kind and the period cannot be told.
    """
    jumps = wraps_of(log.theta)
    if trust_units or not jumps.any():
        return log
    period = period_of(log, jumps)
    if period == 0:
        raise Error(
            f"{log.name}: the angle jumps from one end of its range to the other"
            f" {np.count_nonzero(jumps)} times, as a counter that wraps does, but not by a turn or"
            " a power of two counts: unwrap it first (--trust-units takes it as it is)"
        )
    counts = f" ({period / log.resolution:.0f} counts)" if log.resolution else ""
    words = (
        f"angle wraps {np.count_nonzero(jumps)} times at {period:.6g} {log.angle_unit}{counts}:"
        " unwrapped"
    )
    return replace(log, theta=np.unwrap(log.theta, period=period), notes=[*log.notes, words])


def wraps_of(theta: np.ndarray) -> np.ndarray:
    """Which moves go from one end of the range to the other in a motion that else is smooth."""
    moves, span = np.abs(np.diff(theta)), float(np.ptp(theta))
    jumps: np.ndarray = moves > span / 2
    if not jumps.any() or jumps.all():
        return np.zeros_like(jumps)
    usual = float(moves[~jumps].max())
    smooth = 0 < SMOOTH_SPAN * usual < span
    at_ends = float(moves[jumps].min()) > span - 4 * usual
    return jumps if smooth and at_ends else np.zeros_like(jumps)


def period_of(log: Log, jumps: np.ndarray) -> float:
    """At which angle the counter wraps: a power of two counts, or a turn; 0: neither."""
    moves = np.diff(log.theta)
    rows = np.flatnonzero(jumps)
    others = np.where(jumps, 0.0, np.abs(moves))
    beside = np.maximum(
        others[np.maximum(rows - 1, 0)], others[np.minimum(rows + 1, len(moves) - 1)]
    )
    jumped = float(np.median(np.abs(moves[rows]) + beside))
    slack = NEAR_WHOLE * jumped + 2 * log.resolution
    whole = [] if log.linear else [2 * np.pi]
    if log.resolution:
        whole.append(log.resolution * 2.0 ** round(np.log2(jumped / log.resolution)))
    near = [period for period in whole if abs(period - jumped) < slack]
    return min(near, key=lambda period: abs(period - jumped), default=0.0)


# --- gaps of the clock ----------------------------------------------------------------------------


def split_at_gaps(log: Log) -> list[Log]:
    """The pieces between the gaps: what moved in a gap nobody saw, so that each piece has its own
    torque at its first row. Pieces too short for a fit, or without motion, are left out.
    """
    after = gaps_of(log)
    if len(after) == 0:
        return [log]
    assert log.time is not None  # no gap is found without a clock
    ends = [0, *after.tolist(), log.rows]
    cut = [slice(start, end) for start, end in zip(ends, ends[1:], strict=False)]
    whole = [rows for rows in cut if _tells(log, rows)]
    lost = float(np.sum(log.time[after] - log.time[after - 1]))
    left = sum(rows.stop - rows.start for rows in cut) - sum(r.stop - r.start for r in whole)
    words = (
        f"the clock has {len(after)} gap{'s' * (len(after) != 1)} ({lost:.3g} s in all, the first"
        f" after row {after[0]}): split there into {len(whole)} pieces"
        + (f"; {left} rows in pieces too short left out" if left else "")
    )
    if not whole:
        raise Error(f"{log.name}: {words}")
    return [taken(log, rows, [] if i else [*log.notes, words]) for i, rows in enumerate(whole)]


def _tells(log: Log, rows: slice) -> bool:
    """Whether a piece is long enough and moves."""
    long_enough = rows.stop - rows.start >= MIN_ROWS
    return long_enough and np.ptp(log.theta[rows]) > 0 and bool(np.ptp(log.torque[rows]) > 0)


def gaps_of(log: Log) -> np.ndarray:
    """The first row after each gap of the clock: a step of time far above the usual ones, in a log
    that is sampled by its clock and not at each edge of the encoder.
    """
    if log.time is None or by_event(log):
        return np.zeros(0, dtype=int)
    steps = np.diff(log.time)
    going = steps[steps > 0]
    if len(going) < MIN_ROWS:
        return np.zeros(0, dtype=int)
    return np.flatnonzero(steps > LONG_STEP * np.percentile(going, USUAL)) + 1


def by_event(log: Log) -> bool:
    """Whether a log was written at each edge of the encoder, not at times of a clock."""
    if log.resolution == 0:
        return False
    counts = np.abs(log.moves[1:]) / log.resolution
    return bool(np.mean(np.abs(counts - 1) < 0.1) > EVENTS)


# --- a clock coarser than the rows ----------------------------------------------------------------


def evened(log: Log) -> Log:
    """With the rows of one and the same time spread evenly up to the next time, so that each has a
    speed; without a clock where it stands still.
    """
    if log.time is None:
        return log
    first = np.flatnonzero(np.diff(log.time, prepend=-np.inf))  # row of each time
    same = log.rows - len(first)
    if same == 0:
        return log
    if len(first) == 1:
        return replace(log, time=None, notes=[*log.notes, "the clock stands still: not used"])
    known = log.time[first]
    end = known[-1] + (known[-1] - known[-2]) / (first[-1] - first[-2]) * (log.rows - first[-1])
    time = np.interp(np.arange(log.rows), np.append(first, log.rows), np.append(known, end))
    words = f"{same} of {log.rows} rows have the time of the row before: spread evenly"
    return replace(log, time=time, notes=[*log.notes, words])
