# SPDX-License-Identifier: MIT
"""From Gram matrices to parameters: variable projection, terms, intervals, held-out error.

INTERVALS  The cost is known for every (a, Fc): J(a, Fc) = sse(a) + stiff(a) (Fc - Fc(a))^2. The
profile likelihood of Fc, sigma0 and a follows from it, also where it is skew or has no end. Its
threshold is widened by what neighbouring rows share: the jackknife over blocks of rows says how
much a parameter varies in truth, the curvature of the profile how much it would with independent
errors; their ratio (at least 1) and Student's t for so many blocks set the 95 % line.

TERMS  One is kept when it has the sign of a passive part (all but the offset above 0), when the
motion can tell it from the others (INFORMED of its column is left beside them), and when it lowers
the cost on the parts of the log not fitted by PAYS.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.stats import t as student

from dahl.identify.sweep import FIRST_TERM, FRICTION, Sweep
from dahl.identify.terms import place_of, places_of

PAYS = 0.03  # of the held-out cost
INFORMED, HARDLY = 0.1, 0.03  # of a column's variance
FOLDS = 5
ROUNDS, STEPS = 2, 9  # of refining the grid around its best node
COARSE = 1.3  # ratio of neighbouring a in the first grid
DENSE = 4001  # points at which a profile is read
CLOSEST = 1e-9  # of log a, from the best to the next point of a profile
EXACT = 1e-16  # of the largest cost: less than rounding leaves of a log without any noise


@dataclass
class Curve:
    """The best linear parameters at each node."""

    a: np.ndarray  # (nodes,)
    sse: np.ndarray  # (nodes,)
    stiff: np.ndarray  # (nodes,) what a unit of Fc away from the best costs
    coefficient: np.ndarray  # (nodes, 1 + terms): Fc, then the terms

    @property
    def best(self) -> int:
        return int(np.argmin(self.sse))


def columns_of(terms: Sequence[str]) -> list[int]:
    """Columns of the Gram matrix: friction first."""
    return [FRICTION, *(FIRST_TERM + place for place in places_of(terms))]


def curve_of(a: np.ndarray, gram: np.ndarray, terms: Sequence[str]) -> Curve:
    """Solve (nodes, WIDTH, WIDTH) for the given terms at each node."""
    matrix, right, power = _normal(gram, columns_of(terms))
    inverse = np.linalg.inv(matrix)
    coefficient = np.einsum("kij,kj->ki", inverse, right)
    sse = np.maximum(power - np.einsum("ki,ki->k", coefficient, right), 1e-15 * power)
    return Curve(a, sse, 1 / inverse[:, 0, 0], coefficient)


def _normal(gram: np.ndarray, columns: list[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Normal equations; a ridge of 1e-12 keeps a column of zeros from stopping everything."""
    matrix = gram[:, columns][:, :, columns].copy()
    diagonal = np.arange(len(columns))
    matrix[:, diagonal, diagonal] *= 1 + 1e-12
    matrix[:, diagonal, diagonal] += 1e-30
    return matrix, gram[:, columns, -1], gram[:, -1, -1]


def cost_of(gram: np.ndarray, columns: list[int], coefficient: np.ndarray) -> np.ndarray:
    """Sum of squares on the rows of `gram` with coefficients found elsewhere: (nodes,)."""
    matrix, right, power = gram[:, columns][:, :, columns], gram[:, columns, -1], gram[:, -1, -1]
    squares = np.einsum("ki,kij,kj->k", coefficient, matrix, coefficient)
    cost: np.ndarray = power - 2 * np.einsum("ki,ki->k", coefficient, right) + squares
    return cost


def search(
    make: Callable[[np.ndarray], Sweep], low: float, high: float, terms: Sequence[str]
) -> Sweep:
    """Sweeps from low to high, then ever finer around the best a."""
    count = max(int(np.ceil(np.log(high / low) / np.log(COARSE))) + 1, 8)
    found = make(np.geomspace(low, high, count))
    for _ in range(ROUNDS):
        found = refine(found, make, terms)
    return found


