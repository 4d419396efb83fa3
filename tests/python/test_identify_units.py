# SPDX-License-Identifier: MIT
"""Which column is what, and in which unit: by the names in a table and by options. A column that
never changes is refused with its value in SI units, which tells both without any fit.
"""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from identify_tools import FC, complaint, dahl_torque, noise_of, shaft, sine, told, with_gaps
from log_writers import DBC
from log_writers import frames as write_frames

pytestmark = pytest.mark.usefixtures("library")

INCH, POUND, G, DEG = 0.0254, 0.45359237 * 9.80665, 9.80665, np.pi / 180
ROWS = 40
UP = [0.5 * k for k in range(ROWS)]


def wrote(header: list[str], *columns: list[float]) -> None:
    head = ",".join(f'"{name}"' for name in header)
    rows = [",".join(map(repr, row)) for row in zip(*columns, strict=True)]
    with open("x.csv", "w", encoding="utf-8") as file:
        file.write("\n".join([head, *rows]) + "\n")


def constant(dahl, what: str, *words: object) -> float:
    """The value at which the table's angle or torque is refused."""
    code, line = complaint(dahl("identify", "x.csv", *words, "--no-files"))
    assert code == 2 and "x.csv" in line
    return float(re.search(rf"{what} is constant \((\S+) in all {ROWS} rows", line)[1])


ANGLES = {
    "angle [deg]": DEG,
    "angle_mrad": 1e-3,
    "Angle (°)": DEG,
    "position / mm": 1e-3,
    "pos_in_mm": 1e-3,
    "[RAD] angle": 1.0,
    "angle [rev]": 2 * np.pi,
    "angle_turn": 2 * np.pi,
    "angle_gon": np.pi / 200,
    "angle (arcmin)": DEG / 60,
    "angle [arcsec]": DEG / 3600,
    "angle_mdeg": DEG / 1e3,
    "angle [urad]": 1e-6,
    "pos_cm": 1e-2,
    "pos [µm]": 1e-6,
    "pos_ft": 12 * INCH,
    "theta_in_deg": DEG,
    "theta [in]": INCH,
    "pos_in": INCH,
    "pos_m": 1.0,
    "position_inch": INCH,
    "angle (Radians)": 1.0,
    "Angle [Degrees]": DEG,
    "Position (raw) [rad]": 1.0,
    "angle": DEG,  # the usual one, as for the names that mean no unit
    "theta_m": DEG,
    "angle_in": DEG,
}
TORQUES = {
    "torque_Nm": 1.0,
    "torque [N m]": 1.0,
    "torque [N*m]": 1.0,
    "torque [N·m]": 1.0,
    "torque_N_m": 1.0,
    "torque_kN_m": 1e3,
    "torque_mNm": 1e-3,
    "torque (mN.m)": 1e-3,
    "torque_uNm": 1e-6,
    "torque_kNm": 1e3,
    "torque_MNm": 1e6,
    "torque [Ncm]": 1e-2,
    "torque [Nmm]": 1e-3,
    "load [lb-ft]": POUND * 12 * INCH,
    "torque_ft_lb": POUND * 12 * INCH,
    "trq_lb_ft": POUND * 12 * INCH,
    "torque_in_lb": POUND * INCH,
    "torque_oz_in": POUND * INCH / 16,
    "torque_kgcm": G / 100,
    "torque [g*cm]": G / 1e5,
    "force [µN]": 1e-6,
    "force [mN]": 1e-3,
    "force [MN]": 1e6,
    "force_kN": 1e3,
    "load_lbf": POUND,
    "load_kip": 1e3 * POUND,
    "load [kgf]": G,
    "load_gf": G / 1e3,
    "Torque (motor) [mNm]": 1e-3,
    "Torque [Nm] (filtered)": 1.0,
    "force_n": 1.0,
    "Torque_Nm [V]": 1.0,
}


@pytest.mark.parametrize("name", ANGLES)
def test_the_unit_in_the_name_of_an_angle(dahl, name):
    wrote([name, "torque_Nm"], [3.0] * ROWS, UP)
    assert constant(dahl, "angle") == pytest.approx(3 * ANGLES[name], rel=1e-5)


