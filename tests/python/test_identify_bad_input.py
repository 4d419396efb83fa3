# SPDX-License-Identifier: MIT
"""Each bad log is refused in one line that names what is wrong and where, with exit code 2; and
each kind of file is read to the same numbers.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import logging
import re
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import can
import log_writers
import numpy as np
import pandas as pd
import pytest
from dahl import Error
from dahl.identify import folder_runs, pipeline, readers
from identify_tools import COUNT, FC, caller, dahl_torque, noise_of, sine, synthetic, write_csv
from log_writers import DBC, FRAMES, LOAD, SHAFT

pytestmark = pytest.mark.usefixtures("library")

ROWS = 1200
THETA = np.floor(sine(1, rows=ROWS, cycles=4) / COUNT) * COUNT
TORQUE = dahl_torque(THETA) + 0.02 * FC * noise_of(1, ROWS)
TIME = np.arange(ROWS) * 1e-3


@pytest.fixture
def run_dahl(capsys):
    return caller(capsys)


@pytest.fixture
def log(tmp_path):
    """Write a CSV with changes to its lines."""

    def write(change=lambda lines: lines, header="t,angle_deg,torque_Nm", **columns):
        path = write_csv(
            tmp_path / "log.csv", columns.get("theta", THETA), columns.get("torque", TORQUE), header
        )
        path.write_text("\n".join(change(path.read_text().splitlines())) + "\n")
        return path

    return write


def refused(run_dahl, *words) -> str:
    """The one line of complaint."""
    done = run_dahl("identify", *words, "--no-files")
    assert done.returncode == 2, done.stdout + done.stderr
    assert re.fullmatch(r"error: [^\n]+\n", done.stderr)
    assert done.stdout == ""
    return done.stderr


def accepted(run_dahl, *words) -> dict:
    """The numbers that are found."""
    done = run_dahl("identify", *words, "--no-files", "--json", "-")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def with_field(row: int, column: int, text: str):
    def change(lines: list[str]) -> list[str]:
        fields = lines[row].split(",")
        fields[column] = text
        return [*lines[:row], ",".join(fields), *lines[row + 1 :]]

    return change


def test_missing_column_with_a_suggestion(run_dahl, log):
    said = refused(run_dahl, log(), "--angle", "angel_deg")
    assert "no column 'angel_deg'; did you mean 'angle_deg'?" in said
    said = refused(run_dahl, log(header="t,x,y"))
    assert "which column is the angle? Name it with --angle" in said


def test_unknown_unit_and_term_with_a_suggestion(run_dahl, log):
    assert "did you mean 'deg'" in refused(run_dahl, log(), "--angle-unit", "degs")
    assert "did you mean 'viscous'" in refused(run_dahl, log(), "--terms", "viscus")


def test_a_broken_log_among_good_ones_is_a_line_and_code_2(run_dahl, log, tmp_path):
    (tmp_path / "empty.csv").touch()
    done = run_dahl("identify", log(), tmp_path / "empty.csv", "--no-files")
    assert (done.returncode, done.stderr) == (2, f"error: {tmp_path / 'empty.csv'}: empty\n")
    assert "sigma0" in done.stdout
    done = run_dahl("identify", tmp_path / "empty.csv", tmp_path / "absent.csv", "--no-files")
    assert (done.returncode, done.stdout) == (2, "")
    first, last = done.stderr.splitlines()
    assert first.endswith("empty.csv: empty") and last.endswith("absent.csv: no such file")
    for name, words in (("empty.csv", "empty"), ("absent.csv", "no such file"), ("", "a folder")):
        said = refused(run_dahl, log(), "--check", tmp_path / name)
        assert f"{tmp_path / name}: {words}" in said


def test_a_folder_without_logs(run_dahl, tmp_path):
    (tmp_path / "notes.md").write_text("no log")
    assert f"{tmp_path}: no logs" in refused(run_dahl, "--each", tmp_path)


def test_gaps_are_named_or_skipped(run_dahl, log):
    path = log(with_field(500, 2, "nan"))
    said = refused(run_dahl, path)
    assert "log.csv:501: column 'torque_Nm': no finite number here and in 1 of 1200 rows" in said
    assert accepted(run_dahl, path, "--skip-gaps")["rows"] == ROWS - 1


@pytest.mark.parametrize("text", ["abc", "1.2.3"])
def test_what_is_no_number(run_dahl, log, text):
    said = refused(run_dahl, log(with_field(7, 1, text)))
    assert f"log.csv:8: column 'angle_deg': '{text}' is not a number" in said


def test_constant_angle_and_torque(run_dahl, log):
    assert "angle is constant" in refused(run_dahl, log(theta=np.full(ROWS, 0.1)))
    assert "torque is constant" in refused(run_dahl, log(torque=np.full(ROWS, 0.1)))


def test_clipped_torque(run_dahl, log):
    said = refused(run_dahl, log(torque=np.clip(TORQUE, -0.35, 0.35)))
    assert "torque is clipped at" in said
    pipeline.identify([synthetic(1)])  # a torque that is not clipped passes


def test_swapped_columns(run_dahl, log):
    swapped = ("--angle", "torque_Nm", "--torque", "angle_deg", "--terms", "offset", "--no-delay")
    part = accepted(run_dahl, log(), *swapped, "--trust-units")["r2"]
    said = refused(run_dahl, log(), *swapped)
    assert f"look swapped: {100 * part:.0f} % are explained this way" in said


def test_wrong_units(run_dahl, log):
    said = refused(run_dahl, log(), "--angle-unit", "rad")
    assert "is the angle in deg" in said
    said = refused(run_dahl, log(theta=THETA * 1e7))
    assert "is the unit right" in said
    known = accepted(run_dahl, log())
    trusted = accepted(run_dahl, log(), "--angle-unit", "rad", "--trust-units")
    assert trusted["sigma0"] == pytest.approx(known["sigma0"] * np.pi / 180, rel=0.02)
    assert trusted["Fc"] == pytest.approx(known["Fc"], rel=0.02)


def test_each_option_of_a_fit_reaches_it(run_dahl, log):
    late = log(torque=np.roll(TORQUE, 4))
    assert accepted(run_dahl, late)["delay_rows"] > 2
    assert accepted(run_dahl, late, "--no-delay")["delay_rows"] == 0
    assert accepted(run_dahl, log(), "--terms", "offset,spring")["extra"].keys() == {
        "offset",
        "spring",
    }
    assert accepted(run_dahl, log(), "--terms", "none")["extra"] == {}
    assert "median of 9 rows" in " ".join(accepted(run_dahl, log(), "--median", "9")["notes"])
    turn = accepted(run_dahl, log(), "--counts-per-turn", "4096")["resolution"]
    assert turn == pytest.approx(2 * np.pi / 4096)


def test_clock_going_backward(run_dahl, log):
    said = refused(run_dahl, log(with_field(600, 0, "0.1")))
    assert "row 600: 0.1 after 0.598, the clock goes backward" in said


def test_empty_and_truncated_and_absent_files(run_dahl, log, tmp_path):
    (tmp_path / "none.csv").write_text("")
    assert "none.csv: empty" in refused(run_dahl, tmp_path / "none.csv")
    assert "no such file" in refused(run_dahl, tmp_path / "absent.csv")
    assert f"{tmp_path}: a folder; --each {tmp_path} takes" in refused(run_dahl, tmp_path)
    assert "no rows" in refused(run_dahl, log(lambda lines: lines[:1]))
    assert "10 rows; at least 30" in refused(run_dahl, log(lambda lines: lines[:11]))
    said = refused(run_dahl, log(lambda lines: [*lines[:-1], "1.199,0"]))
    assert "log.csv:1201: column 'torque_Nm': no finite number" in said
    (tmp_path / "noise.csv").write_bytes(bytes(range(256)) * 4)
    assert "not a text file" in refused(run_dahl, tmp_path / "noise.csv")
    for raw, byte in ((b"angle,torque [\x81Nm]\n1,2\n", 14), (b"angle\xe9,torque\n1,\x012\n", 5)):
        (tmp_path / "other.csv").write_bytes(raw)
        assert f"not a text file (byte {byte})" in refused(run_dahl, tmp_path / "other.csv")


@pytest.mark.parametrize("kind", ["json", "mat", "parquet", "mf4", *FRAMES])
def test_truncated_binary_and_structured_files(run_dahl, files, kind, tmp_path):
    whole = files[kind].read_bytes()
    cut = tmp_path / f"cut.{kind}"
    cut.write_bytes(
        whole[: len(whole) // 7] + (b"\x00(1 junk" if kind in ("log", "asc", "trc") else b"")
    )
    said = refused(run_dahl, cut, *options_for(kind, files))
    assert f"cut.{kind}" in said


def test_truncated_anywhere(files, tmp_path, caplog):
    """Each library has its own way of meeting the end of a file too early; what asammdf says to its
    own log reaches nobody.
    """
    logging.getLogger("asammdf").addHandler(caplog.handler)
    for kind in (*WRITERS, *FRAMES):
        whole, cut = files[kind].read_bytes(), tmp_path / f"short.{kind}"
        for part in (1, 10, 130, len(whole) // 2, len(whole) - 1):
            cut.write_bytes(whole[:part])
            try:
                assert readers.read(cut, source_for(kind, files)).rows
            except Error as error:
                assert re.fullmatch(rf"[^\n]*short\.{kind}[^\n]*", str(error))
                assert not str(error).endswith(f"read as .{kind}")  # but why it cannot
    logging.getLogger("asammdf").removeHandler(caplog.handler)
    assert not [one for one in caplog.records if one.name.startswith("asammdf")]


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("deep.json", "[" * 200_000, "deep.json: not JSON"),
        ("one.json", '[{"angle": 1, "torque": 2}]', "1 rows; a log has more than one"),
        ("one.csv", "angle,torque\n1,2\n", "1 rows; a log has more than one"),
        (
            "big.json",
            '{"angle": [1e999, 1], "torque": [1, 2]}'.replace("1e999", "9" * 400),
            "column 'angle': a number",
        ),
        ("wide.csv", "angle,torque\n1,2,3\n1,2,4\n", "wide.csv:1: fewer names than"),
        ("mixed.json", '[{"angle": 1, "torque": 2}, 5]', "cannot be read as .json"),
        ("ragged.csv", "angle,torque\n1,2\n1,2,3\n", "in line 3"),
        ("ragged", "angle,torque\n1,2\n1,2,3\n", "cannot be read as a table: "),
        ("none.json", '{"a": 1, "b": ["c"]}', "none.json: no list of rows and no columns of equal"),
        ("long.json", '{"angle": [1, 2], "torque": [1, 2, 3]}', "no columns of equal length in it"),
        ("text.csv", "angle,torque\n1,2\n\0,3\n", "not a text file (byte 17)"),
        ("blank.csv", "\n \n", "a first line with column names was expected"),
        ("new.mat", "MATLAB 7.3 MAT-file".ljust(124) + "\0\2IM", "MATLAB 7.3 (HDF5); save it with"),
        ("hole.csv", "angle,torque\n1,2\n3,\n", "hole.csv:3: column 'torque': no finite number"),
        ("hole.json", '{"angle": [1, 2], "torque": [2, "x"]}', "hole.json: row 2: column 'torque'"),
        (
            "bare.csv",
            "1 2\n3 x\n",
            "which column is the angle? Name it with --angle (there are: 1, 2)",
        ),
    ],
)
def test_files_that_a_library_did_not_expect(run_dahl, tmp_path, name, text, words):
    (tmp_path / name).write_text(text)
    said = refused(run_dahl, tmp_path / name)
    assert name in said
    assert words in said


def test_rows_and_columns_are_found_wherever_they_are(tmp_path):
    """In nested JSON, lists without names, structures and matrices of MATLAB, tables without names
    or with blanks.
    """
    from scipy.io import savemat

    source = readers.Source("2", "1", angle_unit="rad", torque_unit="Nm")
    for name, text in (
        ("a.json", '{"about": ["x"], "run": {"data": [[5, 1], [6, 2]]}}'),
        ("c.json", '{"n": [1], "z": [[5, 1], [6, 2]]}'),
        ("b.json", '{"run": {"load": [5, 6], "way": [1, 2], "n": 3}}'),
        ("a.csv", "5 1\n6 2\n"),
        ("b.csv", "\n x ;  y\n5;1\n6; 2\n"),
        ("c.txt", "x\ty\n5\t1\n6\t2\n"),
    ):
        (tmp_path / name).write_text(text)
        log = readers.read(tmp_path / name, source)
        assert (log.theta.tolist(), log.torque.tolist()) == ([1, 2], [5, 6]), name
    both = np.array([[5.0, 1.0], [6.0, 2.0]])
    savemat(
        tmp_path / "a.mat", {"run": {"way": both[:, 1], "n": 3.0, "load": both[:, 0]}, "k": 1.0}
    )
    savemat(tmp_path / "b.mat", {"run": both})
    savemat(tmp_path / "s.mat", {"way": np.arange(3.0), "load": np.arange(3.0), "fit": [1.0, 2.0]})
    assert readers.read(tmp_path / "s.mat", readers.Source("way", "load")).rows == 3
    savemat(tmp_path / "n.mat", {"rig": {"run": {"way": both[:, 1], "load": both[:, 0]}}})
    for name, angle, torque in (
        ("a.mat", "run.way", "run.load"),
        ("b.mat", "run.2", "run.1"),
        ("n.mat", "rig.run.way", "rig.run.load"),
    ):
        log = readers.read(tmp_path / name, readers.Source(angle, torque, angle_unit="rad"))
        assert (log.theta.tolist(), log.torque.tolist()) == ([1, 2], [5, 6]), name
    (tmp_path / "d.csv").write_text("5 1\n6 x\n")
    with pytest.raises(Error, match=r"d\.csv:2: column '2': 'x' is not a number"):
        readers.read(tmp_path / "d.csv", source)
    savemat(tmp_path / "c.mat", {"k": 1.0})
    with pytest.raises(Error, match=r"c\.mat: no vectors in it"):
        readers.read(tmp_path / "c.mat", source)


def test_a_can_log_lacks_what_tells_its_signals(files, tmp_path):
    for source, words in (
        (readers.Source(dbc=files["dbc"]), "name the signals with --angle SIGNAL"),
        (readers.Source(angle="Angle", dbc=files["dbc"]), "name the signals with --angle SIGNAL"),
        (readers.Source("Angle", "Torque", dbc=tmp_path / "none.dbc"), "none.dbc: No such file"),
        (readers.Source("Angle", "Torque"), "needs --dbc FILE"),
    ):
        with pytest.raises(Error, match=words):
            readers.read(files["blf"], source)


def test_a_file_on_which_its_library_crashes_is_one_line(files, run_dahl, tmp_path):
    """The type of a MAT element is 8, which is none: scipy looks it up and dereferences NULL."""
    whole = bytearray(files["mat"].read_bytes())
    place = whole.index((9).to_bytes(4, "little"), 128)  # the first column of doubles
    whole[place] = 8
    (tmp_path / "crash.mat").write_bytes(whole)
    assert "crash.mat: broken: reading it crashes" in refused(run_dahl, tmp_path / "crash.mat")


def test_a_table_without_rows(run_dahl, tmp_path):
    empty = {"angle": np.array([]), "torque": np.array([])}
    log_writers.parquet(tmp_path / "empty.parquet", empty)
    assert "0 rows" in refused(run_dahl, tmp_path / "empty.parquet")


@pytest.mark.parametrize("ending", ["mf4", "raw.mf4", "MF4"])
def test_an_mf4_not_closed_leaves_no_copy(files, ending, tmp_path, monkeypatch):
    """asammdf works on a copy of such a file; of a broken one it is left to us."""
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    kind = ending.lower()
    whole, open_ = bytearray(files[kind].read_bytes()), tmp_path / f"open.{ending}"
    whole[60] = 1  # "some counts are not right yet"
    copies = []
    copy = shutil.copy
    monkeypatch.setattr(shutil, "copy", lambda *two: copies.append(copy(*two)))
    for part in (len(whole), len(whole) // 3):
        open_.write_bytes(whole[:part])
        with contextlib.suppress(Error):
            readers.read(open_, source_for(kind, files))
    assert len(copies) == 2
    assert list((tmp_path / "temporary").iterdir()) == []


def test_values_of_the_same_time_stay_apart(tmp_path):
    """Interpolation would give each of them the last one's torque."""
    table = {"t": np.zeros(3), "x_m": np.arange(3.0), "force_N": np.array([5.0, 7.0, 6.0])}
    log_writers.channels(tmp_path / "burst.mf4", table)
    source = readers.Source("x_m", "force_N")
    assert readers.read(tmp_path / "burst.mf4", source).torque.tolist() == [5, 7, 6]
    (tmp_path / "bus.dbc").write_text(DBC)
    signals = readers.Signals(tmp_path / "bus.dbc", "Angle", "Torque")
    signals.found = {"Angle": [(1.0, 0.0), (1.0, 1.0)], "Torque": [(1.0, 5.0), (1.0, 7.0)]}
    assert signals.values("bus")["torque"].tolist() == [5, 7]


