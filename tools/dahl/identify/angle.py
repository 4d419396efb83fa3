# SPDX-License-Identifier: MIT
"""The angle between the counts of an encoder: three treatments of one reading, and its noise.

A reading is known to half a count. The motion within a count matters most at a turn. Which
treatment suits a log depends on how it turns, so that each one is a hypothesis of the fit:
"between counts" for smooth motion, "sharp turns" for strokes that end at speed, "as read" for a
motion that rests between counts, or with noise that stops abruptly.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import savgol_filter

WIDTHS = (81, 41, 21, 11)  # rows of the local cubics that are tried, the widest that agrees is used
DERIVATIVE_WIDTHS = (161, 121, *WIDTHS)  # wider, since each derivative multiplies the noise
ALLOWED_OFF = 0.65  # counts from the reading; .5 is exact, the rest is for noise of the edges
MAX_OFF_ROWS = 0.01  # part of the rows that may be further off
MAX_GROWTH = 1.03  # of the distance from the reading against the next narrower cubic
EDGES_AT_TURN = 7  # edges on either side of a turn that a parabola is drawn through
MIN_SLOWER = 2.2  # times the rows of a count further in, that one at a smooth turn takes
MAX_TURNS = 400  # of a log; above it, sharp turns would cost seconds
WHITE_CORRELATION = -0.3  # third differences of white noise have -.75; of a smooth motion, above 0
THIRD_DIFFERENCE_GAIN = 20.0  # 1 + 9 + 9 + 1: variance of a third difference of white noise
ROBUST_MEAN = 0.717  # mean of the smallest 95 % of |normal| in standard deviations
MIN_CORNER = 8.0  # standard deviations of the noise: white noise alone is not so far off
NOISE_ROWS = 30_000  # first rows, enough to estimate the noise of an angle


def between_counts(theta: np.ndarray, count: float) -> np.ndarray:
    """A spline through the edges of counts, then the widest local cubic that agrees with them."""
    edges = np.flatnonzero(np.diff(theta))
    if not count or len(edges) < 4:
        return theta
    rows, angles = edges + 0.5, (theta[edges] + theta[edges + 1]) / 2
    spline = CubicSpline(rows, angles)
    inner = _within_count(spline(np.clip(np.arange(len(theta)), rows[0], rows[-1])), theta, count)
    widths = [width for width in WIDTHS if width < len(theta)]
    off = [np.abs(savgol_filter(inner, width, 3) - theta) / count for width in widths]
    rms = [float(np.sqrt(np.mean(one**2))) for one in off]
    for k, width in enumerate(widths):
        narrower = rms[min(k + 1, len(rms) - 1)]
        if np.mean(off[k] > ALLOWED_OFF) < MAX_OFF_ROWS and rms[k] < MAX_GROWTH * narrower:
            smooth = _within_count(savgol_filter(inner, width, 3), theta, count)
            return _within_count(savgol_filter(smooth, width, 3), theta, count)
    return inner


def _within_count(inner: np.ndarray, theta: np.ndarray, count: float) -> np.ndarray:
    clipped: np.ndarray = np.clip(inner, theta - count / 2, theta + count / 2)
    return clipped


def turns_smoothly(theta: np.ndarray, count: float) -> bool:
    """Whether strokes slow down before they turn, and the turns have rows enough for two cubics.

    A count at the end of a stroke then takes longer than one further in: of a sine 2.3 to 3.5 times
    as long. If the stroke ends at .4 of its speed, it takes at most twice as long.
    """
    edges, turns, _ = _edges_of(theta)
    angles = (theta[edges] + theta[edges + 1]) / 2
    at_ends, inside = [], []
    for i, j in pairwise(turns.tolist()):
        if j - i >= 2 * EDGES_AT_TURN:
            rows_per_count = np.diff(edges[i:j]) * count / np.abs(np.diff(angles[i:j]))
            for side in (rows_per_count, rows_per_count[::-1]):
                at_ends.append(side[0])
                inside += side[EDGES_AT_TURN - 2 : EDGES_AT_TURN].tolist()
    turns = turns[(turns > 1) & (turns < len(edges) - 1)]
    rows = edges[turns + 1] - edges[turns - 2]  # of a turn and a count on both sides
    if not (at_ends and len(rows) and np.median(rows) >= 2 * WIDTHS[-1]):
        return False
    return float(np.mean(at_ends)) > MIN_SLOWER * float(np.mean(inside))


def _edges_of(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the rows before each edge, the first edge of each stroke but the first, and the
    direction of each edge.
    """
    edges = np.flatnonzero(np.diff(theta))
    direction = np.sign(theta[edges + 1] - theta[edges])
    return edges, np.flatnonzero(np.diff(direction)) + 1, direction