@pytest.mark.parametrize("name", TORQUES)
def test_the_unit_in_the_name_of_a_torque(dahl, name):
    wrote(["angle_rad", name], UP, [3.0] * ROWS)
    assert constant(dahl, "torque") == pytest.approx(3 * TORQUES[name], rel=1e-5)


@pytest.mark.parametrize(
    ("words", "angle"),
    [
        (("--angle-unit", "mrad"), 3e-3),
        (("--angle-unit", "in"), 3 * INCH),
        (("--angle-unit", "counts", "--counts-per-turn", 500), 3 * 2 * np.pi / 500),
    ],
)
def test_a_unit_that_was_said_goes_before_the_name(dahl, words, angle):
    wrote(["angle_deg", "torque_Nm"], [3.0] * ROWS, UP)
    assert constant(dahl, "angle", *words) == pytest.approx(angle, rel=1e-5)
    wrote(["angle_deg", "torque_Nm"], UP, [3.0] * ROWS)
    assert constant(dahl, "torque", "--torque-unit", "lbin") == pytest.approx(
        3 * POUND * INCH, rel=1e-5
    )
    code, line = complaint(dahl("identify", "x.csv", "--torque-unit", "Mn", "--no-files"))
    assert code == 2 and "--torque-unit Mn" in line and "MN" in line


TIMES = {
    "t": 1.0,
    "time_ms": 1e-3,
    "t [ms]": 1e-3,
    "time [µs]": 1e-6,
    "time_ns": 1e-9,
    "Time (seconds)": 1.0,
    "time [Milliseconds]": 1e-3,
}


@pytest.mark.parametrize("name", TIMES)
def test_the_unit_of_the_time(dahl, name):
    """A gap of 0.302 s is named so, and a unit that was assumed."""
    log = with_gaps(shaft(rows=1500, cycles=6), (500, 801))
    wrote(
        [name, "angle_rad", "torque_Nm"],
        (log.time / TIMES[name]).tolist(),
        log.theta.tolist(),
        log.torque.tolist(),
    )
    facts = json.loads(dahl("identify", "x.csv", "--no-files", "--json", "-").stdout)
    assert told(facts, "gap")[:2] == [1, 0.302]
    assert (told(facts, "--time-unit") is not None) is (name == "t")


@pytest.mark.parametrize(("step", "doubted"), [(0.5, False), (1.0, True)])
def test_a_clock_that_may_be_in_milliseconds(dahl, step, doubted):
    log = shaft(rows=1500, cycles=6)
    clock = (step * np.arange(1500)).tolist()
    wrote(["t", "angle_rad", "torque_Nm"], clock, log.theta.tolist(), log.torque.tolist())
    facts = json.loads(dahl("identify", "x.csv", "--no-files", "--json", "-").stdout)
    assert step in told(facts, "--time-unit") and (told(facts, "in ms?") is not None) is doubted


# --- which column ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("what", "names", "found"),
    [
        ("angle", ["t", "Theta", "trq"], 1),
        ("angle", ["t", "shaft_pos", "torque"], 1),
        ("angle", ["angle_ref", "position", "encoder", "trq"], 1),
        ("angle", ["theta_dot", "angle_rate", "theta_vel", "trq", "theta"], 4),
        ("angle", ["position_error", "pos_err", "angle_acc", "angle_ref_rad", "pos", "trq"], 4),
        ("angle", ["set_position", "encoder", "trq"], 1),
        ("angle", ["target_angle", "trq"], 0),
        ("angle", ["level_angle", "accurate_angle", "trq"], 0),
        ("torque", ["angle", "LOAD"], 1),
        ("torque", ["angle", "x_Nm", "y_Nm", "z_Nm"], 1),
        ("torque", ["force", "moment", "angle"], 1),
        ("torque", ["load_cell_N", "torque_Nm", "angle"], 1),
        ("torque", ["torque_cmd", "torque_rate", "torque_error", "torque_meas", "angle"], 3),
        ("torque", ["torque_cmd", "load_N", "angle"], 1),
        ("torque", ["trq_ref", "angle"], 0),
    ],
)
def test_columns_that_nobody_named(dahl, what, names, found):
    """A measured one before one that was wanted, no rate, and of equals the first: each column has
    a value of its own, but for the angle where the torque is asked for.
    """
    free = {"torque": "angle", "angle": ""}[what]
    columns = [UP if name in (free, "t") else [k + 1.0] * ROWS for k, name in enumerate(names)]
    wrote(names, *columns)
    words = ("--angle-unit", "rad", "--torque-unit", "Nm")
    assert constant(dahl, what, *words) == found + 1


