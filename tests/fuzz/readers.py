# SPDX-License-Identifier: MIT
"""readers.py tables|buses FOLDER [libFuzzer options]: pass any bytes to the Python readers.
readers.py seeds FOLDER tables|buses: write seeds of the binary formats.

A reader may raise dahl.Error only, with one line. All columns are finite and of one length. FOLDER
holds the file under test. The readers are called without the command, which would be slower.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import atheris

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools"))

with atheris.instrument_imports(include=["dahl"]):
    from dahl import Error
    from dahl.io import can_logs, can_signals, readers

import numpy as np

TABLES = (".csv", ".json", ".mat", ".parquet")
BUSES = (".log", ".asc", ".trc", ".blf", ".mf4")
DBC = """VERSION ""
BU_: E
BO_ 256 M: 8 E
 SG_ angle : 0|16@1- (1,0) [0|0] "deg" E
 SG_ torque : 16|16@1- (1,0) [0|0] "Nm" E
"""


def check_arrays(arrays: list[np.ndarray]) -> None:
    """All finite, all of one length."""
    assert len({len(array) for array in arrays}) == 1, "columns of different lengths"
    assert all(np.isfinite(array).all() for array in arrays), "a value that is not finite"


def read_table(path: Path, choice: int) -> None:
    """The reader of named columns, or the one that detects columns."""
    if choice & 1:
        check_arrays([*readers.read_columns(path, {"angle": "1", "time": "2"})[1].values()])
        return
    source = readers.Source(skip_gaps=bool(choice & 2), counts_per_turn=360.0)
    log = readers.read(path, source)
    check_arrays([log.theta, log.torque] + ([] if log.time is None else [log.time]))


def read_bus(path: Path, choice: int) -> None:
    """Frames of a log, signals of a log, or the bus description."""
    dbc = path.with_name("bus.dbc")
    if choice & 1:
        dbc.write_text(DBC, encoding="utf-8")
        log = readers.read(path, readers.Source("angle", "torque", dbc=dbc))
        check_arrays([log.theta, log.torque, log.time])
    elif choice & 2:
        dbc.write_bytes(path.read_bytes())
        can_signals.read_dbc(dbc)
    elif path.suffix == ".log":
        assert can_logs.read_candump(path), "no frames and no error"
    else:
        assert list(can_logs.frames_of(path)), "no frames and no error"


def fuzz(folder: Path, kinds: tuple[str, ...], read: Callable[[Path, int], None]) -> None:
    """Run libFuzzer; the first byte chooses the format and the reader."""

    def one(data: bytes) -> None:
        if not data:
            return
        path = folder / f"log{kinds[data[0] % len(kinds)]}"
        path.write_bytes(data[1:])
        try:
            read(path, data[0] // len(kinds))
        except Error as error:
            assert "\n" not in str(error), f"not one line: {error}"

    atheris.Setup([sys.argv[0], *sys.argv[3:]], one)
    atheris.Fuzz()


def make_seeds(folder: Path, what: str) -> None:
    """Write small logs of the binary formats, each after the byte that chooses its format."""
    import can
    import pandas as pd
    from scipy.io import savemat

    folder.mkdir(parents=True)
    columns = {"angle": [1.0, 2.0, 4.0, 3.0], "torque": [1.0, 2.0, 1.0, 0.0]}
    if what == "tables":
        savemat(folder / "log.mat", columns)
        pd.DataFrame(columns).to_parquet(folder / "log.parquet", compression=None)
        kinds = TABLES
    else:
        with can.BLFWriter(folder / "log.blf") as writer:
            for i in range(4):
                message = can.Message(timestamp=i, arbitration_id=256, data=bytes([i] * 8))
                message.is_extended_id = False
                writer.on_message_received(message)
        kinds = BUSES
    for path in list(folder.iterdir()):
        head = bytes([kinds.index(path.suffix) + 20 * len(kinds)])
        path.write_bytes(head + path.read_bytes())


def main() -> None:
    warnings.simplefilter("ignore")
    folder = Path(sys.argv[2])
    if sys.argv[1] == "seeds":
        make_seeds(folder, sys.argv[3])
    elif sys.argv[1] == "tables":
        fuzz(folder, TABLES, read_table)
    else:
        fuzz(folder, BUSES, read_bus)


if __name__ == "__main__":
    main()