def on_a_bus(tmp_path, angle_times, torque_times) -> dict[str, np.ndarray]:
    """What is read where frame k of either message has the value k, and the torque 100 more."""
    (tmp_path / "bus.dbc").write_text(DBC)
    signals = readers.Signals(tmp_path / "bus.dbc", "Angle", "Torque")
    for name, times, offset in (("Angle", angle_times, 0), ("Torque", torque_times, 100)):
        signals.found[name] = [(time, k + offset) for k, time in enumerate(times)]
    return signals.values("bus")


def test_an_answer_belongs_to_its_angle_however_late_it_comes(tmp_path):
    """A busy bus brings each answer later or earlier, within the period."""
    angles = np.arange(1000) * 1e-3
    answers = angles + np.random.default_rng(1).uniform(1e-6, 0.99e-3, 1000)
    read = on_a_bus(tmp_path, angles, answers)
    assert (read["torque"] - read["angle"]).tolist() == [100] * 1000
    lost = np.delete(answers, [3, 500, 999])  # their angles have no torque
    read = on_a_bus(tmp_path, angles, lost)
    assert read["angle"].tolist() == np.delete(np.arange(1000), [3, 500, 999]).tolist()
    assert read["torque"].tolist() == list(range(100, 1097))


def test_a_torque_at_a_rate_of_its_own_is_interpolated(tmp_path):
    angles = np.arange(0, 1, 1e-3)
    read = on_a_bus(tmp_path, angles, 0.01 + np.arange(0, 0.9, 7e-3))
    assert read["time"][[0, -1]].tolist() == pytest.approx([0.01, 0.906])
    assert read["torque"] == pytest.approx(100 + (read["time"] - 0.01) / 7e-3)
    with pytest.raises(Error, match="share no time"):
        on_a_bus(tmp_path, angles, angles + 2)


