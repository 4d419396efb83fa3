# SPDX-License-Identifier: MIT
"""What is said of a log, word for number: each finding with its size and its place, which parameter
it takes the claim from, and both sides of the limit from which on it is said. The logs and results
are made by hand, so that each number is known.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from types import SimpleNamespace

import identify_truth
import numpy as np
import pytest
from dahl import Error
from dahl.identify import (
    angle_noise,
    clean,
    drift,
    explore,
    grid,
    in_step,
    lowpass,
    path,
    pipeline,
    plan_quality,
    play,
    recording,
    torque_steps,
    turning,
)
from dahl.identify.fit import Interval
from dahl.identify.log import Log
from dahl.identify.result import Cycles, Result, Verdict
from identify_tools import COUNT, FC, SIGMA0, dahl_torque, noise_of, sine, synthetic

pytestmark = pytest.mark.usefixtures("library")

BOTH = ("sigma0", "Fc")


@pytest.fixture(scope="module")
def good(library) -> Result:
    return pipeline.identify([synthetic(5, rows=3000, cycles=6)], pipeline.Options(terms=()))


# --- parameters by cycle --------------------------------------------------------------------------


def by_cycle(count: int = 12, **change) -> Cycles:
    """Cycles of 100 rows with errors of a tenth of a percent; `change` are factors of a value."""
    wobble = 1 + 1e-4 * np.resize([1, -1, 0.5, -0.5], count)
    usual = {"Fc": FC, "sigma0": SIGMA0, "offset": 0.01 * FC}
    value = {name: one * wobble * change.get(name, 1.0) for name, one in usual.items()}
    error = {name: np.full(count, 1e-3 * abs(one)) for name, one in usual.items()}
    error["offset"] = np.full(count, 1e-3 * FC)
    return Cycles(value, error, 100 * np.arange(count) + 7)


def ramp(part: float, count: int = 12) -> np.ndarray:
    return 1 + part * np.linspace(-0.5, 0.5, count)


def step(part: float, place: int, count: int = 12) -> np.ndarray:
    """The larger side is as usual."""
    behind = np.arange(count) >= place
    if place > count / 2:
        return np.where(behind, 1 + part, 1.0)
    return np.where(behind, 1.0, 1 - part)


@pytest.mark.parametrize(
    ("change", "said", "doubts"),
    [
        ({}, "", ()),
        ({"Fc": ramp(0.2)}, "Fc drifts by +20 % over 12 cycles", BOTH),
        ({"Fc": ramp(-0.2)}, "Fc drifts by -20 % over 12 cycles", BOTH),
        ({"Fc": ramp(0.034)}, "Fc drifts by +3 % over 12 cycles", BOTH),
        ({"Fc": ramp(0.026)}, "", ()),
        ({"sigma0": ramp(0.11)}, "sigma0 drifts by +11 % over 12 cycles", ("sigma0",)),
        ({"sigma0": ramp(0.09)}, "", ()),
        ({"sigma0": step(0.3, 5)}, "sigma0 steps by +30 % at cycle 6 (row 508)", ("sigma0",)),
        ({"Fc": step(-0.3, 2)}, "Fc steps by -30 % at cycle 3 (row 208)", BOTH),
        ({"Fc": step(-0.3, 10)}, "Fc steps by -30 % at cycle 11 (row 1008)", BOTH),
        ({"offset": 1 + 30 * ramp(1)}, "offset drifts by +30 % of Fc over 12 cycles", ()),
        ({"offset": 1 + 4 * ramp(1)}, "", ()),
    ],
)
def test_how_a_parameter_changes_and_where(change, said, doubts):
    found = drift.findings(by_cycle(**change))
    assert [(one.text, one.doubts) for one in found] == ([(said, doubts)] if said else [])


@pytest.mark.parametrize(("count", "named"), [(4, False), (5, True)])
def test_a_drift_takes_five_cycles(count, named):
    assert bool(drift.findings(by_cycle(count, Fc=ramp(0.5, count)))) is named


@pytest.mark.parametrize(
    ("name", "part", "odd", "said", "doubts"),
    [
        ("Fc", 0.08, [3], "Fc of cycle 4 disagrees with the others", ()),
        ("Fc", -0.08, [3], "Fc of cycle 4 disagrees with the others", ()),
        ("Fc", 0.05, [3], "", ()),
        ("Fc", 0.08, [3, 14], "Fc of cycle 4, 15 disagrees with the others", ()),
        ("Fc", 0.08, [3, 9, 14], "Fc of cycle 4, 10, 15 disagrees with the others", BOTH),
        (
            "sigma0",
            0.3,
            [3, 9, 14],
            "sigma0 of cycle 4, 10, 15 disagrees with the others",
            BOTH[:1],
        ),
        ("sigma0", 0.15, [3], "", ()),
    ],
)
def test_which_cycles_are_odd(name, part, odd, said, doubts):
    """Of 24: more than a tenth takes the claim away. Alternating signs, so that nothing drifts."""
    factor = np.ones(24)
    factor[odd] += part
    found = drift.findings(by_cycle(24, **{name: factor}))
    assert [(one.text, one.doubts) for one in found] == ([(said, doubts)] if said else [])


def test_of_many_odd_cycles_the_first_eight_are_named():
    factor = np.ones(60)
    factor[2:56:6] += 0.3
    (found,) = drift.findings(by_cycle(60, Fc=factor))
    assert found.text == "Fc of cycle 3, 9, 15, 21, 27, 33, 39, 45 ... disagrees with the others"


def test_a_cycle_that_is_known_badly_counts_less():
    """The same step, but the cycles behind it have errors as large as itself."""
    cycles = by_cycle(Fc=step(0.2, 10))
    assert drift.findings(cycles)
    cycles.error["Fc"][10:] = FC
    assert drift.findings(cycles) == []
    cycles.value["Fc"][11] = 3 * FC  # nor does it make the others odd
    cycles.error["Fc"][11] = 9 * FC
    assert drift.findings(cycles) == []


# --- encoder and unit -----------------------------------------------------------------------------


def on_grid(step: float, told: float, linear: bool = False, rows: int = 3000) -> Log:
    theta = np.round(sine(1, rows=rows, cycles=4) / step) * step
    return Log("x.csv", theta, dahl_torque(theta), linear=linear, resolution=told)


@pytest.mark.parametrize(
    ("linear", "words"),
    [
        (False, "the angle lies on a grid of 16384 counts a turn, not of 8192:"),
        (True, "the angle lies on a grid of 5 counts a millimetre, not of 2.5:"),
    ],
)
def test_the_grid_of_the_angle_in_counts(linear, words):
    (found,) = grid.finding(
        on_grid(2e-4 if linear else COUNT, 4e-4 if linear else 2 * COUNT, linear)
    )
    assert found.text.startswith(words)
    assert found.doubts == ("sigma0",)


@pytest.mark.parametrize(("off", "said"), [(0.991, False), (1.009, False), (0.985, True)])
def test_a_grid_agrees_within_a_hundredth(off, said):
    assert bool(grid.finding(on_grid(COUNT, off * COUNT))) is said


def test_a_coarser_grid_takes_many_steps_to_be_believed():
    """A log that by chance read each second count alone."""
    few = on_grid(COUNT, COUNT / 2)
    assert grid.finding(few)
    few.theta = np.repeat(COUNT * np.array([0.0, 1, 2, 3, 4, 5, 3, 2]), 30)
    assert grid.finding(few) == []
    few.resolution = 0.0
    assert grid.finding(few) == []


def test_the_other_unit_is_named_with_its_counts():
    log = on_grid(360 / 4096, 360 / 4096)
    log.theta = log.theta * 1000
    with pytest.raises(
        Error,
        match=r"^x\.csv: steps of 0\.0878906 rad would be 71\.5 counts a turn"
        r" with the angle in rad, but 4096 in deg: is the angle in deg ",
    ):
        grid.refuse(log)
    log.resolution = np.radians(2 * np.pi / 4096)
    with pytest.raises(Error, match=r"234683\.5 .* in deg, but 4096 in rad: is the angle in rad "):
        grid.refuse(log)
    for counts in (4096 * (1 + 4e-4), 4096.0, 4096 * (1 + 6e-4), 128 * 1.0, 2.0**27):
        log.resolution = np.radians(360 / counts)
        grid.refuse(log)


# --- the recording --------------------------------------------------------------------------------


def test_a_gap_is_named_with_its_length_and_its_row():
    log = synthetic(1, rows=3000, cycles=3)
    keep = np.ones(3000, dtype=bool)
    keep[500:700] = keep[1500:1800] = False
    first, *others = recording.split_at_gaps(recording.taken(log, keep, ["before"]))
    assert [first.rows, *(one.rows for one in others)] == [500, 800, 1200]
    assert first.notes == [
        "before",
        "the clock has 2 gaps (0.502 s in all, the first after row 500): split there into 3 pieces",
    ]
    assert others[0].notes == others[1].notes == []
    assert others[0].time[0] == log.time[700] and others[0].torque[0] == log.torque[700]
    keep[1500:1800] = True
    assert "1 gap (0.201 s" in recording.split_at_gaps(recording.taken(log, keep, []))[0].notes[0]


@pytest.mark.parametrize(("steps", "pieces"), [(4.9, 1), (5.1, 2)])
def test_a_gap_is_more_than_five_usual_steps(steps, pieces):
    log = synthetic(1, rows=600, cycles=3)
    log.time[300:] += (steps - 1) * 1e-3
    assert len(recording.split_at_gaps(log)) == pieces


def test_a_log_of_nothing_but_short_pieces_is_refused():
    log = synthetic(1, rows=290, cycles=3)
    log.time += 0.02 * (np.arange(290) // 29)
    with pytest.raises(Error, match="9 gaps .* 0 pieces; 290 rows in pieces too short left out"):
        recording.split_at_gaps(log)
    whole = synthetic(1, rows=300, cycles=3)
    whole.time += 0.02 * (np.arange(300) // 30)
    assert len(recording.split_at_gaps(whole)) == 10


def test_a_wrap_is_named_with_its_period():
    log = synthetic(1)
    counts = np.round(log.theta / COUNT).astype(int)
    wrapped = replace(log, theta=(counts % 128) * COUNT, notes=["before"])
    jumps = np.count_nonzero(np.abs(np.diff(counts % 128)) > 64)
    mended = recording.unwrapped(wrapped)
    period = 128 * COUNT
    assert mended.notes == [
        "before",
        f"angle wraps {jumps} times at {period:.6g} rad (128 counts): unwrapped",
    ]
    assert np.allclose(np.diff(mended.theta), np.diff(counts) * COUNT)
    assert recording.unwrapped(wrapped, trust_units=True) is wrapped
    with pytest.raises(
        Error, match=f" {np.count_nonzero(np.abs(np.diff(counts % 200)) > 100)} times"
    ):
        recording.unwrapped(replace(log, theta=(counts % 200) * COUNT))


@pytest.mark.parametrize("linear", [False, True])
def test_a_linear_motion_has_no_turn_to_wrap_at(linear):
    theta = (3.0 * np.sin(np.linspace(0, 40, 4000)) + 3) * 1.5 % (2 * np.pi)
    log = Log("x.csv", theta, np.arange(4000.0), linear=linear)
    if linear:
        with pytest.raises(Error, match="unwrap it first"):
            recording.unwrapped(log)
    else:
        assert " at 6.28319 rad: unwrapped" in recording.unwrapped(log).notes[0]


# --- filters, noise, delays -----------------------------------------------------------------------


@dataclass
class Filtered:
    """A fit with a filter."""

    sigma0: float
    Fc: float
    words: str = "time constant of 10 rows"


@pytest.mark.parametrize(
    ("fits", "doubts"),
    [
        ([(101.0, 0.5), (99.0, 0.5)], ()),
        ([(101.0, 0.5), (107.0, 0.5)], ("sigma0",)),
        ([(101.0, 0.52), (99.0, 0.5)], ("Fc",)),
        ([(107.0, 0.5), (90.0, 0.48)], BOTH),
    ],
)
def test_filters_that_disagree_take_the_claim(good, fits, doubts):
    ends = {"sigma0": Interval(95.0, 105.0), "Fc": Interval(0.49, 0.51), "a": Interval(1, 2)}
    result = replace(good, estimate=replace(good.estimate, ci95=ends))
    made = [Filtered(*one) for one in fits]
    found = lowpass._told(result, made[0], made)
    assert tuple(name for one in found for name in one.doubts) == doubts
    for one in found:
        low, high = sorted(sigma0 for sigma0, _ in fits)
        assert one.text == (
            "torque looks late or low-passed (time constant of 10 rows): sigma0 is then"
            f" {low:.4g} to {high:.4g} N m/rad"
        )
        forces = sorted(Fc for _, Fc in fits)
        wanted = {"sigma0": (low, high), "Fc": (forces[0], forces[-1])}
        assert one.reach == {name: wanted[name] for name in {*doubts, "sigma0"}}


def test_filters_are_what_they_are_called():
    """On a step: how late, how long, how far after a time constant; each from its first value."""
    x = np.concatenate((np.zeros(50), np.ones(100)))[:, None] + 3.0
    for kind, words in lowpass.KINDS.items():
        y = kind(10, x)
        assert y.shape == x.shape and np.all(y[:50] == pytest.approx(3)), words
        assert y[-1] == pytest.approx(4, abs=1e-3), words
        after = {"time constant": 1 - np.exp(-1), "mean": 1.0, "delay": 0.0}[words.split(" of")[0]]
        assert y[59, 0] - 3 == pytest.approx(after, abs=1e-3), words
    assert [lowpass._delay(10, x)[k, 0] for k in (59, 60)] == [3, 4]


def test_the_parameters_behind_a_filter_are_found_again():
    """Of a torque that went through it, with an offset, and odd rows that weigh nothing."""
    log = synthetic(1, rows=3000, cycles=6)
    theta = sine(1, rows=3000, cycles=6)
    log = replace(log, theta=theta, resolution=0.0, weight=np.ones(3000))
    log.torque = -(lowpass._first_order(10, dahl_torque(theta)) + 0.3)
    log.torque[1000:1100], log.weight[1000:1100] = 7.0, 0.0
    turned = replace(log, torque=-log.torque)
    found = SimpleNamespace(
        logs=[turned], eased=[log], sign=-1.0, estimate=SimpleNamespace(terms={"offset": 0.3})
    )
    measured = lowpass.Measured(found)
    filters = dict(lowpass._filters((lowpass._first_order,), (10, 20)))
    right, wrong = measured.fits(list(filters.items()), 0.93 * SIGMA0 / FC * lowpass.NODES)
    assert right.words == "time constant of 10 rows"
    assert right.sigma0 == pytest.approx(SIGMA0, rel=2e-3)
    assert right.Fc == pytest.approx(FC, rel=2e-3)
    assert right.cost == pytest.approx(right.squares.sum()) and len(right.squares) == 3000
    assert right.cost < 0.2 * wrong.cost
    closer = measured.fits(list(filters.items())[:1], right.a * lowpass.CLOSER)[0]
    assert closer.sigma0 == pytest.approx(SIGMA0, rel=2e-4)


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [(1.0, 0.81, False), (1.0, 0.79, True), (0.9, 1.0, False)],
)
def test_a_filter_explains_clearly_more(before, after, said):
    """A fifth of the squares, or surely something."""
    uneven = np.resize(np.repeat([1.0, -1.0], 20), 800)
    assert lowpass.is_better(before + 0.9 * uneven, np.full(800, after)) is said
    steady = np.full(800, 1.0)
    assert lowpass.is_better(steady + 0.01 * np.resize([1, -1], 800), steady - 0.01)


def test_a_bilinear_loop_is_no_filtered_one(good):
    """By the cost of a row."""
    rmse = good.models.rmse["bilinear"]
    cost = rmse**2 * good.logs[0].rows
    assert lowpass._bent_otherwise(good, 1.01 * cost)
    assert not lowpass._bent_otherwise(good, 0.99 * cost)


def test_a_log_of_edges_without_a_clock_is_not_asked_for_filters(good):
    """Its rows are no time at all."""
    steps = np.sign(np.diff(good.logs[0].theta, append=0.0))
    log = replace(good.logs[0], theta=np.cumsum(steps) * COUNT, time=None, resolution=COUNT)
    assert lowpass.finding(replace(good, delay=5.0, logs=[log])) == []


@pytest.mark.parametrize("rows", [3, 6])
def test_a_torque_that_comes_late_is_doubted_without_a_clock_too(rows):
    """Rows are of one length where a clock made them, told or not."""
    log = synthetic(3, part=0.01)
    late = replace(log, torque=np.roll(log.torque, rows), time=None)
    result = pipeline.identify([late])
    assert not result.verdict.sigma0
    assert "torque looks late or low-passed" in result.verdict.text
    assert pipeline.identify([replace(log, time=None)]).verdict.sigma0


def behind(theta: np.ndarray, width: float) -> np.ndarray:
    """An angle behind a play."""
    drawn, one = [], theta[0]
    for ahead in theta:
        one = min(max(one, ahead - width / 2), ahead + width / 2)
        drawn.append(one)
    return np.array(drawn)


@pytest.mark.parametrize(
    ("where", "counts", "every"),
    [("before", 8, 1), ("before", 7, 1), ("before", 4, 25), ("in", 8, 1)],
)
def test_a_play_beside_the_encoder_is_no_delay(where, counts, every):
    """Between encoder and bearing or in the encoder's coupling: as a delay eight counts of it put
    sigma0 off by 37 and 90 %. Of seven the width lies below the nearest of those tried first; four
    are less than a row of a seldom reading.
    """
    true, width = sine(2, amplitude=0.06), counts * COUNT
    bearing, encoder = (
        (behind(true, width), true) if where == "before" else (true, behind(true, width))
    )
    torque = dahl_torque(bearing) + 0.05 * FC * noise_of(2, len(true))
    read = np.floor(encoder / COUNT + 0.3) * COUNT
    time = np.arange(len(true)) * 1e-3
    seen = (column[::every] for column in (read, torque, time))
    result = pipeline.identify([Log("lost motion", *seen, resolution=COUNT)])
    assert not result.verdict.sigma0
    told = re.search(rf"play of (\S+) rad {where} the encoder explains it as", result.verdict.text)
    assert told and float(told[1]) == pytest.approx(width, rel=0.1)
    ends = result.estimate.ci95["sigma0"]
    assert ends.low <= 1.1 * SIGMA0 and ends.high >= 0.9 * SIGMA0


@pytest.mark.parametrize(
    ("amplitude", "waves", "viscous", "doubts"),
    [
        (0.05, 60, 0.0, ("Fc",)),  # passes for a viscous part, which takes 15 % of Fc
        (0.05, 240, 0.0, ()),  # several waves in a stroke, which the intervals hold
        (0.026, 240, 0.0, BOTH),  # no part beside friction is taken
        (0.05, 12, 0.0, ()),  # nearly straight: a spring
        (0.05, 12, 0.03, ()),  # a viscous part that is one
    ],
)
def test_a_torque_that_depends_on_the_angle(amplitude, waves, viscous, doubts):
    """A tenth of Fc, the same both ways, over `waves` rad of a wave for each rad."""
    log = synthetic(4, 0.02, rows=3000, cycles=8, amplitude=amplitude)
    more = 0.1 * FC * np.sin(waves * log.theta + 0.3) + viscous * np.gradient(log.theta, 1e-3)
    result = pipeline.identify([replace(log, torque=log.torque + more)])
    said = "the torque depends on the angle beyond a spring: sigma0 is then"
    found = [one for one in result.findings if one.text.startswith(said)]
    assert [one.doubts for one in found] == [doubts] * bool(doubts)
    for name, true in (("sigma0", SIGMA0), ("Fc", FC)):
        ends = result.estimate.ci95[name]
        assert 0.99 * ends.low <= true <= 1.01 * ends.high
        assert not (name in doubts and result.verdict.identifiable[name])
        for one in found:
            assert sum(one.reach.get(name, (true, true))) / 2 == pytest.approx(true, rel=0.01)
    assert doubts or all(result.verdict.identifiable.values())


@pytest.mark.parametrize("seed", [1004, 1007])
def test_the_rounding_of_an_encoder_is_no_torque_over_the_angle(seed):
    """Read in step, in strokes of 35 and 31 rows."""
    result = pipeline.identify([identify_truth.in_step(seed)])
    assert all(result.verdict.identifiable.values()), result.verdict.text


def test_a_true_delay_is_no_play():
    log = synthetic(3)
    late = replace(log, torque=np.roll(log.torque, 1))
    result = pipeline.identify([late])
    assert result.verdict.sigma0 and "play" not in result.verdict.text


def test_a_play_is_led_and_followed_back():
    """On a way that turns with its speed at zero, as its rest tells."""
    true, width = sine(1, cycles=3), 20 * COUNT
    seen = behind(true, width)
    assert play.followed(true, width) == pytest.approx(seen)
    assert play.led(seen, seen, width)[1000:] == pytest.approx(true[1000:], abs=0.05 * width)


@pytest.mark.parametrize(
    ("sigma0", "Fc", "size", "doubts", "moved"),
    [
        (1.0, 1.0, 1.0, (), ""),
        (0.98, 1.0, 1.0, (), ""),
        (0.96, 1.0, 1.0, ("sigma0",), "sigma0 by -4.0 %"),
        (1.04, 1.0, 1.0, ("sigma0",), "sigma0 by +4.0 %"),
        (1.0, 0.95, 1.0, ("Fc",), "Fc by -5.0 %"),
        (0.9, 0.9, 1.0, BOTH, "sigma0 by -10.0 %, Fc by -10.0 %"),
        (1.0, 1.0, 5.0, ("sigma0",), "sigma0 by +0.0 %"),
    ],
)
def test_what_the_noise_of_the_angle_moves(good, monkeypatch, sigma0, Fc, size, doubts, moved):  # noqa: N803
    """By more than half of the half width of an interval, here 6 %; or a sixteenth of a presliding
    length, 5 counts of noise.
    """
    estimate = good.estimate
    values = {name: getattr(estimate, name) for name in BOTH}
    ends = {name: Interval(0.94 * value, 1.06 * value) for name, value in values.items()}
    result = replace(good, estimate=replace(estimate, ci95=ends))
    most = max(size * 0.0625 / 5 / estimate.a, 0.0)
    monkeypatch.setattr(angle_noise, "noise_of", lambda theta, count: most)
    again = SimpleNamespace(sigma0=sigma0 * values["sigma0"], Fc=Fc * values["Fc"])
    monkeypatch.setattr(angle_noise, "MORE_THAN_ROUNDING", 0.1)
    found = angle_noise.finding(result, lambda made: again)
    assert tuple(name for one in found for name in one.doubts) == doubts
    for one in found:
        counts = f"{most:.3g} rad ({most / COUNT:.1f} counts)"
        assert one.text == f"angle noise of {counts} moves {moved}"


def test_noise_below_the_rounding_is_not_tried(good):
    assert angle_noise.finding(good, lambda made: pytest.fail("tried")) == []


def test_the_trial_of_the_noise_is_a_log_of_the_found_parameters(good):
    """On nearly the motion that was measured, with that noise on its counts, none on its torque."""
    log = good.raw[0]
    made = angle_noise._made(log, 3 * COUNT, good.estimate)
    assert np.std(made.theta - log.theta) == pytest.approx(3 * COUNT, rel=0.1)
    assert np.allclose(made.theta / COUNT, np.round(made.theta / COUNT), atol=1e-6)
    truth = dahl_torque(sine(5, rows=3000, cycles=6), good.estimate.sigma0, good.estimate.Fc)
    assert np.abs(made.torque - truth)[300:].max() < 0.05 * FC
    smooth = angle_noise._made(replace(log, resolution=0.0), 0.0, good.estimate).theta
    assert np.abs(smooth - sine(5, rows=3000, cycles=6)).max() < 2 * COUNT


@pytest.mark.parametrize(
    ("rows", "said"), [(39.9, ""), (40.0, "40 rows late"), (-55.0, "-55 rows")]
)
def test_a_long_delay_claims_nothing(rows, said):
    found = explore.long_delay(rows)
    assert [one.doubts for one in found] == ([BOTH] if said else [])
    assert all(said in one.text for one in found)


# --- the plan -------------------------------------------------------------------------------------


def judged(good: Result, **changed) -> list[str]:
    sure = Verdict(True, True, "good")
    return plan_quality.of(replace(good, **{"verdict": sure, **changed})).against


def test_what_speaks_against_a_plan(good):
    assert judged(good) == []
    for verdict in (Verdict(False, True), Verdict(True, False)):
        assert judged(good, verdict=verdict) == ["not both parameters are identifiable"]
    assert judged(good, backlash=1e-3) == ["it does not know of the backlash"]
    for name, against in (
        ("Dahl", []),
        ("Coulomb", ["the library has no plan for Coulomb's model"]),
    ):
        models = replace(good.explored.models, chosen=name)
        assert judged(good, explored=replace(good.explored, models=models)) == against
    doubted = [plan_quality.of(good, counts, True).against for counts in (0.0, 4096.0)]
    assert ["the counts a turn are in doubt" in words for words in doubted] == [True, False]


@pytest.mark.parametrize(("part", "against"), [(0.25, False), (0.4, True)])
def test_a_plan_explains_nine_tenths_at_least(good, part, against):
    """White noise of a part of the spread of the torque, beside what the log has."""
    raw = good.raw[0]
    noisy = raw.torque + part * raw.torque.std() * noise_of(9, raw.rows)
    result = replace(good, raw=[replace(raw, torque=noisy)])
    quality = plan_quality.of(replace(result, verdict=Verdict(True, True)))
    left = (part * raw.torque.std()) ** 2 + (0.05 * FC) ** 2
    assert quality.r2 == pytest.approx(1 - left / np.var(noisy), abs=0.01)
    words = [f"it explains {100 * quality.r2:.0f} % of the friction on the raw motion, 90 % is the"]
    assert [one[: len(words[0])] for one in quality.against] == words * against


def test_a_plan_does_not_draw_the_load(good):
    """Offset, spring and the sign of the sensor are taken off before it is judged."""
    raw = good.raw[0]
    terms = {"offset": 0.4, "spring": 3.0, "viscous": 9.0}
    load = 0.4 + 3.0 * (raw.theta - good.logs[0].zero)
    turned = replace(raw, torque=-(raw.torque + load))
    estimate = replace(good.estimate, terms=terms)
    result = replace(good, raw=[turned], estimate=estimate, sign=-1.0)
    assert plan_quality.of(result).r2 == pytest.approx(good.plan.r2, abs=1e-6)


@pytest.mark.parametrize(("linear", "turn"), [(False, 2 * np.pi), (True, 1e-3)])
def test_a_plan_counts_by_the_turn_or_by_the_millimetre(good, linear, turn):
    result = replace(good, logs=[replace(one, linear=linear) for one in good.logs])
    for counts, wanted, target in ((5000.0, turn / 5000, True), (0.0, COUNT, False)):
        quality = plan_quality.of(result, counts)
        assert quality.theta_per_count == pytest.approx(wanted)
        assert quality.of_target is target


def test_a_coarse_target_explains_less(good):
    """As the counts hide the presliding."""
    fine, coarse = (plan_quality.of(good, counts).r2 for counts in (16384.0, 512.0))
    assert coarse < fine - 0.005


# --- cleaning -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rows", "wanted"),
    [
        (0.0, [1, 0.5, 0, 0.2, 1]),
        (1.0, [0.5, 0, 0.2, 1, 1]),
        (-1.0, [1, 1, 0.5, 0, 0.2]),
        (0.5, [0.5, 0, 0, 0.2, 1]),
        (-0.5, [1, 0.5, 0, 0, 0.2]),
    ],
)
def test_weights_go_with_their_torques(rows, wanted):
    """The lesser of both rows that a torque is drawn from."""
    weight = np.array([1, 0.5, 0, 0.2, 1])
    assert clean.shifted_weight(weight, rows).tolist() == wanted


def test_a_constant_channel_is_refused_with_its_value():
    log = synthetic(1, rows=300, cycles=2)
    for name, change in (
        ("angle", {"theta": log.theta * 0 + 0.25}),
        ("torque", {"torque": log.torque * 0 - 1.5}),
    ):
        value = {"angle": "0.25", "torque": "-1.5"}[name]
        with pytest.raises(Error, match=rf"{name} is constant \({value} in all 300 rows\)"):
            clean.refuse(replace(log, **change))


def test_a_clipped_torque_is_named_with_limit_and_row():
    for side in (1, -1):
        log = synthetic(1, rows=4000, cycles=4)
        top = 1.1 * np.abs(log.torque).max()
        log.torque[1000:1200] = side * top
        with pytest.raises(
            Error,
            match=rf"clipped at {side * top:g} N m \(200 of 4000 rows, the"
            " first is row 1001",
        ):
            clean.refuse(log)
    log.theta[999:1200] = log.theta[999]
    clean.refuse(log)  # a shaft that rests


def test_how_much_of_the_motion_informs_sigma0(good):
    """Of the rows that move: those where the slope is at least a tenth of sigma0, by the
    closed form.
    """
    theta = np.repeat(0.2 * np.abs(np.arange(-100, 401) % 200 - 100.0), 3)
    log = Log("x", theta, dahl_torque(theta), np.arange(len(theta)) * 1e-3)
    study = pipeline.Study([log])
    moves = np.diff(theta, prepend=theta[0])
    for a in (0.5, 1.0):
        ratio = dahl_torque(theta, a, 1.0)
        steep = (1 - np.sign(moves) * ratio > 0.1)[moves != 0]
        informs = pipeline._informs(study, SimpleNamespace(a=a))
        assert informs == pytest.approx(steep.mean(), abs=0.005)
        assert 0.05 < informs < 0.95


# --- a torque in steps ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("steps", "noise", "off"),  # steps in Fc, noise over a step, part of Fc that it may be off
    [(4, 0.0, 1 / 8), (10, 0.0, 1 / 20), (4, 0.6, 0.0), (1000, 0.0, 0.0)],
)
def test_a_torque_in_steps_may_be_half_a_step_off(good, steps, noise, off):
    """sigma0 twice that part; noise as large as a step takes it away, and so do fine steps."""
    log, step = good.raw[0], FC / steps
    torque = dahl_torque(log.theta) + noise * step * np.random.default_rng(1).normal(size=3000)
    coarse = replace(log, torque=np.round(torque / step) * step)
    ci95 = {"Fc": Interval(FC * 0.99, FC * 1.01), "sigma0": good.estimate.ci95["sigma0"]}
    estimate = replace(good.estimate, Fc=FC, a=SIGMA0 / FC, ci95=ci95)
    found = torque_steps.finding([coarse], estimate)
    if off == 0:
        assert not found
        return
    assert found[0].text.startswith(f"torque comes in steps of {step:.3g} N m ")
    assert found[0].text.endswith(f"Fc may be {100 * off:.2g} % off, sigma0 {200 * off:.2g} %")
    assert found[0].reach["Fc"] == pytest.approx((FC * (1 - off), FC * (1 + off)))
    assert found[0].reach["sigma0"] == pytest.approx(
        (SIGMA0 * (1 - 2 * off), SIGMA0 * (1 + 2 * off))
    )
    assert found[0].doubts == ()


def test_a_coarse_torque_has_the_truth_in_its_intervals():
    """Half a step from one of its levels to the next, where rounding moves Fc the most."""
    made = synthetic(5, rows=3000, cycles=6)
    for part in (0.9, 1.0, 1.1):
        coarse = replace(made, torque=np.round(made.torque / (part * FC / 3)) * part * FC / 3)
        result = pipeline.identify([coarse], pipeline.Options(terms=()))
        for name, truth in (("Fc", FC), ("sigma0", SIGMA0)):
            within = result.estimate.ci95[name]
            assert within.low <= truth <= within.high or not result.verdict.identifiable[name]
        assert "torque comes in steps" in result.verdict.text


# --- an encoder that is read in step --------------------------------------------------------------


def in_step_words(log) -> list[str]:
    result = pipeline.identify([log])
    return [note for note in result.logs[0].notes if "in step" in note]


def test_an_encoder_read_in_step_is_named_and_widens_the_intervals():
    """The same counts in each cycle; where each stroke has its own length nothing is said."""
    log = identify_truth.in_step(1000)
    (words,) = in_step_words(log)
    assert re.search(r"sigma0 may be \d\.\d+ % off", words)
    length = in_step.period_of(log, 0.3 * FC / SIGMA0)
    turns = path.reversals(log.theta, 0.3 * FC / SIGMA0)[::2]
    assert length == pytest.approx(np.diff(turns).mean(), abs=0.6)
    assert in_step.period_of(replace(log, resolution=0.0), 0.3 * FC / SIGMA0) == 0
    swelling = np.round(log.theta * np.linspace(1, 3, log.rows) / COUNT) * COUNT
    assert in_step.period_of(replace(log, theta=swelling), 0.3 * FC / SIGMA0) == 0
    slow = replace(log, theta=np.repeat(log.theta, 60))
    assert in_step.period_of(slow, 0.3 * FC / SIGMA0) == 0  # more than 3000 rows a cycle


@pytest.mark.parametrize("seed", [0, 4, 9])
def test_a_shaft_that_rests_between_two_counts(seed):
    """It does so at the same angle each time, and nobody knows where within the count."""
    draw = np.random.default_rng(seed)
    phase = (np.arange(5000) * 6 / 5000 + draw.uniform()) % 1
    theta = draw.uniform(0.03, 0.07) * np.interp(phase, [0, 0.3, 0.5, 0.8, 1], [-1, 1, 1, -1, -1])
    read = np.floor(theta / COUNT + draw.uniform()) * COUNT
    torque = dahl_torque(theta) + 0.01 * FC * noise_of(seed, 5000)
    log = Log("rests", read, torque, np.arange(5000) * 1e-3, resolution=COUNT)
    result = pipeline.identify([log])
    ends = result.estimate.ci95["sigma0"]
    assert result.verdict.sigma0 and ends.low < SIGMA0 < ends.high
    assert any("sigma0 may be" in note and "in step" in note for note in result.notes)


def test_a_motion_of_a_count_now_and_then_has_no_path_to_read_in_step():
    """The mean cycle is within its rounding: nothing of the motion is left to be made again."""
    theta = 0.01 * (np.arange(400) % 20 == 0)
    log = Log("now and then", theta, np.sign(theta), resolution=0.01)
    assert in_step.period_of(log, 0.001) == 20
    result = SimpleNamespace(raw=[log], estimate=None)
    assert in_step.finding(result, lambda logs: pytest.fail("tried"), 0.001) == []


@pytest.mark.parametrize(
    ("sigma0", "Fc", "left", "reach"),
    [
        # errors of 3 % and 4 % in turn: 2.306 standard errors beside the interval's half width
        ((1.03, 0.96), (1.0, 1.0), 1.9, {"sigma0": 2.306 * np.sqrt((0.03**2 + 0.04**2) / 2)}),
        ((1.0, 1.0), (0.99, 0.99), 0.1, {"Fc": 2.306 * 0.01}),
        ((1.0, 1.0), (1.0, 1.0), 1.0, {}),
        # rounding would leave more than twice the squares that there are: it is none
        ((1.03, 0.96), (1.0, 1.0), 2.1, {}),
    ],
)
def test_what_a_rounding_in_step_moves(good, monkeypatch, sigma0, Fc, left, reach):  # noqa: N803
    """Each trial rounds elsewhere; the roots of the mean squares widen the intervals."""
    made, best = [], good.estimate
    monkeypatch.setattr(in_step, "period_of", lambda *_: 500)

    def refit(logs):
        k = len(made) % 2
        made.append(logs[0])
        made_of = {"sse": left * best.sse, "rows": best.rows}
        return SimpleNamespace(sigma0=best.sigma0 * sigma0[k], Fc=best.Fc * Fc[k], **made_of)

    found = in_step.finding(good, refit, 0.001)
    assert len(made) == 8 and {log.rows for log in made} == {min(4000, good.raw[0].rows)}
    counts = [tuple(np.round(log.theta / log.resolution).astype(int)) for log in made]
    assert len(set(counts)) == 8 and np.ptp([row[0] for row in counts]) <= 3
    wanted = {
        name: np.hypot(error, best.ci95[name].relative(getattr(best, name)))
        for name, error in reach.items()
    }
    ends = {name: end for one in found for name, end in one.reach.items()}
    assert set(ends) == set(wanted) and not any(one.doubts for one in found)
    for name, part in wanted.items():
        value = getattr(best, name)
        assert ends[name] == pytest.approx((value * (1 - part), value * (1 + part)), rel=1e-3)


# --- turning points between the rows --------------------------------------------------------------


def coarse(seed: int, rows_a_cycle: float, noise: float = 0.01) -> Log:
    """The torque of a shaft that turns between the rows: 16 steps of the truth in each."""
    phase = 2 * np.pi * np.arange(3000 * 16) / (16 * rows_a_cycle) + seed
    theta = 4 * FC / SIGMA0 * np.sin(phase)
    torque = dahl_torque(theta)[::16] + noise * FC * noise_of(seed, 3000)
    return Log("x", np.floor(theta[::16] / COUNT) * COUNT, torque, resolution=COUNT)


@pytest.mark.parametrize("seed", [2, 4])
def test_a_shaft_that_turns_between_the_rows(seed):
    result = pipeline.identify([coarse(seed, 18.37)])
    (note,) = [note for note in result.logs[0].notes if "turns between the rows" in note]
    assert re.search(r"(sigma0|Fc) may be \d", note)
    for name, truth in (("sigma0", SIGMA0), ("Fc", FC)):
        ends = result.estimate.ci95[name]
        assert not result.verdict.identifiable[name] or ends.low <= truth <= ends.high
    fine = pipeline.identify([coarse(seed, 150.37)])
    assert not [note for note in fine.logs[0].notes if "turns between" in note]


def test_the_travel_that_no_row_tells():
    """Of parabolas whose vertex is half-way between two rows, and in a row."""
    half = -((np.arange(-4, 4) + 0.5) ** 2)
    assert turning.untold(Log("x", half, half), 1.0) == pytest.approx(2 * 0.25)
    whole = -(np.arange(-4.0, 5.0) ** 2)
    assert turning.untold(Log("x", whole, whole), 1.0) == 0.0
    assert turning.untold(Log("x", np.arange(9.0), np.arange(9.0)), 1.0) == 0.0


@pytest.mark.parametrize(
    ("off", "left", "said"),
    [(0.2, 1.9, True), (-0.1, 0.1, True), (1e-4, 1.0, False), (0.2, 2.1, False)],
)
def test_what_turning_between_the_rows_moves(good, monkeypatch, off, left, said):
    """What the parameters then are, one and a half times as far, with the width that they have."""
    best, made = good.estimate, []
    monkeypatch.setattr(turning, "untold", lambda *_: 1.0)

    def refit(logs):
        made.extend(logs)
        made_of = {"sse": left * best.sse, "rows": best.rows}
        return SimpleNamespace(sigma0=best.sigma0 * (1 + off), Fc=best.Fc, **made_of)

    found = turning.finding(good, refit, 0.001)
    assert [log.rows for log in made] == [log.rows for log in good.logs]
    assert bool(found) == said
    if said:
        low, high = found[0].reach["sigma0"]
        half = (best.ci95["sigma0"].high - best.ci95["sigma0"].low) / 2
        true = best.sigma0 / (1 + 1.5 * off)
        assert (low, high) == pytest.approx(
            (min(true - half, best.sigma0), max(true + half, best.sigma0))
        )
        assert list(found[0].reach) == ["sigma0"] and not found[0].doubts
