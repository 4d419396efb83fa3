# SPDX-License-Identifier: MIT
"""Angles between counts, cycles, weights and thinning, against plain loops and known motions."""

from dataclasses import replace

import numpy as np
import pytest
from dahl.identify import angle, models
from dahl.identify.samples import block_for, samples_of
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from identify_tools import COUNT, FC, SIGMA0, chirp, dahl_torque, log_of, noise_of, shaft, sine

A = SIGMA0 / FC


def turns_by_row(theta: np.ndarray, least: float) -> list[int]:
    """Rows of the extremes between which the angle goes back by more than `least`."""
    found, side, low, high = [], 0, 0, 0
    for row, now in enumerate(theta.tolist()):
        low = row if now <= theta[low] else low
        high = row if now >= theta[high] else high
        if side >= 0 and theta[high] - now > least:
            found += [high] if side else []
            side, low, high = -1, row, row
        elif side <= 0 and now - theta[low] > least:
            found += [low] if side else []
            side, low, high = 1, row, row
    return found


@given(arrays(float, st.integers(3, 60), elements=st.integers(-9, 9)), st.sampled_from([0.5, 2.5]))
def test_turning_points_against_row_by_row(theta, least):
    """A turn may last: each of its rows is a turning point."""
    found, wanted = models.turning_points(theta, least), turns_by_row(theta, least)
    assert theta[found].tolist() == theta[wanted].tolist()
    for one, other in zip(found.tolist(), wanted, strict=True):
        assert (theta[min(one, other) : max(one, other)] == theta[one]).all()


# --- the angle between counts ---------------------------------------------------------------------

SINE = sine(3, rows=3000, cycles=9)
SAW = 0.05 * (2 * np.abs(np.arange(3000) / 333.3 % 2 - 1) - 1)  # turns at speed
RESTS = 0.05 * np.clip(1.3 * np.sin(np.arange(3000) / 60), -1, 1)


def read(theta: np.ndarray) -> np.ndarray:
    return np.floor(theta / COUNT + 0.3) * COUNT + 0.2 * COUNT


@pytest.mark.parametrize("theta", [SINE, SAW])
@pytest.mark.parametrize("treatment", [angle.between_counts, angle.with_sharp_turns])
def test_a_treatment_is_nearer_to_the_motion_and_within_half_a_count(theta, treatment):
    seen = read(theta)
    treated = treatment(seen, COUNT)
    assert np.abs(treated - seen).max() <= 0.5 * COUNT * (1 + 1e-9)
    assert np.mean((treated - theta) ** 2) < 0.3 * np.mean((seen - theta) ** 2)
    assert np.array_equal(treatment(theta, 0.0), theta)
    assert np.array_equal(treatment(theta[:3], COUNT), theta[:3])


def error_at_turns(treated: np.ndarray, theta: np.ndarray) -> float:
    """Mean error in counts, towards the middle of the motion."""
    turns = models.turning_points(theta, 10 * COUNT)
    return float(np.mean((theta - treated)[turns] * np.sign(theta[turns]))) / COUNT


def test_each_treatment_suits_its_turns():
    sharp = error_at_turns(angle.with_sharp_turns(read(SAW), COUNT), SAW)
    smooth = error_at_turns(angle.between_counts(read(SAW), COUNT), SAW)
    assert abs(sharp) < 0.12 < smooth
    assert abs(error_at_turns(angle.between_counts(read(SINE), COUNT), SINE)) < 0.12


@pytest.mark.parametrize("speed", [0.05, 0.3, 0.7, 1.3, 3.0])  # counts per row
def test_edges_show_whether_strokes_turn_smoothly(speed):
    """A sine does if a turn has rows enough. A triangle does not, with corners round in a count."""
    phase = np.pi * speed * np.arange(max(int(4000 / speed), 12_000)) / 120.74
    saw = 60.37 * np.arcsin(np.sin(phase)) * 2 / np.pi
    rows = max(round(1 / speed), 1)
    for theta, is_smooth in (
        (saw, False),
        (np.convolve(saw, np.ones(rows) / rows, "valid"), False),
        (60.37 * np.sin(phase), speed < 1),
        (60.37 * np.sin(phase) * np.sin(phase / 7.3), speed < 1),
    ):
        assert angle.turns_smoothly(read(theta * COUNT), COUNT) is is_smooth
        (log,) = [log_of(theta * COUNT, dahl_torque(theta * COUNT))]
        assert ("sharp turns" in samples_of([log]).angles) is not is_smooth


@pytest.mark.parametrize("counts", [3.0, 5.0, 8.0])  # of the way in which a stroke slows down
@pytest.mark.parametrize("least", [0.4, 0.7])  # speed at its ends, of that further in
def test_a_stroke_that_slows_down_but_ends_at_speed_turns_sharply(counts, least):
    way, sign, theta = 0.0, 1, [0.3]
    while len(theta) < 20_000:
        to_end = min(way, 60.7 - way)
        step = min(1.0, least + (1 - least) * max(to_end, 0.0) / counts) / 12
        way, sign = (way + step, sign) if way + step < 60.7 else (0.0, -sign)
        theta.append(theta[-1] + sign * step)
    assert not angle.turns_smoothly(read(np.array(theta) * COUNT), COUNT)


