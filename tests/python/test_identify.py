# SPDX-License-Identifier: MIT
"""Identification on logs whose truth is known: error, cover of the intervals, and each thing that
is to be found and named, planted one at a time.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dahl.identify import clean, fit, output, pipeline
from dahl.identify.terms import columns_of, place_of, torque_of
from dahl.identify.verdict import judge
from identify_tools import COUNT, FC, SIGMA0, dahl_torque, noise_of, sine, synthetic
from scipy.integrate import solve_ivp
from scipy.stats import t as student

pytestmark = pytest.mark.usefixtures("library")

SEEDS = 40  # of the short form; 200 in the long one


def errors_and_cover(
    seeds: int, options: pipeline.Options | None = None, **kind: float
) -> tuple[np.ndarray, np.ndarray]:
    """Relative errors of sigma0 and Fc, and whether their intervals hold the truth: (seeds, 2)."""
    errors, held = [], []
    for seed in range(seeds):
        found = pipeline.identify([synthetic(seed, **kind)], options or pipeline.Options()).estimate
        errors.append((found.sigma0 / SIGMA0 - 1, found.Fc / FC - 1))
        pairs = ((found.ci95["sigma0"], SIGMA0), (found.ci95["Fc"], FC))
        held.append([one.low <= truth <= one.high for one, truth in pairs])
    return np.array(errors), np.array(held)


def test_the_reference_solves_the_equation():
    """The tests' own torque against an ODE solver, on a path with reversals."""
    theta = sine(3, rows=400, cycles=2)
    smooth = lambda x: np.interp(x, np.arange(400), theta)  # noqa: E731

    def slope(x: float, F: np.ndarray) -> np.ndarray:  # noqa: N803
        rate = smooth(min(int(x) + 1, 399)) - smooth(int(x))
        return SIGMA0 * (1 - F / FC * np.sign(rate)) * rate

    truth = [0.0]
    for row in range(399):
        truth.append(solve_ivp(slope, (row, row + 1), [truth[-1]], rtol=1e-9, atol=1e-12).y[0, -1])
    assert np.abs(dahl_torque(theta) - truth).max() < 1e-5 * FC


@pytest.mark.checks
@pytest.mark.parametrize("shared", [0.0, 0.9])
def test_error_and_cover(shared):
    errors, held = errors_and_cover(SEEDS, shared=shared)
    if shared == 0:
        sigma0, Fc = np.median(np.abs(errors), axis=0)  # noqa: N806
        assert sigma0 < 0.005
        assert Fc < 0.001
    assert (held.mean(axis=0) >= 0.85).all()  # 40 seeds: 90 % and two standard errors less


@pytest.mark.long
@pytest.mark.parametrize("shared", [0.0, 0.9])
def test_error_and_cover_of_200_seeds(shared):
    """Inside the true choice; over the choices see test_coverage_identify.py."""
    alone = pipeline.Options(terms=(), delay=False)
    errors, held = errors_and_cover(200, alone, shared=shared)
    if shared == 0:
        assert np.median(np.abs(errors[:100]), axis=0)[0] < 0.005
        assert np.median(np.abs(errors[:100]), axis=0)[1] < 0.001
    assert (held.mean(axis=0) >= 0.90).all()
    assert (held.mean(axis=0) <= 0.99).all()


def test_a_good_log_is_identifiable_without_further_terms():
    result = pipeline.identify([synthetic(5)])
    assert result.verdict.identifiable == {"sigma0": True, "Fc": True}
    assert result.verdict.text == "sigma0 and Fc identifiable"
    assert result.estimate.terms == {}
    assert result.delay == result.backlash == 0
    assert result.reversals == 20
    assert result.models.r2["none"] < 0.1 < result.models.r2["coulomb"] < result.models.r2["dahl"]


@pytest.mark.parametrize(
    ("term", "size"), [("offset", 0.3), ("spring", 4.0), ("viscous", 0.5), ("inertia", 0.02)]
)
def test_a_term_that_is_there_is_found(term, size):
    log = sweeping(7)
    log.zero = float(log.theta[0])
    log.torque = log.torque + size * columns_of(log)[:, place_of(term)]
    found = pipeline.identify([log]).estimate
    assert term in found.terms
    assert found.terms[term] == pytest.approx(size, rel=0.1)
    assert found.Fc == pytest.approx(FC, rel=0.03)