def test_columns_that_somebody_named(dahl):
    """By name, or by number from 1; a name goes first."""
    wrote(["t", "angle", "2", "trq"], UP, [5.0] * ROWS, [7.0] * ROWS, UP)
    for said, value in (("angle", 5), ("2", 7), ("3", 7)):
        words = ("--angle", said, "--torque", "trq", "--angle-unit", "rad", "--torque-unit", "Nm")
        assert constant(dahl, "angle", *words) == value
    for wrong in ("0", "5", "angel"):
        code, line = complaint(dahl("identify", "x.csv", "--angle", wrong, "--no-files"))
        assert code == 2 and f"'{wrong}'" in line and "x.csv" in line
    wrote(["t", "theta_dot", "angle_vel", "trq"], *[UP] * 4)
    code, line = complaint(dahl("identify", "x.csv", "--no-files"))
    assert code == 2 and "--angle" in line and "theta_dot" in line


def identified(dahl, header: list[str], *columns: np.ndarray) -> dict:
    wrote(header, *(column.tolist() for column in columns))
    done = dahl("identify", "x.csv", "--no-files", "--json", "-")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_of_several_columns_the_others_are_named(dahl):
    log = shaft(rows=1500, cycles=6)
    head = ["angle_rad", "x_Nm", "y_Nm"]
    facts = identified(dahl, head, log.theta, log.torque, 2 * log.torque)
    (note,) = (note for note in facts["notes"] if "--torque" in note)
    assert "'x_Nm'" in note and "'y_Nm'" in note
    assert facts["Fc"] == pytest.approx(FC, rel=0.02)


def test_a_force_over_an_angle_is_named(dahl):
    """A load cell on a lever: what it says lacks a length."""
    log = shaft(rows=1500, cycles=6)
    for angle, noted in (("angle_rad", True), ("pos_mm", False)):
        theta = log.theta * (1 if noted else 1000)
        facts = identified(dahl, [angle, "load_N"], theta, log.torque)
        assert any("'load_N'" in note for note in facts["notes"]) is noted
        assert facts["linear"] is not noted
        assert facts["units"]["Fc"] == ("N m" if noted else "N")


def test_a_signed_number_read_as_unsigned(dahl):
    """Of 16 bits; an offset that is one is not taken off."""
    theta = sine(1, rows=1500, cycles=6)
    raw = np.rint(1000 * (dahl_torque(theta) + 0.02 * FC * noise_of(1, 1500)))
    for offset, taken in ((0, True), (40_000, False)):
        facts = identified(dahl, ["angle_rad", "load_mNm"], theta, (raw + offset) % 65536)
        assert facts["Fc"] == pytest.approx(FC, rel=0.02)
        assert (told(facts, "65536") is not None) is taken
        assert facts["extra"].get("offset", 0) == pytest.approx(offset / 1000, abs=0.02)


def test_the_units_of_a_can_log_are_those_of_its_dbc(dahl, tmp_path):
    """Its raw values are of 1e-4 of these."""
    raw = np.arange(40)
    dbc = DBC.replace('"deg"', '"mrad"').replace('"Nm"', '"mNm"')
    (tmp_path / "x.dbc").write_text(dbc)
    words = ("--dbc", "x.dbc", "--angle", "Angle", "--torque", "Torque", "--no-files")
    for name, angle, torque in (
        ("angle", 0 * raw + 30_000, raw),
        ("torque", raw, 0 * raw + 30_000),
    ):
        write_frames(tmp_path / "x.log", raw * 1e-3, angle, torque)
        code, line = complaint(dahl("identify", "x.log", *words))
        assert code == 2
        assert float(re.search(rf"{name} is constant \((\S+) in", line)[1]) == 0.003
