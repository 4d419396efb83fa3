# SPDX-License-Identifier: MIT
"""What is wrong with a measured log: refused where it makes a fit meaningless, handled and named
where it does not.

Refused: constant angle or torque, clipped torque, units and encoders that cannot be. Handled: an
angle that flickers or has spikes, torque rows that disagree with their neighbours, a flat zone of
backlash, a torque that comes late.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import Akima1DInterpolator, CubicSpline
from scipy.ndimage import maximum_filter, median_filter
from scipy.signal import savgol_filter

from dahl import Error
from dahl.identify import grid, path
from dahl.identify.log import Log

WINDOWS = (1, 5, 9, 15)  # rows of the running median of the angle that are tried
FLICKER = 8  # rows that turn and turn back at once, beyond one for each true reversal
CLIPPED = 0.02  # of all rows at one and the same extreme torque
OUTLIER = 4.0  # robust standard errors beyond which a row weighs less (Huber)
NEIGHBOURS = 9  # rows whose median says what a row should be like
BAND, APART = 0.1, 0.25  # of Fc: half width of a band of torque, distance to the bands beside it
FLAT = 2.5  # a band that takes so many times the travel of its neighbours is flat
CUBICS = (81, 41, 21, 11)  # rows of the local cubics that are tried between counts
BENDS = 1.03  # of what the next narrower one leaves of the readings: it cuts strokes short
REST = 3.0  # times the rows of the counts before and after it, that a rest takes at least
FEW_RESTS = 4  # of a log; fewer are no part of its motion
MIN_ROWS = 30


def refuse(log: Log, trust_units: bool = False) -> None:
    """Raise dahl.Error for a log that no fit can use."""
    if log.rows < MIN_ROWS:
        raise Error(f"{log.name}: {log.rows} rows; at least {MIN_ROWS} were expected")
    for name, values in (("angle", log.theta), ("torque", log.torque)):
        if np.ptp(values) == 0:
            raise Error(f"{log.name}: {name} is constant ({values[0]:g} in all {log.rows} rows)")
    _refuse_clipped(log)
    if not trust_units:
        _refuse_units(log)


def _refuse_clipped(log: Log) -> None:
    """Many rows at the very same extreme, in a torque that elsewhere is noisy. Where a shaft rests,
    a torque without noise stays as it is: a quarter of the rows must move."""
    inside = (log.torque < log.torque.max()) & (log.torque > log.torque.min())
    noise = np.abs(np.diff(log.torque, 2))[inside[1:-1]]
    if len(noise) and np.median(noise) < 1e-4 * np.ptp(log.torque):
        return  # without noise a saturated friction is constant too
    moving = _under_way(log)
    for extreme in (log.torque.max(), log.torque.min()):
        there = np.flatnonzero(log.torque == extreme)
        many = len(there) > max(CLIPPED * log.rows, 20)
        if many and np.mean(moving[there]) > 0.25 and _sticks(log, there):
            raise Error(
                f"{log.name}: torque is clipped at {extreme:g} {log.unit}"
                f" ({len(there)} of {log.rows} rows, the first is row {there[0] + 1})"
            )


def _under_way(log: Log) -> np.ndarray:
    """Rows in which the shaft moves, also between two counts that are as far apart as usual."""
    stepped = np.diff(log.theta, prepend=log.theta[0]) != 0
    apart = np.diff(np.flatnonzero(stepped))
    near: np.ndarray = maximum_filter(stepped, 2 * int(np.median(apart)) + 1 if len(apart) else 1)
    return near


def _sticks(log: Log, there: np.ndarray) -> bool:
    """Long runs at the extreme, not the last step of a coarse sensor."""
    levels, counts = np.unique(log.torque, return_counts=True)
    beside = counts[1:6] if levels[0] == log.torque[there[0]] else counts[-6:-1]
    return bool(np.mean(np.diff(there) == 1) > 0.7 and len(there) > 10 * np.mean(beside))


def _refuse_units(log: Log) -> None:
    """Amplitudes and encoders that nobody has."""
    span = float(np.ptp(log.theta))
    low, high, unit = (1e-8, 1e2, "m") if log.linear else (1e-7, 1e4, "rad")
    if not low <= span <= high:
        raise Error(
            f"{log.name}: the angle covers {span:g} {unit}, {low:g} to {high:g} was expected;"
            " is the unit right (--angle-unit, or --trust-units)?"
        )
    grid.refuse(log)


def flickers(log: Log) -> int:
    """How often the angle goes one way and at once the other, beyond its true reversals."""
    moves = log.moves
    back = int(np.count_nonzero(moves[1:] * moves[:-1] < 0))
    steady = median(log, WINDOWS[-1])
    true = len(path.reversals(steady, max(3 * log.resolution, 0.02 * float(np.ptp(steady)))))
    return max(back - true, 0)


def median(log: Log, window: int) -> np.ndarray:
    """The angle as the running median of `window` rows: (rows,) rad (m)."""
    return log.theta if window == 1 else median_filter(log.theta, window, mode="nearest")


def between_counts(log: Log) -> np.ndarray:
    """The angle between the edges of counts, (rows,) rad (m): a spline through the edges passed,
    then the widest local cubic that agrees with the readings, kept within half a count of them.

    An encoder hides up to a count of travel at each turning point, in a periodic motion always the
    same part; the torque knows better.
    """
    found = _through_edges(log)
    if found is None:
        return log.theta
    resting = _at_rest(log, *found)
    inner = _within_count(np.where(np.isnan(resting), found[0], resting), log)
    windows = [window for window in CUBICS if log.rows > window]
    left = [_left_by(savgol_filter(inner, window, 3), log) for window in windows]
    for window, (off, spread), (_, next_spread) in zip(
        windows, left, left[1:] + left[-1:], strict=True
    ):
        if off < 0.01 and spread <= BENDS * next_spread:
            smooth = savgol_filter(inner, window, 3)
            smooth = savgol_filter(_within_count(smooth, log), window, 3)
            return _within_count(np.where(np.isnan(resting), smooth, resting), log)
    return inner


def doubt_between_counts(log: Log, inner: np.ndarray) -> np.ndarray:
    """By how much another path through the edges of counts is off `inner`, which between_counts()
    gave: (rows,) rad (m). Akima's splines follow a kink of the speed that cubic ones round; where
    the shaft rests both paths are the same.
    """
    found = _through_edges(log)
    if found is None:
        return np.zeros(log.rows)
    _, places, edges = found
    rows = np.clip(np.arange(log.rows), places[0], places[-1])
    other = _within_count(Akima1DInterpolator(places, edges)(rows), log)
    doubt: np.ndarray = np.where(np.isnan(_at_rest(log, *found)), other - inner, 0.0)
    return doubt


def _left_by(smooth: np.ndarray, log: Log) -> tuple[float, float]:
    """The part of the rows in which a smooth angle is off its reading, and by how much it is so on
    the mean, in counts.
    """
    off = np.abs(smooth - log.theta) / log.resolution
    return float(np.mean(off > 0.65)), float(np.sqrt(np.mean(off**2)))


def rests(log: Log) -> bool:
    """Whether the shaft rests between two counts, for longer than a smooth turn takes."""
    found = _through_edges(log)
    return found is not None and len(_rests_of(log, *found)) > 0


def _through_edges(log: Log) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """A spline through the edges of counts that were passed, (rows,), and the places and angles of
    these; nothing where there are too few.
    """
    passed = np.flatnonzero(np.diff(log.theta))
    if log.resolution == 0 or len(passed) < 4:
        return None
    places, edges = passed + 0.5, (log.theta[passed] + log.theta[passed + 1]) / 2
    rows = np.clip(np.arange(log.rows), places[0], places[-1])
    return CubicSpline(places, edges)(rows), places, edges


def _rests_of(log: Log, inner: np.ndarray, places: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """After which edges the shaft rests, of those that stand beside two each way: the next one
    takes much longer than these, which went on in one direction, and the spline goes on by more
    than a count.
    """
    rows = np.arange(int(places[0]) + 1, int(places[-1]) + 1)
    took, steps = np.diff(places), np.diff(edges)
    far = np.abs(inner[rows] - log.theta[rows]) > log.resolution
    found = np.unique(np.searchsorted(places, rows[far])) - 1
    found = found[(found > 1) & (found < len(took) - 2)]
    before, after = (found[:, None] + two for two in ((-2, -1), (1, 2)))
    beside = np.maximum(took[before].max(axis=1), took[after].max(axis=1))
    steady = (steps[before].prod(axis=1) > 0) & (steps[after].prod(axis=1) > 0)
    resting: np.ndarray = found[steady & (took[found] > REST * beside)]
    return resting if len(resting) >= FEW_RESTS else resting[:0]


def _at_rest(log: Log, inner: np.ndarray, places: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Each rest at what was read, (rows,), NaN elsewhere; up to half a count the shaft goes on with
    the speed it had.
    """
    rested, took = np.full(log.rows, np.nan), np.diff(places)
    for k in _rests_of(log, inner, places, edges):
        there = np.arange(int(places[k]) + 1, int(places[k + 1]) + 1)
        begin, end = (min(took[k + side] / 2, took[k] / 3) for side in (-1, 1))
        known = [places[k], places[k] + begin, places[k + 1] - end, places[k + 1]]
        read = log.theta[there[0]]
        rested[there] = np.interp(there, known, [edges[k], read, read, edges[k + 1]])
    return rested


