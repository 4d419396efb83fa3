# SPDX-License-Identifier: MIT
"""Tables that `dahl identify` reads: the numbers are those that another program wrote, and an error
names file, line or row, column and value.
"""

import json

import log_writers
import numpy as np
import pandas as pd
import pytest
from dahl.errors import Error
from dahl.identify import Source
from dahl.identify import read as read_log
from hypothesis import strategies as st
from identify_tools import complaint
from log_reading import read, refused, run
from log_writers import TABLES
from property_tools import holds, modes
from scipy.io import savemat

ROWS = 40


def table_of(seed: int, rows: int = ROWS, size: float = 1.0) -> log_writers.Table:
    """Return a rising time and two columns of noise in 64ths, which short text holds exactly."""
    draw = np.random.default_rng(seed)
    way, force = draw.integers(-1000, 1000, (2, rows)) / 64 * size
    return {"t": np.arange(rows) / 8, "pos_m": way, "force_N": force}


# --- each kind of file ----------------------------------------------------------------------------


@pytest.mark.parametrize("kind", TABLES)
def test_a_table_of_each_kind_comes_back_as_it_was_written(kind, tmp_path):
    prefix = "rig." if kind == "structure.mat" else ""
    named = ("--angle", f"{prefix}pos_m", "--torque", f"{prefix}force_N")
    named += () if kind == "channels.mf4" else ("--time", f"{prefix}t")
    for seed, size in enumerate((1.0, 1 / 3e7, 7e7)):
        table = table_of(seed, rows=30 + 17 * seed, size=size)
        path = tmp_path / f"{seed}.{kind.upper() if seed else kind}"
        TABLES[kind](tmp_path / kind, table)
        (tmp_path / kind).rename(path)
        for words in (named, ()) if kind != "structure.mat" else (named,):
            log = read(path, *words, "--trust-units", "--angle-unit", "m")
            assert log.linear and log.name == str(path)
            for found, wrote in zip((log.time, log.theta, log.torque), table.values(), strict=True):
                assert found.dtype == float
                np.testing.assert_allclose(found, wrote, rtol=1e-14)


def test_an_archive_may_hold_columns_and_objects(tmp_path):
    table = table_of(4)
    columns = {name: values[:, None] for name, values in table.items()}
    about = np.array({"rig": "left"}, dtype=object)
    np.savez(tmp_path / "log.npz", allow_pickle=True, about=about, **columns)
    log = read(tmp_path / "log.npz")
    assert np.array_equal(log.torque, table["force_N"])


def test_a_mat_file_with_vectors_of_other_lengths_is_read_by_those_that_two_share(tmp_path):
    table = {"t": np.arange(60) / 8, "pos_m": np.arange(60.0), "force_N": np.sin(np.arange(60))}
    others = {"raw": {"adc": np.arange(900.0)}, "gains": np.ones(7), "rig": table, "Kp": 3.0}
    path = tmp_path / "x.mat"
    savemat(path, others)
    log = read(path, "--time", "rig.t")
    assert log.theta == pytest.approx(table["pos_m"])
    savemat(path, {"raw": {"adc": np.arange(900.0)}, "gains": np.ones(7)})
    assert "x.mat" in refused(path) and "no two vectors" in refused(path)


@pytest.mark.parametrize("kind", TABLES)
def test_a_row_without_a_number_is_named_or_left_out(kind, tmp_path):
    table, path = table_of(1), tmp_path / kind
    table["force_N"][[5, 9]] = np.nan
    TABLES[kind](path, table)
    prefix = "rig." if kind == "structure.mat" else ""
    words = ("--angle", f"{prefix}pos_m", "--torque", f"{prefix}force_N", "--angle-unit", "m")
    line, place = refused(path, *words), ":7:" if kind in TEXTS else ": row 6:"
    assert line.startswith(f"{path}{place} ") and "nan" in line
    assert f"{prefix}force_N'" in line and f"2 of {ROWS}" in line and "--skip-gaps" in line
    log, kept = read(path, *words, "--skip-gaps"), np.delete(np.arange(ROWS), [5, 9])
    assert log.theta.tolist() == table["pos_m"][kept].tolist()
    assert log.torque.tolist() == table["force_N"][kept].tolist()
    TABLES[kind](path, {**table, "force_N": np.full(ROWS, np.nan)})
    assert f"{ROWS} of {ROWS}" in refused(path, *words, "--skip-gaps")


def test_rows_and_columns_are_found_in_nested_json_and_matlab(tmp_path):
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
        log = read_log(path, Source(way, load, angle_unit="rad"))
        assert (log.theta.tolist(), log.torque.tolist()) == (angle.tolist(), torque.tolist()), name
    savemat(tmp_path / "e.mat", {"k": 1.0})
    assert "e.mat" in refused(tmp_path / "e.mat")


