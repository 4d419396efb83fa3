# SPDX-License-Identifier: MIT
"""Before a fit a log is repaired with a note, or rejected with value, limit and place. Each limit
has a log that just passes.
"""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from dahl import Error
from dahl.identify import Log
from dahl.identify.preprocess import preprocess
from dahl.io import encoder_grid
from identify_tools import COUNT, FC, dahl_torque, noise_of, shaft, sine, synthetic

# --- rejected -------------------------------------------------------------------------------------


def clipped(part: float, rows: int = 4000, side: int = 1, moving: float = 1.0) -> Log:
    """Return a noisy torque at its limit for a part of the rows; in `moving` of them it moves."""
    log = synthetic(1, rows=rows, cycles=4)
    start, count = rows // 4, int(part * rows)
    log.torque[start : start + count] = 1.01 * log.torque.max()
    rest = slice(start, start + int(count * (1 - moving)))
    log.theta[rest] = log.theta[start]
    return replace(log, torque=side * log.torque)


def creeping(end: float) -> Log:
    """Return a shaft with at least six rows a count, and a sensor that clips at a part of Fc."""
    log = synthetic(1, rows=8000, cycles=4, amplitude=0.02)
    return replace(log, torque=np.clip(log.torque, -end * FC, end * FC))


def spanning(span: float, linear: bool) -> Log:
    log = synthetic(1, rows=400, cycles=3)
    theta = log.theta * span / np.ptp(log.theta)
    return replace(log, theta=theta, linear=linear, resolution=0.0, time=None)


def in_other_unit(counts: float, linear: bool = False, to_deg: bool = True) -> Log:
    """Return an angle in deg of an encoder with these counts, used as rad; or the reverse."""
    log = synthetic(1, rows=400, cycles=3, amplitude=0.6)
    step, turn = (360 / counts, np.degrees) if to_deg else (2 * np.pi / counts, lambda x: x)
    theta = np.round(turn(log.theta) / step) * step
    if not to_deg:
        theta, step = np.radians(theta), np.radians(step)
    return replace(log, theta=theta, resolution=step, linear=linear)


