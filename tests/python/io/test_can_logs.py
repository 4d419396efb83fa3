# SPDX-License-Identifier: MIT
"""CAN logs and channels of an MF4: signals by a DBC, at the times of their frames, and each angle
with its own torque.
"""

from __future__ import annotations

import errno
import shutil
import tempfile
from pathlib import Path

import log_writers
import numpy as np
import pytest
from dahl.io import files
from log_reading import RefusedError, read, refused, signals
from log_writers import DBC, FRAMES, LOAD, SHAFT, STEP

pytestmark = pytest.mark.usefixtures("library")

ROWS = 100
TIME = np.arange(ROWS) * 1e-3


def wave(rows: int = ROWS) -> np.ndarray:
    return np.arange(rows) * 7 % 11 - 5


@pytest.mark.parametrize("kind", FRAMES)
def test_frames_are_read_as_they_were_sent(kind, tmp_path):
    """python-can writes the files; endings have any case; the angle is unwrapped."""
    words = signals(tmp_path)
    for seed in range(3):
        draw = np.random.default_rng(seed)
        angle, torque = draw.integers(-900_000, 900_000, (2, ROWS))
        log_writers.frames(tmp_path / f"x.{kind}", 1000 + 0.01 * np.arange(ROWS), angle, torque)
        path = tmp_path / f"{seed}.{kind.upper() if seed else kind}"
        shutil.move(tmp_path / f"x.{kind}", path)
        log = read(path, *words)
        assert (log.rows, log.notes, log.unit) == (ROWS, [], "N m")
        np.testing.assert_allclose(np.diff(log.time), 0.01, atol=2e-3)
        np.testing.assert_allclose(log.torque, torque * STEP, rtol=1e-12)
        turns = (np.degrees(log.theta) - angle * STEP) / 360
        np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)


# --- signals and the DBC --------------------------------------------------------------------------


@pytest.fixture
def shaft(tmp_path):
    log_writers.frames(tmp_path / "x.blf", TIME, np.arange(ROWS), wave())
    return tmp_path / "x.blf"


def test_a_bus_log_needs_a_dbc_and_names_of_it(shaft, tmp_path):
    words = signals(tmp_path)
    (tmp_path / "x.csv").write_text("angle,torque\n1,2\n")
    for some, parts in (
        ((), ("x.blf", "--dbc")),
        (words[:2], ("--angle", "--torque")),
        (words[:4], ("--angle", "--torque")),
        (("--dbc", tmp_path / "none.dbc", *words[2:]), ("none.dbc: No such file",)),
        (("--dbc", tmp_path / "x.csv", *words[2:]), ("x.csv", "DBC")),
        ((*words[:2], "--angle", "Angel", "--torque", "Torque"), ("'Angel'", "'Angle'")),
        ((*words, "--load", "Torqe"), ("'Torqe'", "'Torque'")),
    ):
        line = refused(shaft, *some)
        assert all(part in line for part in parts), line
    log_writers.frames(tmp_path / "x.mf4", TIME, np.arange(ROWS), wave())
    assert "--dbc" in refused(tmp_path / "x.mf4")


def test_a_dbc_with_errors_elsewhere_is_accepted(shaft, tmp_path):
    """A signal beyond its message, overlapping signals, Windows letters, an invalid comment."""
    odd = (
        "BO_ 300 Odd: 1 A\n"
        ' SG_ Long : 0|16@1- (1,0) [0|0] "°" A\n'
        ' SG_ Twice : 0|8@1- (1,0) [0|0] "" A\nCM_ 1 free words;\n'
    )
    assert read(shaft, *signals(tmp_path, dbc=DBC + odd)).rows == ROWS


def test_a_signal_in_two_messages_needs_the_name_of_one(shaft, tmp_path):
    wish = DBC[DBC.index("BO_ 257") :].replace("257 Load", "258 Wish").replace("0.0001", "1")
    words = signals(tmp_path, dbc=DBC.replace("BO_ 257", f"{wish}BO_ 257"))
    line = refused(shaft, *words)
    assert "Wish.Torque" in line and "Load.Torque" in line
    log = read(shaft, *words, "--torque", "Load.Torque")
    assert log.torque == pytest.approx(wave() * STEP) and log.notes == []


@pytest.mark.parametrize("beyond", [10**9, -(10**9)])  # +-1e5 N m
def test_values_beyond_the_range_of_the_dbc_are_ignored(tmp_path, beyond):
    """As are error frames, requests and short frames."""
    path, torque = tmp_path / "x.log", wave() * 1000
    torque[50:53] = beyond, 10**6, -(10**6)  # the latter are the limits of the DBC, +-100 N m
    log_writers.frames(path, TIME, np.arange(ROWS), torque)
    log = read(path, *signals(tmp_path))
    assert np.delete(torque, 50) * STEP == pytest.approx(log.torque)
    with path.open("a") as file:
        file.write("(2.000000) 1 101#R8\n(2.100000) 1 101#01\n(2.200000) 1 100#\n")
    assert read(path, *signals(tmp_path)).rows == ROWS - 1
    log_writers.frames(path, TIME[:1], *np.ones((2, 1), dtype=int))
    assert "'Angle'" in refused(path, *signals(tmp_path))


