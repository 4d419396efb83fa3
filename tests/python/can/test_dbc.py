# SPDX-License-Identifier: MIT
"""`dahl dbc` describes one or several nodes."""

import itertools
from pathlib import Path

import cantools
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