def test_a_dbc_with_a_fault_elsewhere_is_taken(files, tmp_path):
    """A signal beyond the end of its message, and two on one bit, as in many a maker's own."""
    odd = (
        "BO_ 300 Odd: 1 A\n"
        ' SG_ Long : 0|16@1- (1,0) [0|0] "" A\n'
        ' SG_ Twice : 0|8@1- (1,0) [0|0] "" A\n'
    )
    (tmp_path / "odd.dbc").write_text(DBC + odd, encoding="cp1252")
    source = readers.Source("Angle", "Torque", dbc=tmp_path / "odd.dbc")
    assert readers.read(files["blf"], source).rows == ROWS


def shaft_on(channel: object, sign: int, **kind: bool) -> Iterator[can.Message]:
    """100 angles and torques of the DBC's messages; the angle goes up or down by a raw step."""
    for k in range(100):
        for number, value, late in ((SHAFT, sign * k, 0.0), (LOAD, k % 9, 2e-4)):
            data = value.to_bytes(4, "little", signed=True) + bytes(4)
            yield can.Message(
                timestamp=1 + k * 1e-3 + late,
                arbitration_id=number,
                data=data,
                channel=channel,
                **{"is_extended_id": False, **kind},
            )


def recorded(path: Path, *shafts: Iterator[can.Message]) -> Path:
    with can.Logger(path) as logger:
        for message in sorted(itertools.chain(*shafts), key=lambda one: one.timestamp):
            logger.on_message_received(message)
    return path