def test_few_strokes_show_no_smooth_turn():
    for theta in (np.r_[1, 0:15, 13], np.r_[0:30], np.r_[0:30, 28:0:-1], np.zeros(9)):
        assert not angle.turns_smoothly(theta * COUNT, COUNT)


@pytest.mark.parametrize("counts", [0.0, 1.0, 5.0])
def test_noise_beyond_the_counts_is_measured_and_smoothed(counts):
    noisy = read(SINE + counts * COUNT * noise_of(4, 3000))
    noise = angle.white_noise(noisy, COUNT)
    assert noise == pytest.approx(counts * COUNT, rel=0.1, abs=0.2 * COUNT)
    smooth = angle.smooth_angle(noisy, COUNT, noise if counts else 0.0)
    if counts:
        assert np.std(smooth - SINE) < 0.35 * noise
    else:
        assert np.array_equal(smooth, angle.between_counts(noisy, COUNT))


# --- cycles, weights and terms --------------------------------------------------------------------


def prepared(*logs, residual: np.ndarray | float = 0.0):
    samples = samples_of(logs)
    return samples.prepared(A, residual + np.zeros(samples.rows))


def test_cycles_are_left_out_once_each():
    for cycles in (5, 8, 20, 60):
        samples = prepared(shaft(rows=3000, cycles=cycles + 0.4))
        assert abs(samples.cycles - cycles) <= 1
        assert 3 <= len(samples.folds) <= 24
        covered = np.concatenate([np.arange(fold.start, fold.stop) for fold in samples.folds])
        assert len(set(covered)) == len(covered)
        assert samples.used[covered].sum() > 0.9 * samples.used.sum()
        sizes = [samples.used[fold].sum() for fold in samples.folds[1:-1]]
        assert max(sizes) < 3 * min(sizes)
        ends = [fold.start for fold in samples.folds[1:]]
        seen = samples.angles["between counts"]
        if cycles in (8, 20):  # a cycle ends at a turn
            assert np.abs(seen[ends]).min() > 0.9 * np.abs(seen).max()


def test_the_start_and_the_ends_of_a_piece_have_no_weight():
    log = shaft(rows=3000, cycles=9)
    pieces = [replace(log.part(rows), name="x") for rows in (slice(0, 1400), slice(1400, None))]
    samples = prepared(*pieces)
    assert samples.logs == 1 and [one.start for one in samples.pieces] == [0, 1400]
    for rows in samples.pieces:
        part = log.theta[rows]
        travel = np.cumsum(np.abs(np.diff(part, prepend=part[0])))
        least = min(6 / A, travel[-1] / 4)
        used, edge = samples.used[rows], len(part) // 20
        assert (used[:edge] == 0).all() and (used[-edge:] == 0).all()
        settled = np.flatnonzero(used)[0]
        assert settled == edge or travel[settled] == pytest.approx(least, abs=2 * COUNT)


def test_outliers_weigh_less():
    noise = 0.01 * noise_of(1, 2400)
    noise[500:505] += (0.0, 0.5, 0, -0.2, 0)
    samples = prepared(shaft(), residual=noise)
    assert samples.weight[501] == pytest.approx(0.08, rel=0.3)
    assert samples.weight[503] == pytest.approx(0.2, rel=0.3)
    assert np.mean(samples.weight == 1) > 0.97
    held = replace(shaft(), weight=np.arange(2400) % 2.0)
    assert set(prepared(held, residual=noise).weight) == {0, 1}


def test_travel_since_a_rest_against_row_by_row():
    samples = prepared(log_of(RESTS, dahl_torque(RESTS)), shaft())
    seen, since, at = samples.angles["between counts"], 0.0, []
    starts = {rows.start for rows in samples.pieces}
    slow = 0.02 * np.percentile(np.abs(samples.speed), 98)
    for row in range(samples.rows):
        rests = row in starts or abs(samples.speed[row]) < slow
        since = 0.0 if rests else since + abs(seen[row] - seen[row - 1])
        at.append(since)
    assert samples.travel_since_rest() == pytest.approx(np.array(at), abs=1e-9)