def test_the_clock_of_a_table_of_pandas(tmp_path):
    time, angle, torque = table_of(6).values()
    for clock in ("s", "datetime64[ns]", "timedelta64[ns]"):
        step = time if clock == "s" else (time * 1e9).astype(clock)
        frame = pd.DataFrame({"angle_rad": angle, "torque_Nm": torque}, index=pd.Index(step))
        frame.index.name = "t"
        frame.to_parquet(tmp_path / "x.parquet")
        log = read(tmp_path / "x.parquet")
        assert log.time == pytest.approx(time) and log.theta.tolist() == angle.tolist()


# --- text in many forms ---------------------------------------------------------------------------

TEXTS = ("comma.csv", "semicolon.csv", "tab.tsv", "blank.txt")
PREAMBLE = ["", "# rig 3", "% 24.11.2026, 12:00", "Messung: Prüfstand 3", "Kalibrierung;1,25;2,5"]
PREAMBLE += ['Datum\t"24.11.2026"', "Rate,1000,Hz", "sep=;"]
NAMES = [  # above the rows, with units in the names or in a separate line
    [["Zeit [ms]", "Winkel [°]", "Drehmoment [mNm]"]],
    [["time_ms", "angle_deg", "torque_mNm"]],
    [["time", "angle", "torque"], ["ms", "deg", "mN·m"]],
    [["Zeit", "Winkel", "Moment"], ["[ms]", "[°]", "[mNm]"]],
    [["time (ms)", "angle, left\n\n(°)", "torque [mNm]"]],
]
FORMS = st.fixed_dictionaries(
    {
        "separator": st.sampled_from(["\t", ";", ",", "  ", ", ", " ; "]),
        "decimal": st.sampled_from(".,"),
        "encoding": st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "cp1252"]),
        "end": st.sampled_from(["\n", "\r\n", "\r"]),
        "preamble": st.lists(st.sampled_from(PREAMBLE), max_size=3, unique=True),
        "names": st.sampled_from(NAMES),
        "mark": st.sampled_from(["", "# ", "% "]),  # before the names
        "after": st.sampled_from(["", "", "\n", "\n  \n", "\n{mark}end, of it\n"]),
        "last": st.booleans(),  # a separator after the last cell
        "text": st.booleans(),  # a column of words
    }
)


def text_of(form: dict, columns: list[list[float]], last: str = "") -> tuple[str, int]:
    """Return a table and the line of its last row, whose last cell may be another one."""
    separator = form["separator"]

    def line(cells: list[str]) -> str:
        words = [*cells[:1], *["some words"] * form["text"], *cells[1:]]
        special = separator.strip(" ") or " "
        quoted = [f'"{word}"' if {special, "\n"} & set(word) else word for word in words]
        return separator.join(quoted) + separator.strip(" ") * form["last"]

    cells = [[f"{x:.17g}".replace(".", form["decimal"]) for x in column] for column in columns]
    cells[-1][-1] = last or cells[-1][-1]
    rows = [line(row) for row in zip(*cells, strict=True)]
    above = [form["mark"] + line(form["names"][0]), *map(line, form["names"][1:])]
    after = form["after"].format(mark=form["mark"] or "# ")
    rows[2:2] = [after.strip("\n")] if after else []
    text = "\n".join([*form["preamble"], *above, *rows])
    return text + after, text.count("\n") + 1


@modes(short=150, long=3000)
def test_a_table_in_any_form_is_read(examples, tmp_path):
    """An error names the line of its cell, and a row without a number may be left out."""
    numbers, path = st.tuples(st.floats(-100, 100), st.floats(-3e4, 3e4)), tmp_path / "x.csv"

    def write(form: dict, text: str) -> None:
        path.write_text(text.replace("\n", form["end"]), encoding=form["encoding"], newline="")

    def check(form: dict, rows: list[tuple[float, float]]) -> None:
        columns = [np.arange(len(rows)) / 8, *np.array(rows).T]
        text, place = text_of(form, columns)
        write(form, text)
        log = read_log(path, Source())
        found = (1e3 * log.time, np.degrees(log.theta), 1e3 * log.torque)
        np.testing.assert_allclose(found, columns, rtol=1e-14, atol=1e-290, err_msg=text)
        assert log.notes == []
        for cell in ("nan", "x y"):
            write(form, text_of(form, columns, cell)[0])
            with pytest.raises(Error, match=rf"x.csv:{place}: column '.*m.*': .*{cell}"):
                read_log(path, Source())
        write(form, text_of(form, columns, "nan")[0])
        log = read_log(path, Source(skip_gaps=True))
        np.testing.assert_allclose(1e3 * log.torque, columns[2][:-1], rtol=1e-14, atol=1e-290)

    holds(check, examples, FORMS, st.lists(numbers, min_size=4, max_size=7))


