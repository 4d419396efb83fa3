# SPDX-License-Identifier: MIT
"""Each option of `dahl identify` does what its help says, on both sides of its limits; logs that no
fit can use are refused in one line; and foreign files are not overwritten.
"""

from __future__ import annotations

import csv
import json
from pathlib import Path

import joblib
import numpy as np
import pytest
from identify_tools import COUNT, FC, SIGMA0, complaint, dahl_torque, noise_of, sine, write_csv
from log_reading import asked, read, refused, run

pytestmark = pytest.mark.usefixtures("library")

ROWS, LATE, OFFSET = 1600, 6, 0.2


def table_of(rows: int = ROWS) -> tuple[np.ndarray, np.ndarray]:
    """Return the angle in whole counts, and a late torque with an offset."""
    theta = sine(1, rows=rows + LATE, cycles=8)
    torque = dahl_torque(theta)[:rows] + OFFSET + 0.02 * FC * noise_of(1, rows)
    return np.floor(theta[LATE:] / COUNT) * COUNT, torque


@pytest.fixture(scope="module")
def rig(tmp_path_factory) -> Path:
    """A log; its last column is twice the torque, with a row without a number."""
    theta, torque = table_of()
    holed = np.where(np.arange(ROWS) == 700, np.nan, 2 * torque)
    path = tmp_path_factory.mktemp("rig") / "rig.csv"
    table = np.column_stack((np.arange(ROWS) * 1e-3, np.degrees(theta), torque, holed))
    header = "t,angle_deg,torque_Nm,friction_holed_Nm"
    np.savetxt(path, table, fmt="%.9g", delimiter=",", header=header, comments="")
    return path


def found_by(*words: object) -> dict:
    done = run("identify", *words, "--json", "-", "--no-files")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def usual(rig, library) -> dict:
    """The numbers without an option."""
    found = found_by(rig)
    assert found["delay_rows"] == pytest.approx(LATE, abs=2.5)
    assert found["extra"] == {"offset": pytest.approx(OFFSET, abs=0.01)}
    assert found["sigma0"] == pytest.approx(SIGMA0, rel=0.15)
    return found


def scaled(usual: dict, sigma0: float, Fc: float) -> dict:  # noqa: N803
    """Return both parameters in other units."""
    wanted = {"sigma0": sigma0 * usual["sigma0"], "Fc": Fc * usual["Fc"]}
    return {name: pytest.approx(value, rel=0.02) for name, value in wanted.items()}


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        (
            "--terms offset,viscous",
            lambda _: {"extra": {"offset": near(OFFSET), "viscous": near(0)}},
        ),
        ("--no-delay", lambda _: {"delay_rows": 0}),
        ("--torque-unit mNm", lambda usual: scaled(usual, 1e-3, 1e-3)),
        ("--angle-unit rad --trust-units", lambda usual: scaled(usual, np.pi / 180, 1.0)),
        ("--angle-unit mm", lambda usual: {"linear": True, **scaled(usual, np.pi / 0.18, 1)}),
        ("--counts-per-turn 8192", lambda _: {"resolution": pytest.approx(2 * COUNT)}),
        ("--torque 4 --skip-gaps", lambda u: {"rows": ROWS - 1, **scaled(u, 2, 2)}),
    ],
)
def test_each_option_does_what_it_says(rig, usual, words, wanted):
    found = found_by(rig, *words.split())
    for name, value in wanted(usual).items():
        assert found[name] == value, name


def near(value: float):
    return pytest.approx(value, abs=0.3)


def test_each_option_of_the_fit_reaches_it(rig):
    """Compare the options of estimate.identify(), without a fit."""
    usual = {"terms": None, "delay": True, "median": 0, "trust_units": False}
    usual |= {"target_counts": 0.0, "model": ""}
    for words, change in (
        ("", {}),
        ("--terms spring,inertia", {"terms": ("spring", "inertia")}),
        ("--terms none", {"terms": ()}),
        ("--no-delay", {"delay": False}),
        ("--median 0", {}),
        ("--median 99", {"median": 99}),
        ("--trust-units", {"trust_units": True}),
        ("--target-counts-per-turn 512", {"target_counts": 512.0}),
        ("--model SLIP-3", {"model": "slip-3"}),
    ):
        assert vars(asked(rig, *words.split())) == usual | change, words


UNUSED = {
    "x.csv": "--jobs 3, --dask tcp://a:1, --within 1, --seconds 1, --frames 1",
    "--each .": "--json -, --name a, --force, --no-files, --check x.csv, --within 1, --frames 1",
    "--follow": "--check x.csv, --jobs 3, --dask tcp://a:1",
}