@pytest.mark.parametrize(
    ("ending", "names"), [("log", ("can0", "can1")), ("blf", (0, 1)), ("asc", (0, 1))]
)
def test_a_signal_on_two_channels_is_no_signal(tmp_path, ending, names):
    """Two shafts would be read as one that jumps to and fro."""
    (tmp_path / "bus.dbc").write_text(DBC)
    source = readers.Source("Angle", "Torque", dbc=tmp_path / "bus.dbc")
    shafts = (shaft_on(name, sign) for name, sign in zip(names, (1, -1), strict=True))
    log = recorded(tmp_path / f"two.{ending}", *shafts)
    with pytest.raises(Error, match=f"'Angle' comes on channels {names[0]}, {names[1]}: which"):
        readers.read(log, source)
    for name, sign in zip(names, (1, -1), strict=True):
        one = readers.read(log, replace(source, channel=str(name)))
        assert one.rows == 100 and (np.sign(np.diff(one.theta)) == sign).all()


@pytest.mark.parametrize("late", [-20.5e-3, -1e-4, 1e-4])
def test_an_id_of_29_bits_is_another_one_than_that_of_11(tmp_path, late):
    """Also where 20 angles and torques of the other id come first, as if there were no other."""
    (tmp_path / "bus.dbc").write_text(DBC)
    source = readers.Source("Angle", "Torque", dbc=tmp_path / "bus.dbc")
    other = [*shaft_on("can0", -1, is_extended_id=True)]
    for message in other:
        message.timestamp += late
    one = readers.read(recorded(tmp_path / "both.log", shaft_on("can0", 1), iter(other)), source)
    assert one.rows == 100 and (np.diff(one.theta) > 0).all()


