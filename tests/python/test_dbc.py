# SPDX-License-Identifier: MIT
"""What a user does with a DBC: decode what a node says, know its defaults, have one for many."""

from __future__ import annotations

from pathlib import Path

import can
import cantools
import pytest
from dahl import cli
from loop_tools import SCENES, run

SCENE = SCENES / "segments.ini"


@pytest.fixture(scope="module")
def database(dbc: Path) -> cantools.database.Database:
    return cantools.database.load_file(dbc)


def described(nodes: int, folder: Path) -> cantools.database.Database:
    path = folder / f"{nodes}.dbc"
    assert cli.main(["dbc", "--nodes", str(nodes), "-o", str(path)]) == 0
    return cantools.database.load_file(path)


def numbered(name: str, number: int) -> str:
    return f"{name}_{number}" if number else name


def test_one_for_n_nodes_decodes_every_frame_of_their_bus(tmp_path: Path) -> None:
    many = described(3, tmp_path)
    run(tmp_path / "run", SCENE, "--virtual", "--nodes", "3")
    seen: dict[str, set[int]] = {}
    for frame in can.LogReader(tmp_path / "run" / "run.log"):
        message = many.get_message_by_frame_id(frame.arbitration_id)
        assert message.decode(frame.data)["Crc"] == frame.data[0]
        seen.setdefault(message.name, set()).add(frame.arbitration_id & 15)
    kinds = {"EncoderState": 0, "FrictionTorque": 0, "Status": 0}
    wanted = {f"{kind}_{n}" if n else kind: {n} for kind in kinds for n in range(3)}
    assert seen == wanted


def test_one_for_n_nodes_keeps_all_that_the_dbc_says(
    tmp_path: Path, database: cantools.database.Database
) -> None:
    many = described(16, tmp_path)
    assert len(many.messages) == 16 * len(database.messages)
    for message in database.messages:
        for number in (0, 1, 15):
            twin = many.get_message_by_frame_id(message.frame_id + number)
            assert twin.name == numbered(message.name, number)
            assert twin.comment == message.comment
            assert twin.cycle_time == message.cycle_time
            assert twin.send_type == message.send_type
            assert {signal.name: str(signal) for signal in twin.signals}.keys() == {
                signal.name for signal in message.signals
            }
            for signal in message.signals:
                other = twin.get_signal_by_name(signal.name)
                for what in ("start", "length", "scale", "unit", "comment", "choices", "initial"):
                    assert getattr(other, what) == getattr(signal, what), (signal.name, what)
                assert other.receivers == [numbered(name, number) for name in signal.receivers]
            assert twin.senders == [numbered(name, number) for name in message.senders]
    names = [numbered(node.name, number) for number in range(16) for node in database.nodes]
    assert sorted(node.name for node in many.nodes) == sorted(names)
    assert many.version == database.version


def test_without_a_file_it_is_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    described(2, tmp_path)
    capsys.readouterr()
    for words in ([], ["-o", "-"]):
        assert cli.main(["dbc", "--nodes", "2", *words]) == 0
        assert capsys.readouterr().out == (tmp_path / "2.dbc").read_text()


def test_a_file_that_is_there_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "own.dbc"
    path.write_text("mine")
    assert cli.main(["dbc", "-o", str(path)]) == 2
    assert capsys.readouterr().err == f"error: {path}: there already; --force overwrites it\n"
    assert path.read_text() == "mine"
    assert cli.main(["dbc", "-o", str(path), "--force"]) == 0
    assert cantools.database.load_file(path).messages
