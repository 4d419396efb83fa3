# SPDX-License-Identifier: MIT
"""The claims of an identification keep to the rule; a Result gives a program residuals, draws and
predictions.
"""

import itertools
import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import field_logs
import hostile_logs
import motor_logs
import numpy as np
import pytest
from dahl import Error
from dahl.identify import Log, Options, Result, check, identify, refusals, report
from identify_tools import (
    COUNT,
    FC,
    SIGMA0,
    chirp,
    dahl_torque,
    log_of,
    noise_of,
    seen,
    shaft,
    sine,
    synthetic,
)
from scipy.signal import lfilter

TRUTH = {"sigma0": SIGMA0, "Fc": FC}
MAX_HALF_WIDTH, MIN_CYCLES = 0.3, 6


def machine(seed: int, sigma0: float = 1.0, Fc: float = 1.0, late: int = 0, side: int = 1) -> Log:  # noqa: N803
    """A log of a machine whose parameters are these parts of the usual ones."""
    theta = sine(seed, rows=1600, cycles=6.3)
    torque = side * np.roll(dahl_torque(theta, sigma0 * SIGMA0, Fc * FC), late)
    return replace(log_of(theta[20:], torque[20:], 0.01), name=f"log {seed}")


def coarse(counts: float) -> Log:
    """An encoder with this number of counts in a presliding length."""
    theta = sine(2, rows=2400, cycles=8)
    return log_of(theta, dahl_torque(theta), 0.02, FC / SIGMA0 / counts)


def coarse_torque() -> Log:
    log = shaft(noise=0.0)
    return replace(log, torque=np.round(4 * log.torque / FC) * FC / 4)


def coulomb() -> Log:
    theta = np.floor(sine(5, rows=1500, cycles=8) / COUNT) * COUNT
    return log_of(theta, dahl_torque(theta, 1e6), 0.05)


def never_slips() -> Log:
    theta = sine(1, rows=2400, cycles=8, amplitude=0.1 * FC / SIGMA0)
    return log_of(theta, SIGMA0 * theta, 0.01, 0.0)


def noise_alone() -> Log:
    return Log("x", sine(1, rows=1500, cycles=8), noise_of(1, 1500), np.arange(1500) * 1e-3)


def few(cycles: float) -> Log:
    return synthetic(int(cycles), 0.01, rows=900 + 100 * int(cycles), cycles=cycles)


def fading_peak() -> Log:
    """A peak of 40 % of Fc after each turn, which fades over five presliding lengths."""
    theta = chirp(4000, amplitude=0.075, first=6)
    travel, side = np.cumsum(np.abs(np.diff(theta, prepend=0.0))), np.sign(np.gradient(theta))
    turned = np.diff(side, prepend=side[0]) != 0
    since = SIGMA0 / FC * (travel - np.maximum.accumulate(np.where(turned, travel, 0.0)))
    peak = 0.4 * FC * side * np.exp(-since / 5) * (1 - np.exp(-since))
    return log_of(theta, dahl_torque(theta) + peak, 0.01)


SMOOTH, ABRUPT = (1 - np.cos(np.pi * np.linspace(0, 1, 150))) / 2, np.linspace(0, 1, 150)


def strokes_and_rests(stroke: np.ndarray) -> np.ndarray:
    """Strokes of other lengths with a rest after each, rad."""
    ends = 0.05 * np.resize([1.0, -0.9, 0.8, -1.0, 0.9, -0.8], 18)
    parts = [
        np.append(start + (end - start) * stroke, np.full(100, end))
        for start, end in itertools.pairwise(ends)
    ]
    return np.concatenate(parts).round(9)  # exact rests


def stops(noise: float) -> Log:
    """Abrupt stops, by an angle without counts."""
    theta = strokes_and_rests(ABRUPT)
    return log_of(theta + noise * noise_of(4, len(theta)), dahl_torque(theta), 0.01, 0.0)


