# SPDX-License-Identifier: MIT
"""CAN logs and channels of an MF4: signals by a DBC, at the times of their frames, and each angle
with its own torque.
"""

import errno
import re
import shutil
import tempfile
from pathlib import Path

import log_writers
import numpy as np
import pytest
from dahl.errors import Error, printable
from dahl.io import can_logs, candump, files
from log_reading import RefusedError, read, refused, signals
from log_writers import DBC, FRAMES, LOAD, SHAFT, STEP

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


# --- times and lines of text logs -----------------------------------------------------------------

DATE = "date Mon Nov 30 10:00:00.000 2026"
TRIGGER = "Begin Triggerblock Mon Nov 30 10:00:00.000 2026\n   0.000000 Start of measurement"
EVENTS = "internal events logged\n// version 9.0.0"
TIMES = np.array([0.0, 0.5, 0.75, 2.0])
ASC_HEADS = {  # name: lines before the frames
    "by Vector": (DATE, "base hex  timestamps absolute", EVENTS, TRIGGER),
    "without a trigger": (DATE, "base hex  timestamps absolute", EVENTS),
    "by log2asc": (DATE, "base hex  timestamps absolute", "no internal events logged"),
    "without events": (DATE, "base hex  timestamps absolute"),
    "with blank lines": ("", DATE, "", "base hex  timestamps absolute", ""),
    "without a date": ("base hex  timestamps absolute",),
    "decimal": (DATE, "base dec  timestamps absolute", EVENTS),
    "with capitals": (
        DATE.upper(),
        "BASE HEX TIMESTAMPS ABSOLUTE",
        EVENTS.upper(),
        TRIGGER.upper(),
    ),
    "without a header": (),
}


def asc(path: Path, head: tuple[str, ...], times: np.ndarray) -> Path:
    """Frame k has the byte k; other events are between the frames."""
    lines = [f"{time:11.6f} 1  100             Rx   d 1 {k:02d}" for k, time in enumerate(times)]
    path.write_text("\n".join([*head, *lines, "End TriggerBlock", ""]))
    return path


def held(path: Path) -> tuple[list[float], list[int]]:
    frames = list(can_logs.frames_of(path, []))
    return [one.timestamp for one in frames], [one.data[0] for one in frames]


@pytest.mark.parametrize("head", ASC_HEADS.values(), ids=ASC_HEADS)
@pytest.mark.parametrize("start", [0.0, 3.25, -1.25])
def test_each_frame_of_an_asc_is_read_at_its_time(tmp_path, head, start):
    """Also before the trigger (below 0), and if the times are those since the event before."""
    times, numbers = held(asc(tmp_path / "x.asc", head, start + TIMES))
    assert times == pytest.approx(start + TIMES) and numbers == [0, 1, 2, 3]
    head = tuple(re.sub("absolute", "relative", line, flags=re.I) for line in head)
    if any("relative" in line for line in head):
        steps = np.diff(start + TIMES, prepend=0)
        times, numbers = held(asc(tmp_path / "y.asc", head, steps))
        assert times == pytest.approx(start + TIMES) and numbers == [0, 1, 2, 3]


def test_events_between_frames_of_an_asc_count_as_time(tmp_path):
    """Times are then those since the event before, whatever it is."""
    path = asc(tmp_path / "x.asc", (DATE, "base hex  timestamps relative", EVENTS), TIMES)
    text = path.read_text().replace("   0.750000 1", "   0.250000 1 Statistic: D 1\n   0.500000 1")
    path.write_text(text)
    assert held(path)[0] == pytest.approx(np.cumsum(TIMES))


@pytest.mark.parametrize("line", ["100 Rx d 8", "CANFD 1 Rx 100 0 0 9 12"])
def test_a_line_of_an_asc_that_is_cut_off_within_its_bytes_is_refused(tmp_path, line):
    """Else a signal of the bytes that are left would be wrong."""
    path = asc(tmp_path / "x.asc", ASC_HEADS["by Vector"], TIMES)
    path.write_text(path.read_text().replace("End TriggerBlock\n", f"3.0 1 {line} FE FF FF F"))
    if "CANFD" in line:
        path.write_text(path.read_text().replace("3.0 1", "3.0"))
    with pytest.raises(Error, match=re.escape(f"{path}: broken or cut off after 4 frames (line")):
        held(path)


