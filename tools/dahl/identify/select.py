# SPDX-License-Identifier: MIT
"""Choose the hypotheses to fit, and find those that the log cannot distinguish.

Dahl's law is fitted with every lag, angle and set of terms. Then the other laws are fitted with the
lags and the angle that did best. A hypothesis is plausible if its score on cycles left out is close
to the best one. The interval covers all plausible hypotheses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from dahl.identify.fit import Fit, Fitter, Hypothesis
from dahl.identify.lags import DAMPING, DELAY, DELAYS, LAGS, MAX_LOGS_WITH_DELAYS, NONE, Lag
from dahl.identify.laws import DAHL, LAWS, Law
from dahl.identify.least_squares import excess
from dahl.identify.samples import Samples
from dahl.identify.start import pair_starts, slip_start
from dahl.io.log import TERMS

PLAUSIBLE_ERRORS = 1.5  # standard errors from the best score; 7 % of the true are further away
MODEL_ERROR = 0.003  # of Fc, rms, that even the right law is off; a judgement
SPLINE_ERROR = 0.02  # the same if turns between two rows are those of a spline
PENALTY = 0.002  # of the best cost, for each parameter: a tie goes to the simpler hypothesis
SKEW_SAMPLES = 0.5  # torque and angle of one row may be read half a row apart
MAX_SKEWED = 3  # hypotheses that are fitted with a skew
FAR_STEP = 0.1  # of ln a: a plausible subset whose linearisation went further is fitted again
MAX_REFITS = 8  # until the best one is at its optimum
OTHER_ANGLES = 5  # laws that are fitted again with the other angles


@dataclass(frozen=True)
class SearchSpace:
    """The hypotheses to fit."""

    terms: tuple[str, ...] | None = None  # exactly these; None: those that improve the score
    lags: tuple[Lag, ...] = field(default_factory=lambda: tuple(LAGS.values()))
    laws: tuple[Law, ...] = field(default_factory=lambda: tuple(LAWS.values()))
    wanted: Law | None = None  # a law that is fitted in any case
    shapes: bool = True  # whether a torque may depend on the angle by more than a spring


def few_cycles(space: SearchSpace) -> SearchSpace:
    """The hypotheses that a few cycles can distinguish; more would predict other logs worse."""
    lags = tuple(lag for lag in space.lags if lag in (NONE, DAMPING))
    laws = tuple(law for law in space.laws if law.suits_few_cycles)
    return replace(space, lags=lags, laws=laws, shapes=False)


def penalised_cost(fit: Fit) -> np.ndarray:
    """Return the cost by cycle with a small charge for each parameter: (cycles,)."""
    cost: np.ndarray = fit.cost * (1 + PENALTY * fit.hypothesis.size)
    return cost


def best_of(fits: Sequence[Fit]) -> Fit:
    """Return the fit with the least cost."""
    return min(fits, key=lambda fit: float(penalised_cost(fit).sum()))


def fit_all(fitter: Fitter, a: float, delay: float, space: SearchSpace) -> list[Fit]:
    """Return fits of all hypotheses, from rough values of a [1/rad (1/m)] and delay [samples]."""
    fits = _with_all_choices(fitter, a, delay, space)
    if not fits:
        return fits
    fits += _other_laws(fitter, fits, space)
    fits = [f for f in fits if np.isfinite(f.value).all() and np.isfinite(f.cost).all()]
    fits = [f for f in fits if f.is_near_optimum] or fits
    return _with_best_at_optimum(fitter, fits)


def _with_best_at_optimum(fitter: Fitter, fits: list[Fit]) -> list[Fit]:
    """Fit the best one again until it is at its optimum: a linearised score may be too good."""
    for _ in range(MAX_REFITS):
        best = best_of(fits)
        again = _converge(fitter, best)
        if again is best:
            break
        fits = [*(f for f in fits if f is not best), again]
    return fits


def _with_all_choices(fitter: Fitter, a: float, delay: float, space: SearchSpace) -> list[Fit]:
    """Dahl's law, also under a load, with each lag, angle and set of terms."""
    choices: list[tuple[Law, Lag]] = [(DAHL, lag) for lag in space.lags]
    if DELAY in space.lags and 1 < fitter.samples.logs <= MAX_LOGS_WITH_DELAYS:
        choices.append((DAHL, DELAYS))
    if fitter.samples.load is not None:
        loaded = [law for law in space.laws if law.follows_load]
        choices += [(law, lag) for law in loaded for lag in space.lags if lag in (NONE, DELAY)]
    fits: list[Fit] = []
    for angle, (law, lag) in product(fitter.samples.angles, choices):
        h = Hypothesis(law, lag, angle)
        if not _smooths_counts(h):
            fits += _fit_term_sets(fitter, h, fitter.start(h, a, lag.guess(a, delay)), space)
    return fits


