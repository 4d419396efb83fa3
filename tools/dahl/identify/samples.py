# SPDX-License-Identifier: MIT
"""All rows of all logs in one table: angles, torque, terms, weights and the cycles that are scored.

A long log is thinned first. If its strokes have many rows, blocks of rows become one sample. If
these are still too many, segments with whole cycles are used, or with turns if cycles are long. So
a fit costs the same for any log.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import median_filter

from dahl.identify import angle as treatments
from dahl.identify import models
from dahl.io.log import HEAD_ROWS, Log

TREATMENTS = ("between counts", "sharp turns", "as read")
MAX_SAMPLES = 10_000  # a fit of more costs seconds and knows little more
MIN_STROKE_SAMPLES = 100  # a stroke of fewer shows its turn poorly
MIN_PRESLIDING_SAMPLES = 20  # in the first presliding length after a turn
SEGMENTS = 8  # of a log with many strokes, so that drift shows
TURNS, SLIDES = 24, 6  # segments round a turn and between turns, if cycles are long
BEFORE_TURN = 0.4  # of a segment round a turn
MAX_FOLDS = 24  # cycles in more are left out in groups
MIN_SCORED_CYCLES = 6  # with fewer a jackknife says little and no parameter is claimed
MIN_FOLDS, FEW_CYCLES_FOLDS = 3, 8  # with fewer cycles, equal parts of the log are left out
SETTLE_LENGTHS = 6.0  # presliding lengths of travel that forget the unknown torque at the start
SETTLE_PART = 0.25  # of the travel of a piece, at most
EDGE_SAMPLES = 100  # at both ends of a piece, where a shifted torque is not known
MIN_TURN_LENGTHS = 0.3  # presliding lengths by which a reversal must turn to be counted
QUICK_STROKE_ROWS = 30  # with fewer, a turn between two rows hides a part of a presliding length
ROWS_BETWEEN = 4  # samples for each row of such a log
MIN_MOVE_COUNTS = 4  # from row to row, of a spline through the rows
MIN_STROKE_PART = 0.05  # of the range of the angle, that a stroke covers
MIN_STROKES, MIN_STROKE_RATIO = 6, 1.5  # from which a delay of several strokes can be seen
HUBER = 4.0  # robust standard deviations beyond which a row weighs less
NEIGHBOURS = 9  # rows whose median says what a row should be
MAX_OUTLIERS = 0.002  # part of the rows; with more, blocks would spread outliers
MIN_NOISE_COUNTS = 0.3  # below it, noise of an angle is part of its counts
NOISE_PLAY = 8.0  # standard deviations of an angle: noise at rest moves it less
ROUNDING = 1e-9  # of the range of an angle: a computed one rests with its last bits in motion
KEEP_ALL = 0.6  # part of the rows, above which segments are not worth the cycles that they cut
MIN_SEGMENT_ROWS, MIN_WINDOW_ROWS = 300, 100  # of a segment, and of one round a turn
NO_CLOCK_STEP = 1e-3  # s, of rows without a clock
FAST_PERCENTILE = 98  # of the speeds: a few wild ones of a jittering clock lie above
REST_SPEED = 0.02  # of fast motion, below which the shaft rests
MIN_RESTS = 0.05  # of the samples; a sine is as slow as a rest in 1 %
KNOTS = 17  # of a torque that depends on the angle
MIN_STEP = 0.2  # of the usual time step: a shorter one is jitter and would give a wild speed


@dataclass(frozen=True)
class Reference:
    """Origins and units of the columns, so that a fit holds for other samples too."""

    centre: float  # rad (m), of springs
    reach: float  # rad (m), from there to the far end
    fast: float  # rad/s (m/s), of fast motion
    mean_speed: float  # geometric, of motion; Fc is given there if it follows the logarithm
    load: float = 1.0  # at which sigma0 and Fc are given


@dataclass(frozen=True)
class Samples:
    """Arrays of shape (n,) over all pieces; `angles` by the treatment of the angle."""

    pieces: list[slice]
    log_of: np.ndarray  # number of the log of each piece
    torque: np.ndarray  # N m (N)
    time: np.ndarray  # s
    weight: np.ndarray  # 0 .. 1
    speed: np.ndarray  # rad/s (m/s)
    acceleration: np.ndarray
    angles: dict[str, np.ndarray]  # rad (m)
    direction: np.ndarray  # of the last move that is no noise: -1 .. 1
    count: float  # rad (m)
    noise: float  # rad (m), of the angle beyond its counts
    block: float  # rows of each sample; below 1 if there are samples between rows
    timed: bool
    reference: Reference
    load: np.ndarray | None = None
    terms: dict[str, np.ndarray] = field(default_factory=dict)
    waves: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))  # (n, KNOTS - 1)
    used: np.ndarray = field(default_factory=lambda: np.zeros(0))  # weight in the fit
    folds: list[slice] = field(default_factory=list)  # samples of each cycle that is left out
    cycles: int = 0

    @property
    def rows(self) -> int:
        return len(self.torque)

    @property
    def logs(self) -> int:
        return len(np.unique(self.log_of))

    @property
    def log_of_rows(self) -> np.ndarray:
        """Number of the log of each sample: (n,)."""
        return np.repeat(self.log_of, [rows.stop - rows.start for rows in self.pieces])

    def moves(self, angle: np.ndarray) -> np.ndarray:
        """From sample to sample, 0 at the start of each piece."""
        moves = np.diff(angle, prepend=angle[:1])
        moves[[rows.start for rows in self.pieces]] = 0.0
        return moves

    def by_piece(self, function: Callable[..., np.ndarray], *arrays: np.ndarray) -> np.ndarray:
        """A function of each piece alone, joined."""
        return np.concatenate([function(*(x[rows] for x in arrays)) for rows in self.pieces])

    def rate(self, x: np.ndarray) -> np.ndarray:
        """The derivative by time."""
        return self.by_piece(np.gradient, x, self.time)

    def delayed(self, x: np.ndarray, delay: float) -> np.ndarray:
        """x as it was `delay` samples before."""
        return self.by_piece(lambda y: delayed(y, delay), x) if delay else x

    @property
    def is_at_rest(self) -> np.ndarray:
        """Whether the shaft rests: (n,)."""
        rests: np.ndarray = np.abs(self.speed) < REST_SPEED * self.reference.fast
        return rests

    @property
    def has_rests(self) -> bool:
        """Whether the shaft rests for more than the turns of a smooth motion."""
        return bool(self.is_at_rest.mean() > MIN_RESTS)

    def travel_since_rest(self) -> np.ndarray:
        """Travel since the last sample at rest or the start of a piece: (n,) rad (m)."""
        travel = np.cumsum(np.abs(self.moves(self.angles["between counts"])))
        starts = self.is_at_rest
        starts[[rows.start for rows in self.pieces]] = True
        last = np.maximum.accumulate(np.where(starts, np.arange(self.rows), 0))
        since: np.ndarray = travel - travel[last]
        return since

    def from_turn(self, a: float) -> np.ndarray:
        """How far each sample is from the last turn of its piece, with the sign: (n,) rad (m)."""

        def of_piece(angle: np.ndarray) -> np.ndarray:
            turns = models.turning_points(angle, MIN_TURN_LENGTHS / a)
            last = np.searchsorted(turns, np.arange(len(angle)), side="right") - 1
            away: np.ndarray = angle - angle[np.append(turns, 0)[last]]
            return away

        return self.by_piece(of_piece, self.angles["between counts"])

    def with_angle(self, name: str, angle: np.ndarray) -> Samples:
        """The same samples with another angle."""
        return replace(self, angles={**self.angles, name: angle})

    def grams(self, columns: np.ndarray) -> np.ndarray:
        """Products of the columns and of the torque, by cycle: (cycles, k + 1, k + 1)."""
        table = np.column_stack((columns, self.torque)) * np.sqrt(self.used)[:, None]
        return np.stack([table[fold].T @ table[fold] for fold in self.folds])

    def max_delay(self) -> float:
        """Return the samples by which the torque may be late: half a stroke if all are alike.

        Such a motion looks the same if the torque is late by a stroke and has the other sign.
        """
        angle = self.angles["between counts"]
        least = max(5 * self.count, MIN_STROKE_PART * float(np.ptp(angle)))
        parts = [np.diff(models.turning_points(angle[rows], least)) for rows in self.pieces]
        lengths = np.concatenate(parts)
        if len(lengths) < MIN_STROKES:
            return np.inf
        low, high = np.percentile(lengths, (10, 90))
        return float(np.median(lengths)) / 2 if high < MIN_STROKE_RATIO * low else np.inf

    def prepared(self, a: float, residual: np.ndarray) -> Samples:
        """The same samples with weights and cycles for a stiffness `a` that is roughly known."""
        weight = self._huber(residual) if (self.weight > 0).all() else self.weight
        settled, cycle = np.zeros(self.rows, dtype=bool), np.zeros(self.rows, dtype=int)
        turns_in_all = 0
        for rows in self.pieces:
            settled[rows] = self._settled(rows, a)
            turns = models.turning_points(self.angles["between counts"][rows], MIN_TURN_LENGTHS / a)
            turns_in_all += len(turns)
            first = int(cycle[rows.start - 1]) + 1 if rows.start else 0
            cycle[rows] = first + _cycle_numbers(turns, rows.stop - rows.start)
        used = weight * settled if (weight * settled).any() else weight
        folds = _folds_of(cycle, used)
        return replace(self, weight=weight, used=used, folds=folds, cycles=turns_in_all // 2)

    def _huber(self, residual: np.ndarray) -> np.ndarray:
        """Less weight for samples that disagree with their neighbours."""
        usual = self.by_piece(lambda r: median_filter(r, NEIGHBOURS, mode="nearest"), residual)
        off = np.abs(residual - usual)
        spread = 1.4826 * float(np.median(off[off > 0])) if (off > 0).any() else np.inf
        weight: np.ndarray = np.minimum(1.0, HUBER * spread / np.maximum(off, 1e-300))
        return weight

    def _settled(self, rows: slice, a: float) -> np.ndarray:
        """Samples of a piece behind which the torque at its start is forgotten."""
        angle = self.angles["between counts"][rows]
        travel = np.cumsum(np.abs(np.diff(angle, prepend=angle[:1])))
        settled: np.ndarray = travel > min(SETTLE_LENGTHS / a, SETTLE_PART * travel[-1])
        edge = min(EDGE_SAMPLES, len(angle) // 20)
        settled[:edge] = settled[len(angle) - edge :] = False
        return settled


def _folds_of(cycle: np.ndarray, used: np.ndarray) -> list[slice]:
    """Cycles with enough weight, in at most MAX_FOLDS groups of neighbours."""
    mass = np.bincount(cycle, used)
    kept = np.flatnonzero(mass > 0.1 * mass.mean())
    group = -(-len(kept) // MAX_FOLDS) or 1
    folds = []
    for i in range(0, len(kept), group):
        several = kept[i : i + group]
        rows = np.flatnonzero((cycle >= several[0]) & (cycle <= several[-1]))
        folds.append(slice(int(rows[0]), int(rows[-1]) + 1))
    if len(folds) >= MIN_FOLDS:
        return folds
    ends = np.linspace(0, len(cycle), FEW_CYCLES_FOLDS + 1).astype(int).tolist()
    return [slice(i, j) for i, j in zip(ends, ends[1:], strict=False)]


def delayed(x: np.ndarray, delay: float) -> np.ndarray:
    """A signal as it was `delay` samples before."""
    places = np.arange(len(x))
    found: np.ndarray = np.interp(places - delay, places, x)
    return found


def _cycle_numbers(turns: np.ndarray, rows: int) -> np.ndarray:
    """The number of the cycle of each sample; of the stroke, if there are few cycles."""
    cuts = turns[::2] if len(turns) > 2 * MIN_SCORED_CYCLES else turns
    number = np.searchsorted(cuts, np.arange(rows), side="right")
    if len(cuts) > 2:  # the parts before the first and after the last turn belong to neighbours
        number = np.clip(number - 1, 0, max(len(cuts) - 2, 0))
    return number


def samples_of(
    logs: Sequence[Log],
    block: int = 0,
    reference: Reference | None = None,
    angles: Sequence[str] = TREATMENTS,
) -> Samples:
    """Return the samples of preprocessed logs.

    `block` is the number of rows of a sample (0: choose); `reference` is that of another fit;
    `angles` are the treatments to compute besides "between counts".
    """
    names = list(dict.fromkeys(log.name for log in logs))
    block = block or _block_of(logs)
    part = MAX_SAMPLES * block / sum(log.rows for log in logs)
    logs = [segment for log in logs for segment in _segments_of(log, part)]
    count = max(log.resolution for log in logs)
    noise = max(treatments.white_noise(log.theta, log.resolution) for log in logs)
    noise = noise if noise > MIN_NOISE_COUNTS * count else 0.0
    timed = all(log.time is not None for log in logs)
    tables = [_columns_of(log, noise, timed, angles) for log in logs]
    joined, pieces = _join([_in_blocks(table, block) for table in tables])
    samples = Samples(
        pieces=pieces,
        log_of=np.array([names.index(log.name) for log in logs]),
        torque=joined["torque"],
        time=joined["time"],
        weight=joined["weight"],
        speed=joined["speed"],
        acceleration=joined["acceleration"],
        angles={key: joined[key] for key in TREATMENTS if key in joined},
        direction=joined["direction"],
        count=count,
        noise=noise,
        block=block / max(log.rows_between for log in logs),
        timed=timed,
        reference=reference or _reference_of(joined),
        load=joined.get("load"),
    )
    return _with_terms(samples)


def fill_quick_strokes(logs: Sequence[Log]) -> list[Log]:
    """Return logs with rows without weight between their rows, if strokes have few rows.

    A shaft that turns between two rows goes further than they show. A spline has these turns.
    """
    return [_with_rows_between(log) if has_quick_strokes(log) else log for log in logs]


def has_quick_strokes(log: Log) -> bool:
    """Whether turns between rows hide a part of the motion."""
    moves = np.abs(log.moves[:HEAD_ROWS])
    usual = float(np.median(moves[moves > 0])) if moves.any() else 0.0
    return usual > MIN_MOVE_COUNTS * log.resolution and _rows_of_a_stroke(log) < QUICK_STROKE_ROWS


def _with_rows_between(log: Log) -> Log:
    rows = np.arange(log.rows)
    places = np.arange((log.rows - 1) * ROWS_BETWEEN + 1) / ROWS_BETWEEN
    last = places.astype(int)
    weight = np.ones(log.rows) if log.weight is None else log.weight
    return replace(
        log.part(last),
        theta=CubicSpline(rows, log.theta)(places),
        time=None if log.time is None else np.interp(places, rows, log.time),
        weight=np.where(places == last, weight[last], 0.0),
        rows_between=ROWS_BETWEEN,
    )


def _join(tables: list[dict[str, np.ndarray]]) -> tuple[dict[str, np.ndarray], list[slice]]:
    """Return the columns that all tables have, one table after the other, and the rows of each."""
    ends = np.cumsum([0, *(len(table["torque"]) for table in tables)]).tolist()
    common = [key for key in tables[0] if all(key in table for table in tables)]
    joined = {key: np.concatenate([table[key] for table in tables]) for key in common}
    return joined, [slice(i, j) for i, j in zip(ends, ends[1:], strict=False)]


def _reference_of(table: dict[str, np.ndarray]) -> Reference:
    angle = table["between counts"]
    low, high = float(angle.min()), float(angle.max())
    speed = np.abs(table["speed"])
    fast = float(np.percentile(speed, FAST_PERCENTILE)) or 1.0
    moving = speed[speed > REST_SPEED * fast]
    mean_speed = float(np.exp(np.mean(np.log(moving)))) if len(moving) else fast
    load = float(np.median(table["load"])) if "load" in table else 1.0
    return Reference((high + low) / 2, (high - low) / 2, fast, mean_speed, load)


def _block_of(logs: Sequence[Log]) -> int:
    """Rows of a sample: 1 unless the strokes have many rows and there are too many rows."""
    rows = sum(log.rows for log in logs)
    if rows <= MAX_SAMPLES or any(_keeps_rows(log) for log in logs):
        return 1
    per_stroke = _rows_of_a_stroke(max(logs, key=lambda log: log.rows))
    return int(np.clip(per_stroke // MIN_STROKE_SAMPLES, 1, -(-rows // MAX_SAMPLES)))


def block_for(logs: Sequence[Log], block: int, a: float) -> int:
    """A block that is short enough for a stiffness `a`: presliding after a turn needs samples."""
    rows = [n for log in logs for n in _presliding_rows(log, a)]
    return block if not rows else int(np.clip(np.median(rows) // MIN_PRESLIDING_SAMPLES, 1, block))


def _presliding_rows(log: Log, a: float) -> list[int]:
    """The rows of the first presliding length after each turn."""
    theta = log.theta[:HEAD_ROWS]
    turns = models.turning_points(theta, MIN_TURN_LENGTHS / a).tolist()
    strokes = zip(turns, [*turns[1:], len(theta)], strict=False)
    away = [np.abs(theta[i:j] - theta[i]) * a > 1 for i, j in strokes]
    return [int(np.argmax(far)) for far in away if far.any()]


def _keeps_rows(log: Log) -> bool:
    """Whether rows must stay apart: some have no torque of their own, or some are outliers."""
    if log.weight is not None and not log.weight.all():
        return True
    torque = log.torque[:HEAD_ROWS]
    off = np.abs(torque - median_filter(torque, NEIGHBOURS, mode="nearest"))
    usual = 1.4826 * float(np.median(off))
    return bool(np.mean(off > 2 * HUBER * usual) > MAX_OUTLIERS) if usual else False


def _rows_of_a_stroke(log: Log) -> float:
    theta = log.theta[:HEAD_ROWS]
    least = max(5 * log.resolution, MIN_STROKE_PART * float(np.ptp(theta)))
    turns = models.turning_points(theta, least)
    return float(np.median(np.diff(turns))) if len(turns) > 1 else float(len(theta))


def _segments_of(log: Log, part: float) -> list[Log]:
    """Return the log or, if only a small part of its rows is to be used, segments from all of it.

    A segment has whole cycles and begins in mid-stroke. If no cycle fits, there are segments round
    turns, and some of the sliding between them.
    """
    budget = max(int(log.rows * part), MIN_SEGMENT_ROWS)
    if budget > KEEP_ALL * log.rows:
        return [log]
    least = max(5 * log.resolution, MIN_STROKE_PART * float(np.ptp(log.theta)))
    turns = models.turning_points(log.theta, least)
    number = min(budget // MIN_SEGMENT_ROWS, SEGMENTS)
    if len(turns) < 3:
        return _cut(log, np.linspace(0, log.rows, number), budget // number)
    cycle = float(np.median(turns[2:] - turns[:-2]))
    cycles = int(budget / number / cycle)
    if cycles == 0:
        return _cut(log, *_round_turns(log, turns, budget))
    first = np.linspace(0, max(len(turns) - 2 * cycles - 2, 0), number).astype(int)
    return _cut(log, (turns[first] + turns[first + 1]) / 2, int(cycles * cycle))


def _round_turns(log: Log, turns: np.ndarray, budget: int) -> tuple[np.ndarray, int]:
    """Return the starts and the width of segments round turns of both directions, and of others."""
    number = min(TURNS + SLIDES, budget // MIN_WINDOW_ROWS)
    width = budget // number
    first = np.linspace(0, len(turns) - 2, max(number * TURNS // (TURNS + SLIDES) // 2, 1))
    chosen = np.unique(np.concatenate((first.astype(int), first.astype(int) + 1)))
    sliding = np.linspace(0, log.rows - width, SLIDES + 2)[1:-1]
    return np.concatenate((turns[chosen] - BEFORE_TURN * width, sliding)), width


def _cut(log: Log, starts: np.ndarray, width: int) -> list[Log]:
    """Return segments of a width; those that overlap are joined."""
    found: list[list[int]] = []
    for start in np.sort(np.clip(starts, 0, log.rows - width)).astype(int).tolist():
        if found and start <= found[-1][1]:
            found[-1][1] = start + width
        else:
            found.append([start, start + width])
    return [log.part(slice(i, j)) for i, j in found]


def _columns_of(
    log: Log, noise: float, timed: bool, angles: Sequence[str]
) -> dict[str, np.ndarray]:
    """All arrays of a log at its own rows."""
    smooth = treatments.smooth_angle(log.theta, log.resolution, noise)
    time = log.time if timed and log.time is not None else NO_CLOCK_STEP * np.arange(log.rows)
    speed, acceleration = rates_of(log.theta, smooth, time, 0.0 if noise else log.resolution)
    table = {
        "torque": log.torque,
        "time": time,
        "weight": np.ones(log.rows) if log.weight is None else log.weight,
        "speed": speed,
        "acceleration": acceleration,
        "between counts": smooth,
        "direction": _direction(log.theta, NOISE_PLAY * noise or ROUNDING * np.ptp(log.theta)),
    }
    has_counts = log.resolution > 0 and not noise
    is_asked = has_counts and "sharp turns" in angles
    if is_asked and not treatments.turns_smoothly(log.theta, log.resolution):
        table["sharp turns"] = treatments.with_sharp_turns(log.theta, log.resolution)
    if has_counts or (noise and treatments.has_corners(log.theta, noise)):
        table["as read"] = log.theta
    if log.load is not None:
        table["load"] = log.load
    return table


def rates_of(
    theta: np.ndarray, smooth: np.ndarray, time: np.ndarray, resolution: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return speed and acceleration of an angle by its smoothed form: (n,) each."""
    step = np.gradient(time)
    usual = float(np.median(step)) or 1.0
    one, two = treatments.derivatives(theta, smooth, resolution)
    return one / np.maximum(step, MIN_STEP * usual), two / usual**2