def _within_count(theta: np.ndarray, log: Log) -> np.ndarray:
    half = log.resolution / 2
    kept: np.ndarray = np.clip(theta, log.theta - half, log.theta + half)
    return kept


def huber(residual: np.ndarray, before: np.ndarray | None) -> np.ndarray:
    """Weights 0 .. 1: less for rows that disagree with their neighbours, (rows,). `before` are the
    weights of rows that weigh less for another reason; those that weigh nothing are no neighbours.
    """
    if before is not None and not before.all():
        some, counted = np.zeros(len(before)), before > 0
        some[counted] = huber(residual[counted], before[counted])
        return some
    odd = np.abs(residual - median_filter(residual, NEIGHBOURS, mode="nearest"))
    usual = 1.4826 * float(np.median(odd[odd > 0])) if (odd > 0).any() else 0.0
    limit = max(OUTLIER * usual, 1e-6 * float(np.ptp(residual)))
    weight: np.ndarray = np.minimum(
        1.0, np.divide(limit, odd, out=np.ones_like(odd), where=odd > limit)
    )
    return weight if before is None else weight * before


def backlash(log: Log, ratio: np.ndarray, turns: np.ndarray) -> tuple[float, float, np.ndarray]:
    """A flat zone between two reversals: its travel in rad (m), its centre in F/Fc, and moves
    without it; 0 where there is none.

    `ratio` is the measured F/Fc. A band of torque is flat when crossing it takes more than FLAT
    times the travel that the bands beside it take; friction that bends gives 1.
    """
    ends = [0, *turns.tolist(), log.rows - 1]
    parts = [(i, j) for i, j in zip(ends, ends[1:], strict=False) if j - i > 8]
    centres = np.linspace(-0.4, 0.4, 17)
    found = [_flatness(log, ratio, parts, centre) for centre in centres]
    best = int(np.argmax([flatness for flatness, *_ in found]))
    flatness, extra, crossed = found[best]
    if flatness < FLAT or crossed < 3 or extra < 3 * log.resolution:
        return 0.0, 0.0, log.moves
    moves = log.moves.copy()
    for i, j in parts:
        inside = slice(*_crossing(ratio[i:j], centres[best], log.theta[j] > log.theta[i], i))
        moves[inside] /= flatness
    return extra, float(centres[best]), moves