def _smooths_counts(h: Hypothesis) -> bool:
    """Whether a filter would smooth the steps of an angle as read, which no torque has."""
    return h.angle == "as read" and h.lag.smooths_counts


def _fit_term_sets(fitter: Fitter, h: Hypothesis, p: np.ndarray, space: SearchSpace) -> list[Fit]:
    """Return fits of this law and lag with each set of terms, or with those of the user."""
    if space.terms is not None:
        one = fitter.fit(replace(h, terms=space.terms), p)
        return [one] if one is not None else []
    pool = [name for name in TERMS if fitter.samples.timed or name in ("offset", "spring")]
    return fitter.fit_term_sets(h, p, pool, space.shapes)


def _other_laws(fitter: Fitter, fits: list[Fit], space: SearchSpace) -> list[Fit]:
    """Laws other than Dahl's, with the lags and the angle that did best with Dahl's."""
    best = best_of(fits)
    a, angle = float(np.exp(best.p[0])), best.hypothesis.angle
    by_lag = {f.hypothesis.lag: f for f in sorted(fits, key=lambda f: -f.total)}
    terms = best.hypothesis.terms if "waves" not in best.hypothesis.terms else ("offset",)
    starts = _law_starts(fitter, Hypothesis(DAHL, NONE, angle, terms), a, space)
    found: list[Fit] = []
    own_lag = best.hypothesis.lag
    lags = {NONE, DAMPING, own_lag, *own_lag.special_cases} & {*space.lags, DELAYS}
    for lag in sorted(lags, key=lambda lag: lag.name):
        own = by_lag.get(lag, best)
        lead = own.p[own.hypothesis.law.parameters :]
        for law, p in starts.items():
            h = Hypothesis(law, lag, angle, terms)
            found += _fit_term_sets(fitter, h, np.append(p, lead), space)
    return found + _with_other_angles(fitter, found, angle)


def _law_starts(
    fitter: Fitter, plain: Hypothesis, a: float, space: SearchSpace
) -> dict[Law, np.ndarray]:
    """Start values without a lag, by law; `plain` is Dahl's law without one."""
    samples, moves = fitter.samples, fitter.moves[plain.angle]
    others = [law for law in LAWS.values() if law is not DAHL]
    starts = {law: law.start(a) for law in others if law.starts_from_dahl(samples, moves)}
    starts |= pair_starts(fitter, plain, a)
    several = slip_start(fitter, plain, a)
    if several is not None:
        starts[several[0].law] = several[1]
    if space.wanted is not None:
        starts.setdefault(space.wanted, space.wanted.start(a))
    return {law: p for law, p in starts.items() if law in (*space.laws, space.wanted)}


def _with_other_angles(fitter: Fitter, fits: list[Fit], angle: str) -> list[Fit]:
    """The best laws with the other treatments of the angle."""
    found: list[Fit] = []
    seen: set[tuple[Law, Lag]] = set()
    others = [name for name in fitter.samples.angles if name != angle]
    for one in sorted(fits, key=lambda f: float(penalised_cost(f).sum())):
        h = one.hypothesis
        if (h.law, h.lag) in seen or len(seen) >= OTHER_ANGLES:
            continue
        seen.add((h.law, h.lag))
        same = [replace(h, angle=name) for name in others]
        again = [fitter.fit(other, one.p) for other in same if not _smooths_counts(other)]
        found += [fit for fit in again if fit is not None]
    return found


@dataclass
class Plausible:
    """Hypotheses that the log cannot distinguish. `near` also has those that are not needed."""

    chosen: Fit  # the simplest
    best: Fit  # by the score
    fits: list[Fit]
    near: list[Fit]