ODD = {  # lines above 40 rows of time, angle and torque, and the form of a row
    "a quote that is never closed": ('"rig 3\ntime_s;angle_deg;torque_Nm', "{};{};{}"),
    "names with units between blanks": ("time [s] angle [deg] torque [Nm]", "{} {} {}"),
    "a line of dashes": ("time_s angle_deg torque_Nm\n------- ----- -----", "{} {} {}"),
    "units of other quantities": ("U;P;Zeit;Winkel;Moment\nV;-;s;deg;Nm", "1;2;{};{};{}"),
    "numbers for words": ("#;1;time_s;angle_deg;torque_Nm", "n;2;{};{};{}"),
    "the same below a title": ("Rig 3\n#;1;time_s;angle_deg;torque_Nm", "n;2;{};{};{}"),
    "a mark in a cell": ("time_s;angle_deg;torque_Nm;what", "{};{};{};run # 3"),
    "another mark between": ("% rig 3\ntime_s;angle_deg;torque_Nm\n# start", "{};{};{}\n# next"),
    "quoted names in a comment": ('# "time_s"\t"angle_deg"\t"torque_Nm"', "{}\t{}\t{}"),
    "a calibration above": ("range;2,5;5\ntime_s;angle_deg;torque_Nm", "{};{};{}"),
}
UNNAMED = {  # the same without names
    "nothing above": ("", "{};{};{}"),
    "a separator at the end": ("", "{}\t{}\t{}\t"),
    "a title": ("Title", "{};{};{};7"),
    "a remark": ("# one remark or more than that", "{} {} {} 7"),
    "a remark and dashes": ("# one remark or more than that\n----", "{},{},{},7"),
}


@pytest.mark.parametrize("above", ODD | UNNAMED)
def test_odd_tables_are_read(above, tmp_path):
    head, row = (ODD | UNNAMED)[above]
    table, words = table_of(5), ("--trust-units",)
    if above in UNNAMED:
        words += tuple("--time 1 --angle 2 --torque 3 --angle-unit deg --torque-unit Nm".split())
    rows = zip(*(column.tolist() for column in table.values()), strict=True)
    (tmp_path / "x.csv").write_text("\n".join([head, *(row.format(*one) for one in rows)]))
    log = read(tmp_path / "x.csv", *words)
    np.testing.assert_allclose(np.degrees(log.theta), table["pos_m"], rtol=1e-14)
    assert log.time.tolist() == table["t"].tolist()
    assert log.torque.tolist() == table["force_N"].tolist()


@pytest.mark.parametrize("before", [0, 3])
def test_a_letter_may_lie_across_the_end_of_the_head(before, tmp_path):
    rows = "".join(f"{k % 7},{k % 5},éé\n" for k in range(10_000))
    (tmp_path / "x.csv").write_text(f"angle,torque,{'n' * (before + 1)}\n{rows}", encoding="utf-8")
    assert read(tmp_path / "x.csv").rows == 10_000


# --- errors and their places ----------------------------------------------------------------------