def test_all_columns_of_two_logs():
    theta, rows = chirp(2000) + 0.3, np.arange(2000)
    one = replace(log_of(theta, dahl_torque(theta)), load=rows + 1.0)
    fine = log_of(theta - 0.02, theta, count=COUNT / 2)
    other = replace(fine, name="other", load=rows + 3001.0)
    samples = prepared(one, other)
    reference, z, inside = samples.reference, samples.terms["spring"], slice(200, 1800)
    assert (samples.rows, samples.logs, samples.block, samples.timed) == (4000, 2, 1, True)
    assert (samples.count, samples.noise) == (COUNT, 0)
    for name in ("torque", "time", "load"):
        column = np.concatenate([getattr(log, name) for log in (one, other)])
        assert np.array_equal(getattr(samples, name), column), name
    assert np.array_equal(samples.angles["as read"], np.concatenate((one.theta, other.theta)))
    assert (z.min(), z.max()) == pytest.approx((-1, 1), abs=1e-9)
    assert reference.centre == pytest.approx(0.29, abs=2e-3)
    assert reference.reach == pytest.approx(0.06, abs=2e-3)
    assert reference.load == np.median(samples.load)
    speed = np.gradient(theta, 1e-3)
    acceleration, size = np.gradient(speed, 1e-3), np.abs(speed)
    for found, true in ((samples.speed, speed), (samples.acceleration, acceleration)):
        assert np.abs(found[:2000] - true)[inside].max() < 0.05 * np.abs(true).max()
    assert reference.fast == pytest.approx(np.percentile(size, 98), rel=0.02)
    moving = size[size > 0.02 * reference.fast]
    assert reference.mean_speed == pytest.approx(np.exp(np.log(moving).mean()), rel=0.02)
    assert samples.terms["cubic"] == pytest.approx(z**3)
    assert np.array_equal(samples.terms["viscous"], samples.speed)
    assert np.array_equal(samples.terms["inertia"], samples.acceleration)
    assert (samples.terms["offset"] == 1).all()
    assert samples.waves.sum(axis=1).max() <= 1 + 1e-9
    assert samples.waves.max(axis=0) == pytest.approx(np.ones(16), abs=0.05)
    again = samples_of([other], reference=reference)
    assert again.terms["spring"] == pytest.approx(z[2000:], abs=1e-3)


@pytest.mark.parametrize(("rows", "cycles"), [(7000, 9), (24_000, 9), (24_000, 300)])
def test_a_long_log_becomes_few_samples(rows, cycles):
    """Blocks of rows if its strokes are long, segments from all of it if they are short."""
    log = shaft(rows=rows, cycles=cycles)
    samples = samples_of([log])
    assert samples.rows <= 10_000 and (samples.block > 1) == (rows > 8000 and cycles == 9)
    assert len(samples.pieces) == (8 if cycles == 300 else 1)
    if samples.block > 1:
        used = log.torque[: round(samples.rows * samples.block)]
        means = used.reshape(samples.rows, -1).mean(axis=1)
        assert samples.torque == pytest.approx(means)
    assert samples.time[0] < 0.1 and samples.time[-1] > 0.99 * (rows - 1) * 1e-3
    marked = replace(log, weight=np.arange(rows) % 4 / 3)
    spiked = replace(log, torque=log.torque + FC * (np.arange(rows) % 100 == 0))
    assert samples_of([marked]).block == samples_of([spiked]).block == 1


def to_and_fro(rows: int, cycles: float) -> np.ndarray:
    """A motion at one speed, rad."""
    return 0.3 * (4 * np.abs(np.arange(rows) * cycles / rows % 1 - 0.5) - 1)


@pytest.mark.parametrize("rows", [9_000, 30_000, 100_000, 400_000])
@pytest.mark.parametrize("cycles", [3.3, 8.6, 40.3, 100.4])
@pytest.mark.parametrize("motion", [to_and_fro, lambda *shape: sine(1, *shape, amplitude=0.3)])
def test_more_rows_never_mean_fewer_cycles(rows, cycles, motion):
    """Of the cycles of a log at least eight are scored, or all but one; turns of both sides."""
    theta = motion(rows, cycles)
    log = log_of(theta, theta, count=COUNT / 64)
    block = block_for([log], samples_of([log], angles=()).block, A)
    samples = samples_of([log], block, angles=())
    samples = samples.prepared(A, np.zeros(samples.rows))
    assert samples.cycles >= min(int(cycles) - 1, 8) and samples.rows < 17_000
    seen = samples.angles["between counts"]
    ends = [seen[one][models.turning_points(seen[one], 0.3 / A)] for one in samples.pieces]
    assert abs(np.mean(np.sign(np.concatenate(ends)))) < 0.35


def test_many_long_logs_share_the_samples():
    log = shaft(rows=50_000, cycles=300)
    samples = samples_of([replace(log, name=str(k)) for k in range(40)], angles=())
    assert samples.logs == 40 and samples.rows < 15_000


def test_a_block_is_short_against_presliding():
    """A twentieth of the rows of the first presliding length after a turn."""
    log = shaft(rows=24_000, cycles=9)
    rows = np.arccos(1 - 1 / A / 0.05) / (2 * np.pi) * 24_000 / 9
    assert block_for([log], 50, A) == pytest.approx(rows / 20, abs=2)
    assert block_for([log], 4, A) == 4
    assert block_for([shaft(rows=1000, cycles=9)], 50, A) == 1
