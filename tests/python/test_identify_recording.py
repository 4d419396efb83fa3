# SPDX-License-Identifier: MIT
"""What a recording does to a log is put right and named, or refused: a grid that is not the
encoder's, degrees for rad, gaps of the clock, wraps, repeated rows, channels read seldom.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dahl import Error
from dahl.identify import pipeline
from dahl.identify.log import Log
from identify_tools import COUNT, FC, SIGMA0, dahl_torque, noise_of, sine, synthetic, write_csv
from log_reading import read, refused

pytestmark = pytest.mark.usefixtures("library")


def holds_the_truth(result) -> bool:
    pairs = ((result.estimate.ci95["sigma0"], SIGMA0), (result.estimate.ci95["Fc"], FC))
    return all(one.low <= truth <= one.high for one, truth in pairs)


def some(log: Log, rows: np.ndarray | slice) -> Log:
    """Some rows of a log."""
    return replace(
        log, theta=log.theta[rows], torque=log.torque[rows], time=log.time[rows], notes=[]
    )


def told(result, words: str) -> list[str]:
    return [note for note in result.notes if words in note]


# --- the encoder ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("counts", "said"), [(16384, ""), (8192, "16384"), (32768, "16384"), (16000, "16384")]
)
def test_counts_per_turn_against_the_grid(tmp_path, counts, said):
    theta = np.floor(sine(1, rows=4000, cycles=8) / COUNT) * COUNT
    path = write_csv(tmp_path / "a.csv", theta, dahl_torque(theta) + 0.01 * noise_of(1, 4000))
    log = read(path, "--counts-per-turn", counts)
    result = pipeline.identify([log])
    assert (f"{said} counts a turn" in result.verdict.text) is bool(said)
    assert bool(result.plan.against) is bool(said)
    for options in (pipeline.Options(trust_units=True), pipeline.Options(target_counts=8192)):
        against = pipeline.identify([log], options).plan.against
        assert not any("counts" in words for words in against)


@pytest.mark.parametrize("bits", [10, 12, 14, 18])
@pytest.mark.parametrize(("unit", "meant"), [("deg", "rad"), ("rad", "deg")])
def test_degrees_and_rad_are_told_apart_both_ways(tmp_path, bits, unit, meant):
    """By the encoder's grid; the right unit passes, and the wrong one where it is to be trusted."""
    count = 2 * np.pi / 2**bits
    theta = np.floor(sine(1, rows=2000, cycles=4, amplitude=0.5) / count) * count
    torque = dahl_torque(theta) + 0.01 * noise_of(1, 2000)
    values = theta if meant == "rad" else np.degrees(theta)
    table = "\n".join(f"{x:.9g},{y:.9g}" for x, y in zip(values, torque, strict=True))
    path = tmp_path / "a.csv"
    path.write_text(f"angle_{meant},torque_Nm\n{table}\n")
    assert read(path).rows == 2000
    path.write_text(f"angle_{unit},torque_Nm\n{table}\n")
    assert f"angle in {meant}" in refused(path)
    assert read(path, "--trust-units").rows == 2000


# --- gaps of the clock ----------------------------------------------------------------------------


