# SPDX-License-Identifier: MIT
"""What a recording does to a log is put right and named, or refused: units that were assumed, a
grid that is not the encoder's, degrees for rad, gaps of the clock, wraps, repeated rows.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dahl import Error
from dahl.identify import cycles, output, pipeline, readers, recording
from dahl.identify.log import Log
from identify_tools import (
    COUNT,
    FC,
    SIGMA0,
    dahl_torque,
    noise_of,
    sine,
    synthetic,
    write_csv,
)

pytestmark = pytest.mark.usefixtures("library")


def holds_the_truth(result) -> bool:
    pairs = ((result.estimate.ci95["sigma0"], SIGMA0), (result.estimate.ci95["Fc"], FC))
    return all(one.low <= truth <= one.high for one, truth in pairs)


# --- units and encoder ----------------------------------------------------------------------------

UP = [0.5 * i for i in range(60)]


def read(path, header: str, **source) -> list[str]:
    """The notes on a small log with these names of columns: time or not, angle, torque."""
    rows = [header, *(",".join([repr(x)] * len(header.split(","))) for x in UP)]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return readers.read(path, readers.Source(**source)).notes


@pytest.mark.parametrize(
    ("header", "source", "assumed"),
    [
        ("time_s,angle_deg,torque_Nm", {}, []),
        ("time_ms,angle_rad,torque_mNm", {}, []),
        ("angle,load", {"angle_unit": "rad", "torque_unit": "Nm"}, []),
        ("angle_deg,torque_A", {}, ["torque in Nm"]),
        ("angle_deg,torque [V]", {}, ["torque in Nm"]),
        ("angle,load", {}, ["angle in deg", "torque in Nm"]),
        ("t,angle,torque", {}, ["angle in deg", "torque in Nm", "time in s"]),
        ("position_mm,load", {"torque_unit": "N"}, []),
        ("position_mm,load", {}, ["torque in N"]),
        ("t,angle_deg,torque_Nm", {"time_unit": "ms"}, []),
    ],
)
def test_each_unit_that_was_assumed_is_named(tmp_path, header, source, assumed):
    notes = read(tmp_path / "log.csv", header, **source)
    assert [note.partition(":")[0].replace(" taken", "") for note in notes] == assumed


@pytest.mark.parametrize(
    ("counts", "said"),
    [(16384, ""), (8192, "16384"), (32768, "16384"), (16000, "16384")],
)
def test_counts_per_turn_against_the_grid(tmp_path, counts, said):
    theta = np.floor(sine(1, rows=2000, cycles=4) / COUNT) * COUNT
    path = write_csv(tmp_path / "a.csv", theta, dahl_torque(theta) + 0.01 * noise_of(1, 2000))
    log = readers.read(path, readers.Source(counts_per_turn=counts))
    result = pipeline.identify([log])
    assert (f"{said} counts a turn" in result.verdict.text) is bool(said)
    assert bool(result.plan.against) is bool(said)
    for options in (pipeline.Options(trust_units=True), pipeline.Options(target_counts=8192)):
        against = pipeline.identify([log], options).plan.against
        assert not any("counts" in words for words in against)


@pytest.mark.parametrize("bits", [10, 12, 14, 18])
@pytest.mark.parametrize(("unit", "meant"), [("deg", "rad"), ("rad", "deg")])
def test_degrees_and_rad_are_told_apart_both_ways(tmp_path, bits, unit, meant):
    """By the encoder's grid; the right unit passes."""
    count = 2 * np.pi / 2**bits
    theta = np.floor(sine(1, rows=2000, cycles=4, amplitude=0.5) / count) * count
    torque = dahl_torque(theta) + 0.01 * noise_of(1, 2000)
    values = theta if meant == "rad" else np.degrees(theta)
    table = "\n".join(f"{x:.9g},{y:.9g}" for x, y in zip(values, torque, strict=True))
    for name in (unit, meant):
        (tmp_path / "a.csv").write_text(f"angle_{name},torque_Nm\n{table}\n")
        log = readers.read(tmp_path / "a.csv", readers.Source())
        if name == meant:
            assert pipeline.identify([log]).estimate.Fc == pytest.approx(FC, rel=0.05)
        else:
            with pytest.raises(Error, match=f"is the angle in {meant}"):
                pipeline.identify([log])