def _direction(theta: np.ndarray, play: float) -> np.ndarray:
    """The sign of the last move at each row, behind a play that absorbs noise."""
    low, sign, signs = float(theta[0]) - play / 2, 0.0, []
    for angle in theta.tolist():
        if angle > low + play:
            low, sign = angle - play, 1.0
        elif angle < low:
            low, sign = angle, -1.0
        signs.append(sign)
    return np.array(signs)


def _in_blocks(table: dict[str, np.ndarray], block: int) -> dict[str, np.ndarray]:
    """Means over `block` rows; the last incomplete block is left out."""
    if block == 1:
        return table
    whole = len(table["torque"]) // block * block
    return {key: x[:whole].reshape(-1, block).mean(axis=1) for key, x in table.items()}


def _with_terms(samples: Samples) -> Samples:
    """Return samples with the columns of torques other than friction."""
    reference = samples.reference
    z = (samples.angles["between counts"] - reference.centre) / reference.reach
    terms = {
        "offset": np.ones(samples.rows),
        "spring": z,
        "viscous": samples.speed,
        "inertia": samples.acceleration,
        "cubic": z**3,
    }
    knots = np.linspace(-1, 1, KNOTS)
    waves = np.column_stack([np.interp(z, knots, row) for row in np.eye(KNOTS)[1:]])
    return replace(samples, terms=terms, waves=waves)