def short_pieces(rows: int) -> Log:
    log = synthetic(1, rows=10 * rows, cycles=4)
    return replace(log, time=log.time + 0.02 * (np.arange(10 * rows) // rows))


def wrapping(counts: int, offset: int = 0) -> Log:
    """Return a counter that wraps at this number of counts; the motion covers 260."""
    theta = (np.round(shaft().theta / COUNT) + offset) % counts * COUNT
    return replace(shaft(), theta=theta)


def wrapping_at_a_turn(linear: bool) -> Log:
    theta = (3.0 * np.sin(np.linspace(0, 40, 4000)) + 3) * 1.5
    torque = dahl_torque(theta, 2.0, 1.0) + 0.02 * noise_of(1, 4000)
    return Log("x", theta % (2 * np.pi), torque, linear=linear)


def seldom(log: Log, every: int, straight: bool, first: int = 0) -> Log:
    """Return a log with a torque reading every few rows, held or interpolated."""
    rows = np.arange(log.rows)
    last = np.maximum((rows - first) // every * every + first, first)
    between = np.interp(rows, rows[first::every], log.torque[first::every])
    return replace(log, torque=between if straight else log.torque[last])


STAIRS = [0.0, 2, 4, 4, 4, 6, 3, 0, 0, 3, 6, 9]


def stairs(times: int, size: float = 1.0) -> Log:
    theta = np.repeat(STAIRS * times, 4) * COUNT * size
    rows = np.arange(theta.size) * 1.0
    return Log("x", theta, rows, rows, resolution=COUNT)


SHAFT, COARSE = shaft(), shaft(rows=3000, noise=0.0)
COARSE.torque = np.round(COARSE.torque / FC * 4) * FC / 4
REJECTED: dict[str, tuple[Callable[[], Log], str]] = {
    "angle at rest": (lambda: replace(SHAFT, theta=np.full(2400, 0.25)), r"angle .*0\.25 .*2400"),
    "torque at rest": (
        lambda: replace(SHAFT, torque=np.full(2400, -1.5)),
        r"torque .*-1\.5 .*2400",
    ),
    "a torque of 1e200": (lambda: replace(SHAFT, torque=1e200 * SHAFT.torque), "torque .*1e.15"),
    "a torque of 1e-30": (lambda: replace(SHAFT, torque=1e-30 * SHAFT.torque), "torque .*1e-15"),
    "29 rows": (lambda: synthetic(1, rows=29), "29 rows.* 30"),
    "30 rows": (lambda: synthetic(1, rows=30), ""),
    "clipped": (lambda: clipped(0.03), r"clipped at 0\.\d+ N m .120 of 4000 rows.* row 1001"),
    "hardly clipped": (lambda: clipped(0.019), ""),
    "clipped below": (lambda: clipped(0.03, side=-1), r"clipped at -0\.\d+ N m .120 of 4000"),
    "clipped while it rests": (lambda: clipped(0.03, moving=0.1), ""),
    "clipped, a third moves": (lambda: clipped(0.03, moving=0.35), "clipped"),
    "few clipped rows": (lambda: clipped(0.05, rows=380), ""),
    "22 clipped rows": (lambda: clipped(0.058, rows=380), "clipped .*22 of 380"),
    "creeping, clipped": (lambda: creeping(0.9), r"clipped at -?0\.45 N m"),
    "creeping": (lambda: creeping(2), ""),
    "noisy, clipped at Fc": (lambda: creeping(1.0), r"clipped at -?0\.5 N m"),
    "noisy, clipped above Fc": (lambda: creeping(1.2), ""),
    "coarse torque": (lambda: COARSE, ""),
    "110 m": (lambda: spanning(1.1e2, True), "110 m.*100 "),
    "90 m": (lambda: spanning(0.9e2, True), ""),
    "9 nm": (lambda: spanning(0.9e-8, True), "9e-09 m.*1e-08"),
    "11 nm": (lambda: spanning(1.1e-8, True), ""),
    "11000 rad": (lambda: spanning(1.1e4, False), "11000 rad.*10000"),
    "9000 rad": (lambda: spanning(0.9e4, False), ""),
    "90 nrad": (lambda: spanning(0.9e-7, False), "9e-08 rad.*1e-07"),
    "110 nrad": (lambda: spanning(1.1e-7, False), ""),
    "deg of 4096": (lambda: in_other_unit(4096), "0878906 rad .*71\\.5 .*4096 in deg"),
    "deg of 256": (lambda: in_other_unit(256), "256 in deg"),
    "deg of 128": (lambda: in_other_unit(128), ""),
    "deg of 4096, a bit off": (lambda: in_other_unit(4096 * 1.0004), "4098 in deg"),
    "deg of another number": (lambda: in_other_unit(4096 * 1.0006), ""),
    "mm of 4096": (lambda: in_other_unit(4096, linear=True), ""),
    "rad of 4096": (lambda: in_other_unit(4096, to_deg=False), "4096 in rad"),
    "pieces of 29 rows": (lambda: short_pieces(29), "9 gaps.* 0 pieces.* 290 rows"),
    "pieces of 30 rows": (lambda: short_pieces(30), ""),
    "wrap at no period": (lambda: wrapping(200), " 16 times"),
    "wrap at a turn": (lambda: wrapping_at_a_turn(False), ""),
    "wrap at a turn, in m": (lambda: wrapping_at_a_turn(True), "unwrap"),
    "11 readings of the angle": (
        lambda: stairs(9).part(slice(48)),
        "every 4 rows only: 11 readings, at least 30",
    ),
    "29 readings of the torque": (
        lambda: seldom(synthetic(3).part(slice(1050)), 35, straight=False),
        "every 35 rows only: 29 readings, at least 30",
    ),
    "30 readings of the torque": (
        lambda: seldom(synthetic(3).part(slice(1085)), 35, straight=False),
        "",
    ),
}


@pytest.mark.parametrize("name", REJECTED)
def test_a_log_beyond_a_limit_is_rejected_and_one_within_passes(name):
    make, words = REJECTED[name]
    trusted = "readings" in name
    if not words:
        preprocess(make(), trusted)
        return
    with pytest.raises(Error, match=words) as said:
        preprocess(make(), trusted)
    assert "\n" not in str(said.value) and str(said.value).startswith(f"{make().name}: ")
    if re.search("trust-units", str(said.value)):
        preprocess(make(), trust_units=True)
    else:
        pytest.raises(Error, preprocess, make(), trust_units=True)


@pytest.mark.parametrize(
    ("part", "said"), [(1.0, ""), (2.0, "16384"), (0.5, "16384"), (16384 / 16000, "16384")]
)
def test_given_counts_are_compared_with_the_grid(part, said):
    words = encoder_grid.contradiction(replace(SHAFT, resolution=part * COUNT))
    assert bool(words) is bool(said) and said in words


# --- repaired -------------------------------------------------------------------------------------


def repaired(log: Log, trust_units: bool = False, median: int = 0) -> tuple[list[Log], str]:
    """Return the pieces and the notes of the repair. The log and the notes of its reader stay."""
    log, before = replace(log, notes=["as read"]), log.theta.copy()
    pieces = preprocess(log, trust_units, median)
    assert log.notes == ["as read"] and np.array_equal(log.theta, before)
    first, *notes = [note for piece in pieces for note in piece.notes]
    assert first == "as read"
    return pieces, "; ".join(notes)


def numbers(notes: str, word: str) -> list[float]:
    """Return the numbers of the one note with this word."""
    (note,) = (note for note in notes.split("; ") if word in note)
    return [float(number) for number in re.findall(r"(?<![\w.])\d+(?:\.\d+)?", note)]


@pytest.mark.parametrize(("counts", "offset"), [(128, 0), (256, 0), (256, 60)])
def test_a_counter_that_wraps_at_a_power_of_two(counts, offset):
    log = wrapping(counts, offset)
    (piece,), notes = repaired(log)
    times = np.count_nonzero(np.abs(np.diff(log.theta)) > counts / 2 * COUNT)
    assert {times, counts} <= {*numbers(notes, "wraps")}
    assert np.diff(piece.theta) == pytest.approx(np.diff(SHAFT.theta), abs=1e-9)


def test_an_angle_that_wraps_at_a_turn():
    (piece,), notes = repaired(wrapping_at_a_turn(False))
    assert np.ptp(piece.theta) == pytest.approx(9, rel=1e-3) and "6.28319 rad" in notes


JUMPS = {
    "spikes": lambda theta: np.where(np.arange(len(theta)) % 500, theta, theta.max()),
    "two levels": lambda theta: (theta > 0) * COUNT,
    "coarse": lambda theta: theta[::400],
    # in one row each: two from end to end, one over two thirds
    "quick returns": lambda _: np.concatenate(
        [np.linspace(low, 1, 500) for low in (0, 0, 1 / 3, 0)]
    ),
}


@pytest.mark.parametrize("kind", JUMPS)
def test_other_jumps_are_not_unwrapped(kind):
    log = synthetic(1, rows=20_000 if kind == "coarse" else 2000, cycles=8)
    theta = JUMPS[kind](log.theta)
    log = replace(log, theta=theta, torque=log.torque[: len(theta)], time=None)
    pieces, notes = repaired(log, median=1)
    assert "wraps" not in notes and np.ptp(pieces[0].theta) == np.ptp(theta)


def without(log: Log, *cuts: tuple[int, int]) -> Log:
    """Return the log without the rows of these cuts; the clock goes on."""
    return log.part(np.delete(np.arange(log.rows), [k for cut in cuts for k in range(*cut)]))


def test_a_log_is_split_at_the_gaps_of_its_clock():
    """A piece goes on over a gap in which the angle rests."""
    pieces, notes = repaired(without(SHAFT, (300, 420), (1400, 1999)))
    assert [piece.rows for piece in pieces] == [300, 980, 401]
    assert numbers(notes, "gaps")[0] == 2
    assert numbers(repaired(without(SHAFT, (300, 420)))[1], "1 gap ")[:3] == [1, 0.121, 300]
    log = synthetic(1, rows=6000, cycles=12)
    log.theta[2300:3000] = log.theta[2300]
    pieces, notes = repaired(without(log, (2000, 2100), (2120, 2300), (3000, 3100)))
    assert [piece.rows for piece in pieces] == [2000, 2900] and "720 rows" in notes


def test_a_log_is_split_where_its_clock_starts_anew():
    """Also at a gap, and if a row was written at each edge; the angle may have moved meanwhile."""
    rows = np.arange(6000)
    time = 1e-3 * (rows % 2500 + 500 * (rows >= 1000))
    log = replace(synthetic(1, rows=6000, cycles=12), time=time)
    log.theta[2500:] += 1.0
    pieces, notes = repaired(log)
    assert [piece.rows for piece in pieces] == [1000, 1500, 2500, 1000]
    assert all((np.diff(piece.time) > 0).all() for piece in pieces)
    assert numbers(notes, "starts anew") == [1, 0.501, 1000, 2, 2500, 4]  # one gap, two restarts
    edges = np.arange(200) % 100
    theta = COUNT * np.minimum(edges, 100 - edges)
    torque = dahl_torque(theta) + 0.01 * FC * noise_of(1, 200)
    pieces, _ = repaired(Log("x", theta, torque, np.r_[0:100, 0:100] * 0.01, resolution=COUNT))
    assert [piece.rows for piece in pieces] == [100, 100]


@pytest.mark.parametrize("repeats", [0, 1, 7])
def test_rows_after_a_gap_that_repeat_the_one_before_it_are_left_out(repeats):
    log = without(SHAFT, (1000, 1400))
    for values in (log.theta, log.torque):
        values[1000 : 1000 + repeats] = values[999]
    pieces, _ = repaired(log)
    assert [piece.rows for piece in pieces] == [1000, 1000 - repeats]


ROWS, STEPS = np.arange(6000), np.full(6000, 1e-3)
DRAW = np.random.default_rng(1)
CLOCKS = {  # that have no gap: the time, and a word of the note
    "jitter": (np.cumsum(DRAW.uniform(0.5e-3, 1.5e-3, 6000)), ""),
    "errors of .4 rows": (1e-3 * (ROWS + DRAW.uniform(-0.4, 0.4, 6000)), "the times jitter"),
    "errors of a row": (1e-3 * (ROWS + DRAW.uniform(-0.9, 0.9, 6000)), "the times jitter"),
    "bursts": (np.cumsum(np.where(ROWS % 10, 1e-4, 1e-3)), ""),
    "coarse": (np.floor(ROWS * 1e-3 / 0.004) * 0.004, "spread"),
    "each time twice": (ROWS // 2 * 2e-3, "time of the row before"),
    "stands still": (np.zeros(6000), "stands still"),
    "a step of 4.9": (np.cumsum(np.where(ROWS == 3000, 4.9e-3, STEPS)), ""),
}


@pytest.mark.parametrize("clock", CLOCKS)
def test_a_clock_without_gaps_splits_nothing(clock):
    time, word = CLOCKS[clock]
    (piece,), notes = repaired(replace(synthetic(1, rows=6000, cycles=6), time=time))
    assert piece.rows == 6000 and "gap" not in notes
    assert word in notes and bool(word) == bool(notes)
    if clock in ("coarse", "each time twice"):
        assert np.diff(piece.time) == pytest.approx(1e-3)
    assert (piece.time is None) == (clock == "stands still")


@pytest.mark.parametrize("every", [2.0, 5.0, 4.4])
@pytest.mark.parametrize("count", [COUNT, 0.0])
def test_rows_between_two_readings_of_the_angle_are_left_out(every, count):
    log = synthetic(3, rows=6000, cycles=20)
    if not count:
        theta = sine(3, rows=6000, cycles=20)
        log = replace(log, theta=theta, torque=dahl_torque(theta), resolution=0.0)
    held = np.ceil(np.floor(ROWS / every) * every).astype(int)
    (piece,), notes = repaired(replace(log, theta=log.theta[held]))
    assert piece.rows == pytest.approx(6000 / every, rel=0.1)
    assert numbers(notes, "angle has a new reading") == [round(every), 6000 - piece.rows]


def test_each_remaining_row_has_a_reading():
    """If the angle rests, each reading counts. Counts of a slow motion are not readings."""
    (piece,) = preprocess(stairs(9), trust_units=True)
    assert piece.torque.tolist() == [4.0 * k for k in range(1, 9 * len(STAIRS))]
    assert preprocess(stairs(9, 1 / 3), trust_units=True)[0].rows == stairs(9).rows
    lost = without(stairs(9), (12, 13))  # a row of three readings
    assert preprocess(lost, trust_units=True)[0].rows == piece.rows


@pytest.mark.parametrize(("every", "straight"), [(4, True), (20, False), (33, False)])
def test_only_readings_of_the_torque_have_weight(every, straight):
    log = seldom(synthetic(2, part=0.02, rows=16_000, cycles=15.3), every, straight, first=3)
    (piece,), notes = repaired(replace(log, torque=log.torque.round(6)))
    weighing = np.flatnonzero(piece.weight)
    assert set(weighing) <= set(range(3, 16_000, every)) and len(weighing) > 0.9 * 16_000 / every
    assert piece.torque[weighing] == pytest.approx(log.torque[weighing], abs=1e-6)
    assert numbers(notes, "torque has a new reading") == [every, 16_000 - len(weighing)]


SMOOTH = dahl_torque(sine(3, rows=6000, cycles=40))
DRY = np.sign(np.sin(ROWS * 0.05))  # 0 in the first row
SPRING = np.abs(ROWS / 63 % 2 - 1)  # of a motion to and fro at one speed
NOISY = SMOOTH + 0.01 * noise_of(3, 6000)
EACH_ROW = {
    "smooth": SMOOTH,
    "two digits": NOISY.round(2),
    "rows that repeat at odd places": np.repeat(NOISY, ROWS % 3 + 1)[:6000],
    "dry": DRY + 1e-9 * SPRING,
    "dry and a spring": DRY + SPRING,
}


@pytest.mark.parametrize("kind", EACH_ROW)
def test_a_torque_with_a_reading_in_each_row_stays(kind):
    (piece,), notes = repaired(Log("x", sine(3, rows=6000, cycles=40), EACH_ROW[kind]), True)
    assert "new reading" not in notes and piece.weight is None


def test_an_angle_drawn_straight_between_its_readings_is_noted():
    rows, known = np.arange(2400), np.arange(0, 2400, 4)
    theta, torque = (np.interp(rows, known, x[known]) for x in (SHAFT.theta, SHAFT.torque))
    assert "drawn straight" in repaired(replace(SHAFT, theta=theta, torque=torque))[1]


@pytest.mark.parametrize("part", [1.0, 0.1])
def test_repeated_rows_are_left_out_and_counted(part):
    log = synthetic(1, rows=4000, cycles=8)
    often = 1 + (np.random.default_rng(1).uniform(size=log.rows) < part)
    rows = np.repeat(np.arange(log.rows), often)
    (piece,), notes = repaired(replace(log.part(rows), time=np.arange(len(rows)) * 1e-3))
    assert np.array_equal(piece.torque, log.torque)
    assert numbers(notes, "repeat the row before") == [len(rows) - log.rows, len(rows)]


def computed_with_rests() -> Log:
    theta = sine(1, rows=4000, cycles=8)
    theta = np.repeat(theta, np.where(np.arange(4000) % 50, 1, 2))
    return Log("x", theta, dahl_torque(theta), np.arange(len(theta)) * 1e-3)


def at_rest() -> Log:
    log = synthetic(1, rows=4000, cycles=8)
    log.theta[500:], log.torque[500:] = log.theta[500], log.torque[500]
    return log


def changing_load() -> Log:
    log = synthetic(1, rows=4000, cycles=8).part(np.arange(8000) // 2)
    return replace(log, load=np.arange(8000) % 2.0)


@pytest.mark.parametrize("make", [computed_with_rests, lambda: COARSE, at_rest, changing_load])
def test_rows_that_are_alike_for_other_reasons_stay(make):
    pieces, notes = repaired(make())
    assert "repeat" not in notes and sum(one.rows for one in pieces) == make().rows


@pytest.mark.parametrize(
    ("spikes", "median", "rows"), [(4, 0, 0), (20, 0, 9), (20, 1, 0), (20, 5, 5), (0, 5, 5)]
)
def test_an_angle_that_flickers(spikes, median, rows):
    """More than eight rows that turn back at once cause a running median; --median sets one."""
    log = shaft(4, rows=3000, cycles=6)
    theta = log.theta.copy()
    theta[np.random.default_rng(0).choice(2998, spikes, replace=False) + 1] += 0.02
    (piece,), notes = repaired(replace(log, theta=theta), median=median)
    assert ("median" in notes) is (rows > 0)
    if rows:
        assert numbers(notes, "median")[-1] == rows
        assert np.abs(piece.theta - log.theta).max() < 3 * COUNT
