# SPDX-License-Identifier: MIT
"""`dahl dbc` describes one or several nodes. tools/fault_table.py writes a table into a page."""

from __future__ import annotations

import itertools
import subprocess
import sys
from pathlib import Path

import cantools
from conftest import ROOT
from identify_tools import complaint


def numbered(name: str, number: int) -> str:
    return f"{name}_{number}" if number else name


def description_of(dahl, nodes: int) -> cantools.database.Database:
    assert dahl("dbc", "--nodes", nodes, "-o", f"{nodes}.dbc").returncode == 0
    return cantools.database.load_file(f"{nodes}.dbc")


def test_a_description_of_n_nodes_repeats_the_dbc_for_each(dahl, dbc):
    database, many = cantools.database.load_file(dbc), description_of(dahl, 16)
    assert (len(many.messages), many.version) == (16 * len(database.messages), database.version)
    for message, number in itertools.product(database.messages, (0, 1, 15)):
        twin = many.get_message_by_frame_id(message.frame_id + number)
        for what in ("comment", "cycle_time", "send_type"):
            assert getattr(twin, what) == getattr(message, what)
        assert twin.senders == [numbered(name, number) for name in message.senders]
        for signal, other in zip(message.signals, twin.signals, strict=True):
            assert other.receivers == [numbered(name, number) for name in signal.receivers]
            for what in (
                "name",
                "start",
                "length",
                "scale",
                "unit",
                "comment",
                "choices",
                "initial",
            ):
                assert getattr(other, what) == getattr(signal, what), (signal.name, what)
    names = [numbered(node.name, number) for number in range(16) for node in database.nodes]
    assert sorted(node.name for node in many.nodes) == sorted(names)


def test_it_is_printed_or_written_and_overwrites_no_file(dahl, dbc):
    printed = dahl("dbc").stdout
    one, project = cantools.database.load_string(printed), cantools.database.load_file(dbc)
    assert [each.name for each in one.messages] == [each.name for each in project.messages]
    assert "\r" not in printed and dahl("dbc", "--nodes", 1, "-o", "-").stdout == printed
    Path("own.dbc").write_text("mine")
    code, line = complaint(dahl("dbc", "-o", "own.dbc"))
    assert code == 2 and line.startswith("own.dbc: ") and "--force" in line
    assert Path("own.dbc").read_text() == "mine"
    assert dahl("dbc", "-o", "own.dbc", "--force").returncode == 0
    assert Path("own.dbc").read_text() == printed


def test_a_page_gets_the_fault_table_between_its_marks(tmp_path):
    def fault_table(*pages: Path) -> subprocess.CompletedProcess:
        command = [sys.executable, ROOT / "tools" / "fault_table.py", *pages]
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)

    page, other = tmp_path / "page.md", tmp_path / "other.md"
    page.write_text("before\n<!-- node:faults -->\nold\n<!-- /node:faults -->\nafter\n")
    half = "its end was cut off\n<!-- node:faults -->\nold\n"
    other.write_text(half)
    assert fault_table(page, other).returncode == 0
    table = fault_table().stdout
    assert len(table.splitlines()) == 2 + (ROOT / "lib/node/fault_table.h").read_text().count(
        " ROW("
    )
    assert "| wrong CRC | crc | CRC | kept | no |" in table
    marked = f"<!-- node:faults -->\n{table}<!-- /node:faults -->\n"
    assert page.read_text() == f"before\n{marked}after\n" and other.read_text() == half
    assert marked in (ROOT / "docs" / "loop.md").read_text(encoding="utf-8")
    missing = fault_table(tmp_path / "none.md")
    assert (missing.returncode, missing.stderr.count("\n")) == (1, 1)
