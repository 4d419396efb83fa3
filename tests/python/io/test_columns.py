# SPDX-License-Identifier: MIT
"""Columns and units of logs, by the names of the columns or by options."""

import math

import numpy as np
import pandas as pd
import pytest
from dahl.identify import Source
from dahl.identify import read as read_log
from log_reading import read, refused, run

ROWS = 40
UP = np.arange(float(ROWS)) / 64
WAVE = np.array([0.25, 0.75, -0.5, 0.125] * (ROWS // 4))


def written(folder, **columns):
    return written_as(folder, columns)


def written_as(folder, columns):
    pd.DataFrame(columns).to_csv(folder / "x.csv", index=False)
    return folder / "x.csv"


# --- units ----------------------------------------------------------------------------------------

POUND, DEGREE, INCH, G = 0.45359237 * 9.80665, math.pi / 180, 0.0254, 9.80665  # N, rad, m, m/s^2
ANGLES = {  # rad (m) of each unit, and the names of columns that have it
    DEGREE: "angle_deg|Angle (°)|Angle [Degrees]|Winkel [°]|theta_in_deg|angle|theta_m|angle_in",
    DEGREE / 1e3: "angle_mdeg",
    1.0: "angle [rad]|[RAD] angle|angle (Radians)|Position (raw) [rad]|angle, left [rad]",
    1e-3: "angle_mrad|winkel_mrad",
    1e-6: "angle [urad]|angle [µrad]",
    DEGREE / 60: "angle (arcmin)",
    DEGREE / 3600: "angle [arcsec]",
    math.pi / 200: "angle_gon",
    2 * math.pi: "angle [rev]|angle_turn|angle_turns|angle_revolutions",
}
LENGTHS = {
    1.0: "pos_m|position [m]",
    1e-2: "pos_cm",
    1e-3: "position / mm|pos_in_mm|Weg [mm]",
    1e-6: "pos [µm]|pos [μm]|pos_um",
    INCH: "theta [in]|pos_in|position_inch|pos_inches",
    12 * INCH: "pos_ft",
}
MOMENTS = {
    1.0: "torque_Nm|torque [N m]|torque [N*m]|torque [N·m]|torque [N.m]|torque_N_m|torque_nm"
    "|Drehmoment [Nm]|Torque [Nm] (filtered)|Torque_Nm [V]|torque",
    1e-2: "torque_cNm|torque [Ncm]",
    1e-3: "torque_mNm|torque (mN.m)|torque [mN m]|torque [Nmm]|Torque (motor) [mNm]",
    1e-6: "torque_uNm|torque [µNm]",
    1e3: "torque_kNm|torque_kN_m",
    1e6: "torque_MNm",
    G / 100: "torque_kgcm|torque [kgf·cm]",
    G / 1e5: "torque [g*cm]|torque_gfcm",
    POUND * 12 * INCH: "load [lb-ft]|torque_ft_lb|trq_lb_ft|torque [ft·lbf]|torque [lbf-ft]",
    POUND * INCH: "torque_in_lb|torque [lbf in]|torque_lbin",
    POUND * INCH / 16: "torque_oz_in|torque [ozf·in]|torque [in oz]",
}
FORCES = {
    1.0: "force_N|force_n|Kraft [N]",
    1e-3: "force [mN]",
    1e-6: "force [µN]",
    1e3: "force_kN",
    1e6: "force [MN]",
    POUND: "load_lbf|load_lb",
    1e3 * POUND: "load_kip",
    G: "load [kgf]",
    G / 1e3: "load_gf",
}
TIMES = {
    1.0: "time_s|t|T(s)|t_sec|Time (seconds)|Zeit [s]|Uhrzeit [s]",
    1e-3: "time_ms|t [ms]|t_msec|time [Milliseconds]|ms|ms_today",
    1e-6: "t_us|time [µs]|us_since_boot",
    1e-9: "time_ns|ns",
}
UNNAMED = "angle|theta_m|angle_in|torque|Torque_Nm [V]|force_n|t".split("|")
LINEAR = {"angle": "pos_m", "torque": "force_N", "time": "t_s"}
TURNING = {"angle": "angle_rad", "torque": "torque_Nm", "time": "t_s"}


@pytest.mark.parametrize(
    ("role", "table", "others"),
    [
        ("angle", ANGLES, TURNING),
        ("angle", LENGTHS, LINEAR),
        ("torque", MOMENTS, TURNING),
        ("torque", FORCES, LINEAR),
        ("time", TIMES, TURNING),
    ],
    ids=["angles", "lengths", "moments", "forces", "times"],
)
def test_a_unit_is_one_factor_however_a_column_spells_it(role, table, others, tmp_path):
    """A name without a unit gets the usual one, with a note."""
    sound = {"angle": UP / 8, "torque": WAVE, "time": UP}
    for name, size in {name: x for x, names in table.items() for name in names.split("|")}.items():
        names = {**others, role: name}
        path = written_as(tmp_path, {names[one]: column for one, column in sound.items()})
        log = read_log(path, Source())
        found = {"angle": log.theta, "torque": log.torque, "time": log.time}
        np.testing.assert_allclose(found.pop(role), size * sound[role], rtol=1e-8, err_msg=name)
        for one, column in found.items():
            np.testing.assert_array_equal(column, sound[one], err_msg=name)
        assert (log.linear, log.unit) == ((True, "N") if others is LINEAR else (False, "N m"))
        assert bool(log.notes) is (name in UNNAMED)


def test_an_option_overrides_the_unit_of_a_name(tmp_path):
    path = written(tmp_path, t_s=UP, angle_deg=UP, torque_Nm=WAVE)
    words = "--angle-unit mrad --torque-unit mNm --time-unit ms --trust-units".split()
    log = read(path, *words)
    for found, wanted in ((log.time, UP), (log.theta, UP), (log.torque, WAVE)):
        np.testing.assert_allclose(found, 1e-3 * wanted, rtol=1e-12)
    log = read(path, "--angle-unit", "in", "--torque-unit", "lb", "--trust-units")
    assert (log.theta[-1], log.torque[0]) == pytest.approx((INCH * UP[-1], POUND / 4))
    for what, wrong, near in (
        ("angle", "degs", "deg"),
        ("torque", "Mn", "MN"),
        ("time", "mss", "ms"),
    ):
        line = refused(path, f"--{what}-unit", wrong)
        assert f"--{what}-unit {wrong}" in line and f"'{near}'" in line


TURN = {"deg": 360.0, "rad": 2 * math.pi, "turn": 1.0}
SWING = 0.3 * np.sin(np.arange(4000) / 97) + 0.02 * np.sin(np.arange(4000) / 11)  # rad


def swinging(unit: str, counts: int, noise: float = 0.0) -> np.ndarray:
    """An angle in a unit, read by an encoder of so many counts a turn; 0: without one."""
    draw = np.random.default_rng(counts).normal(size=len(SWING))
    read = SWING / (2 * math.pi) * (counts or 1)
    read = np.round(read + noise * draw) if counts else read
    return read if unit == "counts" else read / (counts or 1) * TURN[unit]


@pytest.mark.parametrize("unit", [*TURN, "counts"])
@pytest.mark.parametrize("counts", [0, 2**12, 2**14, 2**17, 2**20, 10_000])
@pytest.mark.parametrize("is_given", [False, True])
def test_an_angle_without_a_unit_is_confirmed_by_its_steps_or_asked_for(
    unit, counts, is_given, tmp_path
):
    """Only steps of an encoder in deg confirm deg. Other steps name their unit in the question."""
    if unit == "counts" and not counts:
        return
    for name, noise in (("angle", 0.0), ("position", 2.0)):
        path = written_as(tmp_path, {name: swinging(unit, counts, noise), "torque_Nm": SWING})
        log = read(path, *(("--counts-per-turn", counts) if is_given and counts else ()))
        asked = log.questions.get("angle", "")
        assert bool(asked) is not (unit == "deg" and counts > 0), (name, asked)
        looks_printed = (unit, counts, is_given) == ("turn", 10_000, False)  # steps of 1e-4
        named = unit if counts and not looks_printed else "deg"
        steps = {"rad": f"2 pi/{counts}", "turn": f"1/{counts}", "deg": ""}.get(named, "whole")
        assert not asked or (f"in {named}?" in asked and (steps in asked or not counts)), asked
        stated = read(path, "--angle-unit", unit, "--counts-per-turn", counts or 1e6)
        assert not stated.questions


@pytest.mark.parametrize(("stated", "unit"), [("deg", "rad"), ("rad", "deg"), ("deg", "turn")])
@pytest.mark.parametrize("counts", [4096, 16384, 10_000])
def test_a_stated_unit_is_refused_if_the_steps_are_those_of_an_encoder_in_another(
    stated, unit, counts, tmp_path
):
    """Also if the counts of a turn are given, which may then be any number."""
    path = written_as(tmp_path, {f"angle_{stated}": swinging(unit, counts), "torque_Nm": SWING})
    given = ("--counts-per-turn", counts)
    assert f"in {unit} (--angle-unit" in refused(path, *given)
    if counts != 10_000:
        assert f"in {unit} (--angle-unit" in refused(path)
    assert read(path, *given, "--angle-unit", unit).questions == {}


@pytest.mark.parametrize("column", ["torque", "load_V", "force"])
def test_a_torque_without_a_unit_is_asked_for(column, tmp_path):
    path = written_as(tmp_path, {"angle_rad": SWING, column: np.cos(SWING)})
    asked = read(path).questions["torque"]
    assert "N m" in asked and f"'{column}'" in asked and "--torque-unit" in asked
    assert read(path, "--torque-unit", "mNm").questions == {}


@pytest.mark.parametrize(
    "names",
    [
        "t_s q_rad i_q",
        "millis shaft_angle_rad current.q",
        "__time pos_rad motor_current_A",
        "time_s pid_pos_rad avg_motor_current",
        "stamp position_rad Iq_measured",
        "t_s angle_rad torque_A",
    ],
)
def test_a_motor_current_needs_a_torque_constant(names, tmp_path):
    values = (1e3 * UP if "millis" in names else UP, UP, WAVE)
    path = written_as(tmp_path, dict(zip(names.split(), values, strict=True)))
    line = refused(path)
    assert f"'{names.split()[2]}'" in line and "--torque-constant" in line
    for words, factor in ((), 0.5), (("--torque-unit", "mA"), 0.5e-3):
        log = read(path, "--torque-constant", 0.5, *words)
        assert log.torque == pytest.approx(factor * WAVE) and log.time == pytest.approx(UP)
        assert log.questions == {} and any("current" in note for note in log.notes)
    assert "Nm" in refused(path, "--torque-constant", 0.5, "--torque-unit", "Nm")
    assert read(path, "--torque-unit", "Nm").torque == pytest.approx(WAVE)


VESC = """ms_today;input_voltage;temp_mos_max;temp_motor;current_motor;current_in;d_axis_current
q_axis_current;erpm;duty_cycle;amp_hours_used;tachometer;tachometer_abs;encoder_position;fault_code
d_axis_voltage;q_axis_voltage;ms_today_setup;battery_level;current_in_setup;current_motor_setup
speed_meters_per_sec;tacho_meters;num_vescs;ms_today_imu;roll;pitch;gyroX;gnss_posTime;gnss_alt;"""


def test_a_log_of_vesc_tool_has_its_clock_in_milliseconds(tmp_path):
    """The first of three; each line ends with a semicolon."""
    names = VESC.replace("\n", ";").split(";")[:-1]
    columns = {name: np.cos(np.arange(ROWS) * k) for k, name in enumerate(names)}
    columns |= {"ms_today": 43_200_000 + 10 * np.arange(ROWS), "current_motor": WAVE}
    columns["encoder_position"] = 1 + 40 * UP
    path = tmp_path / "vesc.csv"
    pd.DataFrame(columns | {"": np.nan}).to_csv(path, sep=";", index=False)
    log = read(path, "--torque-constant", 0.5)
    assert np.diff(log.time) == pytest.approx(0.01) and log.torque == pytest.approx(0.5 * WAVE)
    assert log.theta == pytest.approx(np.radians(1 + 40 * UP))
    assert not any("time" in note for note in log.notes), log.notes


@pytest.mark.parametrize(("unit", "size"), [("s", 1), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_a_clock_since_1970_has_the_unit_of_its_size(unit, size, tmp_path):
    stamps = [round((1_790_000_000 + at) * size) for at in 64 * UP]
    path = written_as(tmp_path, {"stamp": stamps, "angle_rad": UP, "effort_Nm": WAVE})
    assert np.diff(read(path).time) == pytest.approx(1, rel=1e-4)


def test_seconds_and_nanoseconds_of_a_stamp_are_added(tmp_path):
    stamp = {
        "header.stamp.sec": 1_790_000_000 + UP // 0.25,
        "header.stamp.nanosec": 4e9 * (UP % 0.25),
    }
    path = written_as(tmp_path, stamp | {"position_rad": UP, "effort_Nm": WAVE})
    assert np.diff(read(path).time) == pytest.approx(4 / 64, abs=1e-5)


ASSUMED = """
time_s,angle_deg,torque_Nm | |
angle,load | --angle-unit rad --torque-unit Nm |
angle,load | | angle deg, torque Nm
t,angle,torque | | angle deg, torque Nm, time s 0.0156
position_mm,load | | torque N
t,angle_deg,torque_Nm | --time-unit ms |
angle_deg,force_kN | | force_kN N m
position_mm,torque_Nm | | torque_Nm N
time_s,angle_deg,torque_Nm | --angle 1 --torque 3 --time 2 | time_s time, angle_deg angle
time_s,angle_deg,torque_Nm | --torque 2 --angle 3 | torque_Nm torque, angle_deg angle
time_s,angle_deg,t_Nm | --angle 3 --torque 2 --angle-unit deg | t_Nm torque
"""


@pytest.mark.parametrize("row", ASSUMED.strip().split("\n"))
def test_a_unit_that_is_assumed_or_of_another_quantity_is_noted(row, tmp_path):
    """A row has names of columns, options, and words of each note."""
    names, words, noted = (part.strip() for part in row.split("|"))
    columns = {name: UP if name[0] in "ta" else WAVE + UP for name in names.split(",")}
    log = read(written_as(tmp_path, columns), *words.split(), "--trust-units")
    notes = [note for note in log.notes if "--time)" not in note]
    assert (len(notes) < len(log.notes)) is (log.time is None)
    for one in noted.split(","):
        assert not noted or any(all(word in note for word in one.split()) for note in notes), one
    assert bool(notes) is bool(noted)


@pytest.mark.parametrize(("step", "is_doubted"), [(0.5, False), (1.0, True)])
def test_a_clock_that_may_be_in_milliseconds_is_noted(step, is_doubted, tmp_path):
    log = read(written(tmp_path, t=step * 64 * UP, angle_rad=UP, torque_Nm=WAVE))
    (note,) = log.notes
    assert f"{step:g} s" in note and ("in ms?" in note) is is_doubted


# --- which column ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("role", "names", "found"),
    [
        ("angle", "t Theta trq", 1),
        ("angle", "t shaft_pos torque", 1),
        ("angle", "t Winkel Moment", 1),
        ("angle", "angle_ref position encoder trq", 1),
        ("angle", "theta_dot angle_rate theta_vel trq theta", 4),
        ("angle", "position_error pos_err angle_acc angle_ref_rad pos trq", 4),
        ("angle", "set_position encoder trq", 1),
        ("angle", "target_angle trq", 0),
        ("angle", "level_angle accurate_angle trq", 0),
        ("torque", "angle LOAD", 1),
        ("torque", "angle x_Nm y_Nm z_Nm", 1),
        ("torque", "force moment angle", 1),
        ("torque", "Kraft Drehmoment Weg", 1),
        ("torque", "load_cell_N torque_Nm angle", 1),
        ("torque", "torque_cmd torque_rate torque_error torque_meas angle", 3),
        ("torque", "torque_cmd load_N angle", 1),
        ("torque", "trq_ref angle", 0),
        ("time", "T_degC T_Nm t_start angle", None),
        ("time", "header.stamp position effort", 0),
        ("time", "__time /joint_states/j1/position /joint_states/j1/effort", 0),
        ("angle", "__time /joint_states/j1/velocity /joint_states/j1/position effort", 2),
        ("torque", "stamp position velocity effort", 3),
        ("angle", "timestamp q_current position torque", 2),
        ("angle", "t q_rad dq_rad tau", 1),
        ("torque", "t q dq tau_est", 3),
        ("torque", "joint.0.pos-fb joint.0.pos-cmd torque-fb", 2),
        ("torque", "pos_estimate vel_estimate torque_target torque_estimate Iq_measured", 3),
        ("time", "T_degC T_Nm t angle time_ms", 2),
    ],
)
def test_the_column_whose_name_fits_best_is_read(role, names, found, tmp_path):
    """No rates; no setpoint or force if there is a measured torque; else the first column."""
    columns = {name: (k + 1) * UP for k, name in enumerate(names.split())}
    words = "--angle-unit rad --torque-unit Nm --time-unit s".split()
    log = read(written_as(tmp_path, columns), *words)
    values = {"angle": log.theta, "torque": log.torque, "time": log.time}[role]
    assert (None if values is None else values[-1]) == (
        None if found is None else (found + 1) * UP[-1]
    )


def test_a_column_is_named_by_name_or_number(tmp_path):
    path = written_as(
        tmp_path, {"a": UP, "b": WAVE, "2": 2 * UP, "angle_deg": 3 * UP, "c [rad]": UP}
    )
    for words, factor in (("--angle 2", 2), ("--angle 3", 2), ("--angle 4", 3), ("--angle c", 1)):
        log = read(path, *words.split(), "--torque", "b", "--time", "1", "--angle-unit", "rad")
        assert (log.theta[-1], log.time[-1]) == (factor * UP[-1], UP[-1])
    for words, parts in (
        ("--torque b --angle angel_deg", ("'angel_deg'", "'angle_deg'", "a, b, 2")),
        ("--torque b --angle 6", ("'6'",)),
        ("--torque b --angle 0", ("'0'",)),
        ("--angle a", ("--torque",)),
        ("--angle a --torque a", ("'a'", "angle", "torque")),
        ("--angle a --torque b --time b", ("'b'", "torque", "time")),
        ("--angle a --torque b --load 2 --load 2", ("'2'", "load 1", "load 2")),
        ("--angle a --torque b --load clamp", ("'clamp'",)),
    ):
        line = refused(path, *words.split())
        assert all(part in line for part in ("x.csv:1:", *parts)), (words, line)
    path = written(tmp_path, angle_rad=UP, x_Nm=WAVE, theta_deg=UP, y_Nm=WAVE)
    notes = [note for note in read(path).notes if "not from" in note]
    assert ["'theta_deg'" in note for note in notes] == [True, False] and "'y_Nm'" in notes[1]


@pytest.mark.parametrize("count", [30, 31])
def test_an_error_lists_thirty_columns(count, tmp_path):
    columns = {f"column{number}": UP for number in range(count)}
    line = refused(written_as(tmp_path, columns), "--angle", "COLUMN7x")
    assert "'column7'" in line and "column29" in line and "column30" not in line
    assert (f" {count - 30} more" in line) is (count > 30)


def test_loads_are_added(tmp_path):
    path = written(tmp_path, angle_deg=UP, load_N=UP, force_N=WAVE, clamp_N=10 * UP)
    log = read(path, "--load", "load_N", "--load", "4")
    assert (log.load.tolist(), log.torque.tolist()) == ((11 * UP).tolist(), WAVE.tolist())
    assert read(path, "--torque", "force_N").load is None
    path = written(tmp_path, angle_deg=UP, torque_Nm=WAVE, clamp=np.where(UP == UP[2], np.inf, UP))
    line = refused(path, "--load", "clamp")
    assert "x.csv:4:" in line and "'clamp'" in line and "inf" in line


# --- clocks ---------------------------------------------------------------------------------------

BEFORE = np.datetime64("2026-11-23T23:59:58.000")
MOMENTS_OF = {
    "date": lambda moment: f"{moment}",
    "date and zone": lambda moment: f"{moment}Z".replace("T", " "),
    "decimal comma": lambda moment: f"{moment}".replace("T", " ").replace(".", ","),
    "time of day, over midnight": lambda moment: f"{moment}".partition("T")[2],
}


@pytest.mark.parametrize("form", MOMENTS_OF)
def test_dates_and_times_of_day_are_seconds_from_the_first(form, tmp_path):
    """With any name of the column; another cell is an error."""
    for name in ("time", "t_ms"):
        steps = (BEFORE + np.timedelta64(125, "ms") * k for k in range(ROWS))
        columns = {name: [*map(MOMENTS_OF[form], steps)], "angle_rad": UP, "torque_Nm": WAVE}
        log = read(written_as(tmp_path, columns))
        assert log.time == pytest.approx(np.arange(ROWS) / 8) and log.notes == []
        columns[name][7] = "noon"
        line = refused(written_as(tmp_path, columns))
        assert "x.csv:9:" in line and f"'{name}'" in line and "'noon'" in line


def test_a_column_that_rises_in_a_unit_of_time_is_the_clock(tmp_path):
    columns = {"Dauer [s]": WAVE, "Tid [ms]": UP, "angle_rad": UP, "torque_Nm": WAVE}
    log = read(written_as(tmp_path, columns))
    assert log.time == pytest.approx(1e-3 * UP)
    (note,) = log.notes
    assert "'Tid [ms]'" in note and "--time" in note
    log = read(written_as(tmp_path, columns | {"t_s": 2 * UP}))
    assert log.time == pytest.approx(2 * UP) and log.notes == []
    assert read(written_as(tmp_path, columns | {"Tid [ms]": np.ones(ROWS)})).time is None


RESTARTS = {  # times of 100 rows that go back, and whether the log is read
    "one": (np.arange(100) % 60, True),
    "two": (7 + np.arange(100) % 33, True),
    "of a recorder that runs on": (np.r_[1000:1060, 5:45], True),
    "a row in the wrong place": (np.r_[0:50, 48, 51:100], False),
    "two loggers in one file": (np.arange(100) // 2 + 1000 * (np.arange(100) % 2), False),
    "the newest row first, in whole seconds": (-(np.arange(100) // 40), False),
    "the same, but for a step": (np.r_[np.repeat([9, 8, 7], 32), 6, 6, 6, 6.001], False),
    "both": (np.r_[0:50, 48, 51:70, 0:30], False),
}


@pytest.mark.parametrize("kind", RESTARTS)
def test_a_clock_may_start_anew_but_not_go_back_by_a_row(kind, tmp_path):
    rows, is_read = RESTARTS[kind]
    angle = np.sin(np.arange(100))
    columns = {"t_s": 0.01 * rows, "angle_rad": angle, "torque_Nm": np.cos(angle)}
    path = written_as(tmp_path, columns)
    if is_read:
        assert read(path).time == pytest.approx(0.01 * rows)
        guess = "--sigma0 100 --fc 0.5 --counts-per-turn 16384 --bandwidth 9 --loop".split()
        for words in (["commission"], ["excite", *guess]):  # which need one run
            assert "the clock goes backward" in run(*words, path).stderr
    else:
        assert "the clock goes backward: split the log there, or sort its rows" in refused(path)


# --- counters -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("unit", "turn"),
    [("deg", 360), ("rad", 2 * math.pi), ("turn", 1), ("gon", 400), ("counts", 300)]
    + [("counts", 16384), ("counts", 1_000_003), ("mm", 360)],
)
def test_an_angle_that_wraps_at_a_turn_is_unwrapped(unit, turn, tmp_path):
    """A length is not; a counter needs its counts per turn."""
    draw = np.random.default_rng(1)
    gone = np.cumsum(np.append(draw.uniform(-0.05, 0.05, 60), np.full(60, 0.02))) * turn
    gone = np.round(gone) if unit == "counts" else gone
    wrapped = (gone + turn // 3) % turn
    path = written_as(tmp_path, {f"Position [{unit}]": wrapped, "load": draw.normal(size=120)})
    log = read(path, *(("--counts-per-turn", turn) if unit == "counts" else ()))
    wanted = wrapped / 1e3 if unit == "mm" else gone * 2 * math.pi / turn
    np.testing.assert_allclose(log.theta - log.theta[0], wanted - wanted[0], atol=1e-9)
    assert any("wraps" in note for note in log.notes) is (unit != "mm")
    if unit == "counts":
        assert log.resolution == pytest.approx(2 * math.pi / turn)
        assert "--counts-per-turn" in refused(path)


def test_the_encoder_counts_are_found_in_the_angle(tmp_path):
    """By the grid of all angles, if no option gives the counts per turn or millimetre."""
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
def test_an_unsigned_16_bit_torque_becomes_signed(most, is_signed, tmp_path):
    torque = np.where(np.arange(ROWS) % 2, 65535 - np.arange(ROWS), np.arange(ROWS))
    torque[5] = most % 16384 if is_signed else 20_000
    log = read(written(tmp_path, angle_rad=UP, torque_mNm=torque))
    wanted = np.where(torque > 32767, torque - 65536, torque) if is_signed else torque
    assert log.torque == pytest.approx(1e-3 * wanted)
    assert any("16-bit" in note for note in log.notes) is is_signed
