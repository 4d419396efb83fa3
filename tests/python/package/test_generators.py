# SPDX-License-Identifier: MIT
"""The committed files that tools/generators write from the C sources, the DBC and keys.csv."""

import importlib
from types import ModuleType

import cantools
import pytest
from conftest import ROOT
from dahl import facts
from dahl.binding import models
from dahl.identify.lags import LAGS
from dahl.identify.laws import LAWS
from dahl.sim.reference import EXACT


def generator(name: str) -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT / "tools/generators")
        return importlib.import_module(name)


@pytest.mark.parametrize(("name", "files"), [("facts", 4), ("frames", 3), ("run_keys", 1)])
def test_the_committed_files_are_those_that_a_generator_writes(name, files):
    texts = generator(name).generated()
    assert len(texts) == files
    for path, text in texts.items():
        assert path.read_text(encoding="utf-8") == text, f"{path}: run tools/generators/{name}.py"


def test_the_header_of_the_frames_has_the_declarations_of_the_dbc():
    assert generator("frames").missing_in_header() == []


def test_the_dbc_and_the_references_have_each_model_and_the_period(dbc):
    """The DBC has no word for slip and parallel, whose number depends on the elements."""
    database, table = cantools.database.load_file(dbc), models.table()
    assert list(table) == list(EXACT) and next(iter(table)) == "dahl"
    named = {row.number: row.class_name for row in table.values() if row.sigma0s}
    for frame in ("ParamWrite", "ParamReply"):
        signal = database.get_message_by_name(frame).get_signal_by_name("Model")
        assert {number: str(word) for number, word in signal.choices.items()} == named
    assert database.get_message_by_name("EncoderState").cycle_time * 1000 == facts.PERIOD_US


def test_each_law_and_lag_of_identify_has_a_sketch():
    """Sums of several elements look like the one that is drawn; the page has friction by load."""
    sketches = generator("identify_sketches")
    assert set(sketches.LAGS_SHOWN) == set(LAGS)
    alike = {"2 slip", "4 slip", "mixed 3", "mixed 4", "loaded"}
    assert set(sketches.LAWS_SHOWN) == set(LAWS) - alike
