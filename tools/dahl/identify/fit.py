# SPDX-License-Identifier: MIT
"""Fit one hypothesis about a log, and score it on cycles that were left out.

A hypothesis is a friction law, a lag of the torque, a treatment of the angle and a set of linear
terms. Stiffnesses, shape parameters and lags are nonlinear; the Fc of each element and the terms
are linear. Gauss-Newton works on the nonlinear ones, with the linear ones projected out (variable
projection). At the optimum the model is linearised in all of them. Then one Gram matrix for each
cycle gives the score on that cycle when it is left out, the jackknife, and every subset of terms.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from dahl.identify import lags, laws
from dahl.identify.lags import Lag
from dahl.identify.laws import Law
from dahl.identify.least_squares import cost_of, jackknife, solve, solve_within
from dahl.identify.samples import FAST_PERCENTILE, Samples

LATE_TERMS = ("spring", "viscous", "inertia")  # that a late sensor shows late too
ROUNDS = 8  # Gauss-Newton steps of a fit, at most
MAX_STEP, MAX_DELAY_STEP = 0.4, 6.0  # of a Gauss-Newton step: in ln a and shapes, in samples
MIN_GAIN, SETTLED_STEP = 1e-4, 1e-3  # of the cost and of ln a, below which the fit has converged
MAX_LINEAR = 0.6  # of ln a: beyond it a linearisation is useless
MAX_ELEMENT = 1.0  # presliding lengths in a count: one of several elements cannot be stiffer
MIN_TIMED = -0.02  # of MAX_FRICTION, at high speed: viscous torque and inertia resist the motion
MAX_FRICTION = 1.5  # of the measured torque: more would have to be cancelled by inertia or a spring
DERIVATIVE_STEP, DERIVATIVE_STEP_ROWS = 0.01, 0.05  # of numerical derivatives


@dataclass(frozen=True)
class Hypothesis:
    """One description of a log."""

    law: Law = laws.DAHL
    lag: Lag = lags.NONE
    angle: str = "between counts"
    terms: tuple[str, ...] = ("offset",)
    skew: float = 0.0  # samples by which the torque is read after the angle

    @property
    def size(self) -> int:
        """Parameters beyond a Dahl element and an offset."""
        terms = sum(16 if term == "waves" else 1 for term in self.terms) - 1
        return self.law.size + self.lag.size + terms

    def contains(self, other: Hypothesis) -> bool:
        """Whether the other one is a special case of this one."""
        law = other.law in (self.law, *self.law.special_cases)
        lag = other.lag in (self.lag, lags.NONE, *self.lag.special_cases)
        terms = set(other.terms) <= set(self.terms)
        return law and lag and terms and self.angle == other.angle

    def __str__(self) -> str:
        lag = "" if self.lag is lags.NONE else f", {self.lag.name}"
        return f"{self.law.name}{lag}, {self.angle}, {'+'.join(self.terms)}"


@dataclass
class Fit:
    """A hypothesis at its optimum."""

    hypothesis: Hypothesis
    p: np.ndarray  # nonlinear parameters: ln a of each element, shapes, lag
    limits: np.ndarray  # N m (N), Fc of each element
    taken_at: np.ndarray  # N m (N), the limits at which derivatives by p were computed
    coefficients: np.ndarray  # of all columns of Fitter.columns()
    left_out: np.ndarray  # (cycles, k) the coefficients without each cycle
    cost: np.ndarray  # (cycles,) squared residuals of each cycle when it is left out
    slopes: np.ndarray = field(init=False)  # N m/rad (N/m), sigma0 of each element

    def __post_init__(self) -> None:
        self.slopes = slopes_of(self.p, self.taken_at, self.coefficients)

    @property
    def total(self) -> float:
        return float(self.cost.sum())

    @property
    def value(self) -> np.ndarray:
        """sigma0 and Fc."""
        return parameters_of(self.p, self.taken_at, self.coefficients)

    @property
    def without(self) -> np.ndarray:
        """sigma0 and Fc without each cycle: (cycles, 2)."""
        return parameters_of(self.p, self.taken_at, self.left_out)

    @property
    def step(self) -> float:
        """How far the linearisation went from the optimum, in ln a."""
        m = len(self.taken_at)
        return float(np.abs(self.coefficients[m : 2 * m]).max())

    @property
    def is_near_optimum(self) -> bool:
        """Whether the linearisation went no further than it holds, in ln a and in the lag."""
        last = len(self.taken_at) + len(self.p) - 1
        late = self.hypothesis.lag
        lag = abs(float(self.coefficients[last])) if late.is_late and late.is_common else 0.0
        return self.step < MAX_LINEAR and lag < MAX_DELAY_STEP

    @property
    def error(self) -> np.ndarray:
        """Standard errors of sigma0 and Fc."""
        return jackknife(self.without)


@dataclass
class Optimum:
    """Where Gauss-Newton ended."""

    p: np.ndarray
    grams: np.ndarray  # (cycles, k, k)
    limits: np.ndarray
    peaks: np.ndarray  # largest |F/Fc| of each element


def slopes_of(p: np.ndarray, taken_at: np.ndarray, c: np.ndarray) -> np.ndarray:
    """sigma0 of each element by coefficients c (..., k) of columns taken at some limits."""
    m = len(taken_at)
    change = np.clip(c[..., m : 2 * m], -MAX_LINEAR, MAX_LINEAR)
    slopes: np.ndarray = np.exp(p[:m]) * (c[..., :m] + taken_at * change)
    return slopes


def parameters_of(p: np.ndarray, taken_at: np.ndarray, c: np.ndarray) -> np.ndarray:
    """sigma0 and Fc of all elements together: (..., 2)."""
    slopes, limits = slopes_of(p, taken_at, c), c[..., : len(taken_at)]
    return np.stack((slopes.sum(axis=-1), limits.sum(axis=-1)), axis=-1)


def score(h: Hypothesis, at: Optimum, columns: Sequence[int]) -> Fit:
    """Fit some columns of a linearised model to all cycles, and score them on cycles left out."""
    whole = at.grams.sum(axis=0)
    full, left = solve(whole, columns), solve(whole - at.grams, columns)
    limits = full[: len(at.limits)]
    return Fit(h, at.p, limits, at.limits, full, left, cost_of(at.grams, columns, left))


class Fitter:
    """Fits hypotheses to one table of samples."""

    def __init__(self, samples: Samples) -> None:
        self.samples = samples
        self.moves = {name: samples.moves(angle) for name, angle in samples.angles.items()}
        self.fast = samples.reference.fast
        self.quick = float(np.percentile(np.abs(samples.acceleration), FAST_PERCENTILE))
        self.max_delay = samples.max_delay()
        torque = samples.torque[samples.weight > 0]
        self.max_friction = MAX_FRICTION * float(np.ptp(np.percentile(torque, (1, 99)))) / 2

    # --- columns of a model ---

    def start(self, h: Hypothesis, a: float, lag: float = 0.0) -> np.ndarray:
        """Start values of the nonlinear parameters."""
        return np.append(h.law.start(a), np.full(h.lag.count(self.samples), lag))

    def elements(self, h: Hypothesis, p: np.ndarray) -> list[np.ndarray]:
        """F/Fc of each element, as the torque sensor would show it."""
        s = self.samples
        moves = h.lag.moves(s, self.moves[h.angle], h.angle, p)
        found = h.law.ratios(s, moves, p)
        return [h.lag.apply(s, s.delayed(x, h.skew), p) for x in found]

    def late(self, fit: Fit, x: np.ndarray) -> np.ndarray:
        """A torque of no friction as the torque sensor of a fit shows it: less its mean."""
        x, lag = x - x.mean(axis=0), fit.hypothesis.lag
        if not lag.is_late:
            return x
        return np.column_stack([lag.apply(self.samples, one, fit.p) for one in x.T])

    def columns(
        self, h: Hypothesis, p: np.ndarray, limits: np.ndarray | None, terms: Iterable[str]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Elements, derivatives by p, lag, terms; and the Fc of each element at which the
        derivatives were taken.
        """
        w = self.elements(h, p)
        if limits is None:
            limits = self._limits_of(w, terms)
        friction = sum(c * x for c, x in zip(limits, w, strict=True))
        names = [name for name in terms if name in ("offset", *LATE_TERMS)]
        others = self._other_torques(h, p, names)
        weights = self._weights(friction, others)
        changes = []
        for k in range(len(p)):
            step = np.zeros(len(p))
            step[k] = DERIVATIVE_STEP_ROWS if k in self._row_parameters(h, p) else DERIVATIVE_STEP
            moved = self.elements(h, p + step)
            change = sum(c * (x - y) for c, x, y in zip(limits, moved, w, strict=True))
            if k >= h.law.parameters and h.lag.is_late:
                again = self._other_torques(h, p + step, names)
                change += sum(c * (x - y) for c, x, y in zip(weights, again, others, strict=True))
            changes.append(change / step[k])
        lag = h.lag.derivatives(self.samples, friction)
        return np.column_stack((*w, *changes, *lag, *self._other_torques(h, p, terms))), limits

    def _other_torques(
        self, h: Hypothesis, p: np.ndarray, names: Iterable[str]
    ) -> list[np.ndarray]:
        """Return the columns of terms as the torque sensor shows them: its lag is that of all."""
        found: list[np.ndarray] = []
        for name in names:
            columns = self.term_columns([name])
            if name in LATE_TERMS and h.lag.is_late:
                columns = [h.lag.apply(self.samples, x - x.mean(), p) for x in columns]
            found += columns
        return found

    def _weights(self, friction: np.ndarray, columns: list[np.ndarray]) -> list[float]:
        """Return the coefficients of columns beside a friction, by least squares."""
        gram = self.samples.grams(np.column_stack((friction, *columns))).sum(axis=0)
        found: list[float] = solve(gram, range(len(columns) + 1))[1:].tolist()
        return found

    def _limits_of(self, w: list[np.ndarray], terms: Iterable[str]) -> np.ndarray:
        """Fc of each element by least squares; small instead of negative."""
        table = np.column_stack((*w, *self.term_columns(terms)))
        gram = self.samples.grams(table).sum(axis=0)
        limits = solve(gram, range(table.shape[1]))[: len(w)]
        found: np.ndarray = np.maximum(limits, 0.02 * max(np.abs(limits).max(), 1e-300))
        return found

    def term_columns(self, names: Iterable[str]) -> list[np.ndarray]:
        found: list[np.ndarray] = []
        for name in names:
            found += list(self.samples.waves.T) if name == "waves" else [self.samples.terms[name]]
        return found

    def _row_parameters(self, h: Hypothesis, p: np.ndarray) -> range:
        """Which parameters are a number of samples."""
        return range(len(p) - h.lag.count(self.samples) if h.lag.is_late else len(p), len(p))

    # --- the fit ---

    def optimum(self, h: Hypothesis, p: np.ndarray, rounds: int = ROUNDS) -> Optimum | None:
        """Gauss-Newton from p, with the linear parameters projected out."""
        best, found, scale, limits = np.inf, None, 1.0, None
        step = np.zeros(len(p))
        for _ in range(rounds):
            trial = p + scale * step
            table, at = self.columns(h, trial, limits, h.terms)
            grams = self.samples.grams(table)
            whole, m, k = grams.sum(axis=0), len(at), len(p)
            linear = [*range(m), *range(m + k, table.shape[1])]
            coefficients = solve(whole, linear)
            cost = float(cost_of(whole, linear, coefficients))
            if cost > best * (1 + 1e-7):
                scale /= 3
                if scale < 0.03:
                    break
                continue
            gain, best, p, scale = best - cost, cost, trial, 1.0
            found = Optimum(trial, grams, at, np.abs(table[:, :m]).max(axis=0))
            limits = coefficients[:m] if (coefficients[:m] > 0).all() else None
            step = self._step(h, p, whole)
            if np.abs(step[:m]).max() < SETTLED_STEP and gain < MIN_GAIN * cost:
                break
        return found

    def _step(self, h: Hypothesis, p: np.ndarray, gram: np.ndarray) -> np.ndarray:
        """The Gauss-Newton step that is best within the limits of all parameters."""
        m, n = h.law.elements, len(p)
        low, high = np.full(n, -MAX_STEP), np.full(n, MAX_STEP)
        for k in self._row_parameters(h, p):
            low[k] = max(-MAX_DELAY_STEP, -self.max_delay - p[k])
            high[k] = min(MAX_DELAY_STEP, self.max_delay - p[k])
        low[-1] = max(low[-1], h.lag.least - p[-1])
        ends = np.full((2, len(gram) - 1), [[-np.inf], [np.inf]])
        ends[:, m : m + n] = low, high
        return solve_within(gram, ends)[m : m + n]

    def _is_friction(self, fit: Fit, peaks: np.ndarray) -> bool:
        """Whether a fit is physical, and no element is larger than the log can show."""
        m, c, law = len(fit.limits), fit.coefficients, fit.hypothesis.law
        is_positive = (fit.limits > 0).all() and (fit.value > 0).all()
        is_too_large = fit.limits @ peaks > self.max_friction
        is_too_stiff = m > 1 and np.exp(fit.p[:m].max()) * self.samples.count > MAX_ELEMENT
        shape = (fit.p + c[m : m + len(fit.p)])[m : law.parameters]
        is_physical = (shape[:1] > law.least).all()
        resists = self.timed(fit).get("viscous", 0.0) > MIN_TIMED * self.max_friction
        delays = [fit.p[k] + c[m + k] for k in self._row_parameters(fit.hypothesis, fit.p)]
        is_too_late = max(map(abs, delays), default=0.0) > self.max_delay
        is_beyond = is_too_large or is_too_stiff or is_too_late
        return bool(is_positive and is_physical and resists and not is_beyond)

    def drives(self, fit: Fit) -> bool:
        """Whether the inertia is negative by more than noise."""
        return self.timed(fit).get("inertia", 0.0) < MIN_TIMED * self.max_friction

    def timed(self, fit: Fit) -> dict[str, float]:
        """Viscous torque and inertia at high speed and acceleration, N m (N)."""
        terms, sizes = fit.hypothesis.terms, {"viscous": self.fast, "inertia": self.quick}
        after = {name: len(terms) - terms.index(name) for name in sizes if name in terms}
        return {name: float(fit.coefficients[-k]) * sizes[name] for name, k in after.items()}

    def fit(self, h: Hypothesis, p: np.ndarray, rounds: int = ROUNDS) -> Fit | None:
        """Fit and score one hypothesis from start values p."""
        at = self.optimum(h, p, rounds)
        if at is None:
            return None
        fit = score(h, at, range(at.grams.shape[-1] - 1))
        return fit if self._is_friction(fit, at.peaks) else None

    def fit_term_sets(
        self, h: Hypothesis, p: np.ndarray, pool: Sequence[str], waves: bool = True
    ) -> list[Fit]:
        """Fit with all terms of the pool, then score every subset from the same Gram matrices."""
        at = self.optimum(replace(h, terms=tuple(pool)), p)
        if at is None:
            return []
        names = [*pool, *(["cubic", "waves"] if waves else [])]
        table, limits = self.columns(h, at.p, at.limits, names)
        at = replace(at, grams=self.samples.grams(table), limits=limits)
        base = len(limits) + len(at.p) + h.lag.columns
        term_of = [name for name in names for _ in self.term_columns([name])]
        found = []
        for terms in _term_sets(names):
            own = [base + k for term in terms for k, name in enumerate(term_of) if name == term]
            found.append(score(replace(h, terms=terms), at, [*range(base), *own]))
        found = [fit for fit in found if self.timed(fit).get("inertia", 1.0) > 0]
        return [fit for fit in found if self._is_friction(fit, at.peaks)]

    def predicted(self, fit: Fit) -> np.ndarray:
        """The torque of a fit at each sample: (n,) N m (N)."""
        h = fit.hypothesis
        table, _ = self.columns(h, fit.p, fit.taken_at, h.terms)
        torque: np.ndarray = table @ fit.coefficients
        return torque

    def other_torque(self, fit: Fit) -> np.ndarray:
        """The torque of the terms of a fit at each sample: (n,) N m (N)."""
        h = fit.hypothesis
        columns = self._other_torques(h, fit.p, h.terms)
        own = fit.coefficients[len(fit.coefficients) - len(columns) :]
        parts = (c * x for c, x in zip(own, columns, strict=True))
        return sum(parts, np.zeros(self.samples.rows))


def _term_sets(names: Sequence[str]) -> list[tuple[str, ...]]:
    """Sets of terms worth a trial: one shape over the angle, with any of the terms by time."""
    shapes = [("offset",), ("offset", "spring"), ("offset", "spring", "cubic"), ("offset", "waves")]
    timed = [name for name in ("viscous", "inertia") if name in names]
    return [
        (*shape, *more)
        for shape in shapes
        if set(shape) <= set(names)
        for n in range(len(timed) + 1)
        for more in combinations(timed, n)
    ]
