# SPDX-License-Identifier: MIT
"""The table of friction models in dahl_parts.h, against the DBC, the exact references and
docs/loop.md.
"""

from __future__ import annotations

import sys

import cantools
import dahl
import pytest
from conftest import ROOT
from dahl import paths
from dahl.binding import models
from dahl.sim.reference import EXACT
from programs import run


def test_the_dbc_the_references_and_the_page_have_each_model_of_the_table(dbc):
    """The DBC has no word for slip and parallel, whose number depends on the elements."""
    database, table = cantools.database.load_file(dbc), models.table()
    assert list(table) == list(EXACT) and next(iter(table)) == "dahl"
    named = {row.number: row.class_name for row in table.values() if row.sigma0s}
    for frame in ("ParamWrite", "ParamReply"):
        signal = database.get_message_by_name(frame).get_signal_by_name("Model")
        assert {number: str(word) for number, word in signal.choices.items()} == named
    printed = run(sys.executable, ROOT / "tools/model_table.py")
    assert printed.count("\n") == 2 + len(table)
    assert printed in (ROOT / "docs/loop.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("is_there", [False, True])
def test_a_missing_header_and_a_row_with_too_few_columns_are_named(monkeypatch, tmp_path, is_there):
    """Such a row would vanish."""
    before, _, after = (paths.INCLUDE / models.HEADER).read_text().partition("MODEL(dahl, DAHL, ")
    header = tmp_path / models.HEADER
    if is_there:
        header.write_text(f"{before}MODEL(dahl, {after}")
    monkeypatch.setattr(paths, "INCLUDE", tmp_path)
    what = f":{before.count(chr(10)) + 1}: .*columns" if is_there else ": No such file"
    with pytest.raises(dahl.RunError, match=f"^{header}{what}"):
        models.table.__wrapped__()