BY_ANGLE = hostile_logs.KINDS["Fc by angle 12 %"]
YES, NO, EITHER = True, False, None
CASES: dict[str, tuple[Callable[[], list[Log]], tuple[bool | None, bool | None], str]] = {
    # logs; whether sigma0 and Fc are claimed; words of the verdict
    "nothing wrong": (lambda: [shaft()], (YES, YES), "sigma0 = "),
    "noise of 20 %": (lambda: [shaft(5, 0.2)], (EITHER, YES), "Fc = "),
    "noise of 300 %": (lambda: [shaft(5, 3.0)], (NO, NO), "explains"),
    "noise alone": (lambda: [noise_alone()], (NO, NO), "explains"),
    "two cycles": (lambda: [few(2.3)], (NO, NO), "2 cycles"),
    "five cycles": (lambda: [few(5.2)], (NO, NO), "5 cycles"),
    "three and four": (lambda: [few(3.6), few(4.6)], (EITHER, YES), "Fc = "),
    "1.5 counts": (lambda: [coarse(1.5)], (EITHER, YES), "Fc = "),
    "four levels in Fc": (lambda: [coarse_torque()], (YES, YES), "Fc = "),
    "a bare sign": (lambda: [coulomb()], (NO, YES), "sigma0 is not identifiable"),
    "fading peak": (lambda: [fading_peak()], (NO, NO), "shape since the turn"),
    "Fc by angle": (lambda: [BY_ANGLE(9048)], (EITHER, EITHER), "Fc by angle"),
    "never slips": (lambda: [never_slips()], (EITHER, NO), "Fc is not identifiable"),
    "two machines": (lambda: [machine(1), machine(2, 1.3)], (EITHER, EITHER), ""),
    "sensor turned in one": (lambda: [machine(1), machine(2, side=-1)], (EITHER, EITHER), ""),
    "sensor turned in both": (lambda: [machine(k, side=-1) for k in (1, 2)], (YES, YES), ""),
    "abrupt stops": (lambda: [stops(0.0)], (YES, YES), "sigma0 = "),
    "abrupt stops, noise": (lambda: [stops(1e-5)], (YES, YES), "sigma0 = "),
    "other delays": (lambda: [machine(1), machine(2, late=4)], (YES, YES), ""),
}


@cache
def found(name: str) -> Result:
    return identify(CASES[name][0]())


@pytest.mark.parametrize("name", CASES)
def test_what_is_claimed(name):
    result, (_, claimed, words) = found(name), CASES[name]
    for is_claimed, wanted in zip(result.claimed, claimed, strict=True):
        assert wanted is EITHER or is_claimed is wanted, result.verdict
    assert words in result.verdict
    for parameter, is_claimed in zip(TRUTH, result.claimed, strict=True):
        p = getattr(result, parameter)
        if is_claimed:
            assert p.low <= TRUTH[parameter] <= p.high, result.verdict
            assert p.half_width <= MAX_HALF_WIDTH and result.samples.cycles >= MIN_CYCLES
            assert f"{parameter} = {p.value:.4g}" in result.verdict
        else:
            assert f"{parameter} is not identifiable" in result.verdict and result.reasons
    for p in (result.a, result.sigma0, result.Fc):
        assert 0 <= p.low <= p.value <= p.high
    json.loads(report.as_json(result), parse_constant=pytest.fail)


@pytest.mark.parametrize("name", CASES)
def test_the_verdict_names_the_largest_source_of_each_width(name):
    result = found(name)
    widths = {source: width.tolist() for source, width in result.intervals.widths.items()}
    counts = widths.pop("counts", [0.0, 0.0])  # the others are cumulative
    for k, parameter in enumerate((result.sigma0, result.Fc)):
        ends = [0.0, *(width[k] for width in widths.values() if np.isfinite(width[k]))]
        own = {**dict(zip(widths, np.diff(ends).tolist(), strict=False)), "counts": counts[k]}
        assert own[parameter.uncertainty] == max(own.values())


@pytest.mark.parametrize("name", CASES)
def test_an_interval_is_made_of_its_sources(name):
    """Plausible fits and lacks of fit lie in it; what counts hide is added as independent."""
    result = found(name)
    i, widths = result.intervals, result.intervals.widths
    for fit in result.plausible.fits:
        assert (i.low <= fit.value).all() and (fit.value <= i.high).all()
    for lack in result.lacks:
        assert (i.low <= lack.low).all() and (lack.high <= i.high).all()
    counts = widths.get("counts", np.zeros(2)) * i.value
    with np.errstate(invalid="ignore"):
        apart = [np.sqrt((end - i.value) ** 2 - counts**2) for end in (i.low, i.high)]
    own, without_counts = widths["lack of fit"], sum(apart) / 2 / i.value
    for k in np.flatnonzero(np.isfinite(i.low) & np.isfinite(i.high) & np.isfinite(counts)):
        assert own[k] - 1e-9 <= without_counts[k] <= own[k] + 0.003  # the error of any law
        assert widths["hypotheses"][k] <= own[k]


