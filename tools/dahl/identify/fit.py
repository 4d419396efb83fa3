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
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.optimize import lsq_linear
from scipy.signal import filtfilt, lfilter

from dahl.identify import models
from dahl.identify.models import LAWS, Law
from dahl.identify.samples import FAST_PERCENTILE, Samples, delayed

FILTERS = ("low pass", "zero-phase filter", "damped low pass")  # the second runs to and fro
DELAYED = ("delay", *FILTERS, "delay+filter")  # the last parameter is a number of samples
LAGS = ("none", "damping", "play", *DELAYED)
LATE_TERMS = ("spring", "viscous", "inertia")  # that a late sensor shows late too
SPECIAL_LAGS = {"delay+filter": ("delay",), "damped low pass": ("damping", "low pass")}
FADING_SPEED = 0.25  # of fast motion: LuGre's damping fades as its state comes to rest in sliding
ROUNDS = 8  # Gauss-Newton steps of a fit, at most
MAX_STEP, MAX_DELAY_STEP = 0.4, 6.0  # of a Gauss-Newton step: in ln a and shapes, in samples
MIN_GAIN, SETTLED_STEP = 1e-4, 1e-3  # of the cost and of ln a, below which the fit has converged
MIN_LOW_PASS = 0.3  # samples; a shorter time constant has no effect
MAX_LINEAR = 0.6  # of ln a: beyond it a linearisation is useless
MAX_ELEMENT = 1.0  # presliding lengths in a count: one of several elements cannot be stiffer
MIN_PEAK = -0.02  # of Fc: its increase if slow or after a rest, which noise may bring below 0
MIN_TIMED = -0.02  # of MAX_FRICTION, at high speed: viscous torque and inertia resist the motion
MAX_FRICTION = 1.5  # of the measured torque: more would have to be cancelled by inertia or a spring
MIN_LOG_SPEED = 0.01  # of fast motion; at a reversal a logarithm would have no bound
MIN_LIMIT = 0.05  # of Fc: friction must not vanish or push at any speed
DERIVATIVE_STEP, DERIVATIVE_STEP_ROWS = 0.01, 0.05  # of numerical derivatives


@dataclass(frozen=True)
class Hypothesis:
    """One description of a log."""

    law: str = "dahl"
    lag: str = "none"
    angle: str = "between counts"
    terms: tuple[str, ...] = ("offset",)
    skew: float = 0.0  # samples by which the torque is read after the angle

    @property
    def friction(self) -> Law:
        return LAWS[self.law]

    @property
    def size(self) -> int:
        """Parameters beyond a Dahl element and an offset."""
        lag = {"none": 0, "delay+filter": 3, "delays": 2, "damped low pass": 3}.get(self.lag, 1)
        terms = sum(16 if term == "waves" else 1 for term in self.terms) - 1
        return self.friction.size + lag + terms

    @property
    def lag_columns(self) -> int:
        """Linear ones."""
        return {"damping": 1, "delay+filter": 2, "damped low pass": 2}.get(self.lag, 0)

    def contains(self, other: Hypothesis) -> bool:
        """Whether the other one is a special case of this one."""
        law = other.law == self.law or other.law in self.friction.special_cases
        lag = other.lag in (self.lag, "none", *SPECIAL_LAGS.get(self.lag, ()))
        terms = set(other.terms) <= set(self.terms)
        return law and lag and terms and self.angle == other.angle

    def __str__(self) -> str:
        lag = "" if self.lag == "none" else f", {self.lag}"
        return f"{self.law}{lag}, {self.angle}, {'+'.join(self.terms)}"


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

    @property
    def total(self) -> float:
        return float(self.cost.sum())

    @property
    def slopes(self) -> np.ndarray:
        """sigma0 of each element, N m/rad (N/m)."""
        return slopes_of(self.p, self.taken_at, self.coefficients)

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
        is_late = self.hypothesis.lag in DELAYED
        lag = abs(float(self.coefficients[last])) if is_late else 0.0
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


def jackknife(values: np.ndarray) -> np.ndarray:
    """Standard error of estimates of which each lacks one cycle: (cycles, k) -> (k,)."""
    n = len(values)
    spread = np.sum((values - values.mean(axis=0)) ** 2, axis=0)
    error: np.ndarray = np.sqrt((n - 1) / n * spread)
    return error


def excess(cost: np.ndarray, best: np.ndarray) -> tuple[float, float]:
    """By how much a cost by cycle is above another, and the standard error of that."""
    more = cost - best
    return float(more.sum()), float(more.std(ddof=1) * np.sqrt(len(more)))


def solve(gram: np.ndarray, columns: Sequence[int]) -> np.ndarray:
    """Least squares by Gram matrices (..., k, k), the torque last: coefficients of some columns."""
    c = list(columns)
    matrix, right = gram[..., c, :][..., c], gram[..., c, -1]
    scale = np.sqrt(np.maximum(np.einsum("...ii->...i", matrix), 1e-300))
    matrix = matrix / scale[..., :, None] / scale[..., None, :] + 1e-10 * np.eye(len(c))
    found: np.ndarray = np.linalg.solve(matrix, (right / scale)[..., None])[..., 0] / scale
    return found