def without_turns(log: Log, rows: int = 837) -> tuple[Log, int]:
    """A log that lost every third reversal, with `rows` rows around each."""
    turns = np.flatnonzero(np.diff(np.sign(np.diff(sine(int(log.name[5:]))))) != 0)[1:18:3]
    keep = np.ones(log.rows, dtype=bool)
    for turn in turns:
        keep[max(turn - rows // 2, 0) : turn + rows // 2] = False
    return some(log, keep), len(turns)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_log_is_split_at_the_gaps_of_its_clock(seed):
    """Reversals that nobody saw: with the gaps joined, sigma0 is far off."""
    log, gaps = without_turns(synthetic(seed))
    result = pipeline.identify([log])
    assert len(result.logs) == gaps + 1 and told(result, f"{gaps} gaps")
    assert sum(piece.rows for piece in result.logs) == log.rows
    assert holds_the_truth(result)
    joined = pipeline.identify([replace(log, time=None)]).estimate.sigma0
    assert abs(joined / SIGMA0 - 1) > 0.1 > 10 * abs(result.estimate.sigma0 / SIGMA0 - 1)
    assert pipeline.check(result, log) == pytest.approx(result.r2, abs=0.002)


@pytest.mark.parametrize("clock", ["jitter", "coarse", "in bursts", "by edge", "stands still"])
def test_a_clock_without_gaps_splits_nothing(clock):
    rng = np.random.default_rng(1)
    log = synthetic(1, rows=6000, cycles=6)
    if clock == "jitter":
        log.time = np.cumsum(rng.uniform(0.5e-3, 1.5e-3, log.rows))
    elif clock == "in bursts":
        log.time = np.cumsum(np.where(np.arange(log.rows) % 10, 1e-4, 1e-3))
    elif clock == "coarse":
        log.time = np.floor(log.time / 0.004) * 0.004
    elif clock == "stands still":
        log.time = np.zeros(log.rows)
    elif clock == "by edge":
        log = some(log, np.concatenate(([True], np.diff(log.theta) != 0)))
    result = pipeline.identify([log])
    (whole,) = result.logs
    assert whole.rows == log.rows and not told(result, "gap")
    assert bool(told(result, "spread evenly")) is (clock == "coarse")
    if clock == "coarse":
        assert np.diff(whole.time) == pytest.approx(1e-3)
    if clock == "stands still":
        assert whole.time is None and told(result, "not used")


def test_pieces_too_short_or_at_rest_are_left_out():
    log = synthetic(1, rows=6000, cycles=12)
    keep = np.ones(6000, dtype=bool)
    keep[2000:2100] = keep[2120:2300] = keep[3000:3100] = False
    log.theta[2300:3000] = log.theta[2300]
    result = pipeline.identify([some(log, keep)])
    assert [piece.rows for piece in result.logs] == [2000, 2900] and told(result, "720 rows")


# --- a channel that is read more seldom than the other --------------------------------------------


@pytest.mark.parametrize("every", [2.0, 5.0, 4.4])
@pytest.mark.parametrize("resolution", [COUNT, 0.0])
def test_rows_between_two_readings_of_the_angle_are_left_out(every, resolution):
    log = synthetic(3, rows=6000, cycles=20)
    if not resolution:
        theta = sine(3, rows=6000, cycles=20)
        log = replace(log, theta=theta, torque=dahl_torque(theta), resolution=0.0)
    held = np.ceil(np.floor(np.arange(log.rows) / every) * every).astype(int)
    result = pipeline.identify([replace(log, theta=log.theta[held])])
    claimed = result.verdict.identifiable["sigma0"]
    assert claimed or every == 4.4  # rows that are not evenly spread look noisy
    assert not claimed or result.estimate.sigma0 == pytest.approx(SIGMA0, rel=0.02)
    rows = result.logs[0].rows
    assert rows == pytest.approx(6000 / every, rel=0.1)
    assert len(told(result, f"every {round(every)} rows only: the {6000 - rows} rows")) == 1


def test_rows_that_are_left_have_a_reading_of_their_own():
    """Where the angle stands still for several readings each of them counts."""
    stairs = [0.0, 2, 4, 4, 4, 6, 3, 0, 0, 3, 6, 9] * 9
    theta = np.repeat(stairs, 4) * COUNT
    log = Log("x", theta, np.arange(theta.size) * 1.0, np.arange(theta.size) * 1.0)
    log.resolution = COUNT
    trust = pipeline.Options(terms=(), delay=False, trust_units=True)
    result = pipeline.identify([log], trust)
    assert result.raw[0].torque.tolist() == [4.0 * k for k in range(1, len(stairs))]
    slow = pipeline.identify([replace(log, theta=theta / 3)], trust)
    assert slow.raw[0].rows == log.rows  # counts of a slow motion do that too
    with pytest.raises(Error, match=r"every 4 rows only: 11 readings, at least 30"):
        pipeline.identify([some(log, slice(0, 48))])


def seldom(log: Log, every: int, straight: bool, first: int = 0) -> Log:
    """With a torque of every so many rows, held or drawn straight from one to the next."""
    rows = np.arange(log.rows)
    read_at = rows[first::every]
    last = np.maximum((rows - first) // every * every + first, first)
    torque = np.interp(rows, read_at, log.torque[read_at]) if straight else log.torque[last]
    return replace(log, torque=torque)


@pytest.mark.parametrize(("every", "straight"), [(4, True), (20, False), (20, True), (33, False)])
def test_a_torque_read_at_some_rows_weighs_at_those(every, straight):
    """Seen as one of each row it gave sigma0 2 to 30 % low, in an interval without the truth."""
    log = seldom(synthetic(2, part=0.02, rows=16_000, cycles=15.3), every, straight, first=3)
    log.torque = log.torque.round(6)
    result = pipeline.identify([log])
    assert result.verdict.identifiable == {"sigma0": True, "Fc": True}
    for name, truth in (("sigma0", SIGMA0), ("Fc", FC)):
        ends = result.estimate.ci95[name]
        assert ends.low < truth < ends.high < 1.1 * ends.low
    assert result.estimate.sigma0 == pytest.approx(SIGMA0, rel=0.015)
    assert result.estimate.rows == pytest.approx(16_000 / every, rel=0.1)
    weighing = np.flatnonzero(result.logs[0].weight)
    assert set(weighing) <= set(range(3, 16_000, every)) and len(weighing) > 0.9 * 16_000 / every
    assert result.rmse == pytest.approx(0.02 * FC, rel=0.1)
    assert len(told(result, f"torque has a new reading every {every} rows only: the 1")) == 1
    assert not told(result, "disagree")


@pytest.mark.parametrize("every", [21])
def test_a_torque_read_at_some_rows_that_comes_late(every):
    log = synthetic(3, part=0.02, rows=20_000, cycles=19.37)
    log.torque = np.concatenate((np.repeat(log.torque[:1], 7), log.torque[:-7]))
    result = pipeline.identify([seldom(log, every, straight=False)])
    assert result.delay == 7
    assert result.estimate.sigma0 == pytest.approx(SIGMA0, rel=0.02)


def test_too_few_readings_of_the_torque_are_refused():
    log = seldom(some(synthetic(3), slice(0, 1050)), 35, straight=False)
    with pytest.raises(Error, match=r"every 35 rows only: 29 readings, at least 30"):
        pipeline.identify([log])


SMOOTH = dahl_torque(sine(3, rows=6000, cycles=40))
DRY = np.sign(np.sin(np.arange(6000) * 0.05))  # 0 in the first row
SPRING = np.abs(np.arange(6000) / 63 % 2 - 1)  # of a motion to and fro at one speed
NOISY = SMOOTH + 0.01 * noise_of(3, 6000)
EACH_ROW = {
    "smooth": SMOOTH,
    "noisy": NOISY,
    "two digits": NOISY.round(2),
    "a step every 20 rows, by the last digit": np.round(np.linspace(0, 3, 6000), 2),
    "rows that repeat at odd places": np.repeat(NOISY, np.arange(6000) % 3 + 1)[:6000],
    "dry": DRY + 1e-9 * SPRING,
    "a spring": SPRING,
    "dry and a spring": DRY + SPRING,
    "dry and noise": DRY + 0.06 * noise_of(3, 6000),
}


@pytest.mark.parametrize("kind", EACH_ROW)
def test_a_torque_with_a_reading_in_each_row_stays(kind):
    log = Log("x", sine(3, rows=6000, cycles=40), EACH_ROW[kind])
    result = pipeline.identify([log], pipeline.Options(terms=("offset",), trust_units=True))
    assert not told(result, "new reading") and result.raw[0].weight is None


# --- wraps ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("counts", [128, 256, 200])
@pytest.mark.parametrize("offset", [0, 60])
def test_a_counter_that_wraps(counts, offset):
    """Powers of two are unwrapped, any other period is refused."""
    log = synthetic(1)  # covers 260 counts
    steps = np.round(log.theta / COUNT).astype(int)
    wrapped = replace(log, theta=((steps + offset) % counts) * COUNT)
    if counts == 200:
        with pytest.raises(Error, match="--trust-units"):
            pipeline.identify([wrapped])
        return
    result = pipeline.identify([wrapped])
    assert told(result, f"wraps {np.count_nonzero(np.abs(np.diff(wrapped.theta)) > 0.03)} times")
    assert np.diff(result.raw[0].theta) == pytest.approx(np.diff(log.theta))


@pytest.mark.parametrize("kind", ["spikes", "two levels", "coarse", "quick returns"])
def test_what_does_not_wrap(kind):
    log = synthetic(1, rows=20_000 if kind == "coarse" else 2000, cycles=8)
    theta, rows = log.theta.copy(), log.rows
    if kind == "spikes":
        theta[::500] = theta.max()
    elif kind == "two levels":
        theta = (theta > 0) * COUNT
    elif kind == "coarse":
        theta = theta[::400]
    elif kind == "quick returns":  # in one row each: two from end to end, one over two thirds
        theta = np.concatenate([np.linspace(low, 1, 500) for low in (0, 0, 1 / 3, 0)])
    rows = len(theta)
    log = replace(log, theta=theta, torque=log.torque[:rows], time=None)
    result = pipeline.identify([log], pipeline.Options(terms=("offset",), trust_units=False))
    assert not told(result, "wraps") and np.ptp(result.raw[0].theta) == np.ptp(theta)


# --- repeated rows --------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["each twice", "some"])
def test_repeated_rows_are_left_out_and_named(kind):
    log = synthetic(1, rows=4000, cycles=8)
    often = np.full(log.rows, 2)
    if kind == "some":
        often = 1 + (np.random.default_rng(1).uniform(size=log.rows) < 0.1)
    rows = np.repeat(np.arange(log.rows), often)
    result = pipeline.identify([replace(some(log, rows), time=np.arange(len(rows)) * 1e-3)])
    assert np.array_equal(result.raw[0].torque, log.torque)
    assert told(result, f"{len(rows) - log.rows} of {len(rows)} rows")


@pytest.mark.parametrize(
    "kind", ["noise", "computed", "computed, with rests", "coarse torque", "at rest", "loads"]
)
def test_rows_that_are_alike_for_other_reasons_stay(kind):
    log = synthetic(1, rows=4000, cycles=8)
    if kind == "computed":
        log.torque = dahl_torque(log.theta)
    elif kind == "computed, with rests":
        rests = np.repeat(np.arange(log.rows), np.where(np.arange(log.rows) % 50, 1, 2))
        theta = sine(1, rows=4000, cycles=8)[rests]
        log = Log("x", theta, dahl_torque(theta), np.arange(len(rests)) * 1e-3)
    elif kind == "coarse torque":
        log.torque = np.round(log.torque / 0.05) * 0.05
    elif kind == "loads":  # one row before and one after another load is put on
        log = some(log, np.repeat(np.arange(log.rows), 2))
        log.load = np.arange(log.rows) % 2.0
    elif kind == "at rest":
        log.theta[500:] = log.theta[500]
        log.torque[500:] = log.torque[500]
    result = pipeline.identify([log], pipeline.Options(terms=("offset",)))
    assert not told(result, "repeat") and sum(one.rows for one in result.raw) == log.rows