# --- angle, torque and load at one time -----------------------------------------------------------


def on_a_bus(folder: Path, angle_times, torque_times):
    """Return angle, torque and log. Frame k has the angle k, or the torque k + 100."""
    rows = [(time, SHAFT, 10_000 * k) for k, time in enumerate(angle_times)]
    rows += [(time, LOAD, 10_000 * (k + 100)) for k, time in enumerate(torque_times)]
    path = log_writers.bus(folder / "x.log", sorted(rows, key=lambda one: one[0]))
    wide = DBC.replace("[-1000|1000]", "[0|0]").replace("[-100|100]", "[0|0]")
    log = read(path, *signals(folder, dbc=wide), "--trust-units")
    return np.degrees(log.theta), log.torque, log


def test_a_torque_belongs_to_the_angle_before_it(tmp_path):
    """On a busy bus it comes at any time within the period."""
    angles = 1 + np.arange(1000) * 1e-3
    answers = angles + np.random.default_rng(1).uniform(1e-6, 0.99e-3, 1000)
    angle, torque, log = on_a_bus(tmp_path, angles, answers)
    assert torque - angle == pytest.approx(np.full(1000, 100.0)) and len(angle) == 1000
    assert log.time == pytest.approx(angles, abs=1e-6)
    lost = np.delete(answers, [3, 500, 999])  # their angles have no torque
    angle, torque, _ = on_a_bus(tmp_path, angles, lost)
    assert angle == pytest.approx(np.delete(np.arange(1000), [3, 500, 999]))
    assert torque == pytest.approx(np.arange(100, 1097))


def test_a_torque_at_another_rate_is_interpolated(tmp_path):
    angles = 1 + np.arange(0, 1, 1e-3)
    _, torque, log = on_a_bus(tmp_path, angles, 1.01 + np.arange(0, 0.9, 7e-3))
    assert log.time[[0, -1]] == pytest.approx([1.01, 1.906])
    assert torque == pytest.approx(100 + (log.time - 1.01) / 7e-3, abs=1e-3)
    with pytest.raises(RefusedError, match=r"x\.log.*'Angle'.*'Torque'"):
        on_a_bus(tmp_path, angles, angles + 2)


def test_frames_of_one_time_stay_apart(tmp_path):
    """Interpolation would give all of them the last torque; also in an MF4 of channels."""
    angles = 1 + np.repeat(np.arange(20.0), 2)
    _, torque, _ = on_a_bus(tmp_path, angles, angles)
    assert torque == pytest.approx(np.arange(100, 140))
    table = {"t": np.zeros(40), "x_m": np.arange(40.0), "force_N": wave(40).astype(float)}
    log_writers.channels(tmp_path / "burst.mf4", table)
    words = ("--angle", "x_m", "--torque", "force_N")
    assert read(tmp_path / "burst.mf4", *words).torque.tolist() == wave(40).tolist()


def test_loads_are_interpolated_at_the_times_of_the_angle_and_added(tmp_path):
    cell = 'BO_ 258 Cell: 8 A\n SG_ Clamp : 0|16@1- (1,0) [0|0] "N" A\n'
    rows = [(k, SHAFT, k % 7) for k in range(40)] + [(k + 0.5, LOAD, k % 5) for k in range(2, 37)]
    rows += [(k, 258, 10 * k) for k in range(0, 40, 2)]
    words = signals(tmp_path, "--load", "Clamp", "--load", "Torque", dbc=DBC + cell)
    log = read(log_writers.bus(tmp_path / "x.log", sorted(rows)), *words)
    torque = np.interp(log.time, np.arange(2, 37) + 0.5, np.arange(2, 37) % 5) * STEP
    assert log.time.tolist() == list(range(3, 37)) and log.torque == pytest.approx(torque)
    assert log.load == pytest.approx(10 * log.time + torque)


# --- several buses and ids ------------------------------------------------------------------------


def shaft_on(sign: int, late: float = 0.0, **kind: object) -> list[tuple]:
    """Return rows of log_writers.bus() of a shaft that turns to one side."""
    angles = [(1 + late + k * 1e-3, SHAFT, sign * k, kind) for k in range(ROWS)]
    return angles + [(time + 2e-4, LOAD, abs(k) % 9, kind) for time, _, k, _ in angles]


def recorded(path: Path, *shafts: list[tuple]) -> Path:
    return log_writers.bus(path, sorted(sum(shafts, []), key=lambda one: one[0]))


