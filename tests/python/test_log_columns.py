# SPDX-License-Identifier: MIT
"""Which column of a log is what, and in which unit: by the name of the column or by an option, each
unit one factor, each assumption a note; clocks of all kinds, counters that run over.
"""

from __future__ import annotations

import math
import re

import numpy as np
import pandas as pd
import pytest
from log_reading import read, refused

pytestmark = pytest.mark.usefixtures("library")

ROWS = 40
UP = np.arange(float(ROWS)) / 64
WAVE = np.array([0.25, 0.75, -0.5, 0.125] * (ROWS // 4))


def written(folder, **columns):
    return written_as(folder, columns)


def written_as(folder, columns):
    pd.DataFrame(columns).to_csv(folder / "x.csv", index=False)
    return folder / "x.csv"


# --- units ----------------------------------------------------------------------------------------

POUND = 0.45359237 * 9.80665  # N, by definition
DEGREE = math.pi / 180
ANGLES = {  # rad of each unit, under each name that it goes by
    DEGREE: ("deg", "degrees", "Degree", "°"),
    DEGREE / 1e3: ("mdeg",),
    1.0: ("rad", "radians"),
    1e-3: ("mrad",),
    1e-6: ("urad", "µrad"),
    DEGREE / 60: ("arcmin",),
    DEGREE / 3600: ("arcsec",),
    2 * math.pi: ("turn", "turns", "rev", "revolutions"),
}
LENGTHS = {1.0: ("m",), 1e-2: ("cm",), 1e-3: ("mm",), 1e-6: ("um", "µm", "μm")}
LENGTHS |= {0.0254: ("in", "inch", "inches"), 0.3048: ("ft",)}
TORQUES = {  # N m
    1.0: ("Nm", "N m", "N·m", "N*m", "N.m", "nm"),
    1e-2: ("cNm", "Ncm"),
    1e-3: ("mNm", "Nmm", "mN m", "mN·m"),
    1e-6: ("uNm", "µNm"),
    1e3: ("kNm",),
    1e6: ("MNm",),
    9.80665e-2: ("kgfcm", "kgf·cm", "kgcm"),
    9.80665e-5: ("gfcm", "gcm"),
    POUND / 16 * 0.0254: ("ozin", "oz-in", "ozf·in", "in oz"),
    POUND * 0.0254: ("lbin", "lb-in", "in-lb", "lbf in", "in lbf"),
    POUND * 0.3048: ("lbft", "ft-lb", "ft lb", "lbf-ft", "ft·lbf"),
}
FORCES = {1.0: ("N",), 1e-3: ("mN",), 1e-6: ("uN", "µN"), 1e3: ("kN",), 1e6: ("MN",)}
FORCES |= {9.80665: ("kgf",), 9.80665e-3: ("gf",), POUND: ("lb", "lbf"), 1e3 * POUND: ("kip",)}
TIMES = {1.0: ("s", "sec", "seconds"), 1e-3: ("ms", "msec"), 1e-6: ("us", "µs"), 1e-9: ("ns",)}
KINDS = [(ANGLES, TORQUES, "angle", "N m"), (LENGTHS, FORCES, "position", "N")]
FORMS = ("{what} [{unit}]", "{what} ({unit})", "{what}_{unit}", "{what}, left [{unit}]")


@pytest.mark.parametrize(("ways", "pushes", "what", "unit"), KINDS, ids=["turning", "linear"])
def test_a_unit_is_one_factor_however_it_is_said(ways, pushes, what, unit, tmp_path):
    """In the name of a column or by an option, under each of its names."""
    for table, other, place in ((ways, pushes, 0), (pushes, ways, 1)):
        for size, names in table.items():
            for number, name in enumerate(names):
                form = FORMS[(number + place) % len(FORMS)]
                if form == FORMS[2] and not name.isascii():
                    form = FORMS[0]
                given = [(what, ""), ("torque", "")]
                given[place] = (form.format(what=given[place][0], unit=name), "")
                given[1 - place] = (given[1 - place][0], next(iter(other.values()))[0])
                path = written_as(tmp_path, {given[0][0]: UP / 8, given[1][0]: WAVE})
                words = [f"--{('angle', 'torque')[1 - place]}-unit", given[1 - place][1]]
                log = read(path, *words, "--trust-units")
                found = (log.theta, log.torque)[place]
                first = size * (UP / 8, WAVE)[place]
                np.testing.assert_allclose(found, first, rtol=1e-8, err_msg=name)
                assert (log.linear, log.unit) == (unit == "N", unit)
                assert not any(("taken" in note) for note in log.notes), (name, log.notes)


def test_a_unit_by_an_option_goes_before_that_of_a_name(tmp_path):
    path = written(tmp_path, t_s=UP, angle_deg=UP, torque_Nm=WAVE)
    words = "--angle-unit mrad --torque-unit mNm --time-unit ms --trust-units".split()
    log = read(path, *words)
    for found, wanted in ((log.time, UP), (log.theta, UP), (log.torque, WAVE)):
        np.testing.assert_allclose(found, 1e-3 * wanted, rtol=1e-12)
    for what, wrong, near in (
        ("angle", "degs", "deg"),
        ("torque", "Nmm2", "Nm"),
        ("time", "mss", "ms"),
    ):
        line = refused(path, f"--{what}-unit", wrong)
        assert wrong in line and f"'{near}'" in line


@pytest.mark.parametrize("size", TIMES)
def test_a_time_is_in_the_unit_of_its_name(size, tmp_path):
    for name in TIMES[size]:
        for clock in (f"time [{name}]", f"t_{name}" if name.isascii() else f"time_{name}"):
            log = read(written_as(tmp_path, {clock: UP, "angle_rad": UP, "torque_Nm": WAVE}))
            np.testing.assert_allclose(log.time, size * UP, rtol=1e-12, err_msg=clock)
            assert log.notes == []


@pytest.mark.parametrize(
    ("header", "words", "assumed"),
    [
        ("time_s,angle_deg,torque_Nm", "", []),
        ("time_ms,angle_rad,torque_mNm", "", []),
        ("angle,load", "--angle-unit rad --torque-unit Nm", []),
        ("angle_deg,torque_A", "", ["torque Nm"]),
        ("angle_deg,torque [V]", "", ["torque Nm"]),
        ("angle,load", "", ["angle deg", "torque Nm"]),
        ("t,angle,torque", "", ["angle deg", "torque Nm", "time s"]),
        ("position_mm,load", "--torque-unit N", []),
        ("position_mm,load", "", ["torque N"]),
        ("theta_m,torque_Nm", "", ["angle deg"]),  # of the motor
        ("t,angle_deg,torque_Nm", "--time-unit ms", []),
    ],
)
def test_each_unit_that_was_assumed_is_named(header, words, assumed, tmp_path):
    columns = [(WAVE if "t" in name[:2] and "o" in name else UP) for name in header.split(",")]
    path = written_as(tmp_path, dict(zip(header.split(","), columns, strict=True)))
    log = read(path, *words.split())
    notes = [note for note in log.notes if "no column of times" not in note]
    assert (len(notes) < len(log.notes)) is (log.time is None)
    found = [re.search(r"^(\w+) taken in (\w+)\b", note) for note in notes]
    assert [" ".join(one.groups()) for one in found] == assumed
    for note, one in zip(notes, found, strict=True):
        assert one[1] != "time" or f"{UP[1]:.3g} s" in note


def test_newtons_over_an_angle_are_told(tmp_path):
    path = written(tmp_path, angle_deg=UP, force_kN=WAVE)
    log = read(path)
    assert log.torque.tolist() == (1e3 * WAVE).tolist() and not log.linear
    assert any("'force_kN'" in note and "N m" in note for note in log.notes)


# --- which column ---------------------------------------------------------------------------------


def test_of_several_columns_that_fit_the_likeliest_is_taken_and_told(tmp_path):
    """The first, but not what was wanted, nor a rate, nor a force where there is a torque."""
    path = written(
        tmp_path,
        theta_ref_rad=9 * UP,
        angle_rate_rad=8 * UP,
        t=UP,
        angle_rad=UP,
        theta_deg=2 * UP,
        load_mNm=5 * WAVE,
        torque_Nm=WAVE,
        time_ms=UP,
    )
    log = read(path)
    assert (log.theta.tolist(), log.torque.tolist()) == (UP.tolist(), WAVE.tolist())
    assert log.time.tolist() == UP.tolist()
    (note,) = (note for note in log.notes if "--angle" in note)
    assert "'angle_rad'" in note and "'theta_deg'" in note


def test_a_column_is_named_by_name_or_number(tmp_path):
    path = written(tmp_path, a=UP, b=WAVE, c=2 * UP, angle_deg=3 * UP)
    for words in ("--angle c --torque b --time a", "--angle 3 --torque 2 --time 1"):
        log = read(path, *words.split(), "--angle-unit", "rad")
        assert (log.theta[-1], log.torque.tolist(), log.time[-1]) == (
            2 * UP[-1],
            WAVE.tolist(),
            UP[-1],
        )
    for words, parts in (
        ("--torque b --angle angel_deg", ("'angel_deg'", "'angle_deg'", "a, b, c")),
        ("--torque b --angle 5", ("'5'",)),
        ("--torque b --angle 0", ("'0'",)),
        ("--angle a", ("--torque",)),
        ("--angle a --torque a", ("'a'", "angle", "torque")),
        ("--angle a --torque b --time b", ("'b'", "torque", "time")),
        ("--angle a --torque b --load c --load c", ("'c'", "load 1", "load 2")),
        ("--angle a --torque b --load clamp", ("'clamp'",)),
    ):
        line = refused(path, *words.split())
        assert all(part in line for part in ("x.csv", *parts)), (words, line)


def test_a_complaint_lists_thirty_columns(tmp_path):
    for count in (30, 31, 75):
        columns = {f"column{number}": UP for number in range(count)}
        line = refused(written_as(tmp_path, columns), "--angle", "COLUMN7x")
        assert "'column7'" in line and "column29" in line and "column30" not in line
        assert (f" {count - 30} more" in line) is (count > 30)


def test_loads_are_added(tmp_path):
    """A load's column is not taken for the torque, whose name it resembles."""
    path = written(tmp_path, angle_deg=UP, load_N=UP, torque_Nm=WAVE, clamp_N=10 * UP)
    log = read(path, "--load", "load_N", "--load", "4")
    assert (log.load.tolist(), log.torque.tolist()) == ((11 * UP).tolist(), WAVE.tolist())
    assert read(path, "--torque", "torque_Nm").load is None
    path = written(tmp_path, angle_deg=UP, torque_Nm=WAVE, clamp=np.where(UP == UP[2], np.inf, UP))
    line = refused(path, "--load", "clamp")
    assert "x.csv:4:" in line and "'clamp'" in line


# --- clocks ---------------------------------------------------------------------------------------

BEFORE = np.datetime64("2026-11-23T23:59:58.000")
MOMENTS = {
    "date": lambda moment: f"{moment}",
    "date and zone": lambda moment: f"{moment}Z".replace("T", " "),
    "decimal comma": lambda moment: f"{moment}".replace("T", " ").replace(".", ","),
    "time of day, over midnight": lambda moment: f"{moment}".partition("T")[2],
}


@pytest.mark.parametrize("form", MOMENTS)
def test_dates_and_times_of_day_are_seconds_from_the_first(form, tmp_path):
    """Whatever the column is called; one cell that is none is named."""
    for name in ("time", "t_ms"):
        steps = (BEFORE + np.timedelta64(125, "ms") * k for k in range(ROWS))
        columns = {name: [*map(MOMENTS[form], steps)], "angle_rad": UP, "torque_Nm": WAVE}
        log = read(written_as(tmp_path, columns))
        assert log.time == pytest.approx(np.arange(ROWS) / 8) and log.notes == []
        columns[name][7] = "noon"
        line = refused(written_as(tmp_path, columns))
        assert "x.csv:9:" in line and f"'{name}'" in line and "'noon'" in line


@pytest.mark.parametrize("clock", ["t", "t_s", "t [ms]", "T(s)", "t_sec", "time", "Time [s]"])
def test_a_temperature_or_a_torque_is_no_clock(clock, tmp_path):
    columns = {"T_degC": 20 + UP**2, "T_Nm": WAVE, "t_start": UP**3, "angle_rad": UP}
    assert read(written_as(tmp_path, columns)).time is None
    log = read(written_as(tmp_path, columns | {clock: UP}))
    assert log.time == pytest.approx((1e-3 if "ms" in clock else 1) * UP)
    assert log.torque.tolist() == WAVE.tolist()


def test_a_column_that_rises_in_a_unit_of_time_is_the_clock_whatever_its_name(tmp_path):
    """As in a table of another language: 'Zeit [s]', or a unit in the line below the names."""
    columns = {"Dauer [s]": WAVE, "Zeit [ms]": UP, "angle_rad": UP, "torque_Nm": WAVE}
    log = read(written_as(tmp_path, columns))
    assert log.time == pytest.approx(1e-3 * UP)
    (note,) = log.notes
    assert "'Zeit [ms]'" in note and "--time" in note
    rows = "\n".join(f"{t:.9g};{x:.9g};{F:.9g}" for t, x, F in zip(UP, UP, WAVE, strict=True))
    path = tmp_path / "german.csv"
    path.write_text("Zeit;Winkel;Moment\ns;rad;Nm\n" + rows.replace(".", ",") + "\n")
    log = read(path, "--angle", "Winkel", "--torque", "Moment")
    assert log.time == pytest.approx(UP) and log.theta == pytest.approx(UP)
    still = columns | {"Zeit [ms]": np.ones(ROWS)}
    assert read(written_as(tmp_path, still)).time is None


def test_a_clock_that_goes_backward_is_refused_with_its_row(tmp_path):
    time = UP.copy()
    time[20] = 0.1
    line = refused(written(tmp_path, t=time, angle_rad=UP, torque_Nm=WAVE))
    assert "row 21" in line and "0.1 after 0.296875" in line
    time[20] = time[19]  # rows of one time are none
    assert read(written(tmp_path, t=time, angle_rad=UP, torque_Nm=WAVE)).rows == ROWS


# --- counters -------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(6))
def test_counts_of_a_counter_that_runs_over_are_a_path(seed, tmp_path):
    """Of any number of counts a turn, from any start; without the number they are refused."""
    draw = np.random.default_rng(seed)
    turn = int(draw.integers(300, 2**20))
    gone = np.cumsum(draw.integers(-turn // 20, turn // 20, 60))
    gone = np.append(gone - gone[-1], np.cumsum(np.full(40, turn // 50)))
    read_by = (gone + int(draw.integers(turn))) % turn
    path = written(tmp_path, counts=read_by, torque=draw.normal(size=100))
    log = read(path, "--counts-per-turn", turn)
    way = (log.theta - log.theta[0]) * turn / (2 * math.pi)
    np.testing.assert_allclose(way, gone - gone[0], atol=1e-6)
    assert log.resolution == pytest.approx(2 * math.pi / turn)
    assert "--counts-per-turn" in refused(path)
    assert "--counts-per-turn -1" in refused(path, "--counts-per-turn", "-1")


@pytest.mark.parametrize(
    ("unit", "turn"), [("deg", 360), ("rad", 2 * math.pi), ("turn", 1), ("mrad", 2e3 * math.pi)]
)
def test_an_angle_that_starts_anew_at_a_turn_is_one_path(unit, turn, tmp_path):
    gone = np.cumsum(np.full(100, 0.03))
    path = written_as(tmp_path, {f"angle [{unit}]": turn * (gone % 1), "torque": np.sin(gone)})
    log = read(path)
    assert np.diff(log.theta) == pytest.approx(0.03 * 2 * math.pi)
    assert sum("wraps" in note for note in log.notes) == 1


def test_the_counts_of_an_encoder_are_seen_in_its_angle(tmp_path):
    """By the grid on which all angles lie; an option says it otherwise, per turn or millimetre."""
    counts = np.round(900 * np.sin(np.arange(300) / 9))
    count = 2 * math.pi / 4096
    path = written(tmp_path, angle_rad=counts * count, torque_Nm=np.cos(np.arange(300)))
    assert read(path).resolution == pytest.approx(count, rel=1e-6)
    assert read(path, "--counts-per-turn", 8192).resolution == pytest.approx(count / 2)
    free = 0.01 * np.cumsum(np.random.default_rng(1).normal(size=300))
    assert read(written(tmp_path, angle_rad=free, torque_Nm=np.cos(free))).resolution == 0
    path = written(tmp_path, position_mm=counts / 50, force_N=np.cos(np.arange(300)))
    assert read(path).resolution == pytest.approx(2e-5)
    assert read(path, "--counts-per-turn", 200).resolution == pytest.approx(5e-6)


@pytest.mark.parametrize(("most", "is_signed"), [(32766, True), (49150, False)])
def test_a_torque_of_16_bits_without_its_sign_gets_it_back(most, is_signed, tmp_path):
    torque = np.where(np.arange(ROWS) % 2, 65535 - np.arange(ROWS), np.arange(ROWS))
    torque[5] = most % 16384 if is_signed else 20_000
    log = read(written(tmp_path, angle_rad=UP, torque_mNm=torque))
    wanted = np.where(torque > 32767, torque - 65536, torque) if is_signed else torque
    assert log.torque == pytest.approx(1e-3 * wanted)
    assert any("16-bit" in note for note in log.notes) is is_signed
