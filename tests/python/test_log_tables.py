# SPDX-License-Identifier: MIT
"""Tables that `dahl identify` reads: what another program wrote comes back number by number, and
what is wrong in a table is named by file, line or row, column and value.
"""

from __future__ import annotations

import shutil

import log_writers
import numpy as np
import pandas as pd
import pytest
from identify_tools import complaint
from log_reading import read, refused, run
from log_writers import TABLES

pytestmark = pytest.mark.usefixtures("library")

ROWS = 40


def table_of(seed: int, rows: int = ROWS, size: float = 1.0) -> log_writers.Table:
    """A time that rises and two columns of noise, in 64ths: text of a few digits is exact."""
    draw = np.random.default_rng(seed)
    way, force = draw.integers(-1000, 1000, (2, rows)) / 64 * size
    return {"t": np.arange(rows) / 8, "pos_m": way, "force_N": force}


# --- each kind of file ----------------------------------------------------------------------------


@pytest.mark.parametrize("kind", TABLES)
def test_a_table_of_each_kind_comes_back_as_it_was_written(kind, tmp_path):
    """At any size of the numbers, by names or by what the columns are called, in small letters or
    in capitals; the folder of an `--each` finds it.
    """
    for seed, size in enumerate((1.0, 1 / 3e7, 7e7)):
        table = table_of(seed, rows=30 + 17 * seed, size=size)
        path = tmp_path / f"{seed}.{kind.upper() if seed else kind}"
        TABLES[kind](tmp_path / kind, table)
        (tmp_path / kind).rename(path)
        prefix = "rig." if kind == "structure.mat" else ""
        named = ("--angle", f"{prefix}pos_m", "--torque", f"{prefix}force_N")
        named += () if kind == "channels.mf4" else ("--time", f"{prefix}t")
        for words in (named, ()) if kind != "structure.mat" else (named,):
            log = read(path, *words, "--trust-units", "--angle-unit", "m")
            assert log.linear and log.name == str(path)
            for found, wrote in zip((log.time, log.theta, log.torque), table.values(), strict=True):
                assert found.dtype == float
                np.testing.assert_allclose(found, wrote, rtol=1e-14)


def test_the_logs_of_a_folder_are_those_with_the_endings_of_logs(tmp_path):
    (tmp_path / "notes.md").write_text("no log")
    code, line = complaint(run("identify", "--each", tmp_path))
    assert code == 2 and str(tmp_path) in line and ".parquet" in line and ".blf" in line


HOLED = {"csv": "7", "tsv": "7", "json": "row 6", "mat": "row 6", "parquet": "row 6"}


@pytest.mark.parametrize("kind", HOLED)
def test_a_row_without_a_number_is_named_or_left_out(kind, tmp_path):
    """Text has lines, the names in the first; other tables have rows alone."""
    write = {path.rpartition(".")[2]: make for path, make in TABLES.items()} | {
        "json": log_writers.json_records,
        "mat": log_writers.mat,
    }
    table, path = table_of(1), tmp_path / f"x.{kind}"
    table["force_N"][[5, 9]] = np.nan
    write[kind](path, table)
    line = refused(path)
    place = HOLED[kind]
    assert line.startswith(f"{path}:{'' if place.isdecimal() else ' '}{place}: ")
    assert "'force_N'" in line and f"2 of {ROWS}" in line and "--skip-gaps" in line
    whole = read(path, "--skip-gaps")
    kept = np.delete(np.arange(ROWS), [5, 9])
    assert (whole.time.tolist(), whole.torque.tolist()) == (
        table["t"][kept].tolist(),
        table["force_N"][kept].tolist(),
    )
    write[kind](path, {**table, "force_N": np.full(ROWS, np.nan)})
    assert f"{ROWS} of {ROWS}" in refused(path, "--skip-gaps")


# --- text as many programs write it ---------------------------------------------------------------

