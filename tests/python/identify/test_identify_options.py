# SPDX-License-Identifier: MIT
"""Each option of `dahl identify` does what its help says; options without use are refused; logs
that no fit can use are one line each; and foreign files are not overwritten.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from identify_tools import COUNT, FC, complaint, dahl_torque, noise_of, sine, write_csv, write_table
from log_reading import asked, read, run

ROWS, LATE, OFFSET = 1600, 6, 0.2


def table_of(rows: int = ROWS) -> tuple[np.ndarray, np.ndarray]:
    theta = sine(1, rows=rows + LATE, cycles=8)
    torque = dahl_torque(theta)[:rows] + OFFSET + 0.02 * FC * noise_of(1, rows)
    return np.floor(theta[LATE:] / COUNT) * COUNT, torque


@pytest.fixture(scope="module")
def rig(tmp_path_factory) -> Path:
    """A log; its last column is twice the torque, with a row without a number."""
    theta, torque = table_of()
    holed = np.where(np.arange(ROWS) == 700, np.nan, 2 * torque)
    columns = {"t": np.arange(ROWS) * 1e-3, "angle_deg": np.degrees(theta), "torque_Nm": torque}
    path = tmp_path_factory.mktemp("rig") / "rig.csv"
    return write_table(path, {**columns, "friction_holed_Nm": holed})


def found_by(*words: object) -> dict:
    done = run("identify", *words, "--json", "-", "--no-files")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_each_option_of_the_fit_reaches_it(rig):
    """Compare the options of estimate.identify(), without a fit; then one fit with three."""
    usual = {"terms": None, "delay": True, "median": 0, "trust_units": False}
    usual |= {"target_counts": 0.0, "model": ""}
    for words, change in (
        ("", {}),
        ("--terms spring,inertia", {"terms": ("spring", "inertia")}),
        ("--terms none", {"terms": ()}),
        ("--no-delay", {"delay": False}),
        ("--median 99", {"median": 99}),
        ("--trust-units", {"trust_units": True}),
        ("--target-counts-per-turn 512", {"target_counts": 512.0}),
        ("--model SLIP-3", {"model": "slip-3"}),
    ):
        assert vars(asked(rig, *words.split())) == usual | change, words
    found = found_by(rig, *"--terms offset,viscous --no-delay --counts-per-turn 8192".split())
    assert (found["delay_rows"], found["resolution"]) == (0, pytest.approx(2 * COUNT))
    assert found["extra"] == pytest.approx({"offset": OFFSET, "viscous": 0}, abs=0.01)


@pytest.mark.parametrize(
    ("angle", "torque", "words", "claimed"),
    [
        ("angle", "torque_Nm", "is the angle in rad? Its steps are 2 pi/16384", (False, True)),
        ("angle_rad", "torque", "is the torque in N m?", (False, False)),
        ("angle_rad", "torque_Nm", "sigma0 = ", (True, True)),
    ],
)
def test_a_number_in_an_assumed_unit_is_not_claimed(angle, torque, words, claimed, tmp_path):
    """The question is the first line, and no header is written: the log is in rad, not in deg."""
    theta, measured = table_of()
    columns = {"t_s": np.arange(ROWS) * 1e-3, angle: theta, torque: measured}
    path = write_table(tmp_path / "x.csv", columns)
    done = run("identify", path, "-o", tmp_path / "out", "--terms", "offset")
    kept = json.loads((tmp_path / "out" / "x.json").read_text())
    assert done.returncode == 0 and kept["verdict"].startswith(words)
    assert tuple(kept["identifiable"].values()) == claimed
    assert (tmp_path / "out" / "dahl_plan_x.h").exists() is all(claimed)


REFUSED = """
    RIG --jobs 3 => --jobs ... LOG
    RIG --dask tcp://a:1 => --dask ... LOG
    RIG --within 1 => --within ... LOG
    RIG --seconds 1 => --seconds ... LOG
    RIG --frames 1 => --frames ... LOG
    --each . --json - => --json ... --each
    --each . --name a => --name ... --each
    --each . --force => --force ... --each
    --each . --no-files => --no-files ... --each
    --each . --check x.csv => --check ... --each
    --each . --within 1 => --within ... --each
    --each . --frames 1 => --frames ... --each
    --each . --jobs 0 => --jobs 0
    --follow --check x.csv => --check ... --follow
    --follow --jobs 3 => --jobs ... --follow
    --follow --dask tcp://a:1 => --dask ... --follow
    RIG --terms viscus => viscus ... 'viscous'
    RIG --terms none,viscous => --terms none
    RIG --model slip-9 => slip-9 ... slip-4
    RIG --counts-per-turn 0 => --counts-per-turn 0
    RIG --counts-per-turn 4294967296 => --counts-per-turn
    RIG ./RIG => RIG ... twice
    RIG --check ./RIG => RIG ... twice
    RIG --check absent.csv --no-files => absent.csv