def test_terms_that_are_fitted_together_keep_their_names():
    sizes = {"offset": 0.3, "spring": 4.0, "viscous": 0.5, "inertia": 0.02}
    log = sweeping(7)
    log.zero = float(log.theta[0])
    log.torque = log.torque + torque_of(log, sizes)
    options = pipeline.Options(terms=("inertia", "spring", "offset", "viscous"), delay=False)
    found = pipeline.identify([log], options).estimate.terms
    assert found == {name: pytest.approx(size, rel=0.1) for name, size in sizes.items()}


def sweeping(seed: int):
    """A log with many speeds: a sine whose frequency grows."""
    x = np.linspace(0, 1, 12_000)
    theta = 0.15 * np.sin(2 * np.pi * (4 * x + 10 * x**2))
    torque = dahl_torque(theta) + 0.02 * FC * noise_of(seed, len(theta))
    return replace(
        synthetic(seed), theta=theta, torque=torque, time=np.arange(len(x)) * 1e-3, resolution=0.0
    )


def test_terms_that_are_asked_for_are_fitted_and_no_others():
    result = pipeline.identify([synthetic(1)], pipeline.Options(terms=("offset", "viscous")))
    assert list(result.estimate.terms) == ["offset", "viscous"]
    assert abs(result.estimate.terms["offset"]) < 0.01 * FC


def test_the_state_at_the_first_row_is_estimated():
    """A log that begins in full friction, and has little else to tell."""
    whole = synthetic(2, rows=4000, cycles=2)
    start = int(np.argmin(np.abs(whole.theta[:2000]))) + 1
    rows = slice(start, start + 1800)
    late = replace(whole, theta=whole.theta[rows], torque=whole.torque[rows], time=whole.time[rows])
    assert abs(late.torque[:50].mean()) > 0.9 * FC
    result = pipeline.identify([late])
    assert result.delay == 0
    assert result.estimate.sigma0 == pytest.approx(SIGMA0, rel=0.04)
    first = np.abs(late.torque - result.predicted[0])[:50]
    assert first.mean() < 0.1 * FC


def test_torque_spikes_weigh_less():
    log = synthetic(3)
    hit = np.random.default_rng(0).choice(log.rows, 100, replace=False)
    log.torque[hit] += 20 * FC
    result = pipeline.identify([log])
    assert result.estimate.Fc == pytest.approx(FC, rel=0.005)
    assert result.estimate.sigma0 == pytest.approx(SIGMA0, rel=0.02)
    assert any("disagree with their neighbours" in note for note in result.notes)


def test_angle_spikes_are_named_and_taken_out():
    log = synthetic(4)
    hit = np.random.default_rng(0).choice(log.rows, 60, replace=False)
    log.theta[hit] += 0.02
    raw = pipeline.identify([log], pipeline.Options(median=1)).estimate
    result = pipeline.identify([log])
    assert result.median > 1
    assert any("turns back at once" in note for note in result.notes)
    assert abs(result.estimate.sigma0 / SIGMA0 - 1) < 0.05 < abs(raw.sigma0 / SIGMA0 - 1)


@pytest.mark.parametrize("rows", [-6.0, 4.5])
def test_a_delay_is_found(rows):
    log = synthetic(5)
    log.torque = clean.shifted(log.torque, -rows)
    result = pipeline.identify([log])
    assert result.delay == pytest.approx(rows, abs=0.6)
    assert result.estimate.sigma0 == pytest.approx(SIGMA0, rel=0.03)


def test_no_delay_is_made_up():
    assert pipeline.identify([synthetic(6)]).delay == 0


def test_backlash_is_named_and_its_travel_not_counted():
    theta, gap = sine(1, amplitude=0.08), 0.01
    torque = with_play(theta, gap) + 0.02 * FC * noise_of(1, len(theta))
    log = replace(synthetic(1), theta=theta, torque=torque, resolution=0.0)
    result = pipeline.identify([log])
    assert result.backlash == pytest.approx(gap, rel=0.35)
    assert result.estimate.sigma0 == pytest.approx(SIGMA0, rel=0.15)
    assert result.estimate.ci95["sigma0"].low < 0.5 * SIGMA0  # as soft as the zone if that is none
    assert not result.verdict.sigma0
    assert "sigma0 hangs on the backlash" in result.verdict.text