CANFD_LINES = [  # line after the channel, and the frame as candump writes it
    ("Rx  123   0 0 8  8 00 11 22 33 44 55 66 77  130000 130  0 0 0 0 0 0", "123#0011223344556677"),
    ("Rx  123   0 0 0  0  130000 130  1000 0 0 0 0 0", "123##0"),
    ("Rx  123   0 0 0  0  130000 130  0 0 0 0 0 0", "123#"),
    ("Rx  123   0 0 8  0  130000 130  10 0 0 0 0 0", "123#R8"),
    ("Tx  123x  Name 1 1 9 12 00 11 22 33 44 55 66 77 88 99 AA BB  1 2  7000 0 0 0", "00000123##3"),
    ("Rx  123   1 0 1  1 FF", "123##1FF"),  # without flags
    ("Rx   ErrorFrame   Not Acknowledge error, dominant error flag  fffe c7", "20000000#"),
    ("Rx   ErrorFrame", "20000000#"),
]


@pytest.mark.parametrize(("line", "wanted"), CANFD_LINES)
def test_the_flags_of_a_canfd_line_decide_its_kind(tmp_path, line, wanted):
    """Not its form, in which classic frames are written too."""
    path = tmp_path / "x.asc"
    path.write_text(f"{DATE}\nbase hex  timestamps absolute\n   0.100000 CANFD   1 {line}\n")
    (frame,) = can_logs.frames_of(path, [])
    assert candump.candump_line(frame).split()[2].startswith(wanted)
    assert frame.is_fd == ("##" in wanted)


def candump_log(path: Path, times: np.ndarray, form: str = "010.6f") -> Path:
    path.write_text("".join(f"({time:{form}}) can0 100#00\n" for time in times))
    return path


def differences(count: int) -> np.ndarray:
    """Times since the frame before of angles each ms and their answers."""
    return np.concatenate(([0.0], np.tile([6e-5, 9.4e-4], count)))


@pytest.mark.parametrize(
    ("times", "line"),
    [
        (differences(20), 4),
        (np.full(20, 1e-3), 2),
        (np.random.default_rng(1).uniform(0, 1e-3, 50), None),
        (np.full(20, 1e-3) + 1e-6 * (np.arange(20) % 3), 4),
    ],
)
def test_times_since_the_frame_before_are_refused_with_the_line(tmp_path, times, line):
    """As `candump -td` writes them. Only an ASC can say that it has such times."""
    path = candump_log(tmp_path / "x.log", times)
    with pytest.raises(Error, match=re.escape(f"{path}:{line or ''}")) as said:
        held(path)
    assert "candump -L" in str(said.value)
    if np.ptp(times) > 0 and (np.diff(times) < 0).sum() > 5:  # log2asc takes them for absolute
        with pytest.raises(Error, match=re.escape(f"{path.with_suffix('.asc')}:")):
            held(asc(path.with_suffix(".asc"), ASC_HEADS["by log2asc"], times))


def test_a_few_frames_in_another_order_are_read(tmp_path):
    """By two controllers, and at one time; `candump -tz` begins with 0."""
    times = np.sort(np.random.default_rng(1).uniform(0, 1, 100)).round(6)
    times[[10, 11, 50, 51]] = times[[11, 10, 51, 50]]
    times[70] = times[71]
    pairs = np.repeat(np.arange(0, 400, 0.5), 2)  # as a simulation writes them
    for form, wanted in (("017.6f", times), ("010.6f", times), ("f", pairs)):
        path = candump_log(tmp_path / "x.log", wanted, form)
        assert held(path)[0] == pytest.approx(wanted)


BAD = ["hello", "(1.0) can0 100#0", "(1.0) can0 100", "\0" * 50, "(1.0) can0 100#0\xff", "(1.0) ca"]


@pytest.mark.parametrize("bad", BAD)
def test_a_bad_line_of_a_candump_log_is_named_and_left_out(tmp_path, bad, dahl_here):
    """With its number, its text and a count. The demo, which writes whole lines, refuses it."""
    words, path = signals(tmp_path), tmp_path / "x.log"
    log_writers.frames(path, TIME, np.arange(ROWS), wave())
    lines = path.read_bytes().splitlines()
    for place in (150, 60, 16):
        lines.insert(place, bad.encode("latin-1"))
    path.write_bytes(b"\n".join(lines))
    log = read(path, *words)
    assert log.rows == ROWS and log.time == pytest.approx(TIME)
    (note,) = log.notes
    assert note.startswith(f"{path}:17: ") and "bad lines: 3 of 203" in note
    assert printable(bad[:5]) in note and note.isprintable()
    with pytest.raises(Error, match=re.escape(f"{path}:17: ")):
        can_logs.read_candump(path)
    path.write_bytes(b"\n".join([lines[0], *[bad.encode("latin-1")] * 2]))
    assert f"{path}:2: " in refused(path, *words)  # no log of candump


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
