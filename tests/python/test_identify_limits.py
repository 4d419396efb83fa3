# SPDX-License-Identifier: MIT
"""Both sides of each limit that a user meets: what is refused and what passes, what is called late,
and which number is still believed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dahl import Error
from dahl.identify import clean, follow, pipeline, readers, verdict
from dahl.identify.fit import Interval
from dahl.identify.log import Log, resolution_of
from dahl.identify.result import Result
from identify_tools import COUNT, FC, SIGMA0, dahl_torque, noise_of, sine, synthetic

pytestmark = pytest.mark.usefixtures("library")


def clipped(part: float, rows: int = 4000, side: int = 1, rest: bool = False) -> Log:
    """A noisy torque whose sensor is at its end for a part of the rows, the shaft maybe at rest."""
    log, there = synthetic(1, rows=rows, cycles=4), slice(rows // 4, int((0.25 + part) * rows))
    log.torque[there] = 1.01 * log.torque.max()
    log.theta[there] = log.theta[rows // 4] if rest else log.theta[there]
    return replace(log, torque=side * log.torque)


def creeping(end: float) -> Log:
    """A shaft that takes six rows and more for a count, and a sensor that ends at a part of Fc."""
    log = synthetic(1, rows=8000, cycles=4, amplitude=0.02)
    return replace(log, torque=np.clip(log.torque, -end * FC, end * FC))


def spanning(span: float, linear: bool) -> Log:
    log = synthetic(1, rows=400, cycles=2)
    theta = log.theta * span / np.ptp(log.theta)
    return replace(log, theta=theta, linear=linear, resolution=0.0)


def in_degrees(counts: float) -> Log:
    """An angle in deg of an encoder of so many counts, taken for rad."""
    log = synthetic(1, rows=400, cycles=2, amplitude=0.6)
    step = 360 / counts
    return replace(log, theta=np.round(np.degrees(log.theta) / step) * step, resolution=step)


@pytest.mark.parametrize(
    ("log", "words"),
    [
        (clipped(0.03), r"clipped at 0\.\d+ N m \(120 of 4000 rows, the first is row 1001\)"),
        (clipped(0.015), ""),
        (clipped(0.03, side=-1), r"clipped at -0\.\d+ N m \(120 of 4000"),
        (clipped(0.015, side=-1), ""),
        (clipped(0.03, rest=True), ""),
        (clipped(0.04, rows=400), ""),
        (creeping(0.9), "clipped"),
        (creeping(2), ""),
        (synthetic(1, rows=29), "29 rows; at least 30"),
        (synthetic(1, rows=30), ""),
        (spanning(1.1e2, True), "is the unit right"),
        (spanning(0.9e2, True), ""),
        (spanning(0.9e-8, True), "is the unit right"),
        (spanning(1.1e-8, True), ""),
        (spanning(1.1e4, False), "is the unit right"),
        (spanning(0.9e4, False), ""),
        (spanning(0.9e-7, False), "is the unit right"),
        (spanning(1.1e-7, False), ""),
        (in_degrees(4096), "4096 in deg"),
        (in_degrees(1024), "1024 in deg"),
        (in_degrees(4000), ""),
        (in_degrees(4150), ""),
        (replace(in_degrees(4096), linear=True), ""),
    ],
)
def test_what_is_refused_and_what_just_passes(log, words):
    if not words:
        clean.refuse(log)
        return
    with pytest.raises(Error, match=words):
        clean.refuse(log)
    if "unit" in words or "deg" in words:
        clean.refuse(log, trust_units=True)


def late(rows: int, seed: int = 5) -> Log:
    """A torque that comes `rows` rows after its angle."""
    log = synthetic(seed, rows=5000, cycles=5)
    first = max(rows, 0)
    last = log.rows + min(rows, 0)
    cut, torque = slice(first, last), log.torque[first - rows : last - rows]
    return replace(log, theta=log.theta[cut], time=log.time[cut], torque=torque)


@pytest.mark.parametrize(("cycle", "rows"), [(54, 12), (36, 8), (180, 40), (54, 4)])
def test_a_torque_late_by_a_part_of_a_coarse_cycle_makes_no_wrong_claim(cycle, rows):
    """60 cycles of few rows; a quarter of a cycle late, friction looks like inertia."""
    theta = 0.05 * np.sin(2 * np.pi * np.arange(60 * cycle + rows) / cycle + 0.3)
    torque = dahl_torque(theta)[: 60 * cycle] + 0.02 * FC * noise_of(0, 60 * cycle)
    time = np.arange(60 * cycle) * 1e-3
    log = Log("", np.round(theta[rows:] / COUNT) * COUNT, torque, time, resolution=COUNT)
    result = pipeline.identify([log])
    ends = result.estimate.ci95["Fc"]
    assert not result.verdict.sigma0
    assert not result.verdict.Fc or ends.low < FC < ends.high


@pytest.mark.parametrize("rows", [-8, 9])
def test_who_comes_late_and_by_how_much(rows):
    """0.001 s a row; the check of another log is shifted in the same way."""
    result = pipeline.identify([late(rows)], pipeline.Options(terms=()))
    assert result.delay == pytest.approx(rows, abs=2.5)
    assert result.estimate.sigma0 == pytest.approx(SIGMA0, rel=0.07)
    who = "torque" if rows > 0 else "angle"
    (note,) = [note for note in result.notes if " rows (" in note]
    assert f": {who} comes {abs(result.delay):.1f} rows" in note
    assert f"({abs(result.delay) * 1e-3:.3g} s) late" in note
    assert (
        pipeline.check(result, late(rows, seed=6)) > pipeline.check(result, late(0, seed=6)) + 0.001
    )
    assert pipeline.check(result, late(rows, seed=6)) == pytest.approx(result.r2, abs=0.004)
    turned = pipeline.identify([late(rows)], pipeline.Options(terms=(), delay=False))
    assert turned.delay == 0
    assert turned.r2 < result.r2


def test_one_row_late_is_enough_where_a_row_is_long():
    """A row covers more than a presliding length at the highest speed."""
    log = synthetic(5, rows=2000, cycles=20, amplitude=0.1)
    log = replace(log, theta=log.theta[:-1], time=log.time[:-1], torque=log.torque[1:])
    assert pipeline.identify([log], pipeline.Options(terms=())).delay == pytest.approx(-1, abs=0.3)


@pytest.mark.parametrize(("size", "named"), [(3.0, False), (12.0, True), (40.0, True)])
def test_torque_spikes_count_from_some_standard_errors_on(size, named):
    """100 rows `size` standard deviations off weigh less, and they alone."""
    log = synthetic(3, rows=3000, cycles=3)
    hit = np.random.default_rng(0).choice(log.rows, 100, replace=False)
    log.torque[hit] += size * 0.05 * FC
    result = pipeline.identify([log], pipeline.Options(terms=()))
    found = [
        int(note.split(": ")[1].split()[0]) for note in result.notes if "they weigh less" in note
    ]
    assert bool(found) == named
    assert all(90 <= count <= 110 for count in found)
    weights = result.logs[0].weight
    assert np.delete(weights, hit).mean() > 0.98
    if named:
        assert weights[hit].mean() < 6 / size


@pytest.mark.parametrize(("spikes", "window"), [(3, 1), (60, 5)])
def test_an_angle_is_smoothed_only_where_it_flickers(spikes, window):
    """A spike turns back twice; a few are left to the robust fit, many are taken out and named."""
    log = synthetic(4, rows=3000, cycles=3)
    hit = np.random.default_rng(0).choice(log.rows - 2, spikes, replace=False) + 1
    log.theta[hit] += 0.02
    result = pipeline.identify([log], pipeline.Options(terms=()))
    assert (result.median >= window) and (result.median > 1) == (window > 1)
    assert any("flicker" in note for note in result.notes) == (window > 1)


@pytest.mark.parametrize("part", [0.25, 1 / 3])
def test_a_delay_between_two_rows_is_interpolated(part):
    """Shifting back by a part of a row restores a straight torque, to the side it came from."""
    rising = np.arange(100.0)
    assert np.allclose(clean.shifted(rising, part)[:-1], rising[:-1] + part)


# --- the verdict ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def good(library) -> Result:
    return pipeline.identify([synthetic(5, rows=3000, cycles=6)], pipeline.Options(terms=()))


def judged(good: Result, width=0.01, Fc=None, lost=(0.1, 0.5, 0.1), **changed) -> verdict.Verdict:  # noqa: N803
    """The verdict on a result with other widths of its intervals (`Fc`: of that one alone) and
    other held-out errors.
    """
    estimate, widths = good.estimate, dict.fromkeys(("sigma0", "Fc", "a"), width)
    widths["Fc"] = Fc or width
    ends = {
        name: Interval(value * (1 - widths[name]), value * (1 + widths[name]))
        for name, value in (("sigma0", estimate.sigma0), ("Fc", estimate.Fc), ("a", estimate.a))
    }
    held = dict(zip(("dahl", "coulomb", "bilinear"), (1 - part for part in lost), strict=True))
    models = replace(good.models, r2={**good.models.r2, **held})
    changed = {"reversals": 12, **changed}
    return verdict.judge(
        replace(good, estimate=replace(estimate, ci95=ends), models=models, **changed)
    )


@pytest.mark.parametrize(
    ("change", "sigma0", "Fc", "words"),
    [
        ({}, True, True, ""),
        ({"width": 0.29}, True, True, ""),
        ({"width": 0.31}, False, False, "sigma0 known within 31 % only"),
        ({"Fc": 0.31}, True, False, ""),
        ({"lost": (0.1, 0.12, 0.1)}, True, True, ""),
        ({"lost": (0.11, 0.12, 0.11)}, False, True, "no better than Coulomb"),
        ({"lost": (0.49, 0.9, 0.49)}, True, True, ""),
        ({"lost": (0.51, 0.9, 0.51)}, False, False, "explains 49 %"),
        ({"lost": (0.1, 0.5, 0.08)}, True, True, ""),
        ({"lost": (0.1, 0.5, 0.06)}, True, True, "bilinear"),
        ({"reversals": 8}, True, True, ""),
        ({"reversals": 7}, True, True, "only 7 reversals"),
        ({"reversals": 1}, True, True, "only 1 reversal"),
        ({"backlash": 1e-3}, True, True, "backlash"),
    ],
)
def test_both_sides_of_each_limit_of_the_verdict(good, change, sigma0, Fc, words):  # noqa: N803
    said = judged(good, **change)
    named = {name: f"{name} not identifiable" in said.text for name in ("sigma0", "Fc")}
    assert named == {"sigma0": Fc and not sigma0, "Fc": sigma0 and not Fc}
    assert ("neither" in said.text) == (not sigma0 and not Fc)
    assert said.identifiable == {"sigma0": sigma0, "Fc": Fc}
    assert (words in said.text) if words else not said.reasons


@pytest.mark.parametrize(("counts", "seen"), [(2.1, True), (1.9, False)])
def test_presliding_of_two_counts_is_the_least(good, counts, seen):
    log = replace(good.logs[0], resolution=1 / good.estimate.a / counts)
    assert judged(good, logs=[replace(log, resolution=0.0), log]).sigma0 is seen


@pytest.mark.parametrize("wide", ["sigma0", "Fc", ""])
def test_following_ends_when_both_are_known(good, wide):
    parts = {name: 0.03 if name == wide else 0.01 for name in ("sigma0", "Fc")}
    values = {name: getattr(good.estimate, name) for name in parts}
    ends = {
        name: Interval(v * (1 - parts[name]), v * (1 + parts[name])) for name, v in values.items()
    }
    result = replace(good, estimate=replace(good.estimate, ci95=ends))
    assert follow.small_enough(replace(result, reversals=8), 0.02) is not bool(wide)
    assert not follow.small_enough(replace(result, reversals=7), 0.02)


# --- what a file says -----------------------------------------------------------------------------


def read(path, header: str, columns, **source) -> Log:
    rows = zip(*(np.asarray(column).tolist() for column in columns), strict=True)
    text = "\n".join([header, *(",".join(map(repr, row)) for row in rows)])
    path.write_text(text + "\n", encoding="utf-8")
    return readers.read(path, readers.Source(**source))


UP = [0.5 * i for i in range(60)]


@pytest.mark.parametrize(
    ("header", "angle", "torque"),
    [
        ("angle [degrees],torque [N m]", np.pi / 180, 1.0),
        ("angle (°),torque (N*m)", np.pi / 180, 1.0),
        ("angle (rad),torque (mNm)", 1.0, 1e-3),
        ("theta_mrad,torque_kNm", 1e-3, 1e3),
        ("angle [turn],torque [lbft]", 2 * np.pi, 4.4482216153 * 0.3048),
        ("angle [rad],torque [lb-in]", 1.0, 4.4482216153 * 0.0254),
        ("position [µm],force [µN]", 1e-6, 1e-6),
        ("position [mm],force [lb]", 1e-3, 0.45359237 * 9.80665),
        ("pos_in,load_kip", 0.0254, 453.59237 * 9.80665),
        ("pos [m],force [kN]", 1.0, 1e3),
        ("pos [mm],force [mN]", 1e-3, 1e-3),
    ],
)
def test_units_as_people_spell_them(tmp_path, header, angle, torque):
    log = read(tmp_path / "log.csv", header, (UP, UP))
    assert np.ptp(log.theta) == pytest.approx(29.5 * angle, rel=1e-8)
    assert log.torque[-1] == pytest.approx(29.5 * torque, rel=1e-8)


@pytest.mark.parametrize(
    ("header", "step", "size", "said"),
    [
        ("t", 0.5, 1, "'t' names no unit of it (--time-unit); a row comes every 0.5 s"),
        ("t", 1.0, 1, "; a row comes every 1 s, is it in ms?"),
        ("time_s", 2.0, 1, ""),
        ("time_ms", 0.5, 1e-3, ""),
        ("t [ms]", 0.5, 1e-3, ""),
    ],
)
def test_the_time_in_its_unit(tmp_path, header, step, size, said):
    up = [step * k for k in range(len(UP))]
    log = read(tmp_path / "log.csv", f"{header},angle_rad,torque_Nm", (up, UP, UP))
    assert np.diff(log.time) == pytest.approx(step * size)
    assert [note.endswith(said) for note in log.notes] == [True] * bool(said)


@pytest.mark.parametrize(("unit", "size"), [("rad", 2 * np.pi / 500), ("mm", 1e-3 / 500)])
def test_counts_per_turn_or_per_millimetre(tmp_path, unit, size):
    values = [0.37 * i % 3 for i in range(60)]
    log = read(tmp_path / "a.csv", f"pos_{unit},load", (values, UP), counts_per_turn=500)
    assert log.resolution == pytest.approx(size)
    grid = np.cumsum(np.random.default_rng(1).integers(-3, 4, 500)) * size
    assert resolution_of(grid) == pytest.approx(size)


@pytest.mark.parametrize(
    ("unit", "turn"), [("deg", 360), ("rad", 2 * np.pi), ("mrad", 2000 * np.pi), ("turn", 1)]
)
def test_an_angle_that_wraps_is_made_whole(tmp_path, unit, turn):
    whole = np.linspace(0, 2.7, 300) * turn
    log = read(tmp_path / "a.csv", f"angle [{unit}],torque", (whole % turn, whole))
    assert np.ptp(log.theta) == pytest.approx(2.7 * 2 * np.pi)
    half = np.abs(np.linspace(-1, 1, 300)) * turn / 2  # no jump: nothing to undo
    log = read(tmp_path / "b.csv", f"angle [{unit}],torque", (half, whole))
    assert np.ptp(log.theta) == pytest.approx(np.pi, rel=0.01)
    for jump, wraps in ((0.89, False), (0.92, True), (1.0, True), (1.6, False)):  # 0 and the turn
        some = (np.array([0, 0.5, jump, 0, 0.5]) * turn, range(5))
        log = read(tmp_path / "c.csv", f"angle [{unit}],torque", some)
        assert any("wraps at a turn" in note for note in log.notes) is wraps


def test_a_signed_number_read_as_unsigned(tmp_path):
    load = np.array([*range(-30, 30), -16384, 16384, -1, 0])
    log = read(tmp_path / "a.csv", "angle_rad,load_N", (range(64), (load % 65536).tolist()))
    assert log.torque.tolist() == load.tolist()
    assert "65536 taken off" in log.notes[0]
    for offset in (32700, 40000):  # no sign lost
        other = [*range(offset, offset + 64)]
        log = read(tmp_path / "b.csv", "angle_rad,load_N", (range(64), other))
        assert log.torque.tolist() == other


def test_columns_by_number_count_from_one(tmp_path):
    columns = (UP, [7.0 * x for x in UP], [3.0 * x for x in UP])
    log = read(tmp_path / "a.csv", "x,y,z", columns, angle="2", torque="3", angle_unit="rad")
    assert (log.theta[-1], log.torque[-1]) == (7 * UP[-1], 3 * UP[-1])
    log = read(tmp_path / "a.csv", "x,y,z", columns, angle="3", torque="1", angle_unit="rad")
    assert (log.theta[-1], log.torque[-1]) == (3 * UP[-1], UP[-1])


def test_rows_of_one_and_the_same_time_are_a_log(tmp_path):
    """A logger whose clock is coarser than its rows."""
    time = [0.5 * (i // 3) for i in range(60)]
    assert read(tmp_path / "a.csv", "t,angle_rad,load", (time, UP, UP)).rows == 60


def test_a_viscous_part_has_the_sign_of_the_motion():
    """And its size; a negative one, which no passive part has, is not made up."""
    log = synthetic(1, rows=4000, cycles=8, amplitude=0.3)
    speed = np.gradient(log.theta, 1e-3)
    theta = sine(1, rows=4000, cycles=8, amplitude=0.3)
    log = replace(log, theta=theta, resolution=0.0)
    options = pipeline.Options(terms=("viscous",))
    found = pipeline.identify([replace(log, torque=log.torque + 0.02 * speed)], options).estimate
    assert found.terms["viscous"] == pytest.approx(0.02, rel=0.15)


def test_held_out_means_held_out():
    """Noise that no model can know is not explained: R2 on the rows left out is below the fit's."""
    rng = np.random.default_rng(1)
    log = replace(synthetic(1, rows=300, cycles=3), torque=rng.normal(size=300))
    result = pipeline.identify(
        [log], pipeline.Options(terms=("offset", "spring", "viscous", "inertia"))
    )
    assert result.models.r2["dahl"] < 0 < result.r2


