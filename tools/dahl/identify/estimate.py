# SPDX-License-Identifier: MIT
"""From logs to sigma0 and Fc: fit hypotheses, find what is plausible, widen by what is not known.

identify() runs all of it. The interval of a parameter starts with the plausible hypotheses. Lack of
fit and simulated logs widen it. One rule then decides what is claimed (result.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

from dahl.errors import InputError
from dahl.identify import diagnose, preprocess, select, simulate
from dahl.identify.diagnose import CORRECTABLE, Lack
from dahl.identify.fit import Fit, Fitter, Hypothesis
from dahl.identify.lags import DAMPING, DELAY, LAGS, NONE, PLAY
from dahl.identify.laws import DAHL, LAWS, OPTIONS
from dahl.identify.least_squares import solve
from dahl.identify.result import Intervals, Result, claims_of
from dahl.identify.samples import (
    MIN_SCORED_CYCLES,
    Samples,
    block_for,
    fill_quick_strokes,
    has_quick_strokes,
    samples_of,
)
from dahl.identify.select import Plausible, SearchSpace
from dahl.identify.start import coarse_start, sign_by_work
from dahl.io.log import TERMS, Log, resolution_of

CONFIDENCE = 0.99  # of the t quantile: a 95 % interval, and room for what no hypothesis covers
SIMULATED_CONFIDENCE = 0.975  # of the quantile of the simulated errors: two-sided 95 %
MIN_ENCODER_GAIN = 0.1  # of the residual, from which an encoder error is taken out of the angle
MAX_CORRECTIONS = 2
HIDDEN_ROUNDING = 0.3  # of the variance of a torque's rounding: it repeats in each cycle
COARSE_ERROR = 2.0  # times the variance of rounding, below which a torque sensor is coarse here
MAX_SWAPPED_COST = 0.8  # of the robust cost, with angle and torque swapped, if they are; half of
# it if the torque takes energy as given, which a soft loop's does too
MAX_WHITE_CORRELATION = 0.5  # of neighbouring rows, that a drift of noise may have
MAX_OTHER_LAG = 1.35  # times the best cost, that Dahl's law leaves without a lag or with a play
MORE_ELEMENTS, OTHER_LAW, MAX_OTHER_COST = 1.4, 0.5, 2.0  # see _beyond_one_element()


@dataclass(frozen=True)
class Options:
    """Choices of the user."""

    terms: tuple[str, ...] | None = None  # TERMS to fit; None: those that improve the score
    delay: bool = True  # whether the torque may be late
    median: int = 0  # rows of a running median of the angle; 0: choose, 1: none
    trust_units: bool = False  # do not check whether the units are plausible
    target_counts: float = 0.0  # per turn (millimetre) of the plan's encoder; 0: the log's
    model: str = ""  # law of header and scene; "": the one that the log asks for


def identify(logs: Sequence[Log], options: Options = Options()) -> Result:
    """Identify sigma0 and Fc from one or more logs of one bearing.

    Returns their values in N m/rad and N m (N/m and N), intervals and verdict. Raises dahl.Error
    for a log that no fit can use.
    """
    trust, median = options.trust_units, options.median
    pieces = [piece for log in logs for piece in preprocess.preprocess(log, trust, median)]
    _check_times(pieces, options)
    pieces = _with_one_sign(pieces)
    fitter, a, delay, sign = _start(fill_quick_strokes(pieces))
    space = _space(options)
    if fitter.samples.cycles < MIN_SCORED_CYCLES:
        space = select.few_cycles(space)
    fits = select.fit_all(fitter, a, delay, space)
    if not fits:
        why = "are angle and torque swapped (--angle, --torque)?"
        if not _are_swapped(pieces):
            why = "record strokes to and fro in which friction is most of the torque"
        raise InputError(f"{logs[0].name}: no friction law fits; {why}")
    fitter, fits, corrected = _correct_encoder(fitter, fits, delay, space)
    found = _judge(fitter, fits, corrected)
    result = Result(list(logs), pieces, fitter.samples, fitter, sign, options, fits, *found)
    result.are_swapped = _are_swapped(pieces)
    return claims_of(result)


def _with_one_sign(pieces: Sequence[Log]) -> list[Log]:
    """Return pieces whose torque has the sign of that of the first log."""
    names = list(dict.fromkeys(piece.name for piece in pieces))
    if len(names) < 2:
        return list(pieces)
    samples = samples_of(pieces, angles=())
    owner = samples.log_of_rows
    ends = np.searchsorted(owner, range(len(names) + 1)).tolist()
    signs = [sign_by_work(samples, slice(i, j)) for i, j in zip(ends, ends[1:], strict=False)]
    first = next((sign for sign in signs if sign), 1.0)
    return [
        _turned_round(piece) if signs[names.index(piece.name)] * first < 0 else piece
        for piece in pieces
    ]


def _are_swapped(pieces: Sequence[Log]) -> bool:
    """Whether the torque explains the angle as friction much better than the other way round."""
    if all(map(_is_spring, pieces)):
        return False
    swapped = [
        replace(one, theta=one.torque, torque=one.theta, resolution=resolution_of(one.torque))
        for one in pieces
    ]
    both = [list(pieces), swapped]
    if any(map(has_quick_strokes, pieces)):  # noise makes any torque look quick
        both = [fill_quick_strokes(some) for some in both]
    given, other = (Fitter(samples_of(some)) for some in both)
    drives = sign_by_work(given.samples, slice(None)) < 0  # swapped friction seems to drive
    most = MAX_SWAPPED_COST if drives else MAX_SWAPPED_COST / 2
    return coarse_start(other).cost < most * coarse_start(given).cost


def _is_spring(piece: Log) -> bool:
    """Whether the torque follows the angle but for white noise: neither is the friction."""
    curve = np.polynomial.Polynomial.fit(piece.theta, piece.torque, 3)
    off = piece.torque - curve(piece.theta)
    return bool(off[1:] @ off[:-1] < MAX_WHITE_CORRELATION * (off @ off))


def _turned_round(piece: Log) -> Log:
    """Return a log with the other sign of the torque, and a note."""
    note = "its friction has the other sign than in the other logs: the torque is turned round"
    return replace(piece, torque=-piece.torque, notes=[*piece.notes, note])


def _start(pieces: Sequence[Log]) -> tuple[Fitter, float, float, float]:
    """Return samples with cycles and weights, and rough start values: a, delay in samples, sign."""
    samples = samples_of(pieces)
    found = coarse_start(Fitter(samples))
    a, delay, sign, rows = found.a, found.delay, found.sign, samples.block
    block = block_for(pieces, int(rows), a) if rows > 1 else 1
    if block < rows:
        delay *= rows / block
        samples = samples_of(pieces, block)
    if sign < 0:
        samples = replace(samples, torque=-samples.torque)
    return Fitter(_weighted(samples, a, delay)), a, delay, sign


def _check_times(pieces: Sequence[Log], options: Options) -> None:
    """Raise dahl.Error for a term of the speed without times: its unit would be unknown."""
    timed = [term for term in options.terms or () if term in ("viscous", "inertia")]
    untimed = next((log.name for log in pieces if log.time is None), None)
    if timed and untimed is not None:
        raise InputError(f"{untimed}: {timed[0]} needs times of the rows (--time)")


def _space(options: Options) -> SearchSpace:
    lags = tuple(lag for lag in LAGS.values() if options.delay or not lag.is_delay)
    return SearchSpace(options.terms, lags, wanted=OPTIONS.get(options.model))


def _weighted(samples: Samples, a: float, delay: float) -> Samples:
    """Return samples with cycles and weights from a first fit."""
    samples = samples.prepared(a, np.zeros(samples.rows))
    fitter = Fitter(samples)
    h = Hypothesis(DAHL, DELAY if delay else DAMPING, terms=TERMS)
    at = fitter.optimum(h, fitter.start(h, a, delay))
    if at is None:
        return samples
    table, _ = fitter.columns(h, at.p, at.limits, h.terms)
    c = solve(at.grams.sum(axis=0), range(table.shape[1]))
    return samples.prepared(float(np.exp(at.p[0])), samples.torque - table @ c)


def _correct_encoder(
    fitter: Fitter, fits: list[Fit], delay: float, space: SearchSpace
) -> tuple[Fitter, list[Fit], list[str]]:
    """Take periodic errors of the encoder out of the angle, if no other law explains them."""
    corrected: list[str] = []
    for _ in range(MAX_CORRECTIONS):
        error = _encoder_error(fitter, fits, corrected)
        if error is None:
            break
        again = Fitter(diagnose.correct_encoder(fitter.samples, error))
        a = float(np.exp(select.best_of(fits).p[0]))
        other = select.fit_all(again, a, delay, space)
        if not other or min(f.total for f in other) > min(f.total for f in fits):
            break
        fitter, fits = again, other
        corrected.append(error.name)
    return fitter, fits, corrected


def _encoder_error(fitter: Fitter, fits: list[Fit], corrected: list[str]) -> Lack | None:
    """Return the largest periodic error that both a simple Dahl law and the best law leave."""
    plain = [f for f in fits if f.hypothesis.law is DAHL and f.hypothesis.size < 4]
    found = diagnose.lack_of_fit(fitter, select.best_of(plain or fits), diagnose.SURE)
    large = [one for one in found if one.gain > MIN_ENCODER_GAIN and one.name not in corrected]
    errors = [one for one in large if one.name.startswith(CORRECTABLE)]
    if not errors:
        return None
    left = diagnose.lack_of_fit(fitter, select.best_of(fits), diagnose.SURE)
    still = {one.name for one in left}
    return max((one for one in errors if one.name in still), key=lambda e: e.gain, default=None)


def _judge(
    fitter: Fitter, fits: list[Fit], corrected: list[str]
) -> tuple[Plausible, list[Lack], Intervals]:
    samples = fitter.samples
    hidden = _hidden_by_rounding(samples, select.best_of(fits))
    seen = select.plausible(fitter, fits, hidden)
    value = seen.chosen.value
    quantile = float(student.ppf(CONFIDENCE, max(len(samples.folds) - 1, 1)))
    lacks = [] if hidden else diagnose.lack_of_fit(fitter, seen.best, quantile, corrected)
    low, high = _over_hypotheses(seen, quantile)
    low, high = _with_other_lags(seen, fits, low, high)
    if samples.has_rests:  # friction that creeps back there looks like a viscous torque in motion
        slips = [f.value[1] + fitter.timed(f).get("viscous", 0.0) for f in seen.fits]
        high[1] = max(high[1], *slips)
    low, high = _beyond_one_element(seen, fits, lacks, low, high)
    widths = {
        "noise": quantile * seen.chosen.error / value,
        "hypotheses": (high - low) / 2 / value,
    }
    for one in lacks:
        low, high = np.minimum(low, one.low), np.maximum(high, one.high)
    widths["lack of fit"] = (high - low) / 2 / value
    if samples.count or samples.noise:
        widths["counts"] = _simulated_reach(fitter, seen.chosen)
        simulated = widths["counts"] * value
        low = value - np.hypot(value - low, simulated)
        high = value + np.hypot(high - value, simulated)
    least = select.relative_error(samples) * value  # no parameter is known better than its law
    low, high = np.minimum(low, value - least), np.maximum(high, value + least)
    return seen, lacks, Intervals(value, low, high, widths)


def _hidden_by_rounding(samples: Samples, best: Fit) -> float:
    """Return the cost of the rounding of a coarse torque sensor, which repeats in each cycle."""
    step = simulate.torque_step(samples.torque)
    weight = float(samples.used.sum())
    rounding = step**2 / 12
    coarse = bool(step) and best.total / weight < COARSE_ERROR * rounding
    return HIDDEN_ROUNDING * rounding * weight if coarse else 0.0


def _over_hypotheses(seen: Plausible, quantile: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and largest sigma0 and Fc over all plausible hypotheses and their errors."""
    reach = [quantile * select.reach(f, seen.near) for f in seen.fits]
    low = np.min([f.value - r for f, r in zip(seen.fits, reach, strict=True)], axis=0)
    high = np.max([f.value + r for f, r in zip(seen.fits, reach, strict=True)], axis=0)
    return low, high


