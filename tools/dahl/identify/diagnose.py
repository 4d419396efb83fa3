# SPDX-License-Identifier: MIT
"""Lack of fit: columns that must not explain what the best hypothesis leaves.

Each row of the table is one effect that no hypothesis models. If a row predicts the left-out cycles
better, the intervals also cover the parameters of a fit with it. If a parameter moves too far, its
claim is withdrawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dahl.identify import models
from dahl.identify.fit import Fit, Fitter, Optimum, score
from dahl.identify.least_squares import excess, jackknife, solve
from dahl.identify.samples import Samples

SURE = 2.0  # standard errors of the gain on cycles left out
MIN_RESIDUAL_GAIN = 0.02  # of the residual, that a row must explain
MAX_GAIN = 0.3  # over the unexplained residual: 23 % of all; more shows a wrong hypothesis
EXTRA_MOVE = 0.5  # of the move by a row: its columns are one of many descriptions of an effect
ENCODER_PERIODS = (8, 16, 32, 64, 128, 256, 512, 1024)  # counts
ANGLE_KNOTS = 7  # of a friction that depends on the angle
RIPPLE_CELLS = 512  # of the range of the angle, over which a fine ripple is found
RIPPLE_PERIODS = (8, 128)  # in this range; a longer period is that of "angle ripple"
SHAPE_KNOTS = (0.15, 0.5, 1.2, 2.5, 5.0, 10.0)  # presliding lengths since the last turn
ENCODER_ERROR = 0.5  # counts, at which the effect of an encoder error is linearised
CORRECTABLE = "encoder error"  # rows whose name begins so can be taken out of the angle


@dataclass
class Row:
    """Columns of one effect, and how sigma0 and Fc vary with their coefficients.

    `ends` (2, ends, columns) gives the changes of ln a and ln Fc at both ends of the drift.
    `max_move` is the relative move of a parameter above which its claim is withdrawn.
    """

    name: str
    columns: np.ndarray
    max_move: float = np.inf
    min_gain: float = MIN_RESIDUAL_GAIN
    ends: np.ndarray | None = None


@dataclass
class Lack:
    """A row that predicts the left-out cycles better."""

    name: str
    gain: float  # over the residual that is then unexplained
    moved: np.ndarray  # (2,) of sigma0 and Fc, as parts
    low: np.ndarray  # (2,)
    high: np.ndarray
    withdraws: tuple[bool, bool] = (False, False)
    text: str = ""  # one line for people
    coefficients: np.ndarray = field(default_factory=lambda: np.zeros(0))


class Context:
    """Quantities that the rows are made of."""

    def __init__(self, fitter: Fitter, fit: Fit) -> None:
        h, m = fit.hypothesis, len(fit.limits)
        self.fitter, self.fit, self.samples = fitter, fit, fitter.samples
        self.base, _ = fitter.columns(h, fit.p, fit.limits, h.terms)
        self.friction = self.base[:, :m] @ fit.limits  # N m
        self.Fc = float(fit.limits.sum())
        self.w = self.friction / self.Fc
        self.by_a = self.base[:, m : 2 * m].sum(axis=1)  # change with ln a of all elements
        self.a = float(np.sum(np.exp(fit.p[:m]) * fit.limits) / self.Fc)
        self.moves, self.angle = fitter.moves[h.angle], fitter.samples.angles[h.angle]
        self.delay = h.lag.delay(fit.p)


def lack_of_fit(
    fitter: Fitter, fit: Fit, quantile: float, corrected: Sequence[str] = ()
) -> list[Lack]:
    """The rows that cycles left out ask for.

    Rows named in `corrected` were taken out of the angle before. They are listed with what is not
    known of them.
    """
    x, h = Context(fitter, fit), fit.hypothesis
    rows = table(x)
    columns = np.column_stack((x.base, *(row.columns for row in rows)))
    at = Optimum(fit.p, fitter.samples.grams(columns), fit.limits, np.ones(len(fit.limits)))
    first, found = x.base.shape[1], []
    own = range(first)
    before = score(h, at, own)
    for row in rows:
        last = first + row.columns.shape[1]
        after = score(h, at, [*own, *range(first, last)])
        found.append(_lack(row, before, after, quantile, row.name in corrected))
        first = last
    return [lack for lack in found if lack is not None]


def _lack(row: Row, before: Fit, after: Fit, quantile: float, is_known: bool) -> Lack | None:
    """Return what a row changes; None if it does not predict the left-out cycles better."""
    gain, error = excess(before.cost, after.cost)
    is_needed = gain > SURE * error and gain > row.min_gain * after.total
    if not (is_known or is_needed):
        return None
    value, spread = after.value, quantile * after.error
    low, high = value - spread, value + spread
    moved, x = value / before.value - 1, after.coefficients[len(before.coefficients) :]
    if is_known:
        return Lack(row.name, 0.0, moved, low, high, coefficients=x)
    if row.ends is not None:
        low, high = _at_ends(row.ends, after, quantile)
    extra = EXTRA_MOVE * np.abs(value - before.value)
    ratio, part = gain / after.total, 100 * gain / before.total
    covered = ", and the interval covers it" if row.ends is not None else ""
    text = f"{row.name} would explain {part:.0f} % of the residual{covered}"
    withdraws = _withdraws(row, moved, ratio)
    return Lack(row.name, ratio, moved, low - extra, high + extra, withdraws, text, x)


def _withdraws(row: Row, moved: np.ndarray, gain: float) -> tuple[bool, bool]:
    """Return whether the claims of sigma0 and Fc are withdrawn.

    A parameter must not move too far. If a row with such a limit explains much of the residual, the
    hypothesis is wrong, and neither parameter is claimed.
    """
    is_wrong = bool(np.isfinite(row.max_move)) and gain > MAX_GAIN
    far = np.abs(moved) > row.max_move
    return bool(far[0]) or is_wrong, bool(far[1]) or is_wrong


def _at_ends(ends: np.ndarray, fit: Fit, quantile: float) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest sigma0 and Fc over the ends of what varies, with their errors.

    The coefficients of the row are the last ones of the fit.
    """
    varying = ends.shape[-1]
    rate, size = ends @ fit.coefficients[-varying:]
    at = fit.value * np.column_stack((np.exp(rate) * (1 + size), 1 + size))
    rates, sizes = (fit.left_out[:, -varying:] @ one.T for one in ends)
    parts = np.stack((rates + sizes, sizes), axis=-1)  # (cycles, ends, 2)
    error = quantile * np.hypot(jackknife(parts), fit.error / fit.value) * fit.value
    return (at - error).min(axis=0), (at + error).max(axis=0)