def at_one_speed(seconds: int, stroke_s: int, speed: float) -> np.ndarray:
    """Strokes at one speed with short ramps at 1 kHz, rad."""
    way = np.where(np.arange(1000 * seconds) // (1000 * stroke_s) % 2, -speed, speed)
    theta = np.cumsum(np.convolve(way, np.ones(50) / 50, "same")) * 1e-3
    return theta - theta.mean()


@pytest.mark.parametrize(
    ("motion", "sigma0", "limit"),
    [((400, 2, 0.3), 4000.0, 2.0), ((240, 8, 1.0), SIGMA0, FC)],
    ids=["100 strokes", "constant speed"],
)
def test_minutes_of_strokes_at_one_speed_are_claimed(motion, sigma0, limit):
    """Viscous friction is the same torque in them, but for the turns."""
    theta, count = at_one_speed(*motion), COUNT / 64
    torque = dahl_torque(theta, sigma0, limit) + 0.03 * limit * noise_of(1, len(theta))
    read = np.floor(theta / count) * count
    log = Log("long", read, torque, np.arange(len(theta)) * 1e-3, resolution=count)
    result = identify([log])
    assert result.claimed == (True, True), result.verdict
    for p, true in ((result.sigma0, sigma0), (result.Fc, limit)):
        assert p.low <= true <= p.high and (p.high - p.low) / 2 < 0.1 * p.value


PATH = chirp(2400, first=5, last=11)


def test_a_periodic_error_of_the_encoder_is_taken_out_of_the_angle():
    error = 2 * COUNT * np.sin(2 * np.pi * PATH / (32 * COUNT))
    log = log_of(PATH + error, dahl_torque(PATH), 0.01)
    result = identify([log], Options(terms=("offset",), delay=False))
    assert result.sigma0.value == pytest.approx(SIGMA0, rel=0.05)
    assert not any("each 32 counts" in reason for reason in result.reasons)


def quick_sine(rows_per_cycle: float, late: int = 0, side: int = 1, rows: int = 3000) -> Log:
    """A sine of few rows a cycle, with a late torque of either sign, at 200 Hz."""
    theta = 0.05 * np.sin(2 * np.pi * (np.arange(rows + 10) / rows_per_cycle))
    torque = side * np.roll(dahl_torque(theta), late)
    return log_of(theta[10:], torque[10:], 0.03)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(("rows", "late"), [(16.3, 0), (21.4, 0), (24.3, 1), (37.7, 2), (55.1, 1)])
def test_a_quick_sine_has_its_sign_and_no_delay_of_half_a_stroke(rows, late, side):
    result = identify([quick_sine(rows, late, side)])
    assert result.sign == side and abs(result.delay_rows) < rows / 4
    for p, true in ((result.sigma0, SIGMA0), (result.Fc, FC)):
        assert not p.claimed or p.low <= true <= p.high, result.verdict


@pytest.mark.parametrize("turned", [(0,), (1, 2), (0, 1, 2)])
def test_each_log_has_a_sign(turned):
    """Also a log that is only predicted."""
    logs = [machine(k, side=-1 if k in turned else 1) for k in range(3)]
    result = identify(logs)
    assert result.claimed == (True, True), result.verdict
    assert result.sigma0.low <= SIGMA0 <= result.sigma0.high
    assert result.Fc.low <= FC <= result.Fc.high
    notes = [note for log in result.logs for note in log.notes if "other sign" in note]
    assert len(notes) == (2 if len(turned) < 3 else 0)
    for side in (1, -1):
        assert check(result, machine(4, side=side)) > 0.99


SWAPPED = {
    "a log": shaft,
    "without an encoder": lambda: log_of(PATH, dahl_torque(PATH), 0.02, 0.0),
    "turned torque": lambda: replace(shaft(), torque=-shaft().torque),
    "little noise": lambda: shaft(noise=0.005),
    "a spring": lambda: log_of(PATH, dahl_torque(PATH) + 4 * PATH, 0.02),
}


@pytest.mark.parametrize("kind", SWAPPED)
def test_swapped_columns_are_named_if_they_are(kind):
    log = SWAPPED[kind]()
    swapped = replace(log, theta=log.torque, torque=log.theta, resolution=0.0)
    try:
        result = identify([swapped], Options(trust_units=True))
        assert result.claimed == (False, False) and "swapped" in result.verdict
    except Error as error:
        assert "swapped" in str(error)
    right = identify([log])
    assert "swapped" not in right.verdict and right.claimed[1]


def test_a_spring_alone_is_not_swapped():
    time = np.arange(12000) * 1e-3
    theta = 0.05 * np.sin(6 * time) * np.sin(0.7 * time)
    torque = 2 * theta + 0.001 * np.random.default_rng(3).normal(size=12000)
    result = identify([Log("spring", theta, torque, time)])
    assert not any(result.claimed) and "swapped" not in result.verdict


def part(x: np.ndarray) -> np.ndarray:
    return FC * x / np.abs(x).max()


SPEED, ACCELERATION = np.gradient(PATH), np.gradient(np.gradient(PATH))
NO_FRICTION = {  # torques along PATH, noise in Fc, counts; whether friction is missing
    "spring": (part(PATH), 0.01, COUNT, True),
    "exact spring": (part(PATH), 0.0, 0.0, True),
    "exact spring, read by counts": (part(PATH), 0.0, COUNT, True),
    "spring with noise": (part(PATH), 0.2, 0.0, True),
    "stiffening spring": (part(PATH + 400 * PATH**3), 0.01, COUNT, True),
    "gravity": (part(np.sin(20 * PATH + 0.4)), 0.01, COUNT, True),
    "spring and inertia": (part(PATH) + part(ACCELERATION), 0.02, COUNT, True),
    "viscous": (part(SPEED), 0.01, COUNT, True),
    "friction": (dahl_torque(PATH), 0.02, COUNT, False),
    "friction in noise": (dahl_torque(PATH), 3.0, COUNT, False),
    "a spring and friction": (4 * part(PATH) + dahl_torque(PATH), 0.5, COUNT, False),
    "noise alone": (0 * PATH, 1.0, COUNT, False),
}


@pytest.mark.parametrize("kind", NO_FRICTION)
def test_missing_friction_is_the_reason_if_it_is_missing(kind):
    torque, noise, count, is_missing = NO_FRICTION[kind]
    result = identify([log_of(PATH, torque, noise, count)])
    step = refusals.next_step("no friction")
    assert [step in one for one in result.refusals.values()] == [is_missing] * len(result.refusals)
    assert ("no friction is seen" in result.verdict) is is_missing
    assert not (is_missing and any(result.claimed))


@pytest.mark.parametrize("seed", range(3))
def test_a_claimed_fit_has_no_negative_inertia(seed):
    """The torque is early, which a negative inertia would describe."""
    theta = chirp(2400, first=4 + seed)
    early = np.interp(np.arange(2400) + 1.4, np.arange(2400), dahl_torque(theta))
    result = identify([log_of(theta, early - 1e-5 * np.gradient(np.gradient(theta)) * 1e6, 0.01)])
    assert result.terms.get("inertia", 0.0) >= 0 or not any(result.claimed)


def test_a_log_without_strokes_is_refused_with_a_next_step():
    theta = np.linspace(0, 1, 600)
    with pytest.raises(Error, match=r"rig: no friction law fits; record strokes to and fro"):
        identify([log_of(theta, FC + 0 * theta)])


@pytest.mark.parametrize("seed", [6017, 6035])
def test_a_motor_current_in_a_loop_is_claimed(seed):
    """Stribeck friction and a late torque; a loop that answers counts of the encoder."""
    result = identify([motor_logs.log(seed)])
    assert result.claimed == (True, True), result.verdict
    assert result.sigma0.low <= SIGMA0 <= result.sigma0.high
    assert result.Fc.low <= FC <= result.Fc.high


def test_a_loop_that_hardly_moves_does_not_show_full_slip():
    result = identify([motor_logs.log(114)])  # 1.2 presliding lengths in all, .29 N m
    assert not result.Fc.claimed or result.Fc.low <= FC <= result.Fc.high, result.verdict


def test_each_refusal_has_a_row_in_the_page(root):
    page = (root / "docs" / "identify.md").read_text().replace("`", "")
    for reason, step in refusals.NEXT_STEPS.items():
        assert f"| {reason} | {step} |" in page
    result = found("noise alone")
    assert result.refusals["Fc"][1] in refusals.NEXT_STEPS.values()
    assert f"next: {result.refusals['Fc'][1]}" in result.verdict


CAUSES = {  # of a log: words that it must show, and words of wrong causes
    ("cogging", 61001): ("cogging", "encoder error each"),
    ("random strokes", 61001): ("travel that a count hides", "play"),
    ("pause", 61005): ("gap", "wrap"),
    ("clipped on one side", 61001): ("wider range", "asymmetric"),
    ("clipped sensor", 61006): ("wider range", "asymmetric"),
    ("rests with relaxation", 61001): ("in the rests", "presliding is shorter"),
    ("adhesion after rests", 61000): ("peak after each rest", "torque that lags"),
    ("preloaded play", 61001): ("no hypothesis explains", "due to travel"),
    ("end stops", 61001): ("no hypothesis explains", "more counts"),
    ("play and eccentric gear", 61003): ("a play is between", "encoder error each"),
    ("flipped torque", 61001): ("the other sign", "swapped"),
    ("warming up", 61001): ("drift", "viscous would"),
    ("merged buses", 61001): ("a new reading every 4 rows", "low pass"),
    ("drifting zero", 61001): ("offset drift", "Fc by angle"),
}


@pytest.mark.parametrize(("kind", "seed"), CAUSES)
def test_a_result_names_the_cause_of_what_is_wrong(kind, seed):
    words, wrong = CAUSES[kind, seed]
    try:
        result = identify([(hostile_logs.KINDS | field_logs.KINDS)[kind](seed)])
        rows = dict(report._rows(result, report.numbers(result)))
        shown = [result.verdict, *report.notes(result), rows["law"], result.against_bounds]
    except Error as error:
        shown = [str(error)]
    assert words in "; ".join(shown) and wrong not in "; ".join(shown), shown


def test_a_spring_that_stiffens_is_a_cubic_term():
    torque = dahl_torque(PATH) + 0.3 * FC * (PATH / 0.05) ** 3
    terms = identify([log_of(PATH, torque, 0.01)]).terms
    assert terms["cubic"] == pytest.approx(0.3 * FC / 0.05**3, rel=0.03)
    assert abs(terms["spring"]) < 0.05 * FC / 0.05


# --- the interface for programs -------------------------------------------------------------------


@cache
def plain() -> Result:
    theta = chirp(2400, first=6, last=12)
    torque = dahl_torque(theta) + 0.1 + 0.02 * np.gradient(theta, 1e-3)
    return identify([log_of(theta, torque, 0.05)])


def test_residuals_and_the_data_frame():
    result = plain()
    table = result.to_dataframe()
    names = ["log", "time", "angle", "speed", "torque", "predicted", "residual", "weight"]
    assert list(table.columns) == names and len(table) == result.samples.rows == 2400
    assert set(table["log"]) == {"rig"} and table["weight"].iloc[0] == 0  # the start is unknown
    log, speed = result.raw[0], np.gradient(chirp(2400, first=6, last=12), 1e-3)
    assert np.array_equal(table[["time", "torque"]].to_numpy().T, (log.time, log.torque))
    assert np.abs(table["angle"] - log.theta).max() <= 0.51 * COUNT
    assert np.abs(table["speed"] - speed)[100:-100].max() < 0.02 * np.abs(speed).max()
    left = table["torque"] - table["predicted"]
    assert left.to_numpy() == pytest.approx(table["residual"].to_numpy())
    used = table["weight"] > 0
    assert table["residual"][used].std() == pytest.approx(0.05 * FC, rel=0.1)
    assert result.a.value == pytest.approx(result.sigma0.value / result.Fc.value)


def test_bootstrap_draws_and_parameters_cycle_by_cycle():
    result, truth = plain(), pytest.approx([SIGMA0, FC], rel=0.02)
    draws, cycles = result.bootstrap(), result.by_cycle()
    assert draws.mean(axis=0) == truth and draws.std(axis=0) == pytest.approx(
        result.chosen.error, rel=0.5
    )
    assert result.correlation == pytest.approx(np.corrcoef(draws.T)[0, 1])
    assert np.array_equal(draws, result.bootstrap())
    assert not np.array_equal(draws, result.bootstrap(seed=1)) and len(result.bootstrap(7)) == 7
    assert {len(values) for values in cycles.values()} == {len(result.samples.folds)}
    assert cycles["Fc"] == pytest.approx(np.full(len(cycles["Fc"]), FC), rel=0.1)
    assert np.median(cycles["sigma0"]) == pytest.approx(SIGMA0, rel=0.1)
    assert np.median(cycles["offset"]) == pytest.approx(0.1, rel=0.1)


def test_a_torque_without_friction_is_scored_on_cycles_left_out():
    """Against weighted least squares of the terms without each cycle."""
    result = plain()
    s, terms = result.samples, [*result.terms]
    assert terms == ["offset", "viscous"]
    columns, root = np.column_stack((np.ones(s.rows), s.speed)), np.sqrt(s.used)
    cycles, left = [np.arange(s.rows)[fold] for fold in s.folds], 0.0
    for cycle in cycles:
        others = np.setdiff1d(np.concatenate(cycles), cycle)
        weighted = columns[others] * root[others, None]
        c = np.linalg.lstsq(weighted, s.torque[others] * root[others], rcond=None)[0]
        left += np.sum(((s.torque - columns @ c) * root)[cycle] ** 2)
    found = report.numbers(result)["held_out"]["none"]
    assert found["rmse"] == pytest.approx(np.sqrt(left / s.used.sum()), rel=1e-4)


def test_a_filter_keeps_its_time_on_a_log_with_other_blocks():
    """The long log is thinned to samples of several rows, the short one is not."""
    logs = []
    for rows in (40_000, 8_000):
        theta = chirp(rows, first=8 * rows / 40_000, last=12 * rows / 40_000)
        torque = lfilter([1 / 200], [1, 1 / 200 - 1], dahl_torque(theta))
        logs.append(log_of(theta, torque))
    result = identify(logs[:1])
    assert result.samples.block > 1 and "low pass" in result.hypothesis.lag.name
    assert check(result, logs[1]) > 0.995


def test_a_log_without_an_encoder_is_predicted_though_the_fit_used_counts_as_read():
    count, theta = FC / SIGMA0 / 2, chirp(2400)
    read = np.floor(theta / count + 0.3) * count
    torque = dahl_torque(read) + 0.01 * FC * noise_of(3, 2400)
    log = Log("rig", read, torque, np.arange(2400) * 1e-3, resolution=count)
    result = identify([log], Options(terms=("offset",), delay=False))
    assert result.hypothesis.angle == "as read" and check(result, log) > 0.998
    assert check(result, log_of(theta, dahl_torque(theta), 0.01, 0.0)) > 0.98


def test_another_log_is_predicted_with_the_mean_of_several_delays():
    logs = []
    for number, delay in enumerate((0, 12, 6)):
        theta = chirp(3000)
        torque = np.roll(dahl_torque(theta), delay)[20:]
        logs.append(replace(log_of(theta[20:], torque, 0.01), name=f"{number}"))
    result = identify(logs[:2])
    assert result.hypothesis.lag.name == "delays"
    assert check(result, logs[2]) > 0.995


@pytest.mark.parametrize("noise", [0.0, 1e-5])
@pytest.mark.parametrize("stroke", [SMOOTH, ABRUPT])
def test_coulomb_friction_keeps_its_sign_in_a_rest(stroke, noise):
    theta = strokes_and_rests(stroke)
    torque, moves = dahl_torque(theta), np.diff(theta, prepend=theta[0])
    moving = np.maximum.accumulate(np.where(moves != 0, np.arange(len(theta)), 0))
    columns = np.column_stack((np.sign(moves)[moving], np.ones(len(theta))))
    _, (left,), *_ = np.linalg.lstsq(columns, torque, rcond=None)
    read = theta + noise * noise_of(4, len(theta))
    found = seen(log_of(read, torque, 0.01, 0.0), terms=("offset",), delay=False)
    assert found["r2_coulomb"] == pytest.approx(1 - left / len(theta) / torque.var(), abs=0.03)


@pytest.mark.parametrize("term", ["viscous", "inertia"])
def test_a_term_of_the_speed_needs_times(term):
    for time in (None, np.full(2400, 5.0)):
        untimed = replace(shaft(), name="untimed", time=time)
        for logs in ([untimed], [shaft(), untimed]):
            with pytest.raises(Error, match=f"untimed: {term}.*time"):
                identify(logs, Options(terms=("offset", term)))


@pytest.mark.parametrize(
    ("motion", "words"),
    [
        (0.05 * np.sin(np.arange(2400) / 48), ("one speed", "the same turning points")),
        (0.02 * np.sin(np.arange(3600) / 80) + 0.04 * np.sin(np.arange(3600) / 33), ()),
    ],
)
def test_a_motion_of_equal_strokes_is_named(motion, words):
    found = seen(log_of(motion, dahl_torque(motion)))
    assert found["identifiable"]["sigma0"]
    alike = [note for note in found["notes"] if "all strokes have" in note]
    assert all(word in note for note in alike for word in words)
    assert bool(alike) == bool(words)
