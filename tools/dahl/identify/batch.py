# SPDX-License-Identifier: MIT
"""Identify each log of a folder separately, in parallel, and store the results.

joblib runs the logs on the cores of this machine or on a Dask cluster. Each result is stored at
once, so that an interrupted run can be continued. A broken log is one line in the table.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from dahl.errors import Error, InputError, RunError
from dahl.identify import estimate, report
from dahl.identify.estimate import Options
from dahl.io import can_logs, readers
from dahl.io.files import one_line, read_json, write_atomic
from dahl.io.readers import Source
from dahl.version import __version__

ENDINGS = {".csv", ".tsv", ".txt", ".json", ".mat", ".npz", ".parquet"} | {*can_logs.CAN_LOGS}
CLUSTER_TIMEOUT_S = 10.0
COLUMNS = ("sigma0", "Fc", "r2", "r2_coulomb", "reversals", "verdict")


def logs_in(folder: Path) -> list[Path]:
    """Return the logs in a folder by their endings. Raises dahl.Error for a folder without logs."""
    if not folder.is_dir():
        raise InputError(f"--each {folder}: no such folder")
    found = sorted(path for path in folder.resolve().iterdir() if path.suffix.lower() in ENDINGS)
    if not found:
        raise InputError(f"--each {folder}: no logs in it ({', '.join(sorted(ENDINGS))})")
    return found


def identify_file(path: Path, source: Source, options: Options) -> tuple[Path, dict[str, Any]]:
    """Return the path and the numbers of a log, or {"error": reason} if it cannot be used."""
    try:
        return path, report.numbers(estimate.identify([readers.read(path, source)], options))
    except RunError:  # such as a missing library: not a fault of the log
        raise
    except Error as error:
        return path, {"error": str(error)}


def digest(path: Path) -> str:
    """Return a hash of a file; "" if it cannot be read, which identify_file() reports."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""


@cache
def method_version() -> str:
    """Return a hash of the code that turns a log into numbers: a change makes results invalid."""
    rooms = (Path(estimate.__file__).parent, Path(readers.__file__).parent)
    sources = [path for room in rooms for path in sorted(room.glob("*.py"))]
    return __version__ + "".join(map(digest, sources))


class Store:
    """Numbers of logs as JSON in a folder, by content and path of the log, options and method."""

    def __init__(self, folder: Path, source: Source, options: Options) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        dbc = source.dbc and source.dbc.resolve()
        self.folder = folder
        self.source, self.options = replace(source, dbc=dbc), options
        self.method = (digest(dbc) if dbc else "", method_version())

    def place(self, path: Path) -> Path:
        """Return the file of the numbers of a log with its content of this moment."""
        key = (digest(path), path, self.source, self.options, self.method)
        return self.folder / f"{hashlib.sha256(repr(key).encode()).hexdigest()}.json"


def run(
    paths: Sequence[Path], store: Store, jobs: int, dask: str | None
) -> Iterator[tuple[Path, dict[str, Any], bool]]:
    """Yield each log with its numbers and whether they were stored before, as they are ready."""
    import joblib

    left = {}
    for path in paths:
        place = store.place(path)
        try:
            yield path, read_json(place), True
        except Error:  # not there, or damaged
            left[path] = place
    with _cluster(dask):
        parallel = joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")
        call = joblib.delayed(identify_file)
        for path, numbers in parallel(call(one, store.source, store.options) for one in left):
            with contextlib.suppress(Error):  # such as a full disk
                write_atomic(left[path], json.dumps(numbers))
            yield path, numbers, False


@contextlib.contextmanager
def _cluster(address: str | None) -> Iterator[None]:
    """Let joblib run processes on this machine, or on the Dask cluster at `address`."""
    if address is None:
        yield
        return
    import joblib
    from dask.distributed import Client

    try:
        client = Client(address, timeout=CLUSTER_TIMEOUT_S)  # type: ignore[no-untyped-call]  # dask is typed in parts
    except (OSError, ValueError) as error:
        words = one_line(error, 120)
        raise RunError(f"--dask {address}: no cluster answers ({words})") from None
    with client, joblib.parallel_config(backend="dask"):
        yield


def write_table(path: Path, rows: dict[str, dict[str, Any]]) -> None:
    """Write a CSV with one line for each log."""
    import pandas as pd

    limits = ["sigma0_low", "sigma0_high", "Fc_low", "Fc_high"]
    columns = ["log", *COLUMNS, *limits, "sigma0_unit", "Fc_unit", "error"]
    lines = []
    for name, row in sorted(rows.items()):
        ends = [*row["ci95"]["sigma0"], *row["ci95"]["Fc"]] if "ci95" in row else []
        units = {f"{key}_unit": row.get("units", {}).get(key) for key in ("sigma0", "Fc")}
        lines.append({**row, **dict(zip(limits, ends, strict=False)), **units, "log": name})
    write_atomic(path, pd.DataFrame(lines, columns=columns, dtype=object).to_csv(index=False))