def test_of_several_columns_that_fit_the_first_is_taken(tmp_path):
    path, up = tmp_path / "many.csv", np.arange(40.0)
    columns = {
        "t": up,
        "angle_rad": up,
        "theta_deg": 2 * up,
        "torque_Nm": 3 * up,
        "load_mNm": up,
    }
    pd.DataFrame(columns | {"time_ms": up}).to_csv(path, index=False)
    read = readers.read(path, readers.Source())
    assert (read.theta[-1], read.torque[-1], read.time[-1]) == (39, 117, 39)
    assert read.notes[0] == "angle taken from 'angle_rad', not from 'theta_deg' (--angle)"


@pytest.mark.parametrize("clock", ["s", "datetime64[ns]", "timedelta64[ns]"])
def test_a_table_of_pandas_has_its_clock(tmp_path, clock):
    """As the index with a name, and as moments."""
    step = TIME if clock == "s" else (TIME * 1e9).astype(clock)
    table = pd.DataFrame({"angle_rad": THETA, "torque_Nm": TORQUE}, index=pd.Index(step, name="t"))
    table.to_parquet(tmp_path / "x.parquet")
    log = readers.read(tmp_path / "x.parquet", readers.Source())
    assert log.time == pytest.approx(TIME) and log.theta == pytest.approx(THETA)


BEFORE = np.datetime64("2026-11-23T23:59:58.000")
FORMS = {
    "date": lambda moment: f"{moment}",
    "date and zone": lambda moment: f"{moment}Z".replace("T", " "),
    "decimal comma": lambda moment: f"{moment}".replace("T", " ").replace(".", ","),
    "time of day, over midnight": lambda moment: f"{moment}".partition("T")[2],
}


@pytest.mark.parametrize("name", ["time", "t_ms"])
@pytest.mark.parametrize("form", FORMS)
def test_times_of_day_are_seconds_from_the_first_whatever_the_column_is_called(
    tmp_path, form, name
):
    path, up = tmp_path / "x.csv", np.arange(40.0)
    moments = (BEFORE + np.timedelta64(125, "ms") * int(k) for k in up)
    columns = {name: [*map(FORMS[form], moments)], "angle_rad": up, "torque_Nm": 3 * up}
    pd.DataFrame(columns).to_csv(path, index=False)
    log = readers.read(path, readers.Source())
    assert log.time == pytest.approx(up / 8) and not any("time" in note for note in log.notes)
    columns[name][7] = "noon"
    pd.DataFrame(columns).to_csv(path, index=False)
    with pytest.raises(Error, match=rf"x.csv:9: column '{name}': 'noon' is not a number"):
        readers.read(path, readers.Source())


@pytest.mark.parametrize("clock", ["t", "t_s", "t [ms]", "T(s)", "t_sec", "time", "Time [s]"])
def test_a_temperature_or_a_torque_is_no_clock(tmp_path, clock):
    path, up = tmp_path / "warm.csv", np.arange(40.0)
    columns = {"T_degC": 20 + up**2, "T_Nm": 3 * up, "t_start": up**3, "angle_rad": up}
    pd.DataFrame(columns).to_csv(path, index=False)
    assert readers.read(path, readers.Source()).time is None
    pd.DataFrame(columns | {clock: up}).to_csv(path, index=False)
    read = readers.read(path, readers.Source())
    step = 1e-3 if "ms" in clock else 1
    assert read.time == pytest.approx(step * up) and read.torque[-1] == 117


def test_channels_that_are_sampled_at_other_times_are_brought_together(tmp_path):
    from asammdf import MDF, Signal

    time, path, source = (
        np.arange(50) * 0.01,
        tmp_path / "two.mf4",
        readers.Source("x_m", "force_N"),
    )
    for late, here in ((0.004, slice(1, 50)), (-0.004, slice(0, 49)), (9.0, None)):
        with MDF() as measured:
            measured.append(Signal(time, time, name="x_m"))
            measured.append(Signal(3 * (time + late), time + late, name="force_N"))
            measured.save(path, overwrite=True)
        if here is None:
            with pytest.raises(Error, match="two.mf4: its channels share no time"):
                readers.read(path, source)
        else:
            read = readers.read(path, source)
            assert read.time == pytest.approx(time[here])
            assert read.torque == pytest.approx(3 * time[here])


