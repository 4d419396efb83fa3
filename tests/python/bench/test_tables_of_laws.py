# SPDX-License-Identifier: MIT
"""`tools/bench.sh laws`: cells of the tables, and the blocks of the page that it writes."""

import shutil
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from conftest import ROOT
from dahl.sim.compensation import CASES, laws_of

NUMBERS = {"rms": 1.0, "ratio": 0.5, "hold": 1e-3, "noise": 0.15, "knob": 0.0}


@pytest.fixture
def laws(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.syspath_prepend(ROOT / "tools/bench")
    module = import_module("laws")
    shutil.copy(ROOT / "docs/compensation.md", tmp_path)
    monkeypatch.setattr(module, "DOCS", tmp_path)
    return module


def compared(seed: int) -> Any:
    """The ratio of the law `dahl` in one case and its hold follow the seed."""
    numbers: dict[str, Any] = {
        axis: {case.name: {law: dict(NUMBERS) for law in laws_of(axis)} for case in cases}
        for axis, cases in CASES.items()
    }
    numbers["position"]["17 bits"]["dahl"] |= {"ratio": seed / 10, "hold": seed * 1e-3}
    return SimpleNamespace(numbers=numbers)


def test_the_tables_have_mean_and_worst_of_the_seeds(laws, monkeypatch, capsys) -> None:
    """0.1 to 0.5: mean 0.3, worst 0.5. The page gets what is printed."""
    monkeypatch.setattr(laws, "compare", compared)
    assert laws.main(["--docs"]) == 0
    printed, page = capsys.readouterr().out, (laws.DOCS / "compensation.md").read_text()
    (row,) = [line for line in printed.splitlines() if line.startswith("| 17 bits | ")]
    assert row.split(" | ")[1] == "0.500" and row.split(" | ")[-2] == "0.300 (0.500)"
    (row,) = [line for line in printed.splitlines() if line.startswith("| dahl | ")]
    assert row.split(" | ")[1:3] == ["3.0 (5.0), 150", "1.0, 150"]
    for table in printed.rstrip("\n").split("\n\n"):
        assert table in page
    assert "## From a log to a compensator" in page


def test_a_worst_seed_within_five_percent_is_not_shown(laws) -> None:
    assert laws.cell([0.100, 0.104], "{:.3f}".format) == "0.102"
    assert laws.cell([0.100, 0.120], "{:.3f}".format) == "0.110 (0.120)"
    assert laws.cell([0.0, 0.0], "{:.3f}".format) == "0.000"
