# SPDX-License-Identifier: MIT
"""tools/fault_table.py keeps the table of a page, and nothing else of it, as the node has it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from conftest import ROOT

TOOL = ROOT / "tools" / "fault_table.py"


def test_a_page_gets_the_table_between_its_marks(tmp_path: Path) -> None:
    page, other = tmp_path / "page.md", tmp_path / "other.md"
    page.write_text("before\n<!-- node:faults -->\nold\n<!-- /node:faults -->\nafter\n")
    half = "its end was cut off\n<!-- node:faults -->\nold\n"
    other.write_text(half)
    subprocess.run([sys.executable, TOOL, page, other], check=True)
    first, *table, last = page.read_text().splitlines()[1:-1]
    assert page.read_text().startswith("before\n") and page.read_text().endswith("\nafter\n")
    assert (first, last) == ("<!-- node:faults -->", "<!-- /node:faults -->")
    assert len(table) == 2 + (ROOT / "lib/node/fault_table.h").read_text().count("    ROW(")
    assert all(row.count("|") == 6 for row in table)
    assert "| wrong CRC | crc | CRC | kept | no |" in table
    assert other.read_text() == half
    printed = subprocess.run([sys.executable, TOOL], capture_output=True, text=True, check=True)
    assert printed.stdout.splitlines() == table


def test_a_page_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    for words, code in (([tmp_path / "none.md"], 1), (["--help"], 0), (["--none"], 2)):
        done = subprocess.run(
            [sys.executable, TOOL, *words], capture_output=True, text=True, check=False
        )
        assert (done.returncode, "Traceback" in done.stderr) == (code, False)
    done = subprocess.run([sys.executable, TOOL, tmp_path], capture_output=True, check=False)
    assert (done.returncode, done.stderr.count(b"\n")) == (1, 1)