# --- the table ------------------------------------------------------------------------------------


def table(x: Context) -> list[Row]:
    """Return all rows that a log can support."""
    makers = (_turns_and_lags, _speed, _drift, _angle, _encoder, _between_logs)
    return [row for make in makers for row in make(x)]


def _turns_and_lags(x: Context) -> list[Row]:
    """The shape after a turn, and a torque that is late."""
    rate = x.samples.rate(x.friction)
    rates = np.column_stack((rate, x.samples.rate(rate)))
    return [
        Row("shape since the turn", _since_turn(x), max_move=0.03, min_gain=0.03),
        Row("low pass or delay", rates, max_move=0.2),
    ]


def _since_turn(x: Context) -> np.ndarray:
    """Hat functions of the travel since the last turn, with the sign of the motion."""
    knots, from_turn = np.array([0.0, *SHAPE_KNOTS]), x.samples.from_turn(x.a)
    direction = np.where(from_turn == 0, 1.0, np.sign(from_turn))
    hats = np.eye(len(knots))[1:-1]  # what fades: neither at the turn nor far from it
    travel = x.a * np.abs(from_turn)
    return np.column_stack([direction * np.interp(travel, knots, hat) for hat in hats])


def _speed(x: Context) -> list[Row]:
    """Friction that depends on speed."""
    speed = x.samples.speed
    slow = [x.w * np.exp(-((speed / (part * x.fitter.fast)) ** 2)) for part in (0.1, 0.4)]
    return [
        Row("speed", np.column_stack(slow), max_move=0.03),
        Row("viscous", speed[:, None], max_move=0.2),
    ]


def _drift(x: Context) -> list[Row]:
    """Parameters that change with time or with the direction."""
    t = np.linspace(-0.5, 0.5, x.samples.rows)  # through all logs
    step = np.sign(t)
    trend = np.column_stack((t, t**2 - 1 / 12))
    at = np.array([-0.45, 0.0, 0.45])
    slope, none = np.column_stack((at, at**2 - 1 / 12)), np.zeros((3, 1))
    rates = np.hstack((0 * slope, at[:, None]))
    sizes = np.hstack((slope, none))
    both_ways = np.array([[[0, -1.0], [0, 1]], [[-1, 0], [1, 0]]])
    return [
        Row("offset drift", trend),
        Row(
            "drift",
            np.column_stack((x.friction[:, None] * trend, x.by_a * t)),
            ends=np.stack((rates, sizes)),
        ),
        Row("step", np.column_stack((x.friction * step, x.by_a * step)), ends=both_ways),
        Row(
            "direction",
            np.column_stack((np.maximum(x.friction, 0), x.by_a * (x.w > 0))),
            max_move=0.2,
        ),
    ]