def test_intervals_are_as_wide_as_the_errors_are():
    """White noise: over 20 logs, errors in units of the half width scatter as 1 over t(0.975)."""
    parts = []
    for seed in range(20):
        theta = sine(seed, rows=1500, cycles=6)
        torque = dahl_torque(theta) + 0.05 * FC * noise_of(seed, 1500)
        log = replace(synthetic(seed, rows=1500), theta=theta, torque=torque, resolution=0.0)
        found = pipeline.identify([log], pipeline.Options(terms=(), delay=False)).estimate
        for name, truth in (("sigma0", SIGMA0), ("Fc", FC)):
            half = found.ci95[name].relative(1.0)
            parts.append((getattr(found, name) - truth) / half)
    assert 0.3 < np.std(parts) < 0.62


def test_a_band_of_torque_that_is_flat_is_found_where_it_is():
    """Friction that bends everywhere alike has none."""
    theta = np.concatenate([np.linspace(-1, 1, 400), np.linspace(1, -1, 400)] * 4)
    turns = np.arange(400, 3200, 400)
    bent = np.tile(np.concatenate([np.linspace(-1, 1, 400), np.linspace(1, -1, 400)]), 4)
    log = Log("bent", theta, bent, resolution=COUNT)
    assert clean.backlash(log, bent, turns)[0] == 0
    flat = np.sign(bent) * np.maximum(np.abs(bent) - 0.3, 0) / 0.7
    slack, centre, moves = clean.backlash(log, flat, turns)
    assert slack == pytest.approx(0.6, rel=0.2)
    assert centre == pytest.approx(0, abs=0.06)
    assert np.abs(moves).sum() < 0.85 * np.abs(log.moves).sum()
    assert clean.backlash(replace(log, resolution=0.15), flat, turns)[0] == pytest.approx(slack)
    assert clean.backlash(replace(log, resolution=0.25), flat, turns)[0] == 0  # below 3 counts
    assert clean.backlash(log.head(1200), flat[:1200], turns[:2])[0] == pytest.approx(
        slack, rel=0.1
    )
    assert clean.backlash(log.head(800), flat[:800], turns[:1])[0] == 0  # crossed twice


