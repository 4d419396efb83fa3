# SPDX-License-Identifier: MIT
"""Fits and scores against dense least squares, scipy.optimize and refits without a cycle."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from dahl.identify import select
from dahl.identify.fit import Fitter, Hypothesis
from dahl.identify.lags import NONE
from dahl.identify.laws import DAHL, SLIP
from dahl.identify.least_squares import solve_within
from dahl.identify.samples import samples_of
from dahl.identify.start import coarse_start, pair_starts, slip_start
from identify_tools import FC, SIGMA0, behind_play, chirp, dahl_torque, described, log_of, springs
from scipy.optimize import least_squares, minimize
from scipy.signal import filtfilt, lfilter

A, STEP = SIGMA0 / FC, 1e-3
PATH = chirp(1500, first=5, last=11)
SPEED = np.gradient(PATH, STEP)


def fitter_of(*torques: np.ndarray, noise: float = 0.02) -> Fitter:
    """Return a fitter of one log for each torque along PATH."""
    logs = [replace(log_of(PATH, x, noise), name=str(k)) for k, x in enumerate(torques)]
    samples = samples_of(logs)
    samples = samples.prepared(A, np.zeros(samples.rows))
    return Fitter(samples)


FRICTION = dahl_torque(PATH)
LAGS = {  # a torque with a lag, and the last parameter that describes it
    "none": (FRICTION, np.log(A)),
    "damping": (FRICTION + 2e-3 * np.gradient(FRICTION, STEP), np.log(A)),
    "delay": (np.interp(np.arange(1500) - 2.5, np.arange(1500), FRICTION), 2.5),
    "low pass": (lfilter([0.2], [1, -0.8], FRICTION), -1 / np.log(0.8)),
    "zero-phase filter": (filtfilt([0.3], [1, -0.7], FRICTION), -1 / np.log(0.7)),
    "play": (dahl_torque(behind_play(PATH, 0.004)), np.log(0.004)),
    "delay+filter": (np.roll(lfilter(np.ones(9) / 9, [1], FRICTION), 3), 7),
    "damped low pass": (
        lfilter([0.2], [1, -0.8], FRICTION + 2e-3 * np.gradient(FRICTION, STEP)),
        -1 / np.log(0.8),
    ),
}


@cache
def plain(lag: str = "none") -> Fitter:
    return fitter_of(LAGS[lag][0] + 0.1 + 4 * PATH + 0.02 * SPEED)


def dense(fitter: Fitter, table: np.ndarray, rows: np.ndarray | slice) -> np.ndarray:
    """Coefficients by weighted least squares on some rows."""
    root, torque = np.sqrt(fitter.samples.used[rows]), fitter.samples.torque[rows]
    return np.linalg.lstsq(table[rows] * root[:, None], torque * root, rcond=None)[0]


LATE = ("spring", "viscous", "inertia")  # seen by the same late sensor


def late(h: Hypothesis, p: np.ndarray, x: np.ndarray) -> np.ndarray:
    """A torque as a late or slow sensor shows it."""
    kept = np.exp(-1 / p[-1]) if "pass" in h.lag.name or "phase" in h.lag.name else 0.0
    if h.lag.name == "zero-phase filter":
        return filtfilt([1 - kept], [1, -kept], x)
    if "delay" in h.lag.name:
        return np.interp(np.arange(len(x)) - p[-1], np.arange(len(x)), x)
    return lfilter([1 - kept], [1, -kept], x)


def model(fitter: Fitter, h: Hypothesis, p: np.ndarray) -> np.ndarray:
    """Elements and terms of a hypothesis, without derivatives."""
    samples, columns = fitter.samples, fitter.elements(h, p)
    if h.lag.name in ("damping", "damped low pass", "delay+filter"):
        rate = np.gradient(columns[0], STEP)
        slow = np.exp(-((samples.speed / (0.25 * fitter.fast)) ** 2))
        columns.append(rate * slow if h.lag.name == "delay+filter" else rate)
    if h.lag.name == "damped low pass":
        columns.append(np.gradient(samples.acceleration, STEP))
    if h.lag.name == "delay+filter":
        columns.append(np.gradient(np.gradient(columns[0])))
    angle = samples.angles["between counts"]
    centre = (angle.max() + angle.min()) / 2
    z = (angle - centre) / (angle.max() - centre)
    own = {"offset": 1 + 0 * z, "spring": z, "cubic": z**3}
    own |= {"viscous": samples.speed, "inertia": samples.acceleration}
    own |= {name: late(h, p, own[name] - own[name].mean()) for name in own if name in LATE}
    return np.column_stack([*columns, *(own[name] for name in h.terms)])


TERMS = ("offset", "spring", "viscous")
HYPOTHESES = [
    *(described("dahl", lag, terms=TERMS) for lag in LAGS),
    described("slip", angle="as read", terms=(*TERMS, "inertia")),
    described("bouc-wen", terms=TERMS),
    described("stribeck", terms=TERMS),
    described("asymmetric", terms=TERMS),
    described("mixed", terms=TERMS),
]


def residual(fitter: Fitter, h: Hypothesis, p: np.ndarray) -> np.ndarray:
    table = model(fitter, h, p)
    off = fitter.samples.torque - table @ dense(fitter, table, slice(None))
    return off * np.sqrt(fitter.samples.used)


@pytest.mark.parametrize("h", HYPOTHESES, ids=str)
def test_a_fit_is_the_optimum_of_least_squares(h):
    fitter = plain(h.lag.name)
    start = fitter.start(h, 1.15 * A, np.log(0.003) if h.lag.name == "play" else 3.0)
    p = fitter.optimum(h, start, 30).p
    by_scipy = least_squares(lambda p: residual(fitter, h, p), p, method="lm", diff_step=1e-3)
    assert np.sum(residual(fitter, h, p) ** 2) <= 2 * by_scipy.cost * (1 + 3e-3)
    fit = fitter.fit(h, start)
    if fit is None:  # no friction
        assert h.law.name not in ("dahl", "slip", "bouc-wen")
        return
    table = model(fitter, h, fit.p)
    near = table @ dense(fitter, table, slice(None))
    assert fitter.predicted(fit) == pytest.approx(near, abs=0.02 * FC)
    assert h.size == len(fit.coefficients) - 3
    if h.law.name == "dahl":
        assert fit.value == pytest.approx([SIGMA0, FC], rel=0.04)
        assert fit.p[-1] == pytest.approx(LAGS[h.lag.name][1], rel=0.05)


def test_a_score_is_that_of_fits_without_each_cycle():
    """Of the linearised model exactly, and of refits nearly."""
    fitter, h = plain("delay"), HYPOTHESES[2]
    fit, samples = fitter.fit(h, fitter.start(h, A, 2.0)), fitter.samples
    table, _ = fitter.columns(h, fit.p, fit.taken_at, h.terms)
    assert len(samples.folds) == len(fit.cost) == len(fit.without) > 6
    for k, fold in enumerate(samples.folds):
        others = np.ones(samples.rows, dtype=bool)
        others[fold] = False
        within = np.zeros(samples.rows, dtype=bool)
        for one in samples.folds:
            within[one] = True
        c = dense(fitter, table, others & within)
        off = samples.torque[fold] - table[fold] @ c
        assert fit.cost[k] == pytest.approx(samples.used[fold] @ off**2, rel=1e-5)
        less = replace(samples, used=np.where(others, samples.used, 0.0))
        again = Fitter(less).fit(h, fit.p)
        assert fit.without[k] == pytest.approx(again.value, rel=2e-3)
        assert fit.without[k] != pytest.approx(fit.value, rel=1e-6)
    deviations = fit.without - fit.without.mean(axis=0)
    n = len(fit.cost)
    assert fit.error == pytest.approx(np.sqrt((n - 1) / n * (deviations**2).sum(axis=0)))
    assert fit.total == pytest.approx(fit.cost.sum()) and fit.value == pytest.approx(
        [SIGMA0, FC], rel=0.02
    )


def test_each_set_of_terms_is_scored_as_a_fit_of_its_own():
    fitter, h = plain(), Hypothesis()
    pool = ("offset", "spring", "viscous", "inertia")
    fits = fitter.fit_term_sets(h, fitter.start(h, A), pool)
    found = {fit.hypothesis.terms: fit for fit in fits}
    shapes = [("offset",), ("offset", "spring"), ("offset", "spring", "cubic"), ("offset", "waves")]
    timed = [(), ("viscous",), ("inertia",), ("viscous", "inertia")]
    assert set(found) <= {(*one, *more) for one in shapes for more in timed} and len(found) > 6
    for terms, fit in found.items():
        columns = [fitter.columns(h, fit.p, fit.taken_at, ())[0], *fitter.term_columns(terms)]
        c = dense(fitter, np.column_stack(columns), slice(None))
        assert fit.coefficients == pytest.approx(c, rel=1e-2, abs=1e-4)
    best = min(fits, key=lambda fit: fit.total).hypothesis.terms
    assert {"spring", "viscous"} <= set(best)
    alone = fitter.fit_term_sets(h, fitter.start(h, A), pool, waves=False)
    assert {"cubic", "waves"} & {term for fit in alone for term in fit.hypothesis.terms} == set()


NO_FRICTION = {  # a torque, and a hypothesis whose best fit is none of friction
    "of the other sign": (-dahl_torque(PATH), Hypothesis()),
    "pushed when fast": (dahl_torque(PATH) - 0.1 * SPEED, described(terms=("offset", "viscous"))),
    "cancelled by a spring": (10 * PATH, described(terms=("offset", "spring"))),
    "less when slow": (
        dahl_torque(PATH, SIGMA0, FC * (1 - 0.3 * np.exp(-((SPEED / 0.4) ** 2)))),
        described("stribeck"),
    ),
    "stiffer than a count": (
        dahl_torque(PATH) + dahl_torque(PATH, 400 * SIGMA0, 0.5 * FC),
        described("2 dahl"),
    ),
}


@pytest.mark.parametrize("name", NO_FRICTION)
def test_a_fit_that_is_no_friction_is_not_returned(name):
    torque, h = NO_FRICTION[name]
    fitter = fitter_of(torque)
    start = fitter.start(h, A)
    start[1:] += {"stribeck": (-0.4, 0), "2 dahl": 5}.get(h.law.name, 0)
    assert fitter.optimum(h, start) is not None
    assert fitter.fit(h, start) is None


def filtered(x: np.ndarray) -> np.ndarray:
    return lfilter([1 - np.exp(-1 / 2.5)], [1, -np.exp(-1 / 2.5)], x)


def delayed(rows: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda x: np.interp(np.arange(1500) - rows, np.arange(1500), x)


@pytest.mark.parametrize(
    ("h", "p", "of_first", "of_second"),
    [
        (described(lag="delay"), [2.5], delayed(2.5), delayed(2.5)),
        (described(lag="delays"), [2.5, -1.0], delayed(2.5), delayed(-1)),
        (described(lag="low pass"), [2.5], filtered, filtered),
        (described(skew=0.5), [], delayed(0.5), delayed(0.5)),
    ],
)
def test_each_log_has_the_lag_from_its_start_on(h, p, of_first, of_second):
    fitter = fitter_of(FRICTION, np.concatenate((np.zeros(5), FRICTION[:-5])))
    (w,) = fitter.elements(Hypothesis(), np.log([A]))
    (found,) = fitter.elements(h, np.array([np.log(A), *p]))
    lagged = np.concatenate((of_first(w[:1500]), of_second(w[1500:])))
    assert found == pytest.approx(lagged, abs=1e-9)
    if h.lag.name == "delays":
        fit = fitter.fit(h, fitter.start(h, A, 1.0))
        assert fit.p[-2:] == pytest.approx([0, 5], abs=0.3)
        assert fit.value == pytest.approx([SIGMA0, FC], rel=0.02)


# --- start values ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("a", "late", "side"), [(0.3, 0, 1), (1, 0, -1), (3, 0, 1), (1, 24, 1), (0.5, -9, -1)]
)
def test_a_coarse_start_is_near(a, late, side):
    torque = side * np.roll(dahl_torque(PATH, a * SIGMA0), late)
    found = coarse_start(fitter_of(torque + 4 * PATH))
    assert found.sign == side and found.delay == pytest.approx(late, abs=3)
    assert found.a == pytest.approx(a * A, rel=0.2 if abs(late) < 20 else 0.5)  # of a grid of 1.45


def test_starts_of_several_elements_are_near():
    parts = ((0.2 * SIGMA0, 0.5 * FC), (0.8 * SIGMA0, 0.2 * FC))
    fitter = fitter_of(springs(PATH, *parts))
    pairs = pair_starts(fitter, Hypothesis(), A)
    pairs = {law.name: p for law, p in pairs.items()}
    assert set(pairs) == {"2 dahl", "mixed", "2 slip"}
    assert np.sort(np.exp(pairs["2 slip"])) == pytest.approx([0.4 * A, 4 * A], rel=0.35)
    assert slip_start(fitter, Hypothesis(), A) is None
    three = fitter_of(springs(PATH, (10, 0.25), (40, 0.15), (50, 0.025)))
    h, p = slip_start(three, Hypothesis(), A)
    fit = three.fit(h, p)
    assert h.law.name == "3 slip" and fit.value == pytest.approx([100, 0.425], rel=0.05)


# --- the hypotheses that are fitted ---------------------------------------------------------------


def tried(space: select.SearchSpace, theta: np.ndarray = PATH, **more: object) -> dict[str, set]:
    """Return the laws, lags, angles and terms of all fits, and the pairs of lag and angle."""
    log = replace(log_of(theta, dahl_torque(theta)), **more)
    samples = samples_of([log])
    samples = samples.prepared(A, np.zeros(samples.rows))
    found = [fit.hypothesis for fit in select.fit_all(Fitter(samples), A, 0.0, space)]
    own = {name: {getattr(h, name).name for h in found} for name in ("law", "lag")}
    own |= {"angle": {h.angle for h in found}}
    own["terms"] = {term for h in found for term in h.terms}
    return own | {"pairs": {(h.lag.name, h.angle) for h in found}}


CURVES = {"exponent", "bouc-wen", "soft shaft"}


def test_all_laws_lags_angles_and_terms_are_tried():
    found = tried(select.SearchSpace())
    assert found["law"] >= {"dahl", "slip", "log speed", "asymmetric", "mixed"} | CURVES
    assert "breakaway" not in found["law"] and "loaded" not in found["law"]
    assert found["lag"] == set(LAGS)
    assert found["angle"] == {"between counts", "sharp turns", "as read"}
    assert found["terms"] == {"offset", "spring", "viscous", "inertia", "cubic", "waves"}
    filtered = {angle for lag, angle in found["pairs"] if "filter" in lag or lag == "low pass"}
    assert "as read" not in filtered
    rests = 0.05 * np.clip(1.3 * np.sin(np.arange(1500) / 30), -1, 1)
    load = 1 + 0.1 * np.sin(np.arange(1500) / 99)
    assert {"breakaway", "loaded"} <= tried(select.SearchSpace(), rests, load=load)["law"]


def test_fewer_hypotheses_if_cycles_times_or_a_user_allow_no_more():
    few = tried(select.few_cycles(select.SearchSpace()), PATH[:500])
    assert few["lag"] == {"none", "damping"} and "spring" in few["terms"]
    assert "dahl" in few["law"] and not few["law"] & (CURVES | {"stribeck", "asymmetric"})
    assert not few["terms"] & {"cubic", "waves"}
    untimed = tried(select.SearchSpace(lags=(NONE,), laws=(DAHL, SLIP)), time=None)
    assert untimed["lag"] == {"none"} and untimed["law"] == {"dahl", "slip"}
    assert untimed["terms"] == {"offset", "spring", "cubic", "waves"}
    asked = select.SearchSpace(("spring",), (NONE,), (DAHL,), wanted=SLIP)
    assert tried(asked)["terms"] == {"spring"} and tried(asked)["law"] == {"dahl", "slip"}


@pytest.mark.parametrize("seed", range(5))
def test_a_step_within_limits_is_the_best_one(seed):
    """No point of the box is better; a step that is clipped parameter by parameter is not best."""
    draw = np.random.default_rng(seed)
    table = draw.normal(size=(40, 3)) @ draw.normal(size=(3, 3))
    torque = table @ (3.0, -2.0, 1.0) + draw.normal(size=40)
    both = np.column_stack((table, torque))
    low, high = np.array([-np.inf, -0.5, -0.1]), np.array([np.inf, 0.5, 0.3])
    ends = np.stack((low, high))
    step = solve_within(both.T @ both, ends)
    best = minimize(lambda c: np.sum((torque - table @ c) ** 2), np.zeros(3), bounds=ends.T)
    assert ((low <= step) & (step <= high)).all()
    assert np.sum((torque - table @ step) ** 2) <= best.fun * (1 + 1e-6)