@pytest.mark.parametrize(
    ("ending", "names"), [("log", ("can0", "can1")), ("blf", (0, 1)), ("asc", (0, 1))]
)
def test_a_signal_on_two_channels_is_refused(tmp_path, ending, names):
    """Two shafts would look like one that jumps to and fro; also if one signal alone is there."""
    shafts = [shaft_on(sign, channel=name) for name, sign in zip(names, (1, -1), strict=True)]
    log, words = recorded(tmp_path / f"two.{ending}", *shafts), signals(tmp_path)
    line = refused(log, *words)
    assert "'Angle'" in line and f"{names[0]}, {names[1]}" in line and "-c " in line
    for name, sign in zip(names, (1, -1), strict=True):
        one = read(log, *words, "-c", name)
        assert one.rows == ROWS and (np.sign(np.diff(one.theta)) == sign).all()
    torques = [row for row in shafts[1] if row[1] == LOAD]
    assert "'Torque'" in refused(recorded(log, shafts[0], torques), *words)


@pytest.mark.parametrize("late", [-20.5e-3, -1e-4, 1e-4])
def test_an_id_of_29_bits_differs_from_one_of_11(tmp_path, late):
    """Also if 20 angles and torques of the other id come first."""
    other = shaft_on(-1, late, is_extended_id=True)
    log = read(recorded(tmp_path / "both.log", shaft_on(1), other), *signals(tmp_path))
    assert log.rows == ROWS and (np.diff(log.theta) > 0).all()


# --- channels of an MF4 ---------------------------------------------------------------------------


def mf4_of(path: Path, *groups: dict[str, tuple[np.ndarray, str]], late: float = 0.0) -> Path:
    """Write values and units by name; each group is `late` after the one before."""
    from asammdf import MDF, Signal

    with MDF() as measured:
        for number, group in enumerate(groups):
            time = TIME + number * late
            kinds = [
                Signal(x, time, unit, name, encoding="utf-8") for name, (x, unit) in group.items()
            ]
            measured.append(kinds)
        measured.save(path, overwrite=True)
    return path


def test_units_and_names_of_the_channels_of_an_mf4(tmp_path):
    theta = np.cumsum(wave()) / 100
    both = {"Angle": (theta, "rad"), "Torque_Nm": (1e3 * wave(), "mNm")}
    log = read(mf4_of(tmp_path / "units.mf4", both))
    assert log.theta == pytest.approx(theta) and log.torque == pytest.approx(wave())
    assert log.notes == [] and log.time == pytest.approx(TIME)
    holed = np.where(TIME == TIME[50], np.nan, theta)
    path = mf4_of(tmp_path / "hole.mf4", {**both, "Angle": (holed, "rad")})
    line = refused(path)
    assert "row 51" in line and "'Angle [rad]'" in line
    assert read(path, "--skip-gaps").rows == ROWS - 1
    words = {**both, "State": (np.array([b"on"] * ROWS), "")}
    line = refused(mf4_of(tmp_path / "words.mf4", words), "--torque", "State")
    assert "words.mf4" in line and "'State'" in line
    twice = mf4_of(tmp_path / "twice.mf4", both, {"Angle": (2 * theta, "rad")})
    assert "'group 1: Angle'" in refused(twice, "--angle", "Angle")
    assert read(twice, "--angle", "group 1: Angle").theta == pytest.approx(2 * theta)


def test_channels_are_read_at_the_times_that_all_cover(tmp_path):
    names = ("--angle", "x_m", "--torque", "force_N")
    for late, here in ((4e-4, slice(1, ROWS)), (-4e-4, slice(0, ROWS - 1)), (9.0, None)):
        rising = {"force_N": (3 * (TIME + late), "N")}
        path = mf4_of(tmp_path / "two.mf4", {"x_m": (TIME, "m")}, rising, late=late)
        if here is None:
            assert "two.mf4" in refused(path, *names)
        else:
            log = read(path, *names)
            assert log.time == pytest.approx(TIME[here])
            assert log.torque == pytest.approx(3 * TIME[here])


@pytest.mark.parametrize("kind", ["channels.mf4", "raw.mf4", "raw.MF4"])
def test_an_mf4_not_closed_leaves_no_copy(kind, tmp_path, monkeypatch, capfd):
    """asammdf copies such a file to the disk, and leaves the copy of a broken one."""
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    made, is_raw = tmp_path / kind.lower(), kind.startswith("raw")
    if is_raw:
        log_writers.frames(made, TIME, np.arange(ROWS), wave())
    else:
        log_writers.channels(made, {"t": TIME, "angle": TIME, "torque": wave()})
    whole, path = bytearray(made.read_bytes()), tmp_path / f"open {kind}"
    whole[60] = 1  # "some counts are not right yet"
    path.write_bytes(whole)
    words = signals(tmp_path) if is_raw else ()
    assert read(path, *words).rows == ROWS
    path.write_bytes(whole[: len(whole) // 3])
    assert path.name in refused(path, *words)
    assert list((tmp_path / "temporary").iterdir()) == [] and capfd.readouterr().err == ""


@pytest.mark.parametrize(("ending", "is_lost"), [("blf", False), ("mf4", True)])
def test_a_full_disk_is_an_error_of_the_log(tmp_path, ending, is_lost):
    """An MF4 is written at its end: the error says that it is lost."""
    path = tmp_path / f"x.{ending}"
    with pytest.raises(OSError, match="No space") as said, files.whole_lines(path, None):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert said.value.filename == str(path) and ("lost" in said.value.strerror) is is_lost
