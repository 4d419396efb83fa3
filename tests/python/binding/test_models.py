# SPDX-License-Identifier: MIT
"""The table of friction models in dahl_frames.h, against the DBC, the exact references and
docs/loop.md.
"""

from __future__ import annotations

import subprocess
import sys

import cantools
import dahl
import pytest
from conftest import ROOT
from dahl.binding import models
from dahl.sim.reference import EXACT, exact_elastoplastic_ratios, travel_per_count

FIRST = (100.0, 0.5, 1e-5)  # sigma0, Fc, theta_per_count


def test_the_dbc_the_references_and_the_page_have_each_model_of_the_table(dbc):
    """The DBC has no word for slip and parallel, whose number depends on the elements."""
    database, table = cantools.database.load_file(dbc), models.table()
    assert list(table) == list(EXACT) and next(iter(table)) == "dahl"
    named = {row.number: row.class_name for row in table.values() if row.sigma0s}
    for frame in ("ParamWrite", "ParamReply"):
        signal = database.get_message_by_name(frame).get_signal_by_name("Model")
        assert {number: str(word) for number, word in signal.choices.items()} == named
    done = subprocess.run(
        [sys.executable, ROOT / "tools" / "model_table.py"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.count("\n") == 2 + len(table)
    assert done.stdout in (ROOT / "docs" / "loop.md").read_text(encoding="utf-8")


def test_the_reference_of_an_element_with_breakaway_follows_small_turns(library):
    """Beyond the breakaway, after each turn, forward and backward."""
    moves, b = [4000, -100, 40, 900, -9000, 100, -40, -800], 0.4
    bearing = dahl.ElastoPlastic(*FIRST, b)
    exact = exact_elastoplastic_ratios(moves, travel_per_count(*FIRST), b)
    torque = [bearing.step_counts(move) for move in moves]
    assert torque == pytest.approx([FIRST[1] * float(ratio) for ratio in exact], abs=1e-8)
