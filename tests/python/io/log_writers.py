# SPDX-License-Identifier: MIT
"""Write logs as other programs do, one writer for each kind of file, without code of the package.

Frames are packed by hand, without the DBC.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

Table = dict[str, np.ndarray]  # columns by name, all (rows,)

DBC = """VERSION ""
NS_ :
BS_:
BU_: A
BO_ 256 Shaft: 8 A
 SG_ Angle : 0|32@1- (0.0001,0) [-1000|1000] "deg" A
BO_ 257 Load: 8 A
 SG_ Torque : 0|32@1- (0.0001,0) [-100|100] "Nm" A
"""
STEP = 1e-4  # deg and Nm per bit of the DBC
SHAFT, LOAD = 256, 257


def text(separator: str) -> Callable[[Path, Table], None]:
    def write(path: Path, table: Table) -> None:
        rows = zip(*(map(repr, column.tolist()) for column in table.values()), strict=True)
        lines = [separator.join(table), *map(separator.join, rows)]
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")

    return write


def json_records(path: Path, table: Table) -> None:
    names, columns = list(table), [column.tolist() for column in table.values()]
    rows = [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]
    path.write_text(json.dumps({"about": {"by": "a rig"}, "entries": rows}), encoding="utf-8")


def json_columns(path: Path, table: Table) -> None:
    columns = {name: column.tolist() for name, column in table.items()}
    path.write_text(json.dumps({"rate": 1000, "data": columns}), encoding="utf-8")


def mat(path: Path, table: Table) -> None:
    from scipy.io import savemat

    savemat(path, dict(table))


def mat_structure(path: Path, table: Table) -> None:
    from scipy.io import savemat

    savemat(path, {"rig": dict(table), "rate": 1000.0})


def parquet(path: Path, table: Table) -> None:
    pd.DataFrame(table).to_parquet(path)


def channels(path: Path, table: Table) -> None:
    from asammdf import MDF, Signal

    time = table.get("t", np.arange(len(next(iter(table.values()))), dtype=float))
    signals = [Signal(column, time, name=name) for name, column in table.items() if name != "t"]
    with MDF() as measured:
        measured.append(signals)
        measured.save(path, overwrite=True)


TABLES: dict[str, Callable[[Path, Table], None]] = {
    "comma.csv": text(","),
    "semicolon.csv": text(";"),
    "tab.tsv": text("\t"),
    "blank.txt": text("  "),
    "records.json": json_records,
    "columns.json": json_columns,
    "plain.mat": mat,
    "structure.mat": mat_structure,
    "log.parquet": parquet,
    "channels.mf4": channels,
}


def frames(path: Path, time: np.ndarray, angle: np.ndarray, torque: np.ndarray) -> None:
    """Write a CAN log by python-can: time in s, deg and Nm in bits of the DBC."""
    import can

    with can.Logger(path) as logger:
        for now, first, second in zip(time.tolist(), angle.tolist(), torque.tolist(), strict=True):
            for number, bits in ((SHAFT, first), (LOAD, second)):
                message = can.Message(
                    timestamp=now,
                    arbitration_id=number,
                    is_extended_id=False,
                    data=struct.pack("<ii", bits, 0),
                    channel=1,
                )
                logger.on_message_received(message)


FRAMES = ("blf", "asc", "trc", "log", "raw.mf4")  # kinds that need a DBC