def solve_within(gram: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Least squares by a Gram matrix with coefficients between two ends, (2, k)."""
    wanted = solve(gram, range(len(gram) - 1))
    if ((ends[0] <= wanted) & (wanted <= ends[1])).all():
        return wanted
    scale = np.sqrt(np.maximum(np.diag(gram)[:-1], 1e-300))
    matrix = gram[:-1, :-1] / scale[:, None] / scale + 1e-10 * np.eye(len(scale))
    root = np.linalg.cholesky(matrix).T
    low, high = ends * scale
    found: np.ndarray = lsq_linear(root, root @ (wanted * scale), (low, high), "bvls").x / scale
    return found


def cost_of(gram: np.ndarray, columns: Sequence[int], coefficients: np.ndarray) -> np.ndarray:
    """Sum of squared residuals that these coefficients leave."""
    c = [*columns, gram.shape[-1] - 1]
    one = np.ones((*coefficients.shape[:-1], 1))
    v = np.concatenate((-coefficients, one), axis=-1)
    left: np.ndarray = np.einsum("...i,...ij,...j->...", v, gram[..., c, :][..., c], v)
    cost: np.ndarray = np.maximum(left, 0.0)
    return cost


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
        law = h.friction
        shapes = [first for first, _, _ in law.shape]
        p = np.array([*(np.log(a) + x for x in law.stiffness), *shapes], dtype=float)
        if h.lag == "delays":
            return np.append(p, np.full(self.samples.logs, lag))
        return np.append(p, lag) if h.lag in (*DELAYED, "play") else p

    def elements(self, h: Hypothesis, p: np.ndarray) -> list[np.ndarray]:
        """F/Fc of each element, as the torque sensor would show it."""
        moves = self.moves[h.angle]
        if h.lag == "play":
            angle = self.samples.angles[h.angle]
            width = float(np.exp(p[-1]))
            moves = self.samples.moves(models.behind_play(angle, self.samples.pieces, width))
        found = self._without_lag(h, p, moves)
        return [self._apply_lag(h, p, self.samples.delayed(x, h.skew)) for x in found]

    def _without_lag(self, h: Hypothesis, p: np.ndarray, moves: np.ndarray) -> list[np.ndarray]:
        """F/Fc of each element on these moves."""
        law, s, pieces = h.friction, self.samples, self.samples.pieces
        a = np.exp(np.clip(p[: law.elements], -50, 50))
        shape = self._shape(h, p)
        if law.kinds == ("limits",):
            limits = self._limits(h, a[0], shape)
            return [models.dahl_with_limits(moves, pieces, a[0], limits)]
        if h.law == "loaded":
            assert s.load is not None
            share = np.maximum(1 + shape[0] * (s.load / s.reference.load - 1), 0.02)
            return [models.dahl_under_load(moves, pieces, a[0], share)]
        if h.law == "asymmetric":
            return [models.asymmetric(moves, pieces, a[0], shape[0])]
        if shape:
            return [models.tabulated(moves, pieces, a[0], h.law, shape[0])]
        laws = {"dahl": models.dahl, "slip": models.slip}
        return [laws[kind](moves, pieces, a[k]) for k, kind in enumerate(law.kinds)]

    def _shape(self, h: Hypothesis, p: np.ndarray) -> list[float]:
        law = h.friction
        return [
            float(np.clip(x, low, high))
            for x, (_, low, high) in zip(p[law.elements :], law.shape, strict=False)
        ]

    def limit_range(self, fit: Fit) -> tuple[float, float]:
        """Least and largest Fc in parts of the mean or fast Fc that the law states.

        The range covers both directions, and the speeds and rests of the log.
        """
        h, shape = fit.hypothesis, self._shape(fit.hypothesis, fit.p)
        if h.law == "asymmetric":
            return 1 - abs(shape[0]), 1 + abs(shape[0])
        if h.friction.kinds != ("limits",):
            return 1.0, 1.0
        limits = self._limits(h, float(np.exp(fit.p[0])), shape)
        return min(float(limits.min()), 1.0), max(float(limits.max()), 1.0)

    def _limits(self, h: Hypothesis, a: float, shape: Sequence[float]) -> np.ndarray:
        """Fc of each sample, in parts of Fc: (n,)."""
        s, strength = self.samples, shape[0]
        if h.law == "stribeck":
            change = np.exp(-((s.speed / (self.fast * np.exp(shape[1]))) ** 2))
        elif h.law == "log speed":
            speed = np.maximum(np.abs(s.speed), MIN_LOG_SPEED * self.fast)
            change = np.log(speed / s.reference.mean_speed)
        else:  # breakaway
            change = np.exp(-a * s.travel_since_rest() / np.exp(shape[1]))
        limits: np.ndarray = np.maximum(1 + strength * change, MIN_LIMIT)
        return limits

    def late(self, fit: Fit, x: np.ndarray) -> np.ndarray:
        """A torque of no friction as the torque sensor of a fit shows it: less its mean."""
        x = x - x.mean(axis=0)
        h = fit.hypothesis
        if h.lag not in (*DELAYED, "delays"):
            return x
        return np.column_stack([self._apply_lag(h, fit.p, one) for one in x.T])

    def _apply_lag(self, h: Hypothesis, p: np.ndarray, x: np.ndarray) -> np.ndarray:
        """x as a late or slow torque sensor shows it."""
        s = self.samples
        if h.lag in ("delay", "delay+filter"):
            return s.delayed(x, p[-1])
        if h.lag == "delays":
            each = p[len(p) - s.logs :]
            parts = zip(s.pieces, s.log_of, strict=True)
            return np.concatenate([delayed(x[rows], each[k]) for rows, k in parts])
        if h.lag in FILTERS:
            run = filtfilt if h.lag == "zero-phase filter" else lfilter
            kept = np.exp(-1 / max(p[-1], 1e-2))
            return s.by_piece(lambda y: run([1 - kept], [1, -kept], y), x)
        return x

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
            if k >= h.friction.parameters and h.lag != "play":
                again = self._other_torques(h, p + step, names)
                change += sum(c * (x - y) for c, x, y in zip(weights, again, others, strict=True))
            changes.append(change / step[k])
        lag = self._lag_columns(h, friction)
        return np.column_stack((*w, *changes, *lag, *self._other_torques(h, p, terms))), limits

    def _other_torques(
        self, h: Hypothesis, p: np.ndarray, names: Iterable[str]
    ) -> list[np.ndarray]:
        """Return the columns of terms as the torque sensor shows them: its lag is that of all."""
        found: list[np.ndarray] = []
        for name in names:
            columns = self.term_columns([name])
            if name in LATE_TERMS and h.lag in (*DELAYED, "delays"):
                columns = [self._apply_lag(h, p, x - x.mean()) for x in columns]
            found += columns
        return found

    def _weights(self, friction: np.ndarray, columns: list[np.ndarray]) -> list[float]:
        """Return the coefficients of columns beside a friction, by least squares."""
        gram = self.samples.grams(np.column_stack((friction, *columns))).sum(axis=0)
        found: list[float] = solve(gram, range(len(columns) + 1))[1:].tolist()
        return found

    def _lag_columns(self, h: Hypothesis, friction: np.ndarray) -> list[np.ndarray]:
        """Derivatives by time that a lag adds, as many as h.lag_columns.

        The second derivative is what any short filter adds to its delay: a mean over rows, a
        filter that runs to and fro, a torque cell that rings.
        """
        s, damping = self.samples, self.samples.rate(friction) / self.fast
        if h.lag == "damping":
            return [damping]
        if h.lag == "damped low pass":
            return [damping, s.rate(s.acceleration)]
        if h.lag == "delay+filter":
            fading = np.exp(-((s.speed / (FADING_SPEED * self.fast)) ** 2))
            bend = s.by_piece(lambda x: np.gradient(np.gradient(x)), friction)
            return [bend, damping * fading]
        return []

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

    def _row_parameters(self, h: Hypothesis, p: np.ndarray) -> list[int]:
        """Which parameters are a number of samples."""
        if h.lag == "delays":
            return list(range(len(p) - self.samples.logs, len(p)))
        return [len(p) - 1] if h.lag in DELAYED else []

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
        m, n = h.friction.elements, len(p)
        low, high = np.full(n, -MAX_STEP), np.full(n, MAX_STEP)
        for k in self._row_parameters(h, p):
            low[k] = max(-MAX_DELAY_STEP, -self.max_delay - p[k])
            high[k] = min(MAX_DELAY_STEP, self.max_delay - p[k])
        if h.lag in FILTERS:
            low[-1] = max(low[-1], MIN_LOW_PASS - p[-1])
        ends = np.full((2, len(gram) - 1), [[-np.inf], [np.inf]])
        ends[:, m : m + n] = low, high
        return solve_within(gram, ends)[m : m + n]

    def _is_friction(self, fit: Fit, peaks: np.ndarray) -> bool:
        """Whether a fit is physical, and no element is larger than the log can show."""
        m, c = len(fit.limits), fit.coefficients
        is_positive = (fit.limits > 0).all() and (fit.value > 0).all()
        is_too_large = fit.limits @ peaks > self.max_friction
        is_too_stiff = m > 1 and np.exp(fit.p[:m].max()) * self.samples.count > MAX_ELEMENT
        has_peak = fit.hypothesis.law in ("stribeck", "breakaway")
        falls = not has_peak or fit.p[1] + c[m + 1] > MIN_PEAK
        resists = self.timed(fit).get("viscous", 0.0) > MIN_TIMED * self.max_friction
        delays = [fit.p[k] + c[m + k] for k in self._row_parameters(fit.hypothesis, fit.p)]
        is_too_late = max(map(abs, delays), default=0.0) > self.max_delay
        is_beyond = is_too_large or is_too_stiff or is_too_late
        return bool(is_positive and falls and resists and not is_beyond)

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
        base = len(limits) + len(at.p) + h.lag_columns
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