"""


@pytest.mark.parametrize("row", [row.strip() for row in REFUSED.strip().split("\n")])
def test_options_without_use_and_bad_words_are_refused(row, rig, monkeypatch):
    monkeypatch.chdir(rig.parent)
    words, facts = row.replace("RIG", rig.name).split(" => ")
    code, line = complaint(run("identify", *words.split()))
    assert code == 2 and all(fact in line for fact in facts.split(" ... "))


def test_a_log_to_check_is_read_with_the_same_options(rig, tmp_path):
    (other := tmp_path / "other.csv").write_bytes(rig.read_bytes())
    for words in ((), ("--torque-unit", "mNm", "--torque", "4", "--skip-gaps")):
        found = found_by(rig, *words, "--check", other)
        assert found["checks"] == {str(other): pytest.approx(found["r2"], abs=0.02)}


def test_a_broken_log_among_good_ones_is_a_line_and_code_2(rig, tmp_path):
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


@pytest.mark.parametrize(("stem", "name"), [("$\\undefined$", "undefined"), ("+", "log")])
def test_a_log_may_have_any_name(tmp_path, stem, name):
    path = write_csv(tmp_path / f"{stem}.csv", *table_of())
    assert run("identify", path, "-o", tmp_path / "out").returncode == 0
    assert (tmp_path / "out" / f"{name}.png").is_file()


def test_a_foreign_file_is_not_overwritten(dahl, tmp_path, rig):
    text = rig.read_bytes()
    Path("rig.tsv").write_bytes(text)
    for theirs in ("rig.ini", "rig.csv"):
        Path(theirs).write_text("[scene]\ntitle = mine\n")
        code, line = complaint(dahl("identify", "rig.tsv", "-o", "."))
        assert code == 2 and line.startswith(f"{theirs}: ") and "--name" in line
        assert read("rig.tsv").rows == ROWS
        assert sorted(path.name for path in tmp_path.iterdir()) == sorted([theirs, "rig.tsv"])
        Path(theirs).unlink()
    Path("rig.csv").write_bytes(text)
    for words, part in (
        ("rig.csv -o .", "--name"),
        ("rig.csv --json ./rig.csv --no-files", "--json ./rig.csv"),
        ("rig.tsv -o . --check rig.csv", "--name"),
        ("rig.tsv --json rig.csv --no-files --check rig.csv", "--json rig.csv"),
        ("rig.tsv rig.csv -o .", "--name"),
    ):
        code, line = complaint(dahl("identify", *words.split()))
        assert code == 2 and line.startswith("rig.csv: ") and part in line
        assert Path("rig.csv").read_bytes() == text
    for _ in range(2):
        assert dahl("identify", "rig.csv", "-o", ".", "--name", "a").returncode == 0


def test_an_interrupted_run_leaves_whole_files(rig, tmp_path, monkeypatch):
    """It is interrupted while the JSON is replaced. --force, since no plan models this delay."""
    words = ("identify", rig, "-o", tmp_path, "--name", "my x", "--force")
    shown = run(*words).stdout
    late = json.loads((tmp_path / "my_x.json").read_text())["delay_rows"]
    assert late == pytest.approx(LATE, abs=2.5) and f"torque late by {late:.2g} rows" in shown
    whole = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    left = ["dahl_plan_my_x.h", "my_x.csv", "my_x.ini", "my_x.json", "my_x.png"]
    assert sorted(whole) == left
    torque = np.loadtxt(tmp_path / "my_x.csv", delimiter=",", skiprows=1)[:, 1]  # without the delay
    off = torque - OFFSET - dahl_torque(sine(1, rows=ROWS + LATE, cycles=8))[LATE:]
    assert np.std(off[50:-50]) < 0.05 * FC
    replace = Path.replace

    def interrupt(part, target):
        if Path(target).name == "my_x.json":
            raise KeyboardInterrupt
        return replace(part, target)

    monkeypatch.setattr(Path, "replace", interrupt)
    with pytest.raises(KeyboardInterrupt):
        run(*words)
    after = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert "dahl_plan_my_x.h" not in after
    assert all(after[name] == whole[name] for name in left[1:4])