def _with_other_lags(
    seen: Plausible, fits: list[Fit], low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return intervals that cover the best Dahl fits without a lag and with a play, if these leave
    little more.

    A small error of the angle at equal turning points looks like a lag, in each cycle, and a play
    looks like a filter. A play in a part of the travel lies beyond both fits, by half of their
    distance.
    """
    values = []
    for lag in (NONE, PLAY):
        same = [f for f in fits if f.hypothesis.law is DAHL and f.hypothesis.lag is lag]
        best = min(same, key=lambda f: f.total, default=seen.best)
        if best.total <= MAX_OTHER_LAG * seen.best.total:
            values.append(best.value)
    if not values:
        return low, high
    beyond = OTHER_LAW * np.ptp(values, axis=0)
    return np.min([low, *(values - beyond)], axis=0), np.max([high, *(values + beyond)], axis=0)


def _beyond_one_element(
    seen: Plausible, fits: list[Fit], lacks: list[Lack], low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return wider intervals if one Dahl element is not enough.

    The fitted law is then one of many with such a curve. Its distance from the best Dahl fit shows
    how much the choice of the law matters, and so does that from another form of an Fc by speed.
    The truth may lie further on by half of this distance, or by 1.4 times if the law has several
    elements and the residual shows a lack of fit: it may then lack small stiff elements. Each law
    that leaves at most twice as much then counts too, with and without a spring: a soft element.
    """
    laws, best = {f.hypothesis.law for f in seen.fits}, seen.best
    by_speed = [law for law in LAWS.values() if law.is_by_speed and best.hypothesis.law.is_by_speed]
    rivals = [[f for f in fits if f.hypothesis.law is law] for law in (DAHL, *by_speed)]
    nearest = [min(some, key=lambda f: f.total).value for some in rivals if some]
    if not nearest or any(law.is_one_element for law in laws):
        return low, high
    lacks_elements = best.hypothesis.law.elements > 1 and bool(lacks)
    apart = np.max(np.abs(best.value - nearest), axis=0)
    apart *= MORE_ELEMENTS if lacks_elements else OTHER_LAW
    most = MAX_OTHER_COST * best.total if lacks_elements else 0.0
    near = sorted((f for f in fits if f.total <= most), key=lambda f: -f.total)
    also = [f.value for f in {(f.hypothesis.law, _has_spring(f)): f for f in near}.values()]
    ends = best.value - apart, best.value + apart
    return np.min([low, ends[0], *also], axis=0), np.max([high, ends[1], *also], axis=0)


def _has_spring(fit: Fit) -> bool:
    """Whether a fit has a torque that depends on the angle."""
    return not {"spring", "waves"}.isdisjoint(fit.hypothesis.terms)


def _simulated_reach(fitter: Fitter, chosen: Fit) -> np.ndarray:
    """Return the relative half widths by counts, rounding and angle noise: (2,)."""
    errors = simulate.refit_errors(fitter, chosen)
    if len(errors) < 2:
        return np.full(2, np.inf)
    quantile = float(student.ppf(SIMULATED_CONFIDENCE, len(errors)))
    reach: np.ndarray = quantile * np.sqrt(np.mean(errors**2, axis=0))
    samples = fitter.samples
    if samples.count and not samples.noise:
        reach = np.hypot(reach, simulate.hidden_travel(fitter, chosen))
    return reach


def check(result: Result, log: Log) -> float:
    """Return R2 of a result on a log that was not fitted, after the unknown start is forgotten.

    Raises dahl.Error if the log cannot be used.
    """
    pieces = preprocess.preprocess(log, trust_units=True)
    if result.sign * sign_by_work(samples_of(pieces, angles=()), slice(None)) < 0:
        pieces = [_turned_round(piece) for piece in pieces]
    samples, predicted = result.predict(fill_quick_strokes(pieces))
    weight = samples.used
    mean = float(weight @ samples.torque / weight.sum())
    lost = weight @ (samples.torque - predicted) ** 2
    return 1 - float(lost / (weight @ (samples.torque - mean) ** 2))