def _flatness(
    log: Log, ratio: np.ndarray, parts: list[tuple[int, int]], centre: float
) -> tuple[float, float, int]:
    """Travel in the band over travel in its neighbours, extra travel, number of crossings."""
    shares, extras = [], []
    for i, j in parts:
        forward = log.theta[j] > log.theta[i]
        widths = [
            _travel(log, _crossing(ratio[i:j], centre + beside, forward, i))
            for beside in (-APART, 0, APART)
        ]
        if min(widths) > 0:
            shares.append(widths[1] / (widths[0] + widths[2]) * 2)
            extras.append(widths[1] - (widths[0] + widths[2]) / 2)
    if len(shares) < max(len(parts) // 2, 1):
        return 0.0, 0.0, 0
    return float(np.median(shares)), float(np.median(extras)), len(shares)


def _crossing(ratio: np.ndarray, centre: float, forward: bool, start: int) -> tuple[int, int]:
    """Rows from entering the band centre +-BAND to leaving it, on the way from one reversal to the
    next: the last row before it, the first row behind it.
    """
    way = ratio if forward else -ratio
    centre = centre if forward else -centre
    behind = np.flatnonzero(way > centre + BAND)
    if len(behind) == 0:
        return start, start
    before = np.flatnonzero(way[: behind[0]] < centre - BAND)
    if len(before) == 0:
        return start, start
    return start + int(before[-1]) + 1, start + int(behind[0])


def _travel(log: Log, rows: tuple[int, int]) -> float:
    return (
        abs(float(log.theta[rows[1]] - log.theta[max(rows[0] - 1, 0)]))
        if rows[1] > rows[0]
        else 0.0
    )


def shifted(torque: np.ndarray, rows: float) -> np.ndarray:
    """The torque `rows` earlier."""
    index = np.arange(len(torque), dtype=float)
    earlier: np.ndarray = np.interp(index + rows, index, torque)
    return earlier


def shifted_weight(weight: np.ndarray, rows: float) -> np.ndarray:
    """The weights that belong to a shifted torque: the lesser of the two rows it is drawn from."""
    index = np.arange(len(weight)) + int(np.floor(rows))
    both = [np.clip(index + k, 0, len(weight) - 1) for k in (0, int(rows % 1 > 0))]
    least: np.ndarray = np.minimum(*weight[both])
    return least
