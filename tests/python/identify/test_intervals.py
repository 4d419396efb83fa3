# SPDX-License-Identifier: MIT
"""Plausible hypotheses, lack of fit and simulated logs, which widen an interval, against dense
least squares, made-up fits and effects of known size.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from dahl.identify import Log, diagnose, estimate, select, simulate
from dahl.identify.diagnose import Lack, lack_of_fit
from dahl.identify.fit import Fit, Fitter, Hypothesis, parameters_of
from dahl.identify.lags import NONE, PLAY
from dahl.identify.refusals import next_step
from dahl.identify.result import Intervals, _against_sigma0
from dahl.identify.samples import samples_of
from identify_tools import (
    COUNT,
    FC,
    SIGMA0,
    chirp,
    dahl_torque,
    described,
    log_of,
    noise_of,
    turns_of,
)

A = SIGMA0 / FC
PATH = chirp(2400, first=5, last=11)
SPEED = np.gradient(PATH) / np.abs(np.gradient(PATH)).max()
RAMP = np.linspace(-0.5, 0.5, 2400)
QUANTILE = 2.0


def fitted(*logs: Log, lag: str = "none", terms: tuple[str, ...] = ("offset",)):
    samples = samples_of(logs)
    samples = samples.prepared(A, np.zeros(samples.rows))
    fitter, h = Fitter(samples), described(lag=lag, terms=terms)
    return fitter, fitter.fit(h, fitter.start(h, A, 1.0))


# --- lack of fit ----------------------------------------------------------------------------------


def plus(shape: np.ndarray) -> list[Log]:
    """Return a log with a shape, in parts of Fc, that is added to the friction."""
    return [log_of(PATH, dahl_torque(PATH) + FC * shape, 0.01)]


def parts(sigma0: np.ndarray | float = 1.0, Fc: np.ndarray | float = 1.0) -> list[Log]:  # noqa: N803
    """Return a log of parameters that vary, in parts of the usual ones."""
    return [log_of(PATH, dahl_torque(PATH, SIGMA0 * sigma0, FC * Fc), 0.01)]


def thirds(change: Callable[[Log], Log]) -> list[Log]:
    """Return three logs, of which the second one is changed."""
    (log,) = plus(0 * PATH)
    logs = [replace(log.part(slice(k, k + 800)), name=str(k)) for k in (0, 800, 1600)]
    return [logs[0], change(logs[1]), logs[2]]


def late(log: Log) -> Log:
    return replace(log, torque=np.interp(np.arange(800) - 3, np.arange(800), log.torque))


WAVE = np.sin(2 * np.pi * PATH / (32 * COUNT))
SINCE = np.concatenate([SIGMA0 / FC * np.abs(x - x[0]) for x in np.split(PATH, turns_of(PATH) + 1)])
PEAK = 0.4 * np.sign(SPEED) * np.exp(-SINCE / 5) * (1 - np.exp(-SINCE))
SLOW = np.exp(-((SPEED / 0.3) ** 2))
EFFECTS: dict[str, tuple[list[Log], tuple[bool, bool]]] = {
    # logs with an effect, and whether sigma0 and Fc are then not claimed
    "shape since the turn": (plus(PEAK), (True, True)),
    "low pass or delay": ([log_of(PATH[8:], dahl_torque(PATH)[:-8], 0.01)], (True, True)),
    "speed": (parts(Fc=1 + 0.3 * SLOW), (True, True)),
    "viscous": (plus(0.1 * SPEED), (True, True)),
    "offset drift": (plus(0.2 * RAMP), (False, False)),
    "drift": (parts(Fc=1 + 0.3 * RAMP), (False, False)),
    "step": (parts(Fc=1 + 0.2 * np.sign(RAMP)), (False, False)),
    "direction": (parts(Fc=1 + 0.3 * np.sign(SPEED)), (True, True)),
    "cubic spring": (plus(0.2 * (PATH / 0.05) ** 3), (False, False)),
    "angle ripple": (plus(0.06 * np.sin(80 * np.pi * PATH)), (True, True)),
    "Fc by angle": (parts(Fc=1 + 0.3 * np.abs(PATH / 0.05)), (False, False)),
    "encoder error each 32": ([log_of(PATH + 2 * COUNT * WAVE, dahl_torque(PATH))], (True, True)),
    "each log": (thirds(lambda log: replace(log, torque=1.2 * log.torque)), (False, False)),
    "delay of each log": (thirds(late), (True, True)),
    "offset of each log": (
        thirds(lambda log: replace(log, torque=log.torque + 0.1 * FC)),
        (False, False),
    ),
}


@cache
def lacks(effect: str) -> tuple[Fitter, Fit, list[Lack]]:
    fitter, fit = fitted(*EFFECTS[effect][0])
    return fitter, fit, lack_of_fit(fitter, fit, QUANTILE)


VARIES = {"drift": (-0.13, 0.13), "step": (-0.2, 0.2), "each log": (0.0, 0.2)}  # parts of Fc


@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_has_a_row_that_explains_it(effect):
    """No other row explains much more. The interval holds both ends of what varies."""
    _, fit, found = lacks(effect)
    own = next(one for one in found if one.name.startswith(effect))
    assert own.gain > 0.4 * max(one.gain for one in found), [(x.name, x.gain) for x in found]
    assert own.withdraws == EFFECTS[effect][1], own
    further = fit.value * (1 + own.moved) + 0.5 * (fit.value * own.moved)
    assert (own.low <= further).all() and (further <= own.high).all()
    if effect in VARIES:
        low, high = FC * (1 + np.array(VARIES[effect]))
        assert own.low[1] <= 1.01 * low and 0.99 * high <= own.high[1]
        assert own.high[1] - own.low[1] < 1.6 * (high - low)


def test_nothing_is_found_in_a_log_without_an_effect():
    fitter, fit = fitted(*plus(0 * PATH))
    assert [one.name for one in lack_of_fit(fitter, fit, QUANTILE) if one.gain > 0.03] == []


def test_errors_of_rate_and_size_may_cancel_in_sigma0():
    e = 0.01 * np.resize([-1.0, 1.0], 8)
    limit, left_out = np.array([FC]), np.column_stack((np.full(8, FC), 0 * e, e, -e))
    whole = np.array([FC, 0.0, 0.0, 0.0])
    h, p = Hypothesis(), np.log([SIGMA0 / FC])
    fit = Fit(h, p, limit, limit, whole, left_out, np.ones(8))
    low, high = diagnose._at_ends(np.array([[[1.0, 0.0]], [[0.0, 1.0]]]), fit, 1.0)
    assert (high - low) / 2 == pytest.approx([0, FC * 0.01 * np.sqrt(7)], abs=1e-12)


def test_a_gain_is_that_of_the_cycles_left_out():
    fitter, fit, found = lacks("offset drift")
    own = next(one for one in found if one.name == "offset drift")
    s, h = fitter.samples, fit.hypothesis
    base, limits = fitter.columns(h, fit.p, fit.limits, h.terms)
    t = np.linspace(-0.5, 0.5, s.rows)
    wide = np.column_stack((base, t, t**2))
    inside = np.zeros(s.rows, dtype=bool)
    for fold in s.folds:
        inside[fold] = True
    costs, each = [], []
    for table in (base, wide):
        weighted, torque = table * np.sqrt(s.used)[:, None], s.torque * np.sqrt(s.used)
        costs.append(0.0)
        for fold in s.folds:
            others = inside.copy()
            others[fold] = False
            c = np.linalg.lstsq(weighted[others], torque[others], rcond=None)[0]
            costs[-1] += np.sum((torque[fold] - weighted[fold] @ c) ** 2)
            each.append(parameters_of(fit.p, limits, c))
    assert own.gain == pytest.approx(costs[0] / costs[1] - 1, rel=1e-3)
    spread = np.std(each[len(s.folds) :], axis=0) * np.sqrt(len(s.folds) - 1)
    moved = np.abs(own.moved) * fit.value
    assert own.high - own.low == pytest.approx(2 * QUANTILE * spread + moved, rel=0.01)


def test_a_periodic_error_of_the_encoder_is_taken_out_of_all_angles():
    fitter, _, found = lacks("encoder error each 32")
    own = next(one for one in found if one.name.startswith("encoder error each 32"))
    better = diagnose.correct_encoder(fitter.samples, own)
    for name, seen in fitter.samples.angles.items():
        before, after = (np.std((x - PATH)[100:-100]) for x in (seen, better.angles[name]))
        assert after < 0.5 * before, name


# --- plausible hypotheses -------------------------------------------------------------------------


def fit_of(cost: np.ndarray | float, sigma0: float = SIGMA0, Fc: float = FC, **more) -> Fit:  # noqa: N803
    """Return a fit of one element with this cost of each of 8 cycles."""
    error = more.pop("error", 1e-3)
    c, p = np.array([Fc, 0.0, 0.0]), np.log([sigma0 / Fc])
    left_out = c * (1 + error * np.resize((1, -1), 8)[:, None])
    return Fit(described(**more), p, c[:1], c[:1], c, left_out, cost * np.ones(8))


EVEN, FEW = np.resize((1, -1), 8), np.arange(8) == 0
NEAR = [  # cost by cycle above 1, hidden cost, whether it is near 1
    (0.0, 0.0, True),
    (0.01, 0.0, False),
    (0.01, 0.1, True),
    (0.01 + 0.025 * EVEN, 0.0, True),
    (0.01 + 0.015 * EVEN, 0.0, False),
    (-0.1, 0.0, True),
    (0.01 + 0.1 * FEW, 0.0, False),  # one cycle hides that the others are worse
    (0.01 + 0.1 * FEW, 0.2, True),
]


@pytest.mark.parametrize(("more", "hidden", "is_near"), NEAR)
def test_near_is_what_the_scatter_of_cycles_hides(more, hidden, is_near):
    assert select.is_near(1 + more + np.zeros(8), np.ones(8), hidden) is is_near


class Stub:
    """A fitter that cannot fit again."""

    samples = SimpleNamespace(used=np.full(8, 1e-3), block=1)

    def fit(self, *_: object) -> None:
        return None


def test_the_simplest_plausible_fit_is_chosen():
    best = fit_of(1.0, 110, law="stribeck", error=1e-4)
    fits = [
        fit_of(1.01 + 0.03 * EVEN, law="dahl", lag="delay"),
        fit_of(1.02 + 0.05 * EVEN, 105, law="slip"),
        best,
        fit_of(1.3, 120),
        fit_of(1.01 + 0.05 * EVEN, 130, law="asymmetric", error=0.5),
    ]
    seen = select.plausible(Stub(), fits, 0.0)
    assert seen.best is best and seen.chosen is fits[1]
    assert {round(fit.value[0]) for fit in seen.fits} == {105, 110, SIGMA0}
    rounded = select.plausible(Stub(), fits, 1e-9)
    assert {fit.hypothesis.law.name for fit in rounded.fits} == {"dahl", "slip"}
    dear = [fit_of(1.0, law="stribeck"), fit_of(1.001)]  # each parameter costs .2 %
    assert select.best_of(dear) is dear[1]


def test_intervals_hold_all_plausible_fits_and_their_errors():
    fits = [fit_of(1.0, 90, error=0.01), fit_of(1.0, 100, 0.6, law="slip", error=0.02)]
    seen = select.Plausible(fits[0], fits[0], fits, fits)
    low, high = estimate._over_hypotheses(seen, QUANTILE)
    errors = [fit.error for fit in fits]
    assert errors[0] == pytest.approx(0.01 * np.sqrt(7) * fits[0].value)
    assert low == pytest.approx(fits[0].value - QUANTILE * errors[0])
    assert high == pytest.approx(fits[1].value + QUANTILE * errors[1])


SPECIAL = [  # cost above that of a Stribeck law, law and lag of another fit; the part of the error
    (0.0, {}, 0.15),
    (0.01 * EVEN, {}, 0.15),  # as good within the scatter
    (0.01, {}, 1.0),  # the cycles ask for more
    (0.0, {"law": "slip"}, 1.0),  # no special case
    (0.0, {"law": "breakaway"}, 1.0),
    (0.0, {"lag": "delay"}, 1.0),
    (0.0, {"terms": ("offset", "spring")}, 1.0),
    (0.0, {"angle": "as read"}, 1.0),
    (0.0, {"error": 0.02}, 0.3),
]


@pytest.mark.parametrize(("more", "other", "part"), SPECIAL)
def test_errors_are_limited_by_those_of_a_special_case(more, other, part):
    rich = fit_of(1.0, law="stribeck", error=0.1)
    special = fit_of(1.0 + more, **({"error": 0.01} | other))
    assert select.reach(rich, [special, rich]) == pytest.approx(part * rich.error, rel=1e-6)
    assert select.reach(special, [special, rich]) == pytest.approx(special.error)
    is_special = part < 1 or more == 0.01
    assert rich.hypothesis.contains(special.hypothesis) is is_special
    is_dominated = is_special and special.total <= rich.total * (1 + 1e-12)
    assert select._is_dominated(rich, [special, rich]) is is_dominated


@pytest.mark.parametrize(
    ("law", "lacking", "far"),
    [("bouc-wen", 0, 0.5), ("bouc-wen", 1, 0.5), ("2 slip", 0, 0.5), ("2 slip", 1, 1.4)],
)
def test_a_curve_that_is_not_of_one_element_may_be_of_many(law, lacking, far):
    plain, best = fit_of(2.0, 80, 0.5), fit_of(1.0, 100, 0.6, law=law)
    ends = best.value * 0.999, best.value * 1.001
    seen = select.Plausible(best, best, [best], [best])
    wide = estimate._beyond_one_element(seen, [plain, fit_of(3.0, 9), best], [0] * lacking, *ends)
    assert wide[0] == pytest.approx([100 - 20 * far, 0.6 - 0.1 * far])
    assert wide[1] == pytest.approx([100 + 20 * far, 0.6 + 0.1 * far])
    seen.fits.append(plain)
    same = estimate._beyond_one_element(seen, [plain, best], [0] * lacking, *ends)
    assert np.array_equal(same, ends)


def test_torque_and_angle_may_be_read_half_a_row_apart():
    fitter, fit = fitted(*plus(0 * PATH))
    far = [fit_of(1e9, law="slip"), fit_of(1e9, lag="delay")]
    found = select._with_skew(fitter, [*far, fit], select.penalised_cost(fit), 1.0)
    assert [one.hypothesis for one in found] == [
        replace(fit.hypothesis, skew=x) for x in (-0.5, 0.5)
    ]
    early, late = (one.value[0] for one in found)
    assert early < fit.value[0] < late or late < fit.value[0] < early
    assert select._with_skew(fitter, [fit], 0.5 * fit.cost, 0.0) == []


@pytest.mark.parametrize(
    ("none", "play", "low", "high"),
    [
        (1.3, 1.3, 85, 120),  # 90 and 100, and beyond both by half of their distance
        (1.3, 1.4, 90, 120),  # a play that fits worse does not count
        (1.4, 1.3, 100, 120),
        (1.4, 1.4, 120, 120),
    ],
)
def test_fits_without_a_lag_and_with_a_play_are_covered(none, play, low, high):
    best = fit_of(1.0, 120, law="dahl", lag="delay+filter")
    fits = [
        best,
        fit_of(none, 90, law="dahl", lag="none"),
        fit_of(play, 100, law="dahl", lag="play"),
    ]
    seen = SimpleNamespace(best=best)
    found = estimate._with_other_lags(seen, fits, best.value, best.value)
    assert [side[0] for side in found] == pytest.approx([low, high])


OBJECTIONS = [  # plausible fits, the chosen one first, and how many objections sigma0 has
    ([("dahl", "delay")], 0),
    ([("exponent", "none")], 0),
    ([("exponent", "delay")], 1),  # both round the loop
    ([("exponent", "delay"), ("bouc-wen", "play")], 1),
    ([("exponent", "delay"), ("stribeck", "play")], 1),
    ([("stribeck", "delay"), ("exponent", "delay")], 0),  # Dahl's law at a reversal
    ([("exponent", "delay"), ("dahl", "delay")], 0),
    ([("exponent", "delay"), ("exponent", "none")], 0),
    ([("exponent", "none"), ("bouc-wen", "play")], 1),  # the last one is the best: with a play
    ([("dahl", "none"), ("bouc-wen", "play")], 0),
    ([("bouc-wen", "none", 0.81)], 0),
    ([("dahl", "none"), ("bouc-wen", "none", 0.79)], 1),  # steepest at rest
    ([("breakaway", "none")], 1),
    ([("breakaway", "delay"), ("bouc-wen", "delay", 0.5)], 2),
]


@pytest.mark.parametrize(("fits", "wanted"), OBJECTIONS)
def test_laws_and_lags_that_leave_no_slope_at_rest(fits, wanted):
    fits = [
        replace(fit_of(1.0, law=law, lag=lag), p=np.array([0, *(shape or [1.0])]))
        for law, lag, *shape in fits
    ]
    i = Intervals(*[np.ones(2)] * 3, {})
    seen = SimpleNamespace(
        intervals=i,
        hypothesis=fits[0].hypothesis,
        plausible=SimpleNamespace(fits=fits, best=fits[-1]),
        samples=SimpleNamespace(has_rests=False),
    )
    found = list(_against_sigma0(seen, i))
    assert len(found) == wanted
    is_play = fits[-1].hypothesis.lag is PLAY
    assert ("law and play" in {reason for _, reason, _ in found}) is (is_play and wanted > 0)
    assert not (is_play and any("filter" in next_step(reason) for _, reason, _ in found))
    for against, reason, _ in found:
        assert against == (
            True,
            reason == ("law and play" if fits[-1].hypothesis.lag is PLAY else "law and lag")
            and fits[0].hypothesis.law.name != "breakaway"
            and all(fit.hypothesis.lag is not NONE for fit in fits),
        )
    seen.intervals = replace(i)  # presliding is hidden
    assert len(list(_against_sigma0(seen, i))) == wanted + 1
    seen.samples.has_rests = True  # a cause for each law of several parameters
    assert len(list(_against_sigma0(seen, i))) == wanted + 1 + (
        fits[0].hypothesis.law.name != "dahl"
    )


# --- simulated logs -------------------------------------------------------------------------------


@cache
def simulated(counts: float, noise: float = 0.01, levels: int = 0) -> tuple[Fitter, Fit]:
    log = log_of(PATH, dahl_torque(PATH), noise, FC / SIGMA0 / counts)
    if levels:
        log = replace(log, torque=np.round(log.torque / FC * levels) * FC / levels)
    return fitted(log)


def test_refits_are_off_by_the_counts_and_the_rounding():
    spread = {}
    for counts, levels in ((26, 0), (1.5, 0), (26, 6)):
        errors = simulate.refit_errors(*simulated(counts, levels=levels))
        assert errors.shape == (7, 2) and np.array_equal(
            errors, simulate.refit_errors(*simulated(counts, levels=levels))
        )
        spread[counts, levels] = np.sqrt(np.mean(errors**2, axis=0))
    assert (spread[26, 0] < (0.01, 0.002)).all()
    assert spread[1.5, 0][0] > 1.4 * spread[26, 0][0] and (spread[26, 6] > 2 * spread[26, 0]).all()
    assert (spread[1.5, 0] < 0.1).all() and (spread[26, 6] < 0.1).all()


def test_simulated_counts_lie_at_other_places():
    """In pairs of opposite shifts, on a motion up to half a count longer or shorter."""
    samples, h = simulated(13)[0].samples, Hypothesis()
    seen = samples.angles["between counts"]
    around = (seen - seen.mean()) / np.abs(seen - seen.mean()).max()
    drawn = []
    for draw in range(8):
        change = (simulate._other_phase(samples, h, draw) - seen) / samples.count
        stretch, shift = np.polyfit(around, change, 1)
        assert change == pytest.approx(shift + stretch * around, abs=1e-6)
        drawn.append((shift, stretch))
    shifts, stretches = np.array(drawn).T
    assert shifts[::2] == pytest.approx(-shifts[1::2])
    assert stretches[::2] == pytest.approx(stretches[1::2])
    for one in (shifts, stretches[::2]):
        assert np.abs(one).max() <= 0.5 and np.diff(np.sort(one)).min() > 0.02 and np.ptp(one) > 0.4


def test_a_bump_goes_further_at_each_turn_and_fades_within_two_counts():
    seen = fitted(*plus(0 * PATH))[0].samples.angles["between counts"]
    bump = simulate._bump_at_turns(seen, COUNT, A)
    turns = turns_of(PATH)
    assert bump[turns] / COUNT == pytest.approx(0.2 * np.sign(PATH[turns]), abs=0.04)
    away = np.min(np.abs(seen[:, None] - seen[turns]), axis=1)
    assert (bump[away > 2 * COUNT] == 0).all() and np.count_nonzero(bump) > 3 * len(turns)
    assert (simulate._bump_at_turns(RAMP, COUNT, A) == 0).all()


def test_a_log_shows_a_part_of_a_change():
    """With the standard error that the noise of the cycles leaves."""
    wave, errors = np.sin(60 * PATH + 20 * RAMP), []
    for noise in (0.01, 0.05):
        fitter, fit = fitted(log_of(PATH, dahl_torque(PATH), noise))
        fitter.samples.torque[:] += 0.7 * 0.02 * wave
        seen, error = simulate._amplitude(fitter, fit, 0.02 * wave)
        assert seen == pytest.approx(0.7, abs=4 * error)
        errors.append(error)
    assert 0 < 2 * errors[0] < errors[1] < 0.05


def test_a_coarse_sensor_is_simulated_with_its_step():
    fitter, fit = simulated(26, levels=6)
    exact = fitter.predicted(fit)
    made = simulate._measure(fitter, fit, exact, np.random.default_rng(1))
    levels = np.unique(made.round(9))
    assert np.diff(levels) == pytest.approx(np.full(len(levels) - 1, FC / 6))
    assert 0.2 * FC / 6 < np.std(made - exact) < 0.6 * FC / 6
    assert simulate._measure(*simulated(26), exact, np.random.default_rng(1)) is exact


def test_travel_hidden_at_turns_matters_with_few_counts():
    fine, coarse = (simulate.hidden_travel(*simulated(counts)) for counts in (26, 3))
    assert (0 < fine).all() and fine[0] < 0.02 < coarse[0] < 0.3


def test_a_coarse_torque_sensor_hides_a_part_of_its_rounding():
    for levels, noise in ((6, 0.0), (6, 0.5), (0, 0.01)):
        fitter, fit = simulated(26, noise, levels)
        step, weight = FC / 6, fitter.samples.used.sum()
        hidden = 0.3 * step**2 / 12 * weight if (levels, noise) == (6, 0) else 0
        assert estimate._hidden_by_rounding(fitter.samples, fit) == pytest.approx(hidden)
    assert simulate.torque_step(np.round(7 * noise_of(1, 999)) / 7) == pytest.approx(1 / 7)
    assert simulate.torque_step(noise_of(1, 999)) == 0
