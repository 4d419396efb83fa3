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
    other.write_text("no table here\n")
    subprocess.run([sys.executable, TOOL, page, other], check=True)
    first, *table, last = page.read_text().splitlines()[1:-1]
    assert page.read_text().startswith("before\n") and page.read_text().endswith("\nafter\n")
    assert (first, last) == ("<!-- node:faults -->", "<!-- /node:faults -->")
    assert len(table) == 2 + (ROOT / "lib/node/fault_table.h").read_text().count("    ROW(")
    assert all(row.count("|") == 6 for row in table)
    assert "| wrong CRC | crc | CRC | kept | no |" in table
    assert other.read_text() == "no table here\n"