def test_between_counts_is_within_half_a_count_of_what_was_read():
    log = synthetic(1, rows=3000, cycles=6)
    between = clean.between_counts(log)
    assert np.abs(between - log.theta).max() <= 0.5 * COUNT * (1 + 1e-9)
    assert np.abs(np.diff(between, 2)).max() < 0.5 * np.abs(np.diff(log.theta, 2)).max()
    assert clean.between_counts(replace(log, resolution=0.0)) is log.theta


@pytest.mark.parametrize("part", [0.03, 0.1])
def test_small_strokes_are_no_flicker(part):
    """Forty of them within a large one, each by a part of its range; spikes are."""
    x = np.linspace(0, 1, 4000)
    theta = np.sin(np.pi * x) + part * np.sin(2 * np.pi * 40 * x)
    log = Log("x", theta, theta)
    assert clean.flickers(log) < 8
    theta[100:4000:100] += 3 * part
    assert clean.flickers(log) > 39


@pytest.mark.parametrize("counts", [300, 30_000, 3_000_000])
def test_an_encoder_is_seen_over_any_range(counts):
    """A slow end of a stroke shows neighbouring counts, however many there are in all."""
    theta = np.round(counts / 2 * np.sin(np.linspace(-1.58, 1.58, 60_000))) * COUNT
    assert resolution_of(theta) == pytest.approx(COUNT)