def _angle(x: Context) -> list[Row]:
    """Torque or friction that depends on the angle."""
    z = x.samples.terms["spring"]
    powers = np.column_stack((z, z**3, z**5))
    rows = [Row("cubic spring", x.fitter.late(x.fit, powers))]
    if "waves" not in x.fit.hypothesis.terms:
        rows.append(Row("angle ripple", x.fitter.late(x.fit, x.samples.waves), max_move=0.2))
    return [*rows, _fine_ripple(x, z), _friction_by_angle(x, z)]


def _fine_ripple(x: Context, z: np.ndarray) -> Row:
    """A sine of the angle, as of cogging, with the period that the residual shows most."""
    gram, own = x.samples.grams(x.base).sum(axis=0), range(x.base.shape[1])
    residual = x.samples.torque - x.base @ solve(gram, own)
    cell = np.clip((z + 1) / 2 * RIPPLE_CELLS, 0, RIPPLE_CELLS - 1).astype(int)
    sums = np.bincount(cell, x.samples.used * residual, RIPPLE_CELLS)
    first, last = (4 * periods for periods in RIPPLE_PERIODS)  # a quarter of a period apart
    spectrum = np.abs(np.fft.rfft(sums, 4 * RIPPLE_CELLS))[first:last]
    phase = np.pi * z * (first + int(np.argmax(spectrum))) / 4
    columns = x.fitter.late(x.fit, np.column_stack((np.sin(phase), np.cos(phase))))
    return Row("angle ripple of cogging", columns, min_gain=0.03)


def _friction_by_angle(x: Context, z: np.ndarray) -> Row:
    """sigma0 and Fc that depend on the angle: hat functions, each without its mean."""
    hats = np.eye(ANGLE_KNOTS)[:, 1:]
    places = np.linspace(-1, 1, ANGLE_KNOTS)
    at = np.column_stack([np.interp(z, places, hat) for hat in hats.T])
    mean = np.average(at, axis=0, weights=x.samples.used)
    sizes = hats - mean
    columns = x.friction[:, None] * (at - mean)
    return Row("Fc by angle", columns, min_gain=0.05, ends=np.stack((0 * sizes, sizes)))


def _encoder(x: Context) -> list[Row]:
    """An error of the encoder that repeats every so many counts."""
    count = x.samples.count
    rows = []
    for period in ENCODER_PERIODS if count else ():
        if 4 * period * count > np.ptp(x.angle):
            continue
        pair = []
        for wave in (np.sin, np.cos):
            error = ENCODER_ERROR * count * wave(2 * np.pi * x.angle / (period * count))
            moves = x.samples.moves(x.angle + error)
            changed = models.dahl(moves, x.samples.pieces, x.a)
            change = changed - models.dahl(x.moves, x.samples.pieces, x.a)
            pair.append(x.Fc * x.samples.delayed(change, x.delay) / (ENCODER_ERROR * count))
        name = f"{CORRECTABLE} each {period} counts"
        rows.append(Row(name, np.column_stack(pair), max_move=0.1, min_gain=0.03))
    return rows


def _between_logs(x: Context) -> list[Row]:
    logs = np.unique(x.samples.log_of)
    if len(logs) < 2:
        return []
    owner = x.samples.log_of_rows
    share = 1 / len(logs)
    masks = [np.where(owner == k, 1 - share, -share) for k in logs[1:]]
    each = np.array([[float(k == j) - share for j in logs[1:]] for k in logs])
    none = np.zeros_like(each)
    ends = np.stack((np.hstack((each, none)), np.hstack((none, each))))
    rate = x.samples.rate(x.friction)
    both = np.column_stack([part * mask for part in (x.by_a, x.friction) for mask in masks])
    rates = np.column_stack([rate * mask for mask in masks])
    return [
        Row("each log", both, min_gain=0.005, ends=ends),
        Row("delay of each log", rates, max_move=0.1),
        Row("offset of each log", np.column_stack(masks)),
    ]


def correct_encoder(samples: Samples, error: Lack) -> Samples:
    """Take a periodic error of the encoder out of all angles."""
    period = float(error.name.split()[-2]) * samples.count
    angles = {}
    for name, angle in samples.angles.items():
        phase = 2 * np.pi * angle / period
        angles[name] = angle + error.coefficients @ np.stack((np.sin(phase), np.cos(phase)))
    return replace(samples, angles=angles)