def with_sharp_turns(theta: np.ndarray, count: float) -> np.ndarray:
    """The angle of strokes that end at speed.

    The edges of each stroke are extrapolated to where they meet those of the next stroke. Then the
    angle is smoothed within each stroke alone.
    """
    edges, turns, direction = _edges_of(theta)
    if not count or len(edges) < 8:
        return theta
    if len(turns) > MAX_TURNS:
        return between_counts(theta, count)
    inner, cuts = _meet_at_turns(theta, edges, turns, direction)
    inner = _within_count(inner, theta, count)
    for width in (41, 21, 11):
        smooth = inner.copy()
        for i, j in zip(cuts, cuts[1:], strict=False):
            if j - i > width:
                smooth[i:j] = savgol_filter(inner[i:j], width, 3)
        if np.mean(np.abs(smooth - theta) > ALLOWED_OFF * count) < MAX_OFF_ROWS:
            return _within_count(smooth, theta, count)
    return inner


def _meet_at_turns(
    theta: np.ndarray, edges: np.ndarray, turns: np.ndarray, direction: np.ndarray
) -> tuple[np.ndarray, list[int]]:
    """The angle with strokes extrapolated into each turn, and the rows at which strokes begin."""
    places, angles = edges + 0.5, (theta[edges] + theta[edges + 1]) / 2
    inner = np.interp(np.arange(len(theta)), places, angles)
    cuts = [0]
    for i, k in enumerate(turns):
        rows = np.arange(edges[k - 1] + 1, edges[k] + 1)
        first = turns[i - 1] if i else 0
        last = turns[i + 1] if i + 1 < len(turns) else len(edges)
        before = slice(max(first, k - EDGES_AT_TURN), k)
        after = slice(k, min(last, k + EDGES_AT_TURN))
        old = _extrapolate(places[before], angles[before], rows)
        new = _extrapolate(places[after], angles[after], rows)
        upper_turn = direction[k - 1] > 0
        inner[rows] = np.minimum(old, new) if upper_turn else np.maximum(old, new)
        on_old = old <= new if upper_turn else old >= new
        cuts.append(int(rows[0] + np.count_nonzero(on_old)) if len(rows) else int(edges[k]) + 1)
    return inner, [*cuts, len(theta)]


def _extrapolate(places: np.ndarray, angles: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """A stroke's angle beyond its last edge, or before its first.

    The angles of edges are exact and their rows are not, so the row is fitted as a parabola of the
    angle.
    """
    after_last = bool(rows.size) and rows[0] > places[-1]
    origin, edge = (places[-1], angles[-1]) if after_last else (places[0], angles[0])
    if len(places) < 2:
        return np.full(len(rows), edge)
    *_, pace, late = np.polyfit(angles - edge, places - origin, min(2, len(places) - 1))
    extended: np.ndarray = edge + (rows - origin - late) / (pace or np.inf)
    return extended


def derivatives(
    theta: np.ndarray, smooth: np.ndarray, count: float
) -> tuple[np.ndarray, np.ndarray]:
    """First and second derivative by row, of the widest local cubic that agrees with the counts."""
    chosen = WIDTHS[-1]
    for width in DERIVATIVE_WIDTHS:
        if count and width < len(theta) // 8:
            off = np.abs(savgol_filter(smooth, width, 3) - theta) / count
            if np.mean(off > 0.6) < MAX_OFF_ROWS:
                chosen = width
                break
    if chosen >= len(theta):
        return np.gradient(smooth), np.gradient(np.gradient(smooth))
    one, two = (savgol_filter(smooth, chosen, 3, deriv=k) for k in (1, 2))
    return one, two


def white_noise(theta: np.ndarray, count: float) -> float:
    """Standard deviation of white errors of the angle beyond its counts, from third differences."""
    third = np.diff(theta[:NOISE_ROWS], 3)
    if third[1:] @ third[:-1] > WHITE_CORRELATION * (third @ third):
        return 0.0
    usual = np.sort(np.abs(third))[: int(0.95 * len(third))].mean() / ROBUST_MEAN
    return float(np.sqrt(max(usual**2 / THIRD_DIFFERENCE_GAIN - count**2 / 12, 0.0)))


def has_corners(theta: np.ndarray, noise: float) -> bool:
    """Whether the motion stops or turns more sharply than the narrowest cubic."""
    off = savgol_filter(theta, WIDTHS[-1], 3) - theta
    return bool(np.abs(off).max() > MIN_CORNER * noise)


def smooth_angle(theta: np.ndarray, count: float, noise: float) -> np.ndarray:
    """Between the counts or, if the angle has noise beyond them, the widest cubic it supports."""
    if not noise:
        return between_counts(theta, count)
    floor = float(np.hypot(noise, count / np.sqrt(12)))
    best = theta
    for width in WIDTHS[::-1]:
        if width < len(theta):
            smooth = savgol_filter(theta, width, 3)
            if width > WIDTHS[-1] and np.std(smooth - theta) > 1.05 * floor:
                break
            best = smooth
    return best
