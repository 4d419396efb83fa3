# SPDX-License-Identifier: MIT
"""Logs: what is good is read whole, what is bad is named by file, line and column."""

from __future__ import annotations

import re

import can
import numpy as np
import pytest
from dahl import Error, logs
from dahl.bus import candump_line

GOOD = "t,angle,torque\n0,1.5,2\n0.001,-2.5,3\n"


@pytest.fixture
def written(tmp_path):
    """Write a log, give its path."""

    def write(text: str | bytes, name: str = "log.csv"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def test_a_field_without_end_is_one_short_line(written):
    for row in ("1," + "1" * 200_000, '1,"' + "2\n" * 60_000):
        path = written("a,b\n" + row)
        with pytest.raises(Error, match=re.escape(f"{path}:")) as error:
            logs.read_table(path, ["a", "b"])
        assert len(str(error.value)) < len(str(path)) + 150


@pytest.mark.parametrize(
    "text",
    [
        GOOD,
        GOOD.replace(",", "\t"),
        GOOD.replace(",", ";"),
        GOOD.replace(",", ", "),
        GOOD.replace("\n", "\r\n"),
        GOOD.rstrip("\n"),
        GOOD + "\n,,\n",
        "\ufeff" + GOOD,
        GOOD.replace("angle", '"angle"'),
        "x,t,x,angle,torque\n1,0,1,1.5,2\n1,0.001,1,-2.5,3\n",
    ],
)
def test_forms_of_a_good_table(written, text):
    table = logs.read_table(written(text), ["angle", "torque"], "t")
    assert table["angle"].tolist() == [1.5, -2.5]
    assert table["torque"].tolist() == [2, 3]
    assert table["t"].tolist() == [0, 0.001]


def test_rows_of_one_and_the_same_time_are_a_table(written):
    assert logs.read_table(written("t,x\n1,2\n1,3\n"), ["x"], "t")["x"].tolist() == [2, 3]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "log.csv: empty"),
        ("\n\n", "log.csv: empty"),
        ("t,angle,torque\n", "log.csv:1: no rows"),
        (
            GOOD.replace("angle", "Angel"),
            "log.csv:1: no column 'angle'; did you mean 'Angel'? (there are: t, Angel, torque)",
        ),
        ("a,b\n1,2\n", "log.csv:1: no column 'angle'"),
        ("angle,t,torque, angle\n1,2,3,4\n", "log.csv:1: 2 columns 'angle': which one is meant?"),
        ("t,angle,torque\n0,1,2\n1,abc,2\n", "log.csv:3: column 'angle': 'abc' is not a number"),
        ("t,angle,torque\n0,1,\n", "log.csv:2: column 'torque': '' is not a number"),
        ("t,angle,torque\n0,nan,2\n", "log.csv:2: column 'angle': 'nan' is not a finite number"),
        ("t,angle,torque\n0,1,-inf\n", "log.csv:2: column 'torque': '-inf' is not a finite number"),
        (
            "t,angle,torque\n0,1,1e999\n",
            "log.csv:2: column 'torque': '1e999' is not a finite number",
        ),
        (
            "t,angle,torque\n1,1,2\n2,1,2\n1.5,1,2\n",
            "log.csv:4: column 't': 1.5 after 2, time goes backward",
        ),
        (
            "t,angle,torque\n0,1,2\n1,1",
            "log.csv:3: column 'torque': missing, the line ends after 2 of 3 columns",
        ),
        ("t,angle,torque\n0,1,2\n1,2,5,3\n", "log.csv:3: the row has 4 fields, the header 3"),
        (b"\x89PNG\r\n\x1a\n\x00\x00", "log.csv: not a text file"),
    ],
)
def test_bad_tables_are_named_by_file_line_and_column(written, text, words):
    with pytest.raises(Error, match=re.escape(words)):
        logs.read_table(written(text), ["angle", "torque"], "t")


def test_no_file(tmp_path):
    with pytest.raises(Error, match="none.csv: no such file"):
        logs.read_table(tmp_path / "none.csv", ["angle"])
    with pytest.raises(Error, match="Is a directory"):
        logs.read_table(tmp_path, ["angle"])


def test_candump_round_trip(written):
    short = {"is_extended_id": False, "channel": "vcan0"}
    sent = [
        can.Message(timestamp=0.001, arbitration_id=0x100, data=bytes(8), **short),
        can.Message(timestamp=1.5, arbitration_id=0x1ABCDEF, data=b"\x01", channel="can0"),
        can.Message(timestamp=2, arbitration_id=0x7FF, is_remote_frame=True, dlc=5, **short),
    ]
    lines = "".join(map(candump_line, sent))
    assert lines.splitlines()[0] == "(0000000000.001000) vcan0 100#0000000000000000"
    back = logs.read_candump(written(lines, "run.log"))
    assert [m.arbitration_id for m in back] == [m.arbitration_id for m in sent]
    assert [(bytes(m.data), m.dlc) for m in back] == [(bytes(m.data), m.dlc) for m in sent]
    assert np.allclose([m.timestamp for m in back], [m.timestamp for m in sent])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "(0000000000.001000) vcan0 100#00\n(0000000000.002000) vcan0 100#0\n",
            "run.log:2: not a line",
        ),
        ("(0000000000.001000) vcan0 100#00\nhello\n", "run.log:2: not a line"),
        ("(zero) vcan0 100#00\n", "run.log:1: not a line"),
        ("", "run.log: no frames"),
    ],
)
def test_bad_candump_logs_are_named_by_line(written, text, words):
    with pytest.raises(Error, match=re.escape(words)):
        logs.read_candump(written(text, "run.log"))


@pytest.mark.parametrize(
    ("ending", "count", "words"),
    [(".asc", 0, "no frames in it"), (".blf", 20, "broken or cut off after 20 frames (")],
)
def test_a_log_without_frames_or_without_its_end_is_named(tmp_path, ending, count, words):
    """python-can's reader of BLF has no word for what is missing at the end."""
    path = tmp_path / f"run{ending}"
    with can.Logger(path) as log:
        for n in range(count):
            log.on_message_received(can.Message(timestamp=n, arbitration_id=n, data=b"1"))
    path.write_bytes(path.read_bytes()[: -1 if count else None])
    with pytest.raises(Error, match=re.escape(f"{path}: {words}")):
        list(logs.frames_of(path))


@pytest.mark.parametrize(("count", "more"), [(30, ""), (31, ", and 1 more"), (75, ", and 45 more")])
def test_a_complaint_lists_thirty_names(count, more):
    names = [f"column{number}" for number in range(count)]
    shown = ", ".join(names[:30])
    assert logs.meant("nothing like it", names) == f" (there are: {shown}{more})"
    assert logs.meant("COLUMN7x", names).startswith("; did you mean 'column7'? (there are: ")