# --- gaps of the clock ----------------------------------------------------------------------------


def without_turns(log, rows: int = 837):
    """A log that lost every third reversal, with `rows` rows around each."""
    turns = np.flatnonzero(np.diff(np.sign(np.diff(sine(int(log.name[5:]))))) != 0)[1:18:3]
    keep = np.ones(log.rows, dtype=bool)
    for turn in turns:
        keep[max(turn - rows // 2, 0) : turn + rows // 2] = False
    return recording.taken(log, keep, []), len(turns)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_log_is_split_at_the_gaps_of_its_clock(seed):
    """Reversals that nobody saw: with the gaps joined, sigma0 is far off."""
    log, gaps = without_turns(synthetic(seed))
    result = pipeline.identify([log])
    assert len(result.logs) == gaps + 1
    assert f"{gaps} gaps" in " ".join(result.notes)
    assert sum(piece.rows for piece in result.logs) == log.rows
    assert holds_the_truth(result)
    joined = pipeline.identify([replace(log, time=None)]).estimate.sigma0
    assert abs(joined / SIGMA0 - 1) > 0.1 > 10 * abs(result.estimate.sigma0 / SIGMA0 - 1)
    assert pipeline.check(result, log) == pytest.approx(result.r2, abs=0.002)


@pytest.mark.parametrize("clock", ["steady", "jitter", "coarse", "in bursts", "by edge"])
def test_a_clock_without_gaps_splits_nothing(clock):
    rng = np.random.default_rng(1)
    log = synthetic(1, rows=3000, cycles=3)
    if clock == "jitter":
        log.time = np.cumsum(rng.uniform(0.5e-3, 1.5e-3, log.rows))
    elif clock == "in bursts":
        log.time = np.cumsum(np.where(np.arange(log.rows) % 10, 1e-4, 1e-3))
    elif clock == "coarse":
        log.time = np.floor(log.time / 0.004) * 0.004
    elif clock == "by edge":
        edges = np.concatenate(([True], np.diff(log.theta) != 0))
        log = recording.taken(log, edges, [])
    assert len(recording.split_at_gaps(log)) == 1


def test_pieces_too_short_or_at_rest_are_left_out():
    log = synthetic(1, rows=3000, cycles=3)
    keep = np.ones(3000, dtype=bool)
    keep[1000:1100] = keep[1120:1300] = keep[2000:2100] = False
    log.theta[1300:2000] = log.theta[1300]
    pieces = recording.split_at_gaps(recording.taken(log, keep, []))
    assert [piece.rows for piece in pieces] == [1000, 900]
    assert "720 rows" in pieces[0].notes[0]


# --- an angle that is read more seldom than the torque --------------------------------------------


def held(log: Log, every: float) -> Log:
    """With an angle that is read every so many rows, not a whole number of them either."""
    read = np.ceil(np.floor(np.arange(log.rows) / every) * every).astype(int)
    return replace(log, theta=log.theta[read])


@pytest.mark.parametrize("every", [2.0, 5.0, 4.4])
@pytest.mark.parametrize("resolution", [COUNT, 0.0])
def test_rows_between_two_readings_of_the_angle_are_left_out(every, resolution):
    log = synthetic(3, rows=6000, cycles=20)
    if not resolution:
        theta = sine(3, rows=6000, cycles=20)
        log = replace(log, theta=theta, torque=dahl_torque(theta), resolution=0.0)
    result = pipeline.identify([held(log, every)])
    claimed = result.verdict.identifiable["sigma0"]
    assert claimed or every == 4.4  # rows that are not evenly spread look noisy
    assert not claimed or result.estimate.sigma0 == pytest.approx(SIGMA0, rel=0.02)
    rows = result.logs[0].rows
    assert rows == pytest.approx(6000 / every, rel=0.1)
    words = f"a new reading every {round(every)} rows only: the {6000 - rows} rows between"
    assert sum(words in note for note in result.logs[0].notes) == 1


def test_rows_that_are_left_have_a_reading_of_their_own():
    """Where the angle stands still for several readings each of them counts."""
    theta = np.repeat([0.0, 2, 4, 4, 4, 6, 3, 0, 0, 3, 6, 9] * 9, 4) * COUNT
    log = Log("x", theta, np.arange(theta.size) * 1.0, resolution=COUNT)
    left = recording.without_stale_angles(log)
    assert left.torque.tolist() == [4.0 * k for k in range(1, 12 * 9)]
    assert recording.without_stale_angles(replace(log, theta=theta / 2)).rows < log.rows
    slow = replace(log, theta=theta / 3)
    assert recording.without_stale_angles(slow) is slow  # counts of a slow motion do that too
    with pytest.raises(
        Error, match=r"x: the angle has a new reading every 4 rows only: 11 readings"
    ):
        recording.without_stale_angles(recording.taken(log, slice(0, 48), []))


# --- a torque that is read more seldom than the angle ---------------------------------------------


def seldom(log: Log, every: int, straight: bool, first: int = 0) -> Log:
    """With a torque of every so many rows, held or drawn straight from one to the next."""
    rows = np.arange(log.rows)
    read = rows[first::every]
    last = np.maximum((rows - first) // every * every + first, first)
    torque = np.interp(rows, read, log.torque[read]) if straight else log.torque[last]
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
        assert ends.low < truth < ends.high and ends.relative(truth) < 0.05
    assert result.estimate.sigma0 == pytest.approx(SIGMA0, rel=0.015)
    assert result.estimate.rows == pytest.approx(16_000 / every, rel=0.1)
    assert result.rmse == pytest.approx(0.02 * FC, rel=0.1)
    assert result.explored.models.chosen == "Dahl" and output.how(result)["rows_weighing_less"] < 60
    told = [
        note for note in result.logs[0].notes if note.startswith("the torque has a new reading")
    ]
    assert len(told) == 1 and f"every {every} rows only: the 1" in told[0]
    assert not any("disagree" in note for note in result.logs[0].notes)


@pytest.mark.parametrize("every", [10, 21])
def test_a_torque_read_at_some_rows_that_comes_late(every):
    log = synthetic(3, part=0.02, rows=20_000, cycles=19.37)
    log.torque = np.concatenate((np.repeat(log.torque[:1], 7), log.torque[:-7]))
    result = pipeline.identify([seldom(log, every, straight=False)])
    assert result.delay == 7
    assert result.estimate.sigma0 == pytest.approx(SIGMA0, rel=0.02)


SMOOTH = dahl_torque(sine(3, rows=6000, cycles=40))
DRY = np.sign(np.sin(np.arange(6000) * 0.05))  # 0 in the first row
SPRING = np.abs(np.arange(6000) / 63 % 2 - 1)  # of a motion to and fro at one speed
READ = SMOOTH + 0.01 * noise_of(3, 6000)


@pytest.mark.parametrize(
    "torque",
    [
        SMOOTH,
        READ,
        READ.round(2),
        READ.round(1),
        SMOOTH.round(2),
        np.round(np.linspace(0, 3, 6000), 2),  # a step every 20 rows, by the last digit
        np.repeat(READ, np.arange(6000) % 3 + 1)[:6000],  # rows that repeat at odd places
        np.zeros(6000),
        np.arange(6000) % 7.0,
        DRY,
        SPRING,
        DRY + SPRING,
        DRY + 0.06 * noise_of(3, 6000),
    ],
)
def test_a_torque_with_a_reading_in_each_row_stays(torque):
    log = Log("x", np.arange(6000.0), torque)
    assert recording.with_torque_readings(log) is log


def test_readings_of_the_torque_are_found(monkeypatch):
    monkeypatch.setattr(recording, "LOOKED_AT", 1000)  # rows, before all of them
    log = Log("x", np.arange(6000.0), READ)
    for straight, digits, part in ((False, 15, 0.95), (True, 15, 0.95), (True, 3, 0.3)):
        printed = seldom(log, 7, straight, first=5)
        printed.torque = printed.torque.round(digits)
        kept = recording.with_torque_readings(printed)
        read = np.flatnonzero(kept.weight)
        assert set(read) <= set(range(5, 6000, 7)) and len(read) > part * 6000 / 7
        assert kept.torque[read].tolist() == READ[read].round(digits).tolist()
        between = np.interp(np.arange(6000), read, kept.torque[read])
        assert kept.torque == pytest.approx(between)
    few = seldom(recording.taken(log, slice(0, 1050), []), 35, straight=False)
    with pytest.raises(
        Error, match=r"x: the torque has a new reading every 35 rows only: 29 readings, at least 30"
    ):
        recording.with_torque_readings(few)


@pytest.mark.parametrize(
    ("every", "usual", "wanted"),
    [(20, 4, 4), (10, 4, 5), (21, 4, 3), (7, 4, 7), (7, 3, 3), (13, 4, 4), (12, 1, 1), (6, 1, 1)],
)
def test_bins_hold_readings_at_one_place(every, usual, wanted):
    weight = np.zeros(1000)
    weight[3::every] = 1
    log = Log("x", np.zeros(1000), np.zeros(1000), weight=weight)
    assert cycles.rows_of_a_bin(usual, [log, replace(log, weight=None)]) == wanted


# --- wraps ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("counts", [128, 256, 200])
@pytest.mark.parametrize("offset", [0, 60])
def test_a_counter_that_wraps(counts, offset):
    """Powers of two are unwrapped, any other period is refused."""
    log = synthetic(1)  # covers 260 counts
    read = np.round(log.theta / COUNT).astype(int) + offset
    wrapped = replace(log, theta=(read % counts) * COUNT)
    if counts == 200:
        with pytest.raises(Error, match="unwrap it"):
            pipeline.identify([wrapped])
        return
    result = pipeline.identify([wrapped])
    assert "wraps" in result.notes[0]
    assert result.estimate.sigma0 == pytest.approx(pipeline.identify([log]).estimate.sigma0)


@pytest.mark.parametrize("unit", ["deg", "rad"])
def test_a_wrap_at_a_turn_is_named(tmp_path, unit):
    turn = {"deg": 360.0, "rad": 2 * np.pi}[unit]
    angle = 0.7 * turn * np.sin(np.linspace(0, 20, 400)) % turn
    rows = "\n".join(f"{x!r},{i}" for i, x in enumerate(angle.tolist()))
    (tmp_path / "a.csv").write_text(f"angle [{unit}],torque [Nm]\n{rows}\n")
    assert any("wraps" in note for note in readers.read(tmp_path / "a.csv", readers.Source()).notes)


@pytest.mark.parametrize("kind", ["smooth", "spikes", "two levels", "coarse", "quick returns"])
def test_what_does_not_wrap(kind):
    theta = synthetic(1).theta.copy()
    if kind == "spikes":
        theta[::500] = theta.max()
    elif kind == "two levels":
        theta = (theta > 0) * COUNT
    elif kind == "coarse":
        theta = theta[::400]
    elif kind == "quick returns":  # in one row each: two from end to end, one over two thirds
        theta = np.concatenate([np.linspace(low, 1, 500) for low in (0, 0, 1 / 3, 0)])
    assert not recording.wraps_of(theta).any()


# --- repeated rows --------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["each twice", "some"])
def test_repeated_rows_are_left_out_and_named(kind):
    log = synthetic(1)
    often = np.full(log.rows, 2)
    if kind == "some":
        often = 1 + (np.random.default_rng(1).uniform(size=log.rows) < 0.1)
    rows = np.repeat(np.arange(log.rows), often)
    twice = replace(recording.taken(log, rows, []), time=np.arange(len(rows)) * 1e-3)
    kept = recording.without_repeats(twice)
    assert np.array_equal(kept.torque, log.torque)
    assert str(len(rows) - log.rows) in kept.notes[0]


@pytest.mark.parametrize(
    "kind", ["noise", "computed", "computed, with rests", "coarse torque", "at rest", "loads"]
)
def test_rows_that_are_alike_for_other_reasons_stay(kind):
    log = synthetic(1)
    if kind == "computed":
        log.torque = dahl_torque(log.theta)
    elif kind == "computed, with rests":
        rests = np.repeat(np.arange(log.rows), np.where(np.arange(log.rows) % 50, 1, 2))
        theta = sine(1)[rests]
        log = Log("x", theta, dahl_torque(theta), np.arange(len(rests)) * 1e-3)
    elif kind == "coarse torque":
        log.torque = np.round(log.torque / 0.05) * 0.05
    elif kind == "loads":  # one row before and one after another load is put on
        log = recording.taken(log, np.repeat(np.arange(log.rows), 2), [])
        log.load = np.arange(log.rows) % 2.0
    elif kind == "at rest":
        log.theta[500:] = log.theta[500]
        log.torque[500:] = log.torque[500]
    assert recording.without_repeats(log) is log