def refine(found: Sweep, make: Callable[[np.ndarray], Sweep], terms: Sequence[str]) -> Sweep:
    """Add STEPS nodes on either side of the best."""
    best = curve_of(found.a, found.total(), terms).best
    left, right = found.a[max(best - 1, 0)], found.a[min(best + 1, len(found.a) - 1)]
    here = found.a[best]
    inner = [np.geomspace(x, y, STEPS // 2 + 2)[1:-1] for x, y in ((left, here), (here, right))]
    fresh = np.concatenate([part for part in inner if part[0] != part[-1]])
    return found.with_nodes(make(fresh)) if len(fresh) else found


@dataclass
class HeldOut:
    """The cost on blocks that were not fitted, each block once."""

    sse: float
    sst: float  # around the mean of those blocks' logs

    @property
    def r2(self) -> float:
        return 1 - self.sse / self.sst if self.sst > 0 else 0.0


def folds_of(owner: np.ndarray) -> np.ndarray:
    """The fold of each block: whole logs where there are several, else parts of the one log."""
    logs, index = np.unique(owner, return_inverse=True)
    if len(logs) > 1:
        return np.asarray(index * min(FOLDS, len(logs)) // len(logs))
    return np.arange(len(owner)) * FOLDS // len(owner)


def held_out(found: Sweep, columns: list[int]) -> HeldOut:
    """Fit FOLDS times without one part, and add up the cost on those parts."""
    fold, sse = folds_of(found.owner), 0.0
    for part in np.unique(fold):
        train, test = found.total(fold != part), found.total(fold == part)
        matrix, right, power = _normal(train, columns)
        coefficient = np.linalg.solve(matrix, right[..., None])[..., 0]
        best = _lowest(found.a, power - np.einsum("ki,ki->k", coefficient, right))
        costs = cost_of(test, columns, coefficient)
        sse += float(np.interp(np.log(best), np.log(found.a), costs))
    return HeldOut(sse, spread_of(found))


def spread_of(found: Sweep) -> float:
    """Sum of squares of the torque around its mean."""
    whole = found.gram[0].sum(axis=0)
    return float(whole[-1, -1] - whole[FIRST_TERM, -1] ** 2 / whole[FIRST_TERM, FIRST_TERM])


def _lowest(a: np.ndarray, cost: np.ndarray) -> float:
    """Where a parabola through the lowest node and its neighbours (in log a) is lowest."""
    i = int(np.argmin(cost))
    if i in (0, len(a) - 1):
        return float(a[i])
    x, y = np.log(a[i - 1 : i + 2]), cost[i - 1 : i + 2]
    x = x - x[1]
    bend = (y[2] - y[1]) / x[2] + (y[1] - y[0]) / x[0]
    slope = ((y[2] - y[1]) / x[2] * -x[0] + (y[0] - y[1]) / x[0] * x[2]) / (x[2] - x[0])
    step = -slope * (x[2] - x[0]) / (2 * bend) if bend > 0 else 0.0
    return float(a[i] * np.exp(np.clip(step, x[0], x[2])))


def choose_terms(found: Sweep, candidates: Sequence[str]) -> list[str]:
    """The subset with the least held-out cost, where each term has to lower it by PAYS."""
    costs = {
        kept: np.log(held_out(found, columns_of(kept)).sse) - np.log1p(-PAYS) * len(kept)
        for count in range(len(candidates) + 1)
        for kept in combinations(candidates, count)
        if "spring" not in kept or "offset" in kept  # where it is relaxed is not known
    }
    for kept in sorted(costs, key=costs.__getitem__):
        if all(fits_in(found, [other for other in kept if other != term], term) for term in kept):
            return sorted(kept, key=place_of)
    return []


def fits_in(found: Sweep, kept: Sequence[str], term: str) -> bool:
    """Told apart by the motion, and with the sign of a passive part."""
    if term == "offset":
        return True
    curve = curve_of(found.a, found.total(), [*kept, term])
    return told_apart(found, kept, term) and bool(curve.coefficient[curve.best, -1] > 0)


def told_apart(found: Sweep, kept: Sequence[str], term: str, part: float = INFORMED) -> bool:
    """Whether the motion can tell a term from the others and from friction."""
    total, own = found.total(), FIRST_TERM + place_of(term)
    best = curve_of(found.a, total, [*kept, term]).best
    others = columns_of(list(dict.fromkeys(["offset", *kept])))
    nodes = (best, len(found.a) - 1)  # beside Dahl's curve, and beside a bare sign
    return all(_left_beside(total[node], own, others) >= part for node in nodes)


def sets_of(found: Sweep, candidates: Sequence[str]) -> list[tuple[str, ...]]:
    """Sets of terms, the empty one first, in which the motion tells each from the others at all."""
    subsets = [
        kept for count in range(len(candidates) + 1) for kept in combinations(candidates, count)
    ]
    return [
        kept
        for kept in subsets
        if ("offset" in kept or not kept)
        and all(
            told_apart(found, [other for other in kept if other != term], term, HARDLY)
            for term in kept
            if term != "offset"
        )
    ]


def _left_beside(gram: np.ndarray, own: int, others: list[int]) -> float:
    """Part of a column's variance that the others and a constant cannot draw."""
    matrix, right = gram[np.ix_(others, others)], gram[others, own]
    rest = gram[own, own] - right @ np.linalg.lstsq(matrix, right, rcond=None)[0]
    mean = gram[FIRST_TERM, own] ** 2 / gram[FIRST_TERM, FIRST_TERM]
    variance = gram[own, own] - mean
    return float(rest / variance) if variance > 0 else 0.0


@dataclass
class Interval:
    """95 %; inf where the cost never rises enough."""

    low: float
    high: float

    def relative(self, value: float) -> float:
        """Half its width over the value."""
        return (self.high - self.low) / 2 / value if value > 0 else np.inf

    def around(self, value: float) -> Interval:
        """With the estimate in it, which the grid of a profile misses where there is no noise."""
        return Interval(min(self.low, value), max(self.high, value))

    @property
    def bounded(self) -> bool:
        return bool(np.isfinite(self.high) and self.low > 0)


@dataclass
class Estimate:
    """What one sweep says for one choice of terms."""

    a: float
    Fc: float
    terms: dict[str, float]
    sse: float
    rows: float  # sum of the weights
    blocks: int
    ci95: dict[str, Interval]
    inflation: dict[str, float]  # variance over what independent errors would give
    curve: Curve

    @property
    def sigma0(self) -> float:
        return self.a * self.Fc


def point(found: Sweep, terms: Sequence[str]) -> Estimate:
    """The parameters of a sweep, without intervals."""
    curve = curve_of(found.a, found.total(), terms)
    a = _lowest(curve.a, curve.sse)
    values = [float(_spline(curve.a, column)(np.log(a))) for column in curve.coefficient.T]
    rows = float(found.gram[0, :, FIRST_TERM, FIRST_TERM].sum())
    named = dict(zip(terms, values[1:], strict=True))
    sse = float(curve.sse.min())
    return Estimate(a, values[0], named, sse, rows, len(found.owner), {}, {}, curve)


def estimate(
    found: Sweep, terms: Sequence[str], hidden: Mapping[str, float] | None = None
) -> Estimate:
    """Parameters and their intervals. `hidden` are further standard errors of a, Fc and sigma0, as
    parts of them, that all blocks share.
    """
    best = point(found, terms)
    dense = _dense(best.curve, best.a)
    freedom = best.rows - len(terms) - 3
    true = _jackknife(found, terms)
    for name, part in (hidden or {}).items():
        true[name] += (part * getattr(best, name)) ** 2
    naive = {name: _naive(dense, name, freedom) for name in ("a", "Fc", "sigma0")}
    inflation = {name: max(true[name] / naive[name], 1.0) if naive[name] else 1.0 for name in naive}
    quantile = float(student.ppf(0.975, best.blocks - 1)) ** 2 / freedom
    ci95 = {
        name: _profile(dense, name, 1 + quantile * inflation[name]).around(getattr(best, name))
        for name in naive
    }
    return replace(best, ci95=ci95, inflation=inflation)


def dense_of(best: Estimate) -> Curve:
    """The curve of an estimate at many points."""
    return _dense(best.curve, best.a)


def profile_of(dense: Curve, sigma0: np.ndarray) -> np.ndarray:
    """Least cost for each sigma0 over the least of all: (n,) -> (n,)."""
    off = sigma0[:, None] / dense.a - dense.coefficient[:, 0]
    least = np.min(dense.sse + dense.stiff * off**2, axis=1)
    best = max(dense.sse.min(), EXACT * dense.sse.max())
    shape: np.ndarray = least / best
    return shape


def _spline(a: np.ndarray, values: np.ndarray) -> CubicSpline:
    return CubicSpline(np.log(a), values)


def _dense(curve: Curve, a: float) -> Curve:
    """The curve at DENSE points over all and DENSE on either side of the best, ever closer to it,
    so that an interval of any width has ends.
    """
    wide = np.linspace(np.log(curve.a[0]), np.log(curve.a[-1]), DENSE)
    apart = np.geomspace(CLOSEST, wide[-1] - wide[0], DENSE)
    x = np.unique(np.concatenate((np.log(a) - apart, np.log(a) + apart, wide)))
    x = x[(x >= wide[0]) & (x <= wide[-1])]
    columns = (curve.sse, curve.stiff, curve.coefficient[:, :1])
    sse, stiff, Fc = (_spline(curve.a, y)(x) for y in columns)  # noqa: N806
    return Curve(np.exp(x), np.maximum(sse, 0.0), stiff, Fc)


def _profile(dense: Curve, name: str, ratio: float) -> Interval:
    """All values of a parameter whose least cost is below ratio times the least of all."""
    limit = dense.sse.min() * ratio
    inside = dense.sse <= limit
    room = np.sqrt(np.where(inside, limit - dense.sse, 0) / dense.stiff)
    scale = {"a": None, "Fc": np.ones_like(dense.a), "sigma0": dense.a}[name]
    if scale is None:
        low, high = dense.a[inside].min(), dense.a[inside].max()
    else:
        low = (scale * (dense.coefficient[:, 0] - room))[inside].min()
        high = (scale * (dense.coefficient[:, 0] + room))[inside].max()
    open_above = bool(inside[-1]) and name != "Fc"
    open_below = bool(inside[0])
    return Interval(
        0.0 if open_below and name != "Fc" else max(float(low), 0.0),
        np.inf if open_above or (open_below and name == "Fc") else float(high),
    )


def _naive(dense: Curve, name: str, freedom: float) -> float:
    """Variance with independent errors: from the width of the profile one standard error up."""
    interval = _profile(dense, name, 1 + 1 / freedom)
    return ((interval.high - interval.low) / 2) ** 2 if np.isfinite(interval.high) else 0.0


def _jackknife(found: Sweep, terms: Sequence[str]) -> dict[str, float]:
    """Variance of each parameter from fits that leave one block out."""
    count, values = len(found.owner), []
    for block in range(count):
        use = np.arange(count) != block
        curve = curve_of(found.a, found.total(use), terms)
        a = _lowest(curve.a, curve.sse)
        Fc = float(np.interp(np.log(a), np.log(curve.a), curve.coefficient[:, 0]))  # noqa: N806
        values.append((a, Fc, a * Fc))
    spread = np.var(np.array(values), axis=0) * (count - 1)
    return dict(zip(("a", "Fc", "sigma0"), map(float, spread), strict=True))