def test_a_log_counts_once(rig):
    """It is recognised by any path, in the fit and in --check."""
    again = rig.parent / "." / ".." / rig.parent.name / rig.name
    for words in ((rig, again), (rig, "--check", again)):
        code, line = complaint(run("identify", *words, "--no-files"))
        assert code == 2 and str(rig.name) in line and "twice" in line
    code, line = complaint(run("identify", "--each", rig.parent, "--jobs", "0"))
    assert code == 2 and "--jobs 0" in line


@pytest.mark.parametrize("kind", UNUSED)
def test_an_option_without_use_is_refused(kind):
    for option in UNUSED[kind].split(", "):
        code, line = complaint(run("identify", *kind.split(), *option.split()))
        assert code == 2 and option.split()[0] in line
        assert ("LOG" if "csv" in kind else kind.split()[0]) in line


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        ("--terms viscus", ("viscus", "'viscous'")),
        ("--model slip-9", ("slip-9", "slip-4")),
        ("--median -1", ("--median", "-1", "99")),
        ("--median 100", ("--median", "100", "99")),
        ("--median 5.0", ("--median", "5.0")),
        ("--target-counts-per-turn 0", ("--target-counts-per-turn", "0")),
        ("--counts-per-turn 0", ("--counts-per-turn 0",)),
        ("--counts-per-turn 4294967296", ("--counts-per-turn",)),
        ("--counts-per-turn nan", ("--counts-per-turn nan",)),
        ("--each x", ("--each",)),
        ("--follow", ("--follow",)),
        ("--terms none,viscous", ("--terms none",)),
    ],
)
def test_bad_values_are_one_line_with_the_limit(rig, words, parts):
    line = refused(rig, *words.split())
    assert all(part in line for part in parts), line


def test_a_log_to_check_is_read_with_the_same_options(rig, tmp_path):
    (other := tmp_path / "other.csv").write_bytes(rig.read_bytes())
    for words in ((), ("--torque-unit", "mNm", "--torque", "4", "--skip-gaps")):
        found = found_by(rig, *words, "--check", other)
        assert found["checks"] == {str(other): pytest.approx(found["r2"], abs=0.02)}
    code, line = complaint(run("identify", rig, "--check", "absent.csv", "--no-files"))
    assert code == 2 and "absent.csv" in line