def with_play(theta: np.ndarray, gap: float) -> np.ndarray:
    """Torque of Dahl's model that is 0 over `gap` rad each time it passes 0 after a reversal."""
    ratio, left, out = 0.0, 0.0, []
    for move in np.diff(theta, prepend=theta[0]):
        side, travel = np.sign(move), abs(move)
        if left > 0:
            free = min(left, travel)
            left, travel = left - free, travel - free
        after = ratio + (side - ratio) * -np.expm1(-SIGMA0 / FC * travel)
        if ratio * after < 0:
            left, after = gap, 0.0
        ratio = after
        out.append(FC * ratio)
    return np.array(out)


def test_a_bilinear_loop_is_called_so():
    theta = sine(2)
    ratio, drawn = 0.0, []
    for move in np.diff(theta, prepend=theta[0]):
        ratio = min(max(ratio + SIGMA0 / FC * move, -1), 1)
        drawn.append(FC * ratio)
    log = replace(synthetic(2), torque=np.array(drawn) + 0.02 * FC * noise_of(2, len(theta)))
    assert "loop is bilinear" in pipeline.identify([log]).verdict.text
    assert "bilinear" not in pipeline.identify([synthetic(2)]).verdict.text


def test_presliding_below_the_encoder_resolution():
    theta = sine(3, amplitude=0.5)
    torque = dahl_torque(theta, sigma0=8000.0) + 0.05 * FC * noise_of(3, len(theta))
    log = replace(synthetic(3), theta=np.round(theta / COUNT) * COUNT, torque=torque)
    verdict = pipeline.identify([log]).verdict
    assert not verdict.sigma0
    assert verdict.Fc
    assert "presliding below encoder resolution" in verdict.text


def test_friction_that_never_slips():
    theta = sine(3, amplitude=0.0004)
    torque = dahl_torque(theta) + 0.01 * FC * noise_of(3, len(theta))
    result = pipeline.identify([replace(synthetic(3), theta=theta, torque=torque, resolution=0.0)])
    assert not result.verdict.Fc
    for turns in (1, 0):  # a motion one way that tells nothing may have slipped all the time
        said = judge(replace(result, reversals=turns)).text
        assert ("never slips" in said) == bool(turns)
    assert output.numbers(result)["ci95"]["Fc"][1] is None


def test_few_reversals_are_named():
    result = pipeline.identify([synthetic(1, cycles=2.5)])
    assert "only 5 reversals" in result.verdict.text


def test_noise_alone_is_nothing():
    log = replace(synthetic(1), torque=noise_of(1, 10_000))
    verdict = pipeline.identify([log]).verdict
    assert verdict.identifiable == {"sigma0": False, "Fc": False}


def test_the_other_sign_is_put_right_and_said():
    log = synthetic(1)
    result = pipeline.identify([replace(log, torque=-log.torque)])
    assert result.estimate.sigma0 == pytest.approx(SIGMA0, rel=0.02)
    assert any("other sign" in note for note in result.notes)


def test_several_logs_in_one_fit():
    logs = [synthetic(seed, rows=4000, cycles=4) for seed in range(3)]
    together, alone = pipeline.identify(logs).estimate, pipeline.identify(logs[:1]).estimate
    assert together.sigma0 == pytest.approx(SIGMA0, rel=0.01)
    assert together.ci95["sigma0"].relative(1) < alone.ci95["sigma0"].relative(1)


def test_what_the_encoder_hides_widens_the_interval():
    """A shared error adds its variance: along a chord of the profile, Student's t times it."""
    found, terms = pipeline.Study([synthetic(1)]).search(())
    parts = (dict.fromkeys(("sigma0", "a"), part) for part in (0.0, 0.01, 0.02))
    bare, some, more = (fit.estimate(found, terms, hidden) for hidden in parts)
    t = student.ppf(0.975, bare.blocks - 1)
    for name in ("sigma0", "a"):
        half = [one.ci95[name].relative(getattr(one, name)) for one in (bare, some, more)]
        assert half[1] > 0.95 * np.hypot(half[0], 0.01 * t)
        assert half[2] > 0.95 * np.hypot(half[0], 0.02 * t)
        grown = [one.inflation[name] - bare.inflation[name] for one in (some, more)]
        assert grown[1] == pytest.approx(4 * grown[0], rel=0.01)
    assert some.ci95["Fc"] == bare.ci95["Fc"]