UNITS_BELOW = '"time, of day", "angle,\nleft", "torque"\ns, deg, Nm\n'
FORMS = {  # what stands above the rows, and a row
    "commas, one at the end": ("time_s,angle_deg,torque_Nm\n", "{},{},{},"),
    "commas and blanks, quoted names": ('time_s, "angle, left [deg]", "torque_Nm"\n', "{}, {}, {}"),
    "a name over two lines": ('time_s,"angle\n(deg)",torque_Nm\n', "{},{},{}"),
    "semicolons": ("time_s;angle_deg;torque_Nm\n", "{};{};{}"),
    "tabs": ("time_s\tangle_deg\ttorque_Nm\n", "{}\t{}\t{}"),
    "a line of units": ("time;angle;torque\ns;deg;Nm\n", "{};{};{}"),
    "units in brackets, blanks": ("time angle torque\n[s] [deg] [Nm]\n", "{}  {} {}"),
    "units below quoted names": (UNITS_BELOW, "{},{},{}"),
    "comments": ("# rig 3\n\n% 2026\ntime_s,angle_deg,torque_Nm\n", "{},{},{}"),
    "names in a comment": ("# time_s angle_deg torque_Nm\n", "{} {} {}"),
    "names in the last comment": ("# rig 3\n# time_s angle_deg torque_Nm\n", "{} {} {}"),
    "empty lines, blanks around": ("\n time_s ;  angle_deg ;torque_Nm\n\n", "{}; {} ;{}"),
}
ENCODINGS = {"utf-8": "\n", "utf-8-sig": "\r", "cp1252": "\r\n"}  # each with another end of a line


@pytest.mark.parametrize("form", FORMS)
def test_text_of_many_programs_is_read_to_the_same_numbers(form, tmp_path):
    """In UTF-8 and the letters of Windows, with points and (but between commas) decimal commas,
    which the first rows do not show where their numbers are whole.
    """
    above, row = FORMS[form]
    time, angle, torque = table_of(2).values()
    angle[:3], torque[:3], time = (0, 1, 2), (3, 4, 5), np.maximum(time - 0.25, 0)
    path = tmp_path / "a.csv"
    for decimal in ".," if "," not in row else ".":
        rows = zip(time.tolist(), angle.tolist(), torque.tolist(), strict=True)
        lines = [row.format(*(f"{x:.17g}".replace(".", decimal) for x in each)) for each in rows]
        for encoding, end in ENCODINGS.items():
            text = above.replace("deg", "°") + "\n".join(lines) + "\n"
            path.write_text(text.replace("\n", end), encoding=encoding, newline="")
            log = read(path)
            assert (log.time.tolist(), log.torque.tolist()) == (time.tolist(), torque.tolist())
            np.testing.assert_allclose(np.degrees(log.theta), angle, rtol=1e-14)
            assert log.notes == []


@pytest.mark.parametrize(
    ("above", "row"),
    [("", "{};{};7"), ("", "{}\t{}"), ("", "{},{},7"), ("# a remark\n", "{} {} 7"), ("", "{} {}")],
)
def test_columns_without_names_have_numbers_for_them(above, row, tmp_path):
    _, angle, torque = table_of(3).values()
    path = tmp_path / "a.csv"
    lines = [row.format(*pair) for pair in zip(angle.tolist(), torque.tolist(), strict=True)]
    path.write_text(above + "\n".join(lines) + "\n")
    log = read(path, *"--angle 1 --torque 2 --angle-unit rad --torque-unit Nm".split())
    assert (log.theta.tolist(), log.torque.tolist()) == (angle.tolist(), torque.tolist())
    assert "(there are: 1, 2" in refused(path) and "--angle" in refused(path)


@pytest.mark.parametrize("before", [0, 3])
def test_a_letter_may_lie_across_the_first_bytes_that_are_looked_at(tmp_path, before):
    rows = "".join(f"{k % 7},{k % 5},éé\n" for k in range(10_000))
    (tmp_path / "x.csv").write_text(f"angle,torque,{'n' * (before + 1)}\n{rows}", encoding="utf-8")
    assert read(tmp_path / "x.csv").rows == 10_000


# --- JSON and MATLAB ------------------------------------------------------------------------------