def plausible(fitter: Fitter, fits: list[Fit], hidden: float) -> Plausible:
    """The hypotheses within PLAUSIBLE_ERRORS of the best one.

    `hidden` is a cost that cycles left out cannot see, as the rounding of a coarse torque sensor
    that is the same in each cycle.
    """
    best = best_of(fits)
    limit = penalised_cost(best)
    free = hidden + model_error(fitter, best)
    near = [f for f in fits if is_near(penalised_cost(f), limit, free)]
    chosen = min(near, key=lambda f: (f.hypothesis.size, f.total))
    chosen = fitter.fit(chosen.hypothesis, chosen.p) or chosen  # without a step of linearisation
    kept = [_converge(fitter, f) for f in near if not _is_dominated(f, near)]
    kept = [f for f in kept if f.is_near_optimum and (f.error < f.value).all()]
    kept = [f for f in kept if is_near(penalised_cost(f), limit, free)]
    kept = kept or [chosen]
    kept += _with_skew(fitter, kept, limit, free)
    if hidden:  # more parameters than the chosen one only fit the rounding
        kept = [f for f in kept if f.hypothesis.size <= chosen.hypothesis.size + 1]
    return Plausible(chosen, best, kept, near)


def model_error(fitter: Fitter, best: Fit) -> float:
    """Cost of the error that even the right law has."""
    part = relative_error(fitter.samples)
    return float(fitter.samples.used.sum()) * (part * float(best.value[1])) ** 2


def relative_error(samples: Samples) -> float:
    """Return the part of sigma0, Fc and torque that even the right law is off."""
    return SPLINE_ERROR if samples.block < 1 else MODEL_ERROR


def is_near(cost: np.ndarray, best: np.ndarray, hidden: float = 0.0) -> bool:
    """Whether a cost by cycle is within PLAUSIBLE_ERRORS of the best one.

    Both the sum and the mean logarithm must be near. In the logarithm no single cycle dominates.
    """
    more, error = excess(cost, best)
    tiny = 1e-12 * float(best.sum()) + 1e-300
    ratio, spread = excess(np.log(cost + tiny), np.log(best + tiny))
    near_ratio = ratio <= PLAUSIBLE_ERRORS * spread or more <= hidden
    return more <= PLAUSIBLE_ERRORS * error + hidden and near_ratio


def _converge(fitter: Fitter, fit: Fit) -> Fit:
    """Return the fit or, if its linearisation went far, a new fit that starts there."""
    if fit.step < FAR_STEP:
        return fit
    return fitter.fit(fit.hypothesis, fit.p) or fit


def _is_dominated(fit: Fit, others: list[Fit]) -> bool:
    """Return whether a special case scores as well."""
    return any(
        other.hypothesis.size < fit.hypothesis.size
        and other.total <= fit.total
        and fit.hypothesis.contains(other.hypothesis)
        for other in others
    )


def _with_skew(fitter: Fitter, kept: list[Fit], limit: np.ndarray, free: float) -> list[Fit]:
    """The best ones with torque and angle read half a row apart, if that is as plausible."""
    found = []
    without = [f for f in kept if not f.hypothesis.lag.is_delay]
    for one in sorted(without, key=lambda f: f.total)[:MAX_SKEWED]:
        for skew in (-SKEW_SAMPLES, SKEW_SAMPLES):
            other = fitter.fit(replace(one.hypothesis, skew=skew), one.p)
            if other is not None and is_near(penalised_cost(other), limit, free):
                found.append(other)
    return found


def reach(fit: Fit, near: list[Fit]) -> np.ndarray:
    """Standard errors of sigma0 and Fc that a hypothesis adds to the interval.

    If the cycles do not ask for what it has beyond a special case, its standard errors are at most
    1.5 times those of the special case. Its value counts in any case.
    """
    error = fit.error
    for other in near:
        smaller = other.hypothesis.size < fit.hypothesis.size
        if smaller and fit.hypothesis.contains(other.hypothesis):
            more, spread = excess(other.cost, fit.cost)
            if more <= spread:
                error = np.minimum(error, 1.5 * other.error)
    return error
