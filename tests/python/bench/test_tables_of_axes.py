# SPDX-License-Identifier: MIT
"""`tools/bench.sh axes`: its tables agree with a recount of the rows, and an axis has the same row
in each run.
"""

import csv
import re
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from conftest import BUILD, ROOT

FIRST, COUNT = 64231, 4
Row = dict[str, str]
RECOUNT: dict[str, Callable[[Row], bool]] = {
    "`Fc_low` is true": lambda row: float(row["Fc_low"]) <= 1,
    "`length_long` is true": lambda row: float(row["length_long"]) >= 1,
    "mean Fc is within 5 %": lambda row: 0.95 < float(row["Fc"]) < 1.05,
    "inertia is within 5 %": lambda row: 0.95 < float(row["inertia"]) < 1.05,
    "inertia is in its interval": lambda row: (
        float(row["inertia_low"]) <= 1 <= float(row["inertia_high"])
    ),
    "done in 25 s": lambda row: float(row["seconds"]) <= 25,
    "bound of the rotor is true": lambda row: float(row["inertia_low"]) <= 1,
}


@pytest.fixture
def axes(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(ROOT / "tools/bench")
    module = import_module("axes")
    monkeypatch.setattr(module, "PROGRAM", BUILD / "tests/lib/commission_axes")
    return module


def measured(axes: Any, file: Path, *words: object) -> list[Row]:
    assert axes.main([*map(str, words), "--rows", str(file)]) == 0
    with file.open(newline="") as opened:
        return [{k: v for k, v in row.items() if v} for row in csv.DictReader(opened)]


def test_the_tables_are_a_count_of_the_axes(axes, tmp_path, capsys) -> None:
    rows = measured(axes, tmp_path / "rows.csv", FIRST, COUNT)
    shown = capsys.readouterr()
    reports = re.split(r"(?m)^(?=\d+ random)", shown.out)[1:]
    assert [row["kind"] for row in rows] == COUNT * ["rigid"] + COUNT * ["flexible"]
    assert f"{COUNT} of {COUNT} flexible axes" in shown.err
    for kind, report in zip(("rigid", "flexible"), reports, strict=True):
        of_kind = [row for row in rows if row["kind"] == kind]
        done = [row for row in of_kind if row["refusal"] == "0"]
        assert f"{COUNT} random {kind} axes, from {FIRST}: {len(done)} gave bounds" in report
        assert len(done) + sum(map(int, re.findall(r"(\d+) (?:refused|not done)", report))) == COUNT
        table = dict(re.findall(r"(?m)^\| (.+) \| (\d+) \|$", report))
        assert {*table} <= {*of_kind[0]} and len(table) == {"rigid": 12, "flexible": 2}[kind]
        for name, count in table.items():
            is_true = RECOUNT.get(name, lambda row, name=name: row[name] == "1")
            assert int(count) == sum(map(is_true, done)), name
    hands = sorted(row["hand"] for row in rows if "hand" in row)
    assert f"A hand then needs {float(hands[len(hands) // 2]):.3f} of its torque" in reports[0]


def test_an_axis_does_not_depend_on_the_first_one(axes, tmp_path) -> None:
    both = measured(axes, tmp_path / "two.csv", FIRST, 2, "--only", "rigid")
    assert both[1:] == measured(axes, tmp_path / "one.csv", FIRST + 1, 1, "--only", "rigid")


def test_refusals_are_counted_by_name(axes) -> None:
    rows = [{"bounds": 0, "refusal": code} for code in (-56, 0, -56)] + [{"bounds": 1}]
    assert axes.refusals(rows) == "2 refused as `LIGHT`, 1 not done in time"


@pytest.mark.parametrize("words", [["5"], ["-1", "3"], ["5", "0"], ["--only", "stiff"]])
def test_bad_arguments_are_refused(axes, words) -> None:
    with pytest.raises(SystemExit) as stopped:
        axes.main(words)
    assert stopped.value.code == 2