def test_the_options_hold_for_each_log_of_a_folder_too(rig, tmp_path, usual, monkeypatch):
    jobs, parallel = [], joblib.Parallel
    monkeypatch.setattr(
        joblib, "Parallel", lambda n_jobs, **how: jobs.append(n_jobs) or parallel(n_jobs=1, **how)
    )
    words = ("--each", rig.parent, "-o", tmp_path, "--jobs", "3", "--torque-unit", "mNm")
    done = run("identify", *words)
    assert (done.returncode, jobs) == (0, [3]), done.stderr
    with (tmp_path / "each.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert row["log"] == "rig.csv"
    assert {name: float(row[name]) for name in ("sigma0", "Fc")} == scaled(usual, 1e-3, 1e-3)


def test_a_cluster_that_is_not_there_is_a_failed_run(rig, tmp_path, monkeypatch):
    # This limit has no option, and ten seconds are long for a test.
    monkeypatch.setattr("dahl.identify.batch.CLUSTER_TIMEOUT_S", 0.5)
    address = "tcp://127.0.0.1:9"
    done = run("identify", "--each", rig.parent, "-o", tmp_path, "--dask", address)
    assert done.returncode == 1 and address in done.stderr


def test_following_ends_after_the_time_that_was_given(tmp_path):
    from log_reading import signals

    bus = ("--follow", "-i", "virtual", "-c", "silent", "--seconds", "0.3")
    code, line = complaint(run("identify", *bus, *signals(tmp_path)))
    assert code == 2 and "0 valid frames" in line


# --- logs that no fit can use ---------------------------------------------------------------------


def test_swapped_columns_are_refused(rig):
    words = "--angle torque_Nm --torque angle_deg --angle-unit deg --terms offset --no-delay"
    code, line = complaint(run("identify", rig, *words.split(), "--trust-units", "--no-files"))
    assert code == 2 and "rig.csv" in line and "friction" in line


def test_a_broken_log_among_good_ones_is_a_line_and_code_2(rig, tmp_path):
    """At any place among the logs; files are named after the first log and written."""
    (tmp_path / "empty.csv").touch()
    write_csv(tmp_path / "still.csv", np.ones(ROWS), table_of()[1])
    logs = (tmp_path / "still.csv", rig, tmp_path / "empty.csv")
    done = run("identify", *logs, "-o", tmp_path / "out", "--terms", "offset", "--no-delay")
    assert done.returncode == 2 and "sigma0" in done.stdout
    first, last = done.stderr.splitlines()
    assert "still.csv: angle is constant (1 in" in first and last.endswith("empty.csv: empty")
    kept = json.loads((tmp_path / "out" / "still.json").read_text())
    assert kept["logs"] == [str(rig)]
    done = run("identify", tmp_path / "empty.csv", tmp_path / "absent.csv", "--no-files")
    assert (done.returncode, done.stdout) == (2, "")
    first, last = done.stderr.splitlines()
    assert "empty.csv" in first and "absent.csv" in last


# --- files ----------------------------------------------------------------------------------------

LEFT = ["dahl_plan_{}.h", "{}.csv", "{}.ini", "{}.json", "{}.png"]


def test_files_go_where_they_are_asked_to(rig, tmp_path):
    """--force, since no plan models this delay."""
    words = ("--name", "my rig", "-o", tmp_path / "out", "--json", tmp_path / "numbers.json")
    done = run("identify", rig, *words, "--force")
    assert done.returncode == 0
    left = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert left == [name.format("my_rig") for name in LEFT]
    kept = (tmp_path / "out" / "my_rig.json").read_text()
    assert (tmp_path / "numbers.json").read_text() == kept


@pytest.mark.parametrize("stem", ["$\\undefined$", "+"])
def test_a_log_may_have_any_name(tmp_path, stem):
    """Dollars are not a formula; a name without a character of C becomes "log"."""
    theta, torque = table_of()
    write_csv(tmp_path / f"{stem}.csv", theta, torque)
    done = run("identify", tmp_path / f"{stem}.csv", "-o", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    name = "log" if stem == "+" else "undefined"
    assert (tmp_path / "out" / f"{name}.png").is_file()


def test_a_foreign_file_is_not_overwritten(dahl, tmp_path, rig):
    """Nor is a log that is read. Files of an earlier run are replaced."""
    text = rig.read_bytes()
    Path("rig.tsv").write_bytes(text)
    for theirs in ("rig.ini", "rig.csv"):
        Path(theirs).write_text("[scene]\ntitle = mine\n")
        code, line = complaint(dahl("identify", "rig.tsv", "-o", "."))
        assert code == 2 and line.startswith(f"{theirs}: ") and "--name" in line
        assert read("rig.tsv").rows == ROWS  # --no-files does not care
        assert sorted(path.name for path in tmp_path.iterdir()) == sorted([theirs, "rig.tsv"])
        Path(theirs).unlink()
    Path("rig.csv").write_bytes(text)
    for words, part in (
        (("rig.csv", "-o", "."), "--name"),
        (("rig.csv", "--json", "./rig.csv", "--no-files"), "--json ./rig.csv"),
        (("rig.tsv", "-o", ".", "--check", "rig.csv"), "--name"),
        (("rig.tsv", "--json", "rig.csv", "--no-files", "--check", "rig.csv"), "--json rig.csv"),
        (("rig.tsv", "rig.csv", "-o", "."), "--name"),
        (("rig.tsv", "rig.csv", "--json", "rig.csv", "--no-files"), "--json rig.csv"),
    ):
        code, line = complaint(dahl("identify", *words))
        assert code == 2 and line.startswith("rig.csv: ") and part in line
        assert Path("rig.csv").read_bytes() == text
    for _ in range(2):
        assert dahl("identify", "rig.csv", "-o", ".", "--name", "a").returncode == 0


def test_an_interrupted_run_leaves_whole_files(rig, tmp_path, monkeypatch):
    """It is interrupted while the JSON is replaced."""
    words = ("identify", rig, "-o", tmp_path, "--name", "x", "--force")
    assert run(*words).returncode == 0
    whole = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert sorted(whole) == [name.format("x") for name in LEFT]
    replace = Path.replace

    def interrupt(part, target):
        if Path(target).name == "x.json":
            raise KeyboardInterrupt
        return replace(part, target)

    monkeypatch.setattr(Path, "replace", interrupt)
    with pytest.raises(KeyboardInterrupt):
        run(*words)
    left = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert "dahl_plan_x.h" not in left
    for name in ("x.json", "x.csv", "x.ini"):
        assert left[name] == whole[name]