def mf4_of(path: Path, *groups: Mapping[str, tuple[np.ndarray, str]]) -> Path:
    """An MF4 of channels with their units, each group with a clock of its own."""
    from asammdf import MDF, Signal

    with MDF() as measured:
        for group in groups:
            pairs = group.items()
            measured.append(
                [Signal(x, TIME, unit, name, encoding="utf-8") for name, (x, unit) in pairs]
            )
        measured.save(path)
    return path


def test_what_an_mf4_says_of_its_channels(tmp_path):
    """Units stand beside the names; holes, words and two channels of one name are no numbers."""
    shaft = {"Angle": (THETA, "rad"), "Torque_Nm": (1e3 * TORQUE, "mNm")}
    log = readers.read(mf4_of(tmp_path / "units.mf4", shaft), readers.Source())
    assert log.theta == pytest.approx(THETA) and log.torque == pytest.approx(TORQUE)
    assert log.notes == []
    holed = {**shaft, "Angle": (np.where(TIME == 0.5, np.nan, THETA), "rad")}
    path = mf4_of(tmp_path / "hole.mf4", holed)
    with pytest.raises(Error, match=r"row 501: column 'Angle \[rad\]': no finite number here"):
        readers.read(path, readers.Source())
    assert readers.read(path, readers.Source(skip_gaps=True)).rows == ROWS - 1
    words = mf4_of(tmp_path / "words.mf4", {**shaft, "State": (np.array([b"on"] * ROWS), "")})
    with pytest.raises(Error, match="words.mf4: channel 'State' holds no numbers"):
        readers.read(words, readers.Source(torque="State"))
    twice = mf4_of(tmp_path / "twice.mf4", shaft, {"Angle": (2 * THETA, "rad")})
    with pytest.raises(Error, match="no column 'Angle'; did you mean 'group 1: Angle'"):
        readers.read(twice, readers.Source("Angle"))
    log = readers.read(twice, readers.Source("group 1: Angle"))
    assert log.theta == pytest.approx(2 * THETA)


@pytest.mark.parametrize(
    "text",
    [
        "time_s,angle_deg,torque_Nm\n0,1.5,0.25,\n0.5,2,-3,\n1,4.5,1e-3,\n",
        'time_s, "angle, left [deg]", "torque_Nm"\n0, 1.5, 0.25\n0.5, 2, -3\n1, 4.5, 1e-3\n',
        'time_s,"angle\n(deg)",torque_Nm\n0,1.5,0.25\n0.5,2,-3\n1,4.5,1e-3\n',
        "time_s;angle_deg;torque_Nm\n0;1,5;0,25\n0,5;2;-3\n1;4,5;1e-3\n",
        "time_s\tangle_deg\ttorque_Nm\n0\t1,5\t0,25\n0,5\t2\t-3\n1\t4,5\t1,0e-3\n",
        "time;angle;torque\ns;deg;Nm\n0;1.5;0.25\n0.5;2;-3\n1;4.5;1e-3\n",
        "time angle torque\n[s] [deg] [Nm]\n0 1,5 ,25\n0,5 2 -3\n1 4,5 ,001\n",
        '"time, of day", "angle,\nleft", "torque"\ns, deg, Nm\n0,1.5,0.25\n0.5,2,-3\n1,4.5,1e-3\n',
        "# rig 3\n\n% 2026\ntime_s,angle_deg,torque_Nm\n0,1.5,0.25\n0.5,2,-3\n1,4.5,1e-3\n",
        "# time_s angle_deg torque_Nm\n0 1.5 0.25\n0.5 2 -3\n1 4.5 1e-3\n",  # numpy.savetxt
        "# rig 3\n# time_s angle_deg torque_Nm\n0 1.5 0.25\n0.5 2 -3\n1 4.5 1e-3\n",
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252"])
def test_tables_of_many_programs(tmp_path, text, encoding):
    """Decimal commas, a line of units, comments, letters of Windows; lines ended by two marks, or
    by either of them.
    """
    path, end = tmp_path / "a.csv", {"utf-8": "\n", "utf-8-sig": "\r", "cp1252": "\r\n"}[encoding]
    path.write_text(text.replace("deg", "°").replace("\n", end), encoding=encoding, newline="")
    read = readers.read(path, readers.Source())
    assert read.time.tolist() == [0, 0.5, 1]
    assert np.degrees(read.theta) == pytest.approx([1.5, 2, 4.5])
    assert read.torque.tolist() == [0.25, -3, 1e-3]
    assert read.notes == []


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("0,001;1,5;0,2\n0,002;2;0,3\n", ([0.001, 0.002], [1.5, 2])),
        ("# a remark\n1,5 0,2 3\n2 4 5\n", ([1.5, 2], [0.2, 4])),
        ("1,2,3\n4,5,6\n", ([1, 4], [2, 5])),
    ],
)
def test_tables_without_names_have_numbers_for_them(tmp_path, text, wanted):
    path = tmp_path / "a.csv"
    path.write_text(text)
    read = readers.read(path, readers.Source("1", "2", angle_unit="rad", torque_unit="Nm"))
    assert (read.theta.tolist(), read.torque.tolist()) == wanted


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("angle;torque\ndeg;Nm\n1;2\n3;x\n", "a.csv:4: column 'torque [Nm]': 'x' is not a"),
        ("# one\n\nangle,torque\n1,2\n3,x\n", "a.csv:5: column 'torque': 'x' is not a number"),
        ('"angle\n\nleft","torque"\n1,2\n3,x\n', "a.csv:5: column 'torque': 'x' is not a number"),
        ('angle 5",torque\n1,2\n3,x\n', "a.csv:3: column 'torque': 'x' is not a number"),
        ("angle,torque\n’,y\nx,y\n1,2\n", "a.csv:2: column 'angle': '’' is not a number"),
        ("angle;torque\nx;5\n1;2\n", "a.csv:2: column 'angle': 'x' is not a number"),
        ("angle,torque\ndeg\n1,2\n", "column 'angle': 'deg' is not a number"),
        ("# only\n% this\n", "empty; a first line with column names was expected"),
    ],
)
def test_what_is_wrong_in_a_table_is_said_with_its_line(tmp_path, text, words):
    (tmp_path / "a.csv").write_text(text, encoding="cp1252")
    with pytest.raises(Error, match=re.escape(words)):
        readers.read(tmp_path / "a.csv", readers.Source())


