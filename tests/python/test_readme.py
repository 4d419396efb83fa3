# SPDX-License-Identifier: MIT
"""The README says what the commands print: its table of forms, the frames, the bounds, and only
commands that exist.
"""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import cantools
import pytest
from conftest import built

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text()


def block(name: str) -> str:
    return re.search(rf"<!-- {name} -->\n(.*?)<!-- /{name} -->", README, re.S)[1]


def test_table_of_forms() -> None:
    forms = built("tests", "lib", "forms")
    printed = subprocess.run([forms], capture_output=True, text=True, check=True).stdout
    assert block("forms") == printed, (
        "paste what build/host/tests/lib/forms prints between the marks"
    )


def test_bounds_are_those_of_the_header() -> None:
    header = (ROOT / "lib/include/dahl.h").read_text()
    bounds = {
        "DAHL_ULP_COUNTS": "0.52 ulp",
        "DAHL_ULP_ANGLE": "0.6 ulp",
        "DAHL_FLOAT_ERROR": "3e-7 Fc",
    }
    for name, said in bounds.items():
        assert re.search(rf"#define {name} {said.split()[0]}\s", header) and said in README


def test_frames_are_those_of_the_dbc() -> None:
    messages = cantools.database.load_file(ROOT / "port/dahl.dbc").messages
    assert messages
    for message in messages:
        assert f"| {message.name} | 0x{message.frame_id:X} + node |" in README


@pytest.mark.parametrize("word", sorted(set(re.findall(r"-k (\w+)", README))))
def test_each_test_command_selects_something(word: str) -> None:
    names = [f.stem for f in (ROOT / "tests").rglob("test_*.*")]
    assert any(word in name for name in names), f"no test file is selected by -k {word}"


NAMED = re.findall(r"(?:lib|port|tests|tools|host_sim|\.readme)/[\w./-]+\w", README)


@pytest.mark.parametrize("path", sorted(set(NAMED)))
def test_named_files_exist(path: str) -> None:
    built = ROOT / "build/host" / path
    assert (ROOT / path).exists() or built.exists(), path