def test_rows_and_columns_are_found_wherever_they_are(tmp_path):
    """In nested JSON, with and without names, in structures and matrices of MATLAB."""
    import json

    from scipy.io import savemat

    _, angle, torque = table_of(4).values()
    both = np.column_stack((torque, angle))
    columns = {"load": torque, "way": angle}
    lists = {what: column.tolist() for what, column in columns.items()}
    for name, content, (way, load) in (
        ("a.json", {"about": ["x"], "run": {"data": both.tolist()}}, ("2", "1")),
        ("b.json", {"n": [1], "z": both.tolist()}, ("2", "1")),
        ("c.json", {"run": {**lists, "n": 3}}, ("way", "load")),
        ("a.mat", {"run": {**columns, "n": 3.0}, "k": 1.0}, ("run.way", "run.load")),
        ("b.mat", {"run": both}, ("run.2", "run.1")),
        ("c.mat", {"rig": {"run": columns}}, ("rig.run.way", "rig.run.load")),
        ("d.mat", {**columns, "fit": angle[:3]}, ("way", "load")),  # of another length
    ):
        path = tmp_path / name
        if path.suffix == ".mat":
            savemat(path, content)
        else:
            path.write_text(json.dumps(content), encoding="utf-8-sig")
        log = read(path, "--angle", way, "--torque", load, "--angle-unit", "rad")
        assert (log.theta.tolist(), log.torque.tolist()) == (angle.tolist(), torque.tolist()), name
    savemat(tmp_path / "e.mat", {"k": 1.0})
    assert "e.mat" in refused(tmp_path / "e.mat")


def test_a_file_on_which_its_library_crashes_is_one_line(tmp_path):
    """The type of a MAT element is 8, which is none: scipy looks it up and dereferences NULL."""
    path = tmp_path / "crash.mat"
    log_writers.mat(path, table_of(5))
    whole = bytearray(path.read_bytes())
    whole[whole.index((9).to_bytes(4, "little"), 128)] = 8  # of the first column of doubles
    path.write_bytes(whole)
    assert "crash.mat" in refused(path)


# --- what is wrong, and where ---------------------------------------------------------------------

BAD = [  # name, text, what the line of complaint holds
    ("a.csv", "angle;torque\ndeg;Nm\n1;2\n3;x\n", ("a.csv:4:", "'torque [Nm]'", "'x'")),
    ("a.csv", "# one\n\nangle,torque\n1,2\n3,x\n", ("a.csv:5:", "'torque'", "'x'")),
    ("a.csv", '"angle\n\nleft","torque"\n1,2\n3,x\n', ("a.csv:5:", "'torque'", "'x'")),
    ("a.csv", 'angle 5",torque\n1,2\n3,x\n', ("a.csv:3:", "'torque'", "'x'")),
    ("a.csv", "angle,torque\n\u2019,y\nx,y\n1,2\n", ("a.csv:2:", "'angle'", "'\u2019'")),
    ("a.csv", "angle;torque\nx;5\n1;2\n", ("a.csv:2:", "'angle'", "'x'")),
    ("a.csv", "angle,torque\n1.2.3,5\n1,2\n", ("a.csv:2:", "'angle'", "'1.2.3'")),
    ("a.csv", "angle,torque\ndeg\n1,2\n", ("'angle'", "'deg'")),
    ("a.csv", "# only\n% this\n", ("a.csv: empty",)),
    ("a.csv", "\n \n", ("a.csv: empty",)),
    ("a.csv", "", ("a.csv: empty",)),
    ("a.csv", "angle,torque\n", ("a.csv:1:", "no rows")),
    ("a.csv", "angle,torque\n1,2\n", ("a.csv", " 1 rows")),
    ("a.csv", "angle,torque\n" + "1,2\n" * 29, ("a.csv", " 29 rows", "30")),
    ("a.csv", "angle,torque\n1,2,3\n1,2,4\n", ("a.csv:1:",)),
    ("a.csv", "angle,torque\n1,2\n1,2,3\n", ("a.csv", "line 3")),
    ("a.csv", "angle,torque\n1,2\n3,\n", ("a.csv:3:", "'torque'", "1 of 2")),
    ("a.csv", "angle,torque\n1,2\n3", ("a.csv:3:", "'torque'", "1 of 2")),
    ("a.csv", "angle,torque\n1,2\n\0,3\n", ("a.csv", "byte 17")),
    ("a.csv", "t,angle,torque\n0,1,2\n2,1,3\n1.5,2,2\n", ("a.csv: row 3", "1.5 after 2")),
    ("a.csv", '"an\ngle","tor\x1bque\x07",t\n1,2,3\n4,5,6\n', ("a.csv", "an gle")),
    ("ragged", "angle,torque\n1,2\n1,2,3\n", ("ragged", "line 3")),
    ("bare.csv", "1 2\n3 x\n", ("bare.csv", "--angle", "1, 2")),
    ("deep.json", "[" * 200_000, ("deep.json",)),
    ("cut.json", '[{"angle": 1,\n "torque"', ("cut.json:2:",)),
    ("one.json", '[{"angle": 1, "torque": 2}]', ("one.json", " 1 rows")),
    ("big.json", f'{{"angle": [{"9" * 400}, 1], "torque": [1, 2]}}', ("big.json", "'angle'")),
    ("mixed.json", '[{"angle": 1, "torque": 2}, 5]', ("mixed.json",)),
    ("none.json", '{"a": 1, "b": ["c"]}', ("none.json",)),
    ("long.json", '{"angle": [1, 2], "torque": [1, 2, 3]}', ("long.json",)),
    ("hole.json", '{"angle": [1, 2], "torque": [2, "x"]}', ("json: row 2:", "'torque'", "'x'")),
    ("new.mat", "MATLAB 7.3 MAT-file".ljust(124) + "\0\2IM", ("new.mat", "7.3", "-v7")),
]


