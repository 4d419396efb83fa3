# SPDX-License-Identifier: MIT
"""Models against measured friction: on made-up logs the model that made them is found, and what is
not in reach leaves the page as it is.
"""

from __future__ import annotations

import re
import sys

import numpy as np
import pytest
from conftest import ROOT

sys.path.insert(0, str(ROOT / "tools" / "bench"))

import measured  # noqa: E402
import report  # noqa: E402
import target  # noqa: E402

pytestmark = pytest.mark.usefixtures("library")

TARGET = {"m3": {case: 10 + k for k, (_, _, case) in enumerate(measured.MODELS.values())}}


@pytest.fixture(scope="module")
def angle():
    """Loops of many sizes, 2 rad wide."""
    t = np.linspace(0, 60, 4000)
    return np.sin(t) * (0.6 + 0.4 * np.sin(0.37 * t)) + 0.1 * np.sin(5 * t)


def made(angle, kind):
    """Torque of an element in steps of its equation, 50 between two rows; neither grid nor C."""
    F, found, last = 0.0, [], angle[0]
    for place in angle:
        for _ in range(50):
            step = (place - last) / 50
            F += 20 * step * (1 - F * np.sign(step)) if kind == "dahl" else 20 * step
            F = max(-1.0, min(1.0, F))
        last = place
        found.append(F)
    return np.array(found)


@pytest.mark.parametrize(("kind", "best"), [("dahl", "Dahl"), ("slip", "slip, 1")])
def test_the_model_that_made_it_is_found(angle, kind, best):
    torque = -3.0 * made(angle, kind) + 0.4 + 0.2 * angle  # the rig counts the reaction
    scores = measured.score(angle, torque)
    other = "slip, 1" if kind == "dahl" else "Dahl"
    assert scores[best] > 0.998
    assert scores["Coulomb"] < scores[other] < scores[best]
    assert scores["slip, 4"] >= scores["slip, 2"] >= scores["slip, 1"]
    assert abs(scores["LuGre, Euler steps"] - scores["Dahl"]) < 0.03


def test_what_no_model_explains_is_not_explained(angle):
    noise = np.random.default_rng(3).normal(size=len(angle))
    assert max(measured.score(angle, noise).values()) < 0.05


def test_the_block_has_each_model_and_its_cost():
    scores = {"rig": {title: 0.9 + 0.01 * k for k, title in enumerate(measured.MODELS)}}
    rows = measured.block(scores, TARGET).splitlines()[3:-1]
    for k, (row, title) in enumerate(zip(rows, measured.MODELS, strict=True)):
        assert re.split(r" *\| *", row.strip("| ")) == [title, str(10 + k), f".{9000 + 100 * k}"]
    assert measured.picture(scores, TARGET).axes[0].get_xscale() == "log"


def test_where_logs_are_not_in_reach_the_page_stays(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(measured.data, "local_folder", lambda name: None)
    monkeypatch.setattr(report, "DOCS", tmp_path)
    with pytest.raises(target.BenchError, match=r"tribometer/reciprocating.tsv is not in reach"):
        measured.measure()
    report.write_measured(TARGET)
    assert "not compared with measured logs anew: tribometer" in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == []


def test_a_new_table_and_picture(monkeypatch, tmp_path):
    scores = {"rig": dict.fromkeys(measured.MODELS, 0.9)}
    monkeypatch.setattr(measured, "measure", lambda: scores)
    monkeypatch.setattr(report, "DOCS", tmp_path)
    (tmp_path / "pictures").mkdir()
    page = tmp_path / "speed.md"
    page.write_text("before\n" + "\nold\n".join(measured.MARKS) + "\nafter\n")
    report.write_measured(TARGET)
    assert page.read_text() == f"before\n{measured.block(scores, TARGET)}\nafter\n"
    assert (tmp_path / "pictures/measured.png").stat().st_size > 5000


def test_the_units_are_the_librarys(angle):
    units = measured.responses(angle)
    assert {kind: unit.shape[1] for kind, unit in units.items()} == {
        "coulomb": 1,
        "dahl": measured.GRID,
        "slip": measured.GRID,
        "lugre": measured.GRID,
        "mixed": 2 * measured.GRID,
    }
    assert all(abs(unit).max() <= 1.0001 for unit in units.values())
