# SPDX-License-Identifier: MIT
"""Write logs as other programs do, one writer for each kind of file, without code of the package.

Frames are packed by hand, without the DBC.
"""

import json
import struct
from collections.abc import Callable, Iterable
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
    "archive.npz": lambda path, table: np.savez(path, **table),
    "log.parquet": parquet,
    "channels.mf4": channels,
}


def bus(path: Path, rows: Iterable[tuple[float, int, int]], **kind: object) -> Path:
    """Write frames by python-can: time in s, id, and the number in the first 4 bytes.

    A row may have a dictionary of more arguments of its can.Message.
    """
    import can

    usual = {"is_extended_id": False, "channel": 1, **kind}
    with can.Logger(path) as logger:
        for time, number, bits, *more in rows:
            data = struct.pack("<ii", bits, 0)
            logger(can.Message(time, number, data=data, **dict(usual, **dict(*more))))
    return path


def frames(path: Path, time: np.ndarray, angle: np.ndarray, torque: np.ndarray) -> Path:
    """Write a CAN log: time in s, deg and Nm in bits of the DBC."""
    rows = zip(time.tolist(), angle.tolist(), torque.tolist(), strict=True)
    return bus(path, (one for now, a, m in rows for one in ((now, SHAFT, a), (now, LOAD, m))))


FRAMES = ("blf", "asc", "trc", "log", "raw.mf4")  # kinds that need a DBC