def test_no_log_and_bad_numbers(run_dahl, log):
    assert "give LOGs, or --each DIR" in refused(run_dahl)
    folder = log().parent
    assert f"{folder}: a folder; --each {folder} takes the logs" in refused(run_dahl, folder)
    assert "--counts-per-turn -1" in refused(run_dahl, log(), "--counts-per-turn", "-1")
    assert "not an integer" in refused(run_dahl, log(), "--median", "x")
    said = refused(run_dahl, log(), "--angle", "angle_deg", "--torque", "angle_deg")
    assert "cannot be both" in said


# --- every kind of file holds the same log --------------------------------------------------------


WRITERS = {
    "csv": log_writers.text(","),
    "tsv": log_writers.text("\t"),
    "json": log_writers.json_records,
    "mat": log_writers.mat,
    "parquet": log_writers.parquet,
    "mf4": log_writers.channels,
}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """One log as a file of each kind."""
    folder = tmp_path_factory.mktemp("kinds")
    made = {kind: folder / f"log.{kind}" for kind in (*WRITERS, *FRAMES, "dbc")}
    degrees = np.degrees(THETA)
    for kind, write in WRITERS.items():
        write(made[kind], {"t": TIME, "angle_deg": degrees, "torque_Nm": TORQUE})
    made["dbc"].write_text(DBC)
    bits = [np.round(values / log_writers.STEP).astype(int) for values in (degrees, TORQUE)]
    for kind in FRAMES:
        log_writers.frames(made[kind], 1000 + TIME, *bits)
    return made


def options_for(kind: str, files) -> tuple:
    if kind in FRAMES:
        return ("--dbc", files["dbc"], "--angle", "Angle", "--torque", "Torque")
    return ()


def source_for(kind: str, files) -> readers.Source:
    if options_for(kind, files):
        return readers.Source(angle="Angle", torque="Torque", dbc=files["dbc"])
    return readers.Source()


@pytest.mark.parametrize("kind", ["csv", "tsv", "json", "mat", "parquet", "mf4", *FRAMES])
def test_every_kind_of_file(files, kind, tmp_path):
    read = readers.read(files[kind], source_for(kind, files))
    assert read.rows == ROWS
    assert np.allclose(read.theta - read.theta[0], THETA - THETA[0], atol=np.radians(1e-4))
    assert np.allclose(read.torque, TORQUE, atol=1e-4)
    assert np.allclose(np.diff(read.time), 1e-3, atol=2e-4)
    assumed = ["time taken in s"] * (kind in ("csv", "tsv", "json", "mat", "parquet"))
    assert [note.split(":")[0] for note in read.notes] == assumed
    assert not read.linear and read.name == str(files[kind])
    loud = tmp_path / f"LOG.{kind.upper()}"
    shutil.copy(files[kind], loud)
    assert readers.read(loud, source_for(kind, files)).theta.tolist() == read.theta.tolist()
    assert folder_runs.logs_in(tmp_path) == [loud]


@pytest.mark.parametrize("kind", ["csv", "tsv", "json", "mat", "parquet"])
def test_a_hole_is_named_by_its_line_or_its_row(kind, tmp_path):
    """Text has lines, the names in the first; other tables have rows alone."""
    torque = TORQUE.copy()
    torque[[5, 9]] = np.nan
    place = tmp_path / f"x.{kind}"
    WRITERS[kind](place, {"t": TIME, "angle_deg": THETA, "torque_Nm": torque})
    where = f"{place}:7" if kind in ("csv", "tsv") else f"{place}: row 6"
    with pytest.raises(Error) as raised:
        readers.read(place, readers.Source())
    said = f"{where}: column 'torque_Nm': no finite number here and in 2 of {ROWS} rows in all"
    assert str(raised.value) == f"{said} (--skip-gaps leaves them out)"
    whole = readers.read(place, readers.Source(skip_gaps=True))
    assert whole.time == pytest.approx(np.delete(TIME, [5, 9]))
    WRITERS[kind](place, {"t": TIME, "angle_deg": THETA, "torque_Nm": torque * np.nan})
    with pytest.raises(Error, match=f"in {ROWS} of {ROWS} rows in all"):
        readers.read(place, readers.Source(skip_gaps=True))