@pytest.mark.parametrize(("name", "text", "parts"), BAD, ids=range(len(BAD)))
def test_what_is_wrong_in_a_table_is_said_with_its_place(name, text, parts, tmp_path):
    encoding = "cp1252" if name.endswith(".csv") else "utf-8"
    (tmp_path / name).write_bytes(text.encode(encoding))
    line = refused(tmp_path / name)
    assert line.isprintable() and len(line) < 400 + len(str(tmp_path))
    for part in parts:
        assert part in line


def test_bytes_that_are_no_text_are_named_by_their_number(tmp_path):
    path = tmp_path / "x.csv"
    for raw, byte in (
        (b"angle,torque [\x81Nm]\n1,2\n", 14),
        (b"angle\xe9,torque\n1,\x012\n", 5),
        (bytes(range(256)) * 4, 0),
    ):
        path.write_bytes(raw)
        assert f"byte {byte}" in refused(path)


def test_what_is_no_file_is_named(tmp_path):
    """Alone, among good logs, and as a log to check."""
    assert "absent.csv: no such file" in refused(tmp_path / "absent.csv")
    line = refused(tmp_path)
    assert f"{tmp_path}: a folder" in line and f"--each {tmp_path}" in line
    assert "--each" in refused() and "--follow" in refused()
    log_writers.parquet(tmp_path / "empty.parquet", {"angle": np.zeros(0), "torque": np.zeros(0)})
    assert " 0 rows" in refused(tmp_path / "empty.parquet")


def test_the_clock_of_a_table_of_pandas(tmp_path):
    """As the index with a name, and as moments."""
    time, angle, torque = table_of(6).values()
    for clock in ("s", "datetime64[ns]", "timedelta64[ns]"):
        step = time if clock == "s" else (time * 1e9).astype(clock)
        frame = pd.DataFrame({"angle_rad": angle, "torque_Nm": torque}, index=pd.Index(step))
        frame.index.name = "t"
        frame.to_parquet(tmp_path / "x.parquet")
        log = read(tmp_path / "x.parquet")
        assert log.time == pytest.approx(time) and log.theta.tolist() == angle.tolist()
    shutil.copy(tmp_path / "x.parquet", tmp_path / "x.csv")
    assert "x.csv" in refused(tmp_path / "x.csv")
