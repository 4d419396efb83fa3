# SPDX-License-Identifier: MIT
"""The numbers inside an identification, each function by itself against least squares on the rows,
brute force or a closed form: an error that a later step would make up for shows here.

References have no code of the package in them: the torque is identify_tools.dahl_torque, speeds
are numpy's gradient, fits are numpy's lstsq and scipy's minimisers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from dahl.identify import (
    choices,
    cycles,
    delay,
    elements,
    fit,
    path,
    sweep,
)
from dahl.identify.choices import Choice, Trial
from dahl.identify.fit import Interval
from dahl.identify.log import Log
from dahl.identify.terms import place_of, speed_of
from identify_tools import FC, SIGMA0, dahl_torque, noise_of, sine
from scipy.ndimage import uniform_filter1d
from scipy.optimize import brentq, minimize_scalar
from scipy.stats import t as student

pytestmark = pytest.mark.usefixtures("library")

A = SIGMA0 / FC
RNG = np.random.default_rng(12)
START = RNG.bit_generator.state
ROWS = 1500
NAMES = ("offset", "spring", "viscous", "inertia")  # whichever other terms there are
KNOWN = [sweep.FRICTION, sweep.START, *(sweep.FIRST_TERM + place_of(name) for name in NAMES), -1]
KNOWN = np.ix_(KNOWN, KNOWN)


@pytest.fixture(autouse=True)
def _same_numbers_in_any_order() -> None:
    """Each test draws the same random numbers, whichever tests ran before it."""
    RNG.bit_generator.state = START


def log_of(seed: int = 1, part: float = 0.05, rows: int = ROWS, cycled: float = 6.0, **more) -> Log:
    """A smooth angle without an encoder, its torque with noise and an offset, 1 kHz."""
    theta = sine(seed, rows=rows, cycles=cycled)
    torque = dahl_torque(theta) + 0.1 + part * FC * noise_of(seed, rows)
    return Log(f"seed {seed}", theta, torque, np.arange(rows) * 1e-3, **more)


def speeds(log: Log) -> tuple[np.ndarray, np.ndarray]:
    def smooth(x: np.ndarray) -> np.ndarray:
        return uniform_filter1d(np.gradient(x, log.time), 9, mode="nearest")

    speed = smooth(log.theta)
    return speed, smooth(speed)


def columns(log: Log, a: float) -> np.ndarray:
    """w, what is left of the first torque, terms, the torque, as KNOWN picks them: (rows, 7)."""
    start = np.exp(-a * np.cumsum(np.abs(np.diff(log.theta, prepend=log.theta[0]))))
    w, one = dahl_torque(log.theta, a, 1.0), np.ones(log.rows)
    return np.column_stack((w, start, one, log.theta - log.zero, *speeds(log), log.torque))


def rows_of(logs: Sequence[Log], a: float, terms: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """w, the terms, the first torque of each log; the torque: all weighed by row."""
    used = [0, *(2 + NAMES.index(term) for term in terms)]
    parts, first = [], []
    for i, log in enumerate(logs):
        root = np.sqrt(np.ones(log.rows) if log.weight is None else log.weight)
        all_ = columns(log, a) * root[:, None]
        own = np.zeros((log.rows, len(logs)))
        own[:, i] = all_[:, 1]
        parts.append(all_[:, [*used, -1]])
        first.append(own)
    whole = np.concatenate(parts)
    return np.column_stack((whole[:, :-1], np.concatenate(first))), whole[:, -1]


def solved(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, float]:
    """Coefficients and the sum of squares that they leave."""
    best = np.linalg.lstsq(x, y, rcond=None)[0]
    return best, float(np.sum((y - x @ best) ** 2))


def best_a(cost: Callable[[float], float], around: float = A, wide: float = 0.3) -> float:
    ends = (np.log(around) - wide, np.log(around) + wide)
    found = minimize_scalar(
        lambda x: cost(np.exp(x)), bounds=ends, method="bounded", options={"xatol": 1e-7}
    )
    return float(np.exp(found.x))


# --- paths and elements ---------------------------------------------------------------------------


def stepped(moves: np.ndarray, a: float, start: float) -> np.ndarray:
    """A spring that slips, row by row."""
    drawn = []
    for move in moves:
        start = min(max(start + a * move, -1.0), 1.0)
        drawn.append(start)
    return np.array(drawn)


@pytest.mark.parametrize("rows", [1, 63, 64, 65, 200])
@pytest.mark.parametrize("start", [0.0, 0.7, -1.0])
def test_paths_of_any_length_from_any_start(rows, start):
    moves = RNG.normal(scale=0.4, size=rows)
    assert path.bilinear(moves, 0.9, start) == pytest.approx(stepped(moves, 0.9, start))
    F, drawn = start, []  # noqa: N806
    for move in moves:
        F = np.sign(move) - (np.sign(move) - F) * np.exp(-0.9 * abs(move))  # noqa: N806
        drawn.append(F)
    assert path.dahl(moves, 0.9, start) == pytest.approx(np.array(drawn), abs=1e-6)


def test_the_sign_of_the_last_move():
    moves = np.array([0.0, 0.0, 2.0, 0.0, -0.1, 0.0, 0.0, 3.0])
    assert path.coulomb(moves, 5.0, 0.3).tolist() == [0.3, 0.3, 1, 1, -1, -1, -1, 1]
    assert path.coulomb(-moves, 5.0).tolist() == [0, 0, -1, -1, 1, 1, 1, -1]


@pytest.mark.parametrize(
    ("theta", "least", "turns"),
    [
        ([0, 1, 2, 1, 0], 1.5, [2]),
        ([0, 1, 2, 1, 0], 2.0, []),  # a turn is more than that
        ([0, 1, 2, 1.5, 3, 2.6, 4, 0], 1.0, [6]),
        ([0, 0, 1, 3, 3, 3, 0, 0, 3], 1.0, [3, 6]),  # where the motion rests, its first row
        ([5, 4, 3, 2, 8, 8, 1], 1.0, [3, 4]),
        ([0, 1, 3, 2.5, 3, 0], 1.0, [4]),  # of two that are as far, the later one
        ([0, 0.5, 0.9, -0.9, 0.9, -0.9], 1.0, [3, 4]),  # strokes to either side of the start
        ([0, 0.4, 0, -0.4, 0, 3, -3], 1.0, [5]),  # what is before the first large move
        ([1, 1, 1], 1.0, []),
        ([1], 1.0, []),
        ([0, 2, 0, 2, 0, 2], 1.9, [3, 4]),  # one move alone is no stroke, nor what follows it
    ],
)
def test_turns_of_a_path(theta, least, turns):
    assert path.reversals(np.array(theta, dtype=float), least).tolist() == turns
    assert path.reversals(-np.array(theta, dtype=float), least).tolist() == turns


def test_elements_at_rest_and_from_a_state():
    moves = np.array([0.0, 0.0, 0.3, 0.0, -0.5, 0.2])
    for exponent in (0, 0.5, 1, 2.0):
        w = elements.of_exponent(exponent)(moves, 0.8)
        assert w[:2].tolist() == [0, 0] and w[3] == pytest.approx(w[2])
    assert elements.general(np.zeros(3), 1.0, 0.5).tolist() == [0, 0, 0]
    assert elements.of_exponent(0)(moves, 0.8) == pytest.approx(stepped(moves, 0.8, 0.0))
    drawn = dahl_torque(np.cumsum(moves), 0.8, 1.0)
    assert elements.of_exponent(1)(moves, 0.8) == pytest.approx(drawn, abs=1e-8)
    u = np.array([0.24, 0, 0.4, 0.16])  # travels times a; exponent 2: the inverse gap grows by it
    gap = [1 / (1 + u[0])]
    gap += [gap[0], 1 / (1 / (2 - gap[0]) + u[2])]
    gap.append(1 / (1 / (2 - gap[2]) + u[3]))
    wanted = np.array([0, 0, 1 - gap[0], 1 - gap[1], gap[2] - 1, 1 - gap[3]])
    assert elements.of_exponent(2.0)(moves, 0.8) == pytest.approx(wanted)
    w, before = [], -0.2  # Fc+ = 1.2, Fc- = 0.8, in h; F = 0.2 + w
    for move in moves:
        limit = 1.2 if move > 0 else 0.8
        F, side = 0.2 + before, np.sign(move)  # noqa: N806
        F = side * limit - (side * limit - F) * np.exp(-0.8 * abs(move) / limit)  # noqa: N806
        w.append(before := F - 0.2)
    drawn = elements.asymmetric(moves, 0.8, 0.2, before=-0.2)
    assert drawn == pytest.approx(np.array(w), abs=1e-6)


# --- products of columns --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def two(library) -> list[Log]:
    """Two logs, one of them with weights, a spring relaxed elsewhere."""
    weight = np.random.default_rng(3).uniform(size=900)
    weight[100:130] = 0.0
    first = replace(log_of(1, rows=900, cycled=4), zero=0.01, weight=weight)
    return [first, replace(log_of(2, rows=700, cycled=3), zero=0.01)]


@pytest.mark.parametrize(
    ("piece", "blocks"), [(100, 3), (700, 3), (32768, 1), (32768, 7), (90, 10)]
)
def test_products_of_all_columns_by_block(two, piece, blocks, monkeypatch):
    monkeypatch.setattr(sweep, "PIECE", piece)
    found = sweep.sweep(two, blocks, np.array([3000.0, 50.0, A]))
    assert found.a.tolist() == [50, A, 3000]
    assert found.owner.tolist() == [0] * blocks + [1] * blocks
    for i, a in enumerate(found.a):
        place = 0
        for log in two:
            length = -(-log.rows // blocks)
            root = 1.0 if log.weight is None else np.sqrt(log.weight)[:, None]
            all_ = columns(log, a) * root
            for start in range(0, log.rows, length):
                part = all_[start : start + length]
                near = pytest.approx(part.T @ part, rel=1e-4, abs=1e-4)
                assert found.gram[i, place][KNOWN] == near, (a, place)
                place += 1


def test_products_without_the_first_torque(two):
    found = sweep.sweep(two, 4, np.array([A]))
    whole = found.total()
    parts = []
    for log in two:
        root = 1.0 if log.weight is None else np.sqrt(log.weight)[:, None]
        all_ = columns(log, A) * root
        start = all_[:, 1:2]
        parts.append(all_ - start @ np.linalg.lstsq(start, all_, rcond=None)[0])
    rest = np.concatenate(parts)
    assert whole[0][KNOWN] == pytest.approx(rest.T @ rest, rel=1e-4, abs=1e-4)
    kept = np.ones(8, dtype=bool)
    kept[4:] = False
    first = sweep.sweep(two[:1], 4, np.array([A])).total()
    assert found.total(kept) == pytest.approx(first)


def test_nodes_come_together_in_their_order(two):
    near, far = (sweep.sweep(two[:1], 2, np.array(at)) for at in ([100.0, 300.0], [200.0, 50.0]))
    both = near.with_nodes(far)
    assert both.a.tolist() == [50, 100, 200, 300]
    assert both.gram[1] == pytest.approx(near.gram[0])
    assert both.gram[2] == pytest.approx(far.gram[1])


def test_speeds_of_a_part_are_those_of_the_whole():
    log = log_of(1)
    log.time = np.cumsum(np.random.default_rng(1).uniform(0.5, 1.5, size=ROWS)) * 1e-3
    smooth = uniform_filter1d
    rate = np.zeros(ROWS)
    rate[1:-1] = (log.theta[2:] - log.theta[:-2]) / (log.time[2:] - log.time[:-2])
    for end, inner in ((0, 1), (-1, -2)):
        rate[end] = (log.theta[end] - log.theta[inner]) / (log.time[end] - log.time[inner])
    speed, change = speed_of(log)
    assert speed == pytest.approx(smooth(rate, 9, mode="nearest"))
    for rows in (slice(0, 40), slice(7, 19), slice(1480, 1500), slice(700, 701)):
        part = speed_of(log, rows)
        assert part[0] == pytest.approx(speed[rows]) and part[1] == pytest.approx(change[rows])
    for short in (log.head(26), replace(log, time=None)):
        assert not np.any(speed_of(short))
    assert np.any(speed_of(log.head(27)))


def test_rows_of_one_time_borrow_a_speed_and_no_infinity():
    log = log_of(1)
    log.time = np.repeat(np.arange(ROWS // 3), 3) * 3e-3
    speed, _ = speed_of(log)
    true = np.gradient(log.theta, 1e-3)
    assert np.isfinite(speed).all()
    assert np.corrcoef(speed[20:-20], true[20:-20])[0, 1] > 0.95


# --- the fit --------------------------------------------------------------------------------------

TERMS = ("offset", "spring")


@pytest.fixture(scope="module")
def swept(two):
    """The sweep of both logs that a search makes, fine around the best."""

    def make(nodes: np.ndarray):
        return sweep.sweep(two, 6, nodes)

    return fit.search(make, 20.0, 5000.0, TERMS)


def test_the_curve_is_least_squares_at_each_node(two, swept):
    curve = fit.curve_of(swept.a, swept.total(), TERMS)
    for i in (0, curve.best, len(swept.a) - 1):
        x, y = rows_of(two, swept.a[i], TERMS)
        best, sse = solved(x, y)
        assert curve.coefficient[i] == pytest.approx(best[:3], rel=1e-3, abs=1e-4)
        assert curve.sse[i] == pytest.approx(sse, rel=1e-4)
        off = best[0] + 0.1
        _, more = solved(x[:, 1:], y - off * x[:, 0])
        assert curve.stiff[i] == pytest.approx((more - sse) / 0.01, rel=1e-3)
        other = np.array([0.4, 0.2, -0.3])
        x1 = rows_of(two[:1], swept.a[i], TERMS)[0]
        assert x1.shape[1] == 4
        left = solved(x[:, 3:], y - x[:, :3] @ other)[1]
        costs = fit.cost_of(swept.total(), fit.columns_of(TERMS), np.tile(other, (len(swept.a), 1)))
        assert costs[i] == pytest.approx(left, rel=1e-4)
    assert curve.best == np.argmin(curve.sse)


def test_a_search_is_coarse_over_all_and_fine_around_the_best():
    asked = []

    def make(nodes: np.ndarray):
        asked.append(np.array(nodes))
        return sweep.sweep([log_of(1, rows=300, cycled=3)], 2, nodes)

    found = fit.search(make, 20.0, 5000.0, ("offset",))
    first, *finer = asked
    assert (first[0], first[-1]) == (pytest.approx(20), pytest.approx(5000))
    assert np.exp(np.diff(np.log(first))).max() <= 1.3 + 1e-9
    assert len(finer) == 2 and [len(one) for one in finer] == [8, 8]
    best = fit.curve_of(found.a, found.total(), ("offset",)).best
    place = int(np.searchsorted(first, found.a[best]))
    assert all(first[place - 2] < a < first[min(place + 1, len(first) - 1)] for a in finer[0])
    assert len(fit.search(make, 100.0, 150.0, ("offset",)).a) >= 8
    ratio = found.a[best + 1] / found.a[best - 1]
    assert 1 < ratio < 1.3 ** (2 / 20)
    steps = np.diff(np.log(np.concatenate((finer[0][:4], [finer[0][4]]))))
    assert steps[:3] == pytest.approx(steps[0])
    edge = fit.refine(sweep_at(make, (500.0, 900.0)), make, ("offset",))  # the best at an end
    assert len(edge.a) == 6 and edge.a.min() == 500


def sweep_at(make, nodes):
    return make(np.array(nodes))


def test_the_lowest_of_three_uneven_nodes():
    a = np.array([20.0, 90.0, 150.0, 400.0])
    for place in (80.0, 100.0, 140.0):
        cost = 3 + 0.7 * (np.log(a) - np.log(place)) ** 2
        assert fit._lowest(a, cost) == pytest.approx(place)
    assert fit._lowest(a, np.array([1.0, 2, 3, 4])) == 20
    assert fit._lowest(a, np.array([4.0, 3, 2, 1])) == 400
    assert fit._lowest(a, np.array([1.0, 1, 1, 1])) == 20


def test_the_point_and_the_spread(two, swept):
    def cost(a: float) -> float:
        return solved(*rows_of(two, a, TERMS))[1]

    found, a = fit.point(swept, TERMS), best_a(cost)
    coefficient, sse = solved(*rows_of(two, a, TERMS))
    assert found.a == pytest.approx(a, rel=1e-4)
    assert (found.Fc, *found.terms.values()) == pytest.approx(coefficient[:3], rel=1e-3)
    assert found.sigma0 == pytest.approx(a * coefficient[0], rel=1e-3)
    assert list(found.terms) == ["offset", "spring"]
    assert found.sse == pytest.approx(sse, rel=1e-3) and found.blocks == 12
    weight = np.concatenate((two[0].weight, np.ones(700)))
    assert found.rows == pytest.approx(weight.sum())
    torque = np.concatenate([log.torque for log in two])
    mean = np.average(torque, weights=weight)
    assert fit.spread_of(swept) == pytest.approx(weight @ (torque - mean) ** 2, rel=1e-6)


def profiled(log: Log, name: str, value: float, terms: Sequence[str]) -> float:
    """The least cost with a parameter held, by rows."""

    def cost(a: float) -> float:
        x, y = rows_of([log], a, terms)
        if name == "a":
            return solved(x, y)[1]
        Fc = value if name == "Fc" else value / a  # noqa: N806
        return solved(x[:, 1:], y - Fc * x[:, 0])[1]

    return cost(value) if name == "a" else cost(best_a(cost))


@pytest.fixture(scope="module")
def alone(library) -> tuple[Log, sweep.Sweep]:
    log = log_of(4, rows=600, cycled=4)
    return log, fit.search(lambda nodes: sweep.sweep([log], 12, nodes), 20.0, 5000.0, ["offset"])


def jackknifed(log: Log, blocks: int) -> dict[str, float]:
    """The variance of each parameter, from fits on the rows without one block each."""
    left, length = [], log.rows // blocks
    for k in range(blocks):
        kept = np.ones(log.rows, dtype=bool)
        kept[length * k : length * (k + 1)] = False

        def fitted(a: float, kept: np.ndarray = kept) -> tuple[np.ndarray, float]:
            x, y = rows_of([log], a, ["offset"])
            return solved(x[kept], y[kept])

        a = best_a(lambda a, fitted=fitted: fitted(a)[1], wide=0.1)
        Fc = fitted(a)[0][0]  # noqa: N806
        left.append((a, Fc, a * Fc))
    spread = (blocks - 1) * np.var(left, axis=0)
    return dict(zip(("a", "Fc", "sigma0"), spread, strict=True))


def test_intervals_are_profiles_as_wide_as_the_jackknife_says(alone):
    log, found = alone
    one = fit.estimate(found, ["offset"])
    freedom, true = 600 - 1 - 3, jackknifed(log, 12)
    for name in true:
        ends, value = one.ci95[name], getattr(one, name)

        def above(x: float, ratio: float, name: str = name) -> float:
            return profiled(log, name, x, ["offset"]) - ratio * one.sse

        def width(ratio: float, value: float = value) -> tuple[float, float]:
            return tuple(
                brentq(above, value, value * (1 + 0.2 * side), args=(ratio,), xtol=1e-5 * value)
                for side in (-1, 1)
            )

        low, high = width(1 + 1 / freedom)
        naive = ((high - low) / 2) ** 2
        assert one.inflation[name] == pytest.approx(max(true[name] / naive, 1), rel=0.03)
        quantile = student.ppf(0.975, 11) ** 2 / freedom
        wanted = width(1 + quantile * one.inflation[name])
        assert (ends.low, ends.high) == pytest.approx(wanted, rel=3e-4)


def test_what_all_blocks_share_widens_the_interval_of_the_slope(alone):
    log, found = alone
    both = {"sigma0": 0.05, "a": 0.05}
    one, hidden = (fit.estimate(found, ["offset"], hidden) for hidden in ({}, both))
    true, quantile = jackknifed(log, 12), student.ppf(0.975, 11)
    assert hidden.ci95["Fc"] == one.ci95["Fc"]
    for name in ("sigma0", "a"):
        value = getattr(one, name)
        wanted = quantile * np.sqrt(true[name] + (0.05 * value) ** 2) / value
        assert hidden.ci95[name].relative(value) == pytest.approx(wanted, rel=0.1)
        assert hidden.ci95[name].high > one.ci95[name].high


@pytest.mark.parametrize("part", [0.01, 1e-3])
def test_intervals_of_a_quiet_log(part):
    """However small the errors are, the interval is at least what the jackknife says."""
    log = log_of(4, part, rows=600, cycled=4)
    found = fit.search(lambda a: sweep.sweep([log], 12, a), 20.0, 5000.0, ["offset"])
    one, true, quantile = fit.estimate(found, ["offset"]), jackknifed(log, 12), 2.2
    for name, variance in true.items():
        width = one.ci95[name].relative(1.0)
        assert 0.95 < width / (quantile * np.sqrt(variance)) < 2.0, name


def test_the_profile_of_the_slope(alone):
    log, found = alone
    best = fit.point(found, ["offset"])
    values = best.sigma0 * np.array([0.9, 1.0, 1.15])
    drawn = fit.profile_of(fit.dense_of(best), values)
    wanted = [profiled(log, "sigma0", value, ["offset"]) / best.sse for value in values]
    assert drawn == pytest.approx(wanted, rel=1e-3)


def test_intervals_without_an_end():
    """A motion that never slips, and one that shows the sign alone."""

    def estimated(log: Log, low: float, high: float) -> fit.Estimate:
        made = fit.search(lambda nodes: sweep.sweep([log], 12, nodes), low, high, ["offset"])
        return fit.estimate(made, ["offset"])

    theta = sine(1, rows=600, cycles=4, amplitude=0.05 / A)
    stiff = Log("", theta, SIGMA0 * theta + 1e-2 * FC * noise_of(1, 600), np.arange(600) * 1e-3)
    found = estimated(stiff, 2.0, 2000.0)
    assert found.ci95["Fc"].high == np.inf and not found.ci95["Fc"].bounded
    assert found.ci95["a"].low == 0 and np.isfinite(found.ci95["a"].high)
    assert found.ci95["sigma0"].low == 0 and found.ci95["Fc"].low > 0
    theta = sine(1, rows=600, cycles=4)
    sign = Log("", theta, FC * np.sign(np.gradient(theta)) + 0.1 * FC * noise_of(1, 600))
    found = estimated(sign, 2.0, 1e6)
    assert found.ci95["sigma0"].high == found.ci95["a"].high == np.inf
    assert found.ci95["Fc"].bounded and found.ci95["a"].low > 100
    assert found.ci95["Fc"].low < FC < found.ci95["Fc"].high


def test_an_interval():
    one = Interval(8.0, 14.0)
    assert one.relative(10.0) == pytest.approx(0.3) and one.relative(0.0) == np.inf
    assert (one.around(7.0), one.around(15.0)) == (Interval(7.0, 14.0), Interval(8.0, 15.0))
    assert one.around(10.0) == one
    ends = [(8.0, 14.0), (0.0, 14.0), (8.0, np.inf), (0.0, np.inf)]
    assert [Interval(*pair).bounded for pair in ends] == [True, False, False, False]


def test_what_the_motion_leaves_of_a_column(two, swept):
    """By the part of its variance that the other columns and a constant cannot draw."""
    total = swept.total()[-1]
    x = np.concatenate([columns(log, swept.a[-1]) for log in two])
    assert x.shape == (1600, 7)
    for own, others in ((3, [2]), (4, [0, 2]), (5, [0, 2, 3, 4])):
        parts = []
        for log in two:
            root = 1.0 if log.weight is None else np.sqrt(log.weight)[:, None]
            all_ = columns(log, swept.a[-1]) * root
            start = all_[:, 1:2]
            parts.append(all_ - start @ np.linalg.lstsq(start, all_, rcond=None)[0])
        rest = np.concatenate(parts)
        left = solved(rest[:, others], rest[:, own])[1]
        variance = solved(rest[:, 2:3], rest[:, own])[1]
        wanted = pytest.approx(left / variance, rel=1e-3, abs=1e-5)
        assert fit._left_beside(total, own, others) == wanted


def designed(**sizes: float) -> sweep.Sweep:
    """A sweep of a motion with two frequencies, on which all terms are told apart."""
    theta = 0.04 * np.sin(2 * np.pi * 5 * np.arange(2400) / 2400)
    theta += 0.02 * np.sin(2 * np.pi * 31 * np.arange(2400) / 2400)
    log = Log("", theta, dahl_torque(theta) + 0.05 * FC * noise_of(3, 2400))
    log.time = np.arange(2400) * 1e-3
    terms = dict(
        zip(("offset", "spring", "viscous", "inertia"), columns(log, A).T[2:6], strict=True)
    )
    for name, size in sizes.items():
        log.torque = log.torque + size * FC * terms[name] / np.abs(terms[name]).max()
    return fit.search(lambda nodes: sweep.sweep([log], 10, nodes), 20.0, 5000.0, ["offset"])


ALL = ["offset", "spring", "viscous", "inertia"]


@pytest.mark.parametrize(
    ("sizes", "chosen"),
    [
        ({}, []),
        ({"offset": 0.3}, ["offset"]),
        ({"offset": -0.3}, ["offset"]),
        ({"viscous": 0.3}, ["viscous"]),
        ({"viscous": -0.3}, []),
        ({"inertia": 0.3}, ["inertia"]),
        ({"inertia": -0.3}, []),
        ({"spring": 0.3}, ["offset", "spring"]),
        ({"offset": 0.3, "inertia": 0.4, "viscous": 0.3}, ["offset", "viscous", "inertia"]),
    ],
)
def test_terms_that_pay(sizes, chosen):
    found = designed(**sizes)
    assert set(fit.choose_terms(found, ALL)) - {"offset"} == set(chosen) - {"offset"}
    if "offset" in chosen:
        assert "offset" in fit.choose_terms(found, ALL)
    assert fit.choose_terms(found, []) == []


def test_sets_of_terms():
    found = designed()
    sets = fit.sets_of(found, ALL)
    assert sets[0] == () and len(sets) == 9 and len(set(sets)) == 9
    assert all(one[0] == "offset" for one in sets[1:])
    assert fit.sets_of(found, ["offset"]) == [(), ("offset",)]
    assert fit.fits_in(found, [], "offset")


@pytest.mark.parametrize(
    ("owner", "fold"),
    [
        ([0] * 10, [0, 0, 1, 1, 2, 2, 3, 3, 4, 4]),
        ([0] * 3, [0, 1, 3]),
        ([0, 0, 2, 2], [0, 0, 1, 1]),
        ([0, 1, 2, 3, 4, 5, 6], [0, 0, 1, 2, 2, 3, 4]),
    ],
)
def test_folds(owner, fold):
    assert fit.folds_of(np.array(owner)).tolist() == fold


def test_r2_of_what_was_held_out():
    assert fit.HeldOut(2.0, 8.0).r2 == 0.75
    assert fit.HeldOut(2.0, 0.0).r2 == 0.0


# --- cycles and choices ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def cut(library) -> cycles.Cut:
    """Nine cycles with an offset of 0.1 and noise of 2 %, weights among them."""
    log = log_of(2, 0.02, rows=3000, cycled=9.3)
    log.weight = np.random.default_rng(5).uniform(0.2, 1, size=3000)
    return cycles.Cut([log], A, 0.003, 10)


def cut_rows(cut: cycles.Cut, a: float, terms: Sequence[str] = ("offset",)) -> np.ndarray:
    """w, its change with log a, the terms and the torque, weighed, of a log of its own bins."""
    log = log_of(2, 0.02, rows=3000, cycled=9.3)
    apart = 1e-3
    above, below = (dahl_torque(log.theta, a * np.exp(x), 1.0) for x in (apart, -apart))
    change = (above - below) / (2 * apart)
    names = ("offset", "spring", "viscous", "inertia")
    some = columns(log, a)[:, [0, *(2 + names.index(term) for term in terms), -1]]
    return np.insert(some, 1, change, axis=1) * cut.root[:, None]


def test_a_bin_is_a_weighed_mean():
    log = log_of(1, rows=10_000, cycled=9)
    log.weight = np.random.default_rng(5).uniform(size=10_000)
    log.weight[5000:5002] = 0
    found = cycles.Cut([log], A, 0.003, 10)
    pairs = log.weight.reshape(-1, 2)
    inner = np.flatnonzero(found.root)
    assert found.rows == 2 and len(found.torque) == 5000
    assert inner[0] > 5 and inner[-1] == 4994
    mean = pairs.mean(axis=1)
    assert found.root[inner[0] : 4995] ** 2 == pytest.approx(mean[inner[0] : 4995])
    some = np.setdiff1d(inner, [2500])
    torque = (pairs * log.torque.reshape(-1, 2)).sum(axis=1)[some] / pairs.sum(axis=1)[some]
    assert found.torque[some] == pytest.approx(torque)
    angle = (pairs * (log.theta - log.zero).reshape(-1, 2)).sum(axis=1)[some]
    assert found.terms[some, 1] == pytest.approx(angle / pairs.sum(axis=1)[some], abs=1e-9)
    weight = found.root**2
    average = np.average(found.torque, weights=weight)
    assert found.spread == pytest.approx(weight @ (found.torque - average) ** 2)
    some = cycles.Cut([replace(log, weight=None)], A, 0.003, 10)
    assert some.means([np.arange(10_001.0)]).tolist() == np.arange(0.5, 1e4, 2).tolist()


@pytest.mark.parametrize(("cycled", "logs"), [(24.5, 1), (30, 1), (47, 1), (60, 1), (13, 3)])
def test_no_more_cycles_are_told_apart_than_promised(cycled, logs):
    """At most 24 in all, of like length, and none of the log is lost between them."""
    made = [replace(log_of(k, rows=4000, cycled=cycled), name=f"{k}") for k in range(logs)]
    found = cycles.Cut(made, A, 0.003, 10)
    assert 12 <= len(found.spans) <= 24
    lengths = [span.stop - span.start for span in found.spans]
    assert max(lengths[:-1]) < 4 * 4000 / cycled + 4000 / 24
    assert all(one.stop <= two.start for one, two in pairwise(found.spans))


def test_fits_without_a_cycle():
    x = RNG.normal(size=(40, 3))
    x[:, 1] = 0.0
    y = RNG.normal(size=40)
    gram = np.column_stack((x, y)).T @ np.column_stack((x, y))
    best = cycles.least_squares(gram)
    wanted = np.linalg.lstsq(x[:, [0, 2]], y, rcond=None)[0]
    assert best == pytest.approx([wanted[0], 0, wanted[1]])
    assert cycles.cost_of(gram, best) == pytest.approx(np.sum((y - x @ best) ** 2))
    values = RNG.normal(size=9)
    without = np.array([np.delete(values, k).mean() for k in range(9)])
    assert cycles.jackknife(without) == pytest.approx(values.std(ddof=1) / 3)
    cost, best = RNG.uniform(size=(2, 9))
    more, error = cycles.excess(cost, best)
    assert more == pytest.approx(sum(cost) - sum(best))
    assert error == pytest.approx(np.std(cost - best, ddof=1) / 3 * 9)


def test_products_of_a_cycle(cut):
    grams = choices.grams_at(cut, A, 0.0)
    x = cut_rows(cut, A, ALL)
    assert len(grams) == len(cut.spans)
    for gram, span in zip(grams, cut.spans, strict=True):
        assert gram[KNOWN] == pytest.approx(x[span].T @ x[span], rel=2e-3, abs=2e-3)
    wanted = [0, 1, 2 + place_of("offset"), 2 + place_of("inertia"), -1]
    assert choices.columns_for(("offset", "inertia")) == wanted
    late = choices.grams_at(cut, A, 3.0)
    y = x / cut.root[:, None].clip(1e-9)
    y[3:, :-1] = y[:-3, :-1]
    y *= cut.root[:, None]
    for gram, span in zip(late[1:], cut.spans[1:], strict=True):
        assert gram[KNOWN] == pytest.approx(y[span].T @ y[span], rel=2e-3, abs=2e-3)


@pytest.mark.parametrize("guess", [0.55, 1.0, 1.9])
def test_a_choice_is_fitted_from_either_side(cut, guess):
    """The best a, what follows from it, and each cycle as the others predict it."""

    def cost(a: float) -> float:
        x = cut_rows(cut, a)
        return solved(x[:, [0, 2]], x[:, -1])[1]

    found, a = choices.fitted(cut, guess * A, Choice(("offset",))), best_a(cost)
    x = cut_rows(cut, a)
    Fc, offset = solved(x[:, [0, 2]], x[:, -1])[0]  # noqa: N806
    assert found.value == pytest.approx({"sigma0": a * Fc, "Fc": Fc}, rel=2e-4)
    assert found.a == pytest.approx(a, rel=3e-3) and abs(found.step) < 2e-3
    assert found.terms == pytest.approx({"offset": offset}, rel=2e-3)
    counted = np.concatenate([np.arange(span.start, span.stop) for span in cut.spans])
    x = cut_rows(cut, found.a)
    left, offsets = {"sigma0": [], "Fc": []}, []
    for k, span in enumerate(cut.spans):
        some = np.setdiff1d(counted, np.arange(span.start, span.stop))
        best = solved(x[some, :-1], x[some, -1])[0]
        assert found.cost[k] == pytest.approx(
            np.sum((x[span, -1] - x[span, :-1] @ best) ** 2), rel=1e-3
        )
        left["Fc"].append(best[0])
        left["sigma0"].append(found.a * (best[0] + best[1]))
        offsets.append(best[2])
    for name, values in left.items():
        assert found.without[name] == pytest.approx(values, rel=1e-3)
    count = len(cut.spans)
    error = np.sqrt((count - 1) / count * np.sum((offsets - np.mean(offsets)) ** 2))
    assert found.errors == pytest.approx({"offset": error}, rel=1e-2)


def test_a_step_of_a_fit_is_not_too_long(cut):
    """From far away six looks, at most .4 of log a apart."""
    for far in (20.0, 40.0):
        found = choices.fitted(cut, far * A, Choice(("offset",)))
        assert np.log(found.a / A / far) == pytest.approx(-5 * 0.4)
    near = choices.fitted(cut, 5 * A, Choice(("offset",)))
    assert near.a == pytest.approx(A, rel=0.01)


def test_the_end_of_a_column_is_drawn_out(cut):
    up = np.arange(3000.0)[:, None]
    assert cut.moved(up, 2.0)[:4, 0].tolist() == [0, 0, 0, 1]
    assert cut.moved(up, -2.0)[-4:, 0].tolist() == [2998, 2999, 2999, 2999]
    assert cut.moved(up, 1.5)[:3, 0].tolist() == [0, 0, 0.5]
    assert cut.moved(up, -1.5)[-3:, 0].tolist() == [2998.5, 2999, 2999]
    assert cut.moved(up, 0.0) is up


@pytest.mark.parametrize(("weight", "counts"), [(0.08, False), (0.11, True)])
def test_a_cycle_that_weighs_a_tenth_of_the_others_counts(weight, counts):
    log = log_of(1, rows=3000, cycled=9)
    spans = cycles.Cut([log], A, 0.003, 10).spans
    log.weight = np.ones(3000)
    log.weight[spans[3]] = weight
    assert len(cycles.Cut([log], A, 0.003, 10).spans) == len(spans) - (not counts)


def test_a_mass_is_never_negative_and_friction_never_drives(cut):
    grams = choices.grams_at(cut, A, 0.0)
    other = grams.copy()
    other[:, -1] *= -1
    other[:, :, -1] *= -1  # the torque with the other sign
    assert choices.read(cut, grams, A, Choice(("offset",))) is not None
    assert choices.read(cut, other, A, Choice(("offset",))) is None
    for sign, kept in ((1.0, True), (-1.0, False)):
        with_mass = grams.copy()
        part = sign * 1e-2 * grams[:, 5]
        with_mass[:, -1] += part
        with_mass[:, :, -1] += part
        with_mass[:, -1, -1] += sign * 1e-2 * grams[:, 5, -1] + 1e-4 * grams[:, 5, 5]
        found = choices.read(cut, with_mass, A, Choice(("offset", "inertia")))
        assert (found is not None) is kept
    assert found is None


def test_all_sets_of_terms_are_fitted_each_at_its_best(cut):
    sets = [(), ("offset",), ("offset", "spring"), ("offset", "viscous")]
    found = choices.of_terms(cut, 0.8 * A, sets)
    assert [one.choice.terms for one in found] == sets
    for one in found:
        alone = choices.fitted(cut, A, one.choice)
        assert one.value == pytest.approx(alone.value, rel=3e-3)
        assert one.cost.sum() == pytest.approx(alone.cost.sum(), rel=0.02)
    late = choices.of_terms(cut, A, [("offset",)], 2.0)
    assert late[0].choice == Choice(("offset",), 2.0)
    assert late[0].cost.sum() > found[1].cost.sum()


def a_trial(value: float, without: Sequence[float], **more) -> Trial:
    both = {"sigma0": value, "Fc": value / 200}
    left = {"sigma0": np.array(without), "Fc": np.array(without) / 200}
    choice = more.pop("choice", Choice())
    return Trial(choice, 200.0, both, left, np.ones(len(without)), **more)


@pytest.mark.parametrize("model", ["Dahl", "slip K=1"])
def test_how_far_a_plausible_choice_draws_an_interval(model):
    base = a_trial(100.0, [100.0, 101, 99, 100.5, 99.5])
    other = a_trial(
        108.0, [108.0, 110, 106, 108, 109], plausible=True, choice=Choice(("offset",), model=model)
    )
    far = a_trial(500.0, [500.0] * 5)  # not plausible
    value, ends = {"sigma0": 102.0, "Fc": 0.5}, {"sigma0": Interval(100.0, 105.0)}
    found = choices.over([base, other, far], base, value, ends)["sigma0"]
    ratio = np.log(np.array([108.0, 110, 106, 108, 109]) / [100.0, 101, 99, 100.5, 99.5])
    error = np.sqrt(4 / 5 * np.sum((ratio - ratio.mean()) ** 2)) * student.ppf(0.975, 4)
    shift = np.log(1.08)
    error += 0.5 * shift * (model != "Dahl")
    below = np.log(102) + shift - np.hypot(np.log(102 / 100), error)
    above = np.log(102) + shift + np.hypot(np.log(105 / 102), error)
    assert found.low == pytest.approx(min(100.0, np.exp(below)))
    assert found.high == pytest.approx(np.exp(above))
    kept = choices.over([base, other], base, {**value, "a": 204.0}, {"a": Interval(1.0, 2.0)})
    assert kept == {"a": Interval(1.0, 2.0)}


def test_the_standard_error_of_a_delay():
    """By parabolas through three delays, of which each cycle is left out."""
    places = RNG.uniform(2.2, 2.8, size=6)
    costs = {rows: 1 + (rows - places) ** 2 for rows in (0.0, 1.0, 2.5, 4.0, 8.0)}
    trials = [Trial(Choice((), rows), A, {}, {}, cost, step=0.0) for rows, cost in costs.items()]
    other = Trial(Choice(("offset",), 2.4), A, {}, {}, np.ones(6))
    best = [np.delete(places, k).mean() for k in range(6)]
    wanted = np.sqrt(5 / 6 * np.sum((best - np.mean(best)) ** 2))
    assert delay.standard_error([*trials, other], trials[2]) == pytest.approx(wanted)
    assert delay.standard_error(trials, trials[0]) == 0.0
    assert delay.standard_error(trials[1:3], trials[2]) == 0.0


def test_the_lowest_of_three_delays():
    def at(rows: float, lowest: float, bend: float = 1.0) -> Trial:
        return Trial(Choice((), rows), A, {}, {}, np.full(2, bend * (rows - lowest) ** 2))

    assert delay._vertex([at(k, 2.7) for k in (1.0, 3.0, 5.0)]) == pytest.approx([2.7])
    assert delay._vertex([at(k, 3.005) for k in (1.0, 3.0, 5.0)]) == []
    assert delay._vertex([at(k, 9.0) for k in (1.0, 3.0, 5.0)]) == []
    assert delay._vertex([at(k, -1.0) for k in (1.0, 3.0, 5.0)]) == []
    assert delay._vertex([at(k, 1.2) for k in (1.0, 3.0, 5.0)]) == pytest.approx([1.2])
    assert delay._vertex([at(k, 2.0, -1.0) for k in (1.0, 3.0, 5.0)]) == []
    assert delay._vertex([at(k, 2.0) for k in (1.0, 3.0)]) == []


def test_the_profile_of_an_exact_fit_has_a_shape():
    """A log without any noise may leave a cost of 0 at the best a: no division by it."""
    a = np.geomspace(50, 200, 5)
    cost = np.array([4.0, 1.0, 0.0, 1.0, 4.0])
    curve = SimpleNamespace(a=a, sse=cost, stiff=np.ones(5), coefficient=np.ones((5, 1)))
    with np.errstate(all="raise"):
        profile = fit.profile_of(curve, a)
    assert np.isfinite(profile).all() and profile.argmin() == 2 and (np.diff(profile)[2:] > 0).all()