@pytest.mark.parametrize("noise", [0.0, 1e-5])
def test_an_interval_holds_its_own_estimate(noise):
    theta = sine(1, rows=3000, cycles=5)
    torque = dahl_torque(theta) + noise * FC * noise_of(1, len(theta))
    log = replace(synthetic(1), theta=theta, torque=torque, time=None, resolution=0.0)
    found = pipeline.identify([log]).estimate
    for name, one in found.ci95.items():
        assert one.low <= getattr(found, name) <= one.high
        assert one.relative(getattr(found, name)) < 1e-3


def counted_strokes(seed):
    """Strokes of .03 rad to either side at two speeds in turn, half cosines, so that at each turn
    the acceleration leaps; a count is .08 presliding lengths; viscous friction and 5 % noise.
    """
    draw = np.random.default_rng(seed)
    ends = 0.03 * np.resize([1, -1], 25) * (1 + 0.25 * draw.random(25))
    rows = np.resize([340, 170], 24)
    shapes = [(1 - np.cos(np.pi * np.arange(n) / n)) / 2 for n in rows]
    strokes = zip(ends, np.diff(ends), shapes, strict=False)
    theta = np.concatenate([start + step * shape for start, step, shape in strokes])
    time = np.arange(len(theta)) * 1e-3
    torque = dahl_torque(theta) + 0.2 * np.gradient(theta, time)
    torque += 0.05 * FC * draw.standard_normal(len(theta))
    read = np.floor(theta / COUNT + draw.random()) * COUNT
    return replace(synthetic(1), theta=read, torque=torque, time=time, resolution=COUNT)


def test_what_the_counts_hide_of_a_turn_is_in_the_intervals():
    held = []
    for seed in range(8):
        found = pipeline.identify([counted_strokes(seed)])
        assert found.inner and "viscous" in found.estimate.terms
        ends = found.estimate.ci95
        held += [ends["sigma0"].low <= SIGMA0 <= ends["sigma0"].high]
        held += [ends["Fc"].low <= FC <= ends["Fc"].high]
        assert ends["sigma0"].relative(found.estimate.sigma0) < 0.03
    assert sum(held) >= 14


def test_a_log_not_fitted_is_predicted():
    result = pipeline.identify([synthetic(0)])
    assert pipeline.check(result, synthetic(1)) > 0.99
    other = replace(synthetic(1), torque=2 * synthetic(1).torque)
    assert pipeline.check(result, other) < 0.9


def test_a_log_not_fitted_is_cleaned_as_those_that_were():
    turned = [replace(synthetic(seed), torque=-synthetic(seed).torque) for seed in (0, 1)]
    assert pipeline.check(pipeline.identify(turned[:1]), turned[1]) > 0.99
    theta = sine(1, amplitude=0.08)
    torque = with_play(theta, 0.01) + 0.02 * FC * noise_of(1, len(theta))
    loose = replace(synthetic(1), theta=theta, torque=torque, resolution=0.0)
    result = pipeline.identify([loose])
    assert pipeline.check(result, loose) > 0.98  # 0.945 with the flat zone counted as travel


def test_a_spring_is_relaxed_at_one_angle_for_all_logs():
    """Of the log that is predicted too, wherever it begins."""
    springy = [synthetic(seed, rows=4000, cycles=4) for seed in (1, 2)]
    for log in springy:
        log.torque = log.torque + 20.0 * log.theta
    assert abs(springy[0].theta[0] - springy[1].theta[0]) > 0.02
    for logs, other in ((springy[:1], springy[1]), (springy, springy[0])):
        result = pipeline.identify(logs, pipeline.Options(terms=("offset", "spring")))
        assert result.estimate.terms["spring"] == pytest.approx(20, rel=0.1)
        assert pipeline.check(result, other) > 0.99
        cut = replace(other, time=other.time + 0.5 * (np.arange(other.rows) >= other.rows // 3))
        assert pipeline.check(result, cut) > 0.99, "of what is behind a gap too"
