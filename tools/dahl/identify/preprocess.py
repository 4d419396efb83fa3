# SPDX-License-Identifier: MIT
"""Check a log before a fit, and repair what the recorder did to it.

preprocess() returns pieces without gaps. Each step adds a note to a log that it changes. A log that
cannot be repaired raises dahl.Error.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import maximum_filter, median_filter
from scipy.signal import savgol_filter

from dahl.errors import InputError
from dahl.identify.angle import white_noise
from dahl.identify.models import turning_points
from dahl.io import encoder_grid
from dahl.io.log import HEAD_ROWS, Log, resolution_of, restarts

MIN_ROWS = 30  # of a log or a piece
MIN_CLIPPED_PART = 0.02  # of all rows, at one extreme torque
MIN_IN_RUNS = 0.7  # of these rows, next to another one, if the sensor is coarse
MIN_FINE_LEVELS = 200  # of a torque, from which a sensor is not coarse
NOISELESS = 1e-4  # of the range of the torque: no sensor resolves such a second difference
MIN_REPEATED_PART = 0.01  # of all rows; fewer repeated rows do no harm
MAX_AT_REST_PART = 0.9  # of all rows; beyond it there is too little motion to decide
MAX_MOVING_REPEATS = 0.1  # of the repeated part: equal torques while the angle moves
MIN_JUMP_COUNTS = 1.5  # a jump after rows at rest is a new reading, not the next count
MIN_HELD_PART = 0.5  # of the travel, in such jumps, if a signal is held
MIN_READINGS = 12  # steps between readings; fewer may be chance
MIN_EVEN_PART = 0.9  # of the steps between readings: whole multiples of the usual one
MAX_BEND = 0.5  # of a step: second difference of a line between readings; white noise has 1.7
MAX_OFF_LINE = 0.1  # of the spread of the torque: distance from the lines between readings
MIN_BEND_RATIO = 10.0  # bend at a reading over the usual bend, if the torque is interpolated
ROUNDING = 1e-10  # of the range of the torque
MIN_WRAP_RATIO = 16.0  # range of a wrapping angle over its largest true move
PERIOD_TOLERANCE = 0.01  # of a period
GAP_STEPS, GAP_PERCENTILE = 5.0, 95  # a gap is so many times this percentile of the clock's steps
CLOCK_ROWS = 51  # over which jittering times are smoothed
JITTER_CORRELATION = -0.3  # of neighbouring steps; white errors of the times have -.5
MIN_JITTER = 0.05  # of a step
MIN_EVENT_PART = 0.9  # of the moves by one count, if a row is written at each encoder edge
MAX_FLICKER = 8  # rows that turn back at once, without the true reversals
FLICKER_ROWS = 9  # of the running median that removes them
MIN_SPIKE_RATIO = 10.0  # largest distance from the median over that of 90 % of the rows
TORQUES = (1e-15, 1e15)  # N m (N), range of a torque
RANGES = {True: (1e-8, 1e2, "m"), False: (1e-7, 1e4, "rad")}  # of an angle, by `linear`


def preprocess(log: Log, trust_units: bool = False, median: int = 0) -> list[Log]:
    """Return the pieces of a log that a fit can use. Raises dahl.Error for a log without
    such a piece.

    `median` is the number of rows of a running median of the angle. If it is 0, a median is used if
    the angle flickers; 1 means no median.
    """
    check(log, trust_units)
    whole = unwrap(drop_repeated_rows(log), trust_units)
    pieces = split_at_gaps(mark_torque_readings(drop_stale_angles(whole)))
    return [remove_flicker(smooth_clock(spread_equal_times(piece)), median) for piece in pieces]


# --- rejected logs --------------------------------------------------------------------------------


def check(log: Log, trust_units: bool = False) -> None:
    """Raise dahl.Error for a log that no fit can use."""
    if log.rows < MIN_ROWS:
        raise InputError(f"{log.name}: {log.rows} rows; at least {MIN_ROWS} were expected")
    for name, values in (("angle", log.theta), ("torque", log.torque)):
        if np.ptp(values) == 0:
            raise InputError(
                f"{log.name}: {name} is constant ({values[0]:g} in all {log.rows} rows): is it the"
                f" right column (--{name})?"
            )
    low, high = TORQUES
    if not low <= np.ptp(log.torque) <= high:
        raise InputError(
            f"{log.name}: the torque covers {np.ptp(log.torque):g} {log.unit}, {low:g} to {high:g}"
            " was expected; is the unit right (--torque-unit)?"
        )
    _check_clipping(log)
    if trust_units:
        return
    span, (low, high, unit) = float(np.ptp(log.theta)), RANGES[log.linear]
    if not low <= span <= high:
        raise InputError(
            f"{log.name}: the angle covers {span:g} {unit}, {low:g} to {high:g} was expected;"
            " is the unit right (--angle-unit, or --trust-units)?"
        )
    encoder_grid.check_unit(log)


def _check_clipping(log: Log) -> None:
    """Raise dahl.Error if many moving rows have exactly the extreme torque of a noisy signal."""
    inside = (log.torque < log.torque.max()) & (log.torque > log.torque.min())
    bends = np.abs(np.diff(log.torque, 2))[inside[1:-1]]
    if len(bends) and np.median(bends) < NOISELESS * np.ptp(log.torque):
        return  # saturated friction without noise is constant too
    moving = _is_moving(log)
    for extreme in (log.torque.max(), log.torque.min()):
        rows = np.flatnonzero(log.torque == extreme)
        many = len(rows) > max(MIN_CLIPPED_PART * log.rows, 20)
        if many and np.mean(moving[rows]) > 0.25 and _is_stuck(log, rows):
            raise InputError(
                f"{log.name}: torque is clipped at {extreme:g} {log.unit}"
                f" ({len(rows)} of {log.rows} rows, the first is row {rows[0] + 1}): record with a"
                " wider range of the sensor"
            )


def _is_moving(log: Log) -> np.ndarray:
    """Return whether the shaft moves at each row, also between two counts: (rows,)."""
    stepped = np.diff(log.theta, prepend=log.theta[0]) != 0
    apart = np.diff(np.flatnonzero(stepped))
    width = 2 * int(np.median(apart)) + 1 if len(apart) else 1
    moving: np.ndarray = maximum_filter(stepped, width)
    return moving


def _is_stuck(log: Log, rows: np.ndarray) -> bool:
    """Whether the extreme occurs in runs, unlike the last step of a coarse sensor.

    With many levels, noise may reach the end of the range in single rows: it cuts their mean.
    """
    levels, counts = np.unique(log.torque, return_counts=True)
    near = counts[1:6] if levels[0] == log.torque[rows[0]] else counts[-6:-1]
    in_runs = len(levels) > MIN_FINE_LEVELS or np.mean(np.diff(rows) == 1) > MIN_IN_RUNS
    return bool(in_runs and len(rows) > 10 * np.mean(near))


# --- repeated rows --------------------------------------------------------------------------------


def drop_repeated_rows(log: Log) -> Log:
    """Leave out rows that repeat angle and torque of the row before."""
    still, same = np.diff(log.theta) == 0, np.diff(log.torque) == 0
    if log.load is not None:
        same &= np.diff(log.load) == 0
    repeated = np.concatenate(([False], still & same))
    part = float(repeated.mean())
    at_rest = still.mean() > MAX_AT_REST_PART
    if part < MIN_REPEATED_PART or at_rest or same[~still].mean() > MAX_MOVING_REPEATS * part:
        return log
    kept = log.torque[~repeated]
    if np.median(np.abs(np.diff(kept, 2))) < NOISELESS * np.ptp(kept):
        return log  # a computed torque stands still with its angle
    note = f"{repeated.sum()} of {log.rows} rows repeat the row before: left out"
    return log.part(~repeated, [*log.notes, note])


# --- signals with fewer readings than rows --------------------------------------------------------


def drop_stale_angles(log: Log) -> Log:
    """Leave out the rows between two readings of the angle. Raises dahl.Error if few are left."""
    changes = np.flatnonzero(np.diff(log.theta)) + 1
    every = rows_per_reading(log.theta, changes, log.resolution)
    if every < 2:
        return log
    rows = np.diff(changes, append=log.rows)  # of one value: several readings if the shaft is slow
    readings = np.maximum(np.rint(rows / every).astype(int), 1)
    number = np.concatenate([np.arange(count) for count in readings])
    fresh = np.minimum(np.repeat(changes, readings) + every * number, log.rows - 1)
    words = f"the angle has a new reading every {every} rows only"
    _check_readings(log, words, len(fresh))
    left = log.rows - len(fresh)
    return log.part(fresh, [*log.notes, f"{words}: the {left} rows between are left out"])


def _check_readings(log: Log, words: str, readings: int) -> None:
    if readings < MIN_ROWS:
        raise InputError(
            f"{log.name}: {words}: {readings} readings, at least {MIN_ROWS} were expected"
        )


def rows_per_reading(values: np.ndarray, changes: np.ndarray, step: float) -> int:
    """Return the usual number of rows between readings of a held signal; 0 if it is not held."""
    rows, moved = np.diff(changes), np.abs(np.diff(values[changes]))
    held = (rows > 1) & (moved >= MIN_JUMP_COUNTS * step)
    if moved[held].sum() < MIN_HELD_PART * moved.sum() or not held.any():
        return 0
    return round(float(np.median(rows[held])))


def mark_torque_readings(log: Log) -> Log:
    """Give weight only to the rows at which a held or interpolated torque was read.

    Raises dahl.Error if they are too few.
    """
    if len(torque_readings(log.torque[:HEAD_ROWS])) == 0:
        return log
    readings = torque_readings(log.torque)
    if len(readings) == 0:
        return log
    every = round(float(np.median(np.diff(readings))))
    theta = log.theta[readings]
    off = np.interp(np.arange(log.rows), readings, theta) - log.theta
    if np.abs(off[readings[0] : readings[-1]]).max() < ROUNDING * np.ptp(theta):
        note = f"angle and torque are drawn straight between every {every}th row: these are used"
        return replace(log.part(readings, [*log.notes, note]), resolution=resolution_of(theta))
    words = f"the torque has a new reading every {every} rows only"
    _check_readings(log, words, len(readings))
    weight = np.zeros(log.rows)
    weight[readings] = 1.0
    torque = np.interp(np.arange(log.rows), readings, log.torque[readings])
    note = f"{words}: the {log.rows - len(readings)} rows between have no weight"
    return replace(log, torque=torque, weight=weight, notes=[*log.notes, note])


def torque_readings(torque: np.ndarray) -> np.ndarray:
    """Return the rows at which a held or interpolated torque was read; no rows otherwise."""
    changes = np.flatnonzero(np.diff(torque)) + 1
    is_held = 2 * len(changes) < len(torque)
    readings = _held_readings(torque, changes) if is_held else _line_ends(torque)
    return readings if _are_even(readings) else readings[:0]


def _held_readings(torque: np.ndarray, changes: np.ndarray) -> np.ndarray:
    """Return jumps by more than the last digit, to more levels than dry friction has."""
    jumps = rows_per_reading(torque, changes, resolution_of(torque)) > 1
    return changes if jumps and len(np.unique(torque)) > MIN_READINGS else changes[:0]


def _line_ends(torque: np.ndarray) -> np.ndarray:
    """Return the isolated bends of a torque that lies on the lines between them.

    Friction itself bends at many neighbouring rows after a reversal.
    """
    step, bend = np.diff(torque), np.abs(np.diff(torque, 2))
    if np.median(bend) > MAX_BEND * np.median(np.abs(step)):
        return np.zeros(0, dtype=int)
    usual = max(float(np.median(bend)), ROUNDING * float(np.ptp(torque)))
    bends = np.flatnonzero(bend > MIN_BEND_RATIO * usual) + 1
    ends = bends[np.diff(bends, prepend=-2) > 1]
    if len(bends) == 0 or 2 * len(ends) < len(bends):
        return ends[:0]
    off = torque - np.interp(np.arange(len(torque)), ends, torque[ends])
    return ends if off.std() < MAX_OFF_LINE * torque.std() else ends[:0]


def _are_even(readings: np.ndarray) -> bool:
    """Whether the readings are evenly spaced; some may repeat the one before."""
    rows = np.diff(readings)
    usual = float(np.median(rows)) if len(rows) >= MIN_READINGS else 0.0
    if usual < 2:
        return False
    off = np.abs(rows - usual * np.rint(rows / usual))
    return bool(np.mean((rows > usual / 2) & (off <= usual // 4)) > MIN_EVEN_PART)


# --- wrapping counters ----------------------------------------------------------------------------


def unwrap(log: Log, trust_units: bool = False) -> Log:
    """Unwrap a counter that wraps. Raises dahl.Error if its period is unclear."""
    jumps = wraps(log.theta)
    paused = [_first_new_row(log, row) - 1 for row in gaps(log).tolist()]
    if trust_units or not np.any(np.delete(jumps, paused)):
        return log  # or the shaft moved on while the recorder paused
    times, period = np.count_nonzero(jumps), wrap_period(log, jumps)
    if period == 0:
        raise InputError(
            f"{log.name}: the angle jumps from one end of its range to the other {times} times, as"
            " a counter that wraps does, but not by a turn or a power of two counts: unwrap it"
            " first (--trust-units uses it as it is)"
        )
    counts = f" ({period / log.resolution:.0f} counts)" if log.resolution else ""
    note = f"angle wraps {times} times at {period:.6g} {log.angle_unit}{counts}: unwrapped"
    return replace(log, theta=np.unwrap(log.theta, period=period), notes=[*log.notes, note])


def wraps(theta: np.ndarray) -> np.ndarray:
    """Return which moves go from end to end of the range in an otherwise smooth motion."""
    moves, span = np.abs(np.diff(theta)), float(np.ptp(theta))
    jumps: np.ndarray = moves > span / 2
    if not jumps.any() or jumps.all():
        return np.zeros_like(jumps)
    usual = float(moves[~jumps].max())
    is_smooth = 0 < MIN_WRAP_RATIO * usual < span
    at_ends = float(moves[jumps].min()) > span - 4 * usual
    return jumps if is_smooth and at_ends else np.zeros_like(jumps)


def wrap_period(log: Log, jumps: np.ndarray) -> float:
    """Return the period that the jumps show: 2^k counts or a turn, rad (m); 0 if neither."""
    moves, rows = np.diff(log.theta), np.flatnonzero(jumps)
    others = np.where(jumps, 0.0, np.abs(moves))
    before, after = others[np.maximum(rows - 1, 0)], others[np.minimum(rows + 1, len(moves) - 1)]
    jumped = float(np.median(np.abs(moves[rows]) + np.maximum(before, after)))
    tolerance = PERIOD_TOLERANCE * jumped + 2 * log.resolution
    periods = [] if log.linear else [2 * np.pi]
    if log.resolution:
        periods.append(log.resolution * 2.0 ** round(np.log2(jumped / log.resolution)))
    near = [period for period in periods if abs(period - jumped) < tolerance]
    return min(near, key=lambda period: abs(period - jumped), default=0.0)


# --- the clock ------------------------------------------------------------------------------------


def split_at_gaps(log: Log) -> list[Log]:
    """Split a log at the gaps and restarts of its clock, and leave out pieces too short or at
    rest.
    """
    after = gaps(log)
    if len(after) == 0:
        return [log]
    assert log.time is not None  # gaps() finds none without a clock
    ends = [*after.tolist(), log.rows]
    starts = [0, *(_first_new_row(log, row) for row in after.tolist())]
    pieces = [slice(start, end) for start, end in zip(starts, ends, strict=True)]
    kept = [rows for rows in pieces if _is_usable(log, rows)]
    left = log.rows - sum(rows.stop - rows.start for rows in kept)
    note = f"{_breaks(log.time, after)}: split there into {len(kept)} pieces" + (
        f"; {left} rows in pieces too short left out" if left else ""
    )
    if not kept:
        raise InputError(f"{log.name}: {note}")
    return [log.part(rows, [] if i else [*log.notes, note]) for i, rows in enumerate(kept)]


def _breaks(time: np.ndarray, after: np.ndarray) -> str:
    """Return the words for breaks of a clock before these rows."""
    steps, words = time[after] - time[after - 1], []
    forward, back = after[steps > 0], after[steps < 0]
    if len(forward):
        lost, many = float(steps[steps > 0].sum()), "s" * (len(forward) > 1)
        place = f"the first after row {forward[0]}"
        words.append(f"has {len(forward)} gap{many} ({lost:.3g} s in all, {place})")
    if len(back):
        times = f" {len(back)} times, first" if len(back) > 1 else ""
        words.append(f"starts anew{times} after row {back[0]}")
    return "the clock " + " and ".join(words)


def _first_new_row(log: Log, row: int) -> int:
    """Return the first row from here on that does not repeat the row before a gap."""
    new = (log.theta[row:] != log.theta[row - 1]) | (log.torque[row:] != log.torque[row - 1])
    return row + int(np.argmax(new))


def _is_usable(log: Log, rows: slice) -> bool:
    moves = np.ptp(log.theta[rows]) > 0 and np.ptp(log.torque[rows]) > 0
    return rows.stop - rows.start >= MIN_ROWS and bool(moves)


def gaps(log: Log) -> np.ndarray:
    """Return the first row after each gap, a time step far above the usual ones, and after each
    restart of the clock.
    """
    if log.time is None:
        return np.zeros(0, dtype=int)
    return np.union1d(restarts(log.time), _long_steps(log, log.time))


def _long_steps(log: Log, time: np.ndarray) -> np.ndarray:
    """Return the first row after each time step far above the usual ones."""
    if _is_written_at_edges(log):
        return np.zeros(0, dtype=int)
    steps = np.diff(time)
    forward = steps[steps > 0]
    if len(forward) < MIN_ROWS:
        return np.zeros(0, dtype=int)
    return np.flatnonzero(steps > GAP_STEPS * np.percentile(forward, GAP_PERCENTILE)) + 1


def _is_written_at_edges(log: Log) -> bool:
    """Whether a row was written at each edge of the encoder, not at each tick of a clock."""
    if log.resolution == 0:
        return False
    counts = np.abs(log.moves[1:]) / log.resolution
    return bool(np.mean(np.abs(counts - 1) < 0.1) > MIN_EVENT_PART)


def spread_equal_times(log: Log) -> Log:
    """Spread rows of one time evenly up to the next time; drop a clock that stands still."""
    if log.time is None:
        return log
    first = np.flatnonzero(np.diff(log.time, prepend=-np.inf))  # row of each new time
    same = log.rows - len(first)
    if same == 0:
        return log
    if len(first) == 1:
        return replace(log, time=None, notes=[*log.notes, "the clock stands still: not used"])
    known = log.time[first]
    per_row = (known[-1] - known[-2]) / (first[-1] - first[-2])
    end = known[-1] + per_row * (log.rows - first[-1])
    time = np.interp(np.arange(log.rows), np.append(first, log.rows), np.append(known, end))
    note = f"{same} of {log.rows} rows have the time of the row before: spread evenly"
    return replace(log, time=time, notes=[*log.notes, note])


def smooth_clock(log: Log) -> Log:
    """Smooth times that jitter around an even clock, since speeds need their differences."""
    if log.time is None or log.rows <= CLOCK_ROWS:
        return log
    usual = np.median(np.diff(log.time))
    off = np.diff(log.time) - usual
    white = off[1:] @ off[:-1] < JITTER_CORRELATION * (off @ off)
    if not white or off.std() < MIN_JITTER * usual:
        return log
    time = savgol_filter(log.time, CLOCK_ROWS, 1)
    return replace(log, time=time, notes=[*log.notes, "the times jitter: smoothed"])


# --- flicker of the angle -------------------------------------------------------------------------


def remove_flicker(log: Log, median: int = 0) -> Log:
    """Use a running median of an angle that turns back at once, unless it has white noise."""
    if median == 1:
        return log
    turns = flicker(log)
    if not median and (turns <= MAX_FLICKER or _is_white(log)):
        return log
    rows = median or FLICKER_ROWS
    why = f"angle turns back at once in {turns} of {log.rows} rows" if not median else "--median"
    note = f"{why}: running median of {rows} rows used"
    theta = median_filter(log.theta, rows, mode="nearest")
    return replace(log, theta=theta, notes=[*log.notes, note])


def _is_white(log: Log) -> bool:
    """Whether all rows have errors of one size; a fit handles these better than a median."""
    off = np.abs(log.theta - median_filter(log.theta, FLICKER_ROWS, mode="nearest"))
    usual = max(float(np.percentile(off, 90)), log.resolution)
    has_spikes = float(off.max()) > MIN_SPIKE_RATIO * usual
    return not has_spikes and white_noise(log.theta, log.resolution) > 0


def flicker(log: Log) -> int:
    """Return how often the angle moves and moves back in the next row, without true reversals."""
    moves = log.moves
    back = int(np.count_nonzero(moves[1:] * moves[:-1] < 0))
    if back <= MAX_FLICKER:
        return 0
    steady = median_filter(log.theta, 15, mode="nearest")
    least = max(3 * log.resolution, 0.02 * float(np.ptp(steady)))
    return max(back - len(turning_points(steady, least)), 0)