@pytest.mark.parametrize("before", [0, 3])
def test_a_letter_may_lie_across_the_first_bytes_that_are_looked_at(tmp_path, before):
    rows = "".join(f"{k},{k},éé\n" for k in range(10_000))
    (tmp_path / "x.csv").write_text(f"angle,torque,{'n' * (before + 1)}\n{rows}", encoding="utf-8")
    assert readers.read(tmp_path / "x.csv", readers.Source()).rows == 10_000


def test_unknown_signal_with_a_suggestion(run_dahl, files):
    said = refused(
        run_dahl, files["blf"], "--dbc", files["dbc"], "--angle", "Angel", "--torque", "Torque"
    )
    assert "no signal 'Angel' in the DBC; did you mean 'Angle'?" in said
    assert "needs --dbc" in refused(run_dahl, files["blf"])
    assert "needs --dbc" in refused(run_dahl, files["raw.mf4"])
    said = refused(run_dahl, files["blf"], "--dbc", files["csv"], "--angle", "A", "--torque", "T")
    assert "log.csv: not a DBC" in said


def test_a_signal_of_two_messages_is_named_with_its_own(files, tmp_path):
    """Of what was wanted and what was measured the DBC may give both one name."""
    wish = DBC[DBC.index("BO_ 257") :].replace("257 Load", "258 Wish").replace("0.0001", "1")
    (tmp_path / "two.dbc").write_text(DBC.replace("BO_ 257", f"{wish}BO_ 257"))
    source = readers.Source("Angle", "Torque", dbc=tmp_path / "two.dbc")
    with pytest.raises(Error, match="several messages, which .*: Wish.Torque, Load.Torque"):
        readers.read(files["blf"], source)
    log = readers.read(files["blf"], replace(source, torque="Load.Torque"))
    assert log.torque == pytest.approx(TORQUE, abs=1e-4) and log.notes == []


@pytest.mark.parametrize(
    ("name", "unit", "size", "linear"),
    [
        ("angle_deg", "", np.pi / 180, False),
        ("theta [rad]", "", 1, False),
        ("pos_mm", "", 1e-3, True),
        ("Position [um]", "", 1e-6, True),
        ("angle", "", np.pi / 180, False),
        ("pos", "in", 0.0254, True),
    ],
)
def test_units_of_the_angle(tmp_path, name, unit, size, linear):
    values = np.linspace(0, 3, 40)
    path = tmp_path / "units.csv"
    pd.DataFrame({name: values, "torque": values}).to_csv(path, index=False)
    read = readers.read(path, readers.Source(angle_unit=unit))
    assert np.ptp(read.theta) == pytest.approx(3 * size)
    assert read.linear == linear
    assert read.unit == ("N" if linear else "N m")


def test_counts_wrap_and_need_their_number(tmp_path):
    counts = (np.arange(300) * 100) % 4096
    path = tmp_path / "counts.csv"
    pd.DataFrame({"counts": counts, "torque": counts}).to_csv(path, index=False)
    with pytest.raises(Error, match="needs --counts-per-turn"):
        readers.read(path, readers.Source())
    read = readers.read(path, readers.Source(counts_per_turn=4096))
    assert np.allclose(np.diff(read.theta), 100 * 2 * np.pi / 4096)
    assert read.resolution == pytest.approx(2 * np.pi / 4096)


def test_names_of_columns_do_not_break_the_line(tmp_path):
    path = tmp_path / "names.csv"
    path.write_text('"an\ngle","tor\x1bque\x07",t\n1,2,3\n4,5,6\n')
    with pytest.raises(Error) as caught:
        readers.read(path, readers.Source())
    assert str(caught.value).isprintable() and "an gle" in str(caught.value)


POUND = 0.45359237 * 9.80665  # N, by definition
UNITS_OF_TORQUE = {"Nm": 1, "mNm": 1e-3, "kNm": 1e3, "N": 1, "mN": 1e-3, "uN": 1e-6, "kN": 1e3}
UNITS_OF_TORQUE |= {"lb": POUND, "kip": 1e3 * POUND, "lbin": POUND * 0.0254, "lbft": POUND * 0.3048}


@pytest.mark.parametrize("unit", UNITS_OF_TORQUE)
def test_units_of_the_torque(tmp_path, unit):
    """As an option, and as the name of the column says it."""
    for name, source in (
        ("torque", readers.Source(torque_unit=unit)),
        (f"torque [{unit}]", readers.Source()),
    ):
        path = tmp_path / "units.csv"
        pd.DataFrame({"angle": np.arange(9.0), name: np.arange(9.0)}).to_csv(path, index=False)
        read = readers.read(path, source)
        assert read.torque[-1] == pytest.approx(8 * UNITS_OF_TORQUE[unit], rel=1e-8)


def test_a_log_is_never_written_over(log, run_dahl, tmp_path):
    """Its own name is the default for the files that are left beside it."""
    path = log()
    before = path.read_bytes()
    done = run_dahl("identify", path, "-o", tmp_path)
    assert done.returncode == 2 and path.read_bytes() == before
    assert re.fullmatch(r"error: .*log\.csv: what is written into [^\n]+--name\n", done.stderr)
    assert run_dahl("identify", path, "-o", tmp_path, "--name", "rig").returncode == 0
    assert path.read_bytes() == before and (tmp_path / "rig.csv").exists()