LONG = "1,2,3\n" * 20_000  # beyond the head
BAD = [  # name, text, parts of the error
    ("a.csv", "angle;torque\ndeg;Nm\n1;2\n3;x\n", "a.csv:4:|'torque [Nm]'|'x'"),
    ("a.csv", 'angle 5",torque\n1,2\n3,x\n', "a.csv:3:|'torque'|'x'"),
    ("a.csv", 'n,angle,torque\n"a\nb",1,2\n\n#\nc,3,x\n', "a.csv:6:|'torque'|'x'"),
    ("a.csv", "t,angle,torque\n0,\u2019,y\n0,1,2\n", "a.csv:2:|'angle'|'\u2019'"),
    ("a.csv", "angle,torque\n1.2.3,5\n1,2\n", "a.csv:2:|'angle'|'1.2.3'"),
    ("a.csv", "angle;torque\n1,5;2\n2,5;3\n1.234,5;4", "a.csv:4:|'angle'|'1.234,5'"),
    ("a.csv", "time;angle;torque\n24.11.2026;1;2\n", "a.csv:2:|'time'|'24.11.2026'"),
    ("a.csv", ",force\n1,2\n3,4\n", "a.csv:1:|--angle|1, force"),
    ("a.csv", "angle,torque\nleft\n1,2\n", "a.csv:2:|--angle"),
    ("a.csv", "", "a.csv: empty"),
    ("a.csv", "angle,torque\n", "a.csv:1:|no rows"),
    ("a.csv", "angle\n1\n2\n", "a.csv:1:|two numbers"),
    ("a.csv", "angle,torque\n1,2\n", "a.csv| 1 rows"),
    ("a.csv", "angle,torque\n" + "1,2\n" * 29, "a.csv| 29 rows|30"),
    ("a.csv", "# x\nangle,torque\n1,2,3\n1,2,4\n", "a.csv:2:|2 names|3 columns"),
    ("a.csv", "angle, left,torque\n1,2\n1,2\n", "a.csv:1:|3 names|2 columns"),
    ("a.csv", "angle,torque\n1,2\n\n1,2,3\n", "a.csv:4:|3 cells|2 columns"),
    ("a.csv", "t,angle,torque\n" + LONG + '1,"2,3', "a.csv:20002:"),
    ("a.csv", "t,angle,torque\n" + LONG + "1,2,\xb0", "a.csv:20002:|byte|UTF-8"),
    ("a.csv", "t,angle,torque\n" + LONG + "# end", "a.csv:20002:|'# end'"),
    ("a.csv", "angle,torque\n1,2\n3,\n", "a.csv:3:|'torque'|nan|1 of 2"),
    ("a.csv", "angle,torque\n-0,2\n1e400,2", "a.csv:3:|'angle'|inf|1 of 2"),
    ("a.csv", "angle,torque\n1,2\n\0,3\n", "a.csv|byte 17"),
    ("a.csv", "t,angle,torque\n0,1,2\n\n2,1,3\n1.5,2,2\n", "a.csv:5:|1.5 after 2"),
    ("a.csv", '"an\ngle","tor\x1bque\x07",t\n1,2,3\n4,5,6\n', "a.csv:1:|an gle"),
    ("bare.csv", "1 2\n3 x\n", "bare.csv:1:|--angle|1, 2"),
    ("title.csv", "A title\nx;y\n1;2\n3;4\n", "title.csv:2:|--angle|x, y"),
    ("a.xlsx", "PK\3\4\0\0", "a.xlsx|XLSX|CSV"),
    ("a.xls", "\xd0\xcf\x11\xe0\0", "a.xls|XLS|CSV"),
    ("a.tdms", "TDSm\x0e\0", "a.tdms|TDMS|CSV"),
    ("a.h5", "\x89HDF\r\n\x1a\n", "a.h5|HDF5|CSV"),
    ("a.csv", "angle,torque [\x81Nm]\n1,2\n", "a.csv|byte 14"),
    ("a.csv", "angle\xe9,torque\n1,\x012\n", "a.csv|byte 5"),
    ("deep.json", "[" * 200_000, "deep.json"),
    ("cut.json", '[{"angle": 1,\n "torque"', "cut.json:2:"),
    ("big.json", f'{{"angle": [{"9" * 400}, 1], "torque": [1, 2]}}', "big.json|'angle'"),
    ("mixed.json", '[{"angle": 1, "torque": 2}, 5]', "mixed.json"),
    ("none.json", '{"a": 1, "b": ["c"]}', "none.json"),
    ("long.json", '{"angle": [1, 2], "torque": [1, 2, 3]}', "long.json"),
    ("hole.json", '{"angle": [1, 2], "torque": [2, "x"]}', "json: row 2:|'torque'|'x'"),
    ("new.mat", "MATLAB 7.3 MAT-file".ljust(124) + "\0\2IM", "new.mat|7.3|-v7"),
]


@pytest.mark.parametrize(("name", "text", "parts"), BAD, ids=range(len(BAD)))
def test_an_error_in_a_table_has_its_place(name, text, parts, tmp_path):
    raw = text.encode("cp1252" if "\u2019" in text else "latin-1")
    (tmp_path / name).write_bytes(raw)
    line = refused(tmp_path / name)
    assert line.isprintable() and len(line) < 400 + len(str(tmp_path))
    assert line.count(str(tmp_path)) == 1
    for part in parts.split("|"):
        assert part in line


def test_a_file_on_which_its_library_crashes_is_one_line(tmp_path):
    """The type of a MAT element is 8, which does not exist: scipy dereferences NULL."""
    path = tmp_path / "crash.mat"
    log_writers.mat(path, table_of(5))
    whole = bytearray(path.read_bytes())
    whole[whole.index((9).to_bytes(4, "little"), 128)] = 8  # of the first column of doubles
    path.write_bytes(whole)
    assert "crash.mat" in refused(path)


def test_a_path_that_is_not_a_log_is_named(tmp_path):
    line = refused(tmp_path)
    assert f"{tmp_path}: a folder" in line and f"--each {tmp_path}" in line
    (tmp_path / "notes.md").write_text("no log")
    assert "--each" in complaint(run("identify", "--each", tmp_path / "none"))[1]
    code, line = complaint(run("identify", "--each", tmp_path))
    assert code == 2 and str(tmp_path) in line and ".parquet" in line and ".blf" in line
    log_writers.parquet(tmp_path / "empty.parquet", {"angle": np.zeros(0), "torque": np.zeros(0)})
    assert " 0 rows" in refused(tmp_path / "empty.parquet")
