# SPDX-License-Identifier: MIT
"""Each log of a folder by itself, side by side, by joblib: on this machine's cores, or on a Dask
cluster. A result is kept as soon as it is there, so that a run can be taken up again; a broken log
is one line and stops nothing.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from dahl import Error, RunError, __version__
from dahl.identify import output, pipeline, readers
from dahl.identify.pipeline import Options
from dahl.identify.readers import Source

ENDINGS = {".csv", ".tsv", ".txt", ".json", ".mat", ".parquet"} | readers.CAN_LOGS
PATIENCE = 10.0  # s for a cluster to answer
SHOWN = ("sigma0", "Fc", "r2", "r2_coulomb", "reversals", "verdict")


def logs_in(folder: Path) -> list[Path]:
    """The files of a folder that may be logs, by their endings. Raises dahl.Error."""
    if not folder.is_dir():
        raise Error(f"--each {folder}: no such folder")
    found = sorted(path for path in folder.iterdir() if path.suffix.lower() in ENDINGS)
    if not found:
        raise Error(f"--each {folder}: no logs in it ({', '.join(sorted(ENDINGS))})")
    return found


def one(path: Path, source: Source, options: Options) -> dict[str, Any]:
    """The numbers of one log, or {"error": why not}; raises nothing that is the log's fault."""
    try:
        return output.numbers(pipeline.identify([readers.read(path, source)], options))
    except Error as error:
        return {"error": str(error)}


def key_of(path: Path, source: Source, options: Options) -> str:
    """What a result depends on: the file as it is, and what was asked for."""
    state = path.stat()
    asked = f"{__version__} {source} {options} {state.st_size} {state.st_mtime_ns}"
    return hashlib.sha256(asked.encode()).hexdigest()


class Kept:
    """Results in a folder, one JSON each."""

    def __init__(self, folder: Path, source: Source, options: Options) -> None:
        self.folder, self.source, self.options = folder, source, options
        folder.mkdir(parents=True, exist_ok=True)

    def place(self, path: Path) -> Path:
        return self.folder / f"{path.name}.json"

    def get(self, path: Path) -> dict[str, Any] | None:
        """The result of an earlier run, if it is still true."""
        try:
            known = json.loads(self.place(path).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        same = known.pop("key", None) == key_of(path, self.source, self.options)
        return known if same else None

    def put(self, path: Path, numbers: dict[str, Any]) -> None:
        """Keep a result; the file is whole at any moment."""
        known = {"key": key_of(path, self.source, self.options), **numbers}
        output.keep(self.place(path), json.dumps(known, indent=2) + "\n")


def _indexed(
    index: int, path: Path, source: Source, options: Options
) -> tuple[int, dict[str, Any]]:
    return index, one(path, source, options)


def run(
    paths: Sequence[Path], kept: Kept, jobs: int, dask: str | None
) -> Iterator[tuple[Path, dict[str, Any], bool]]:
    """(log, numbers, whether from an earlier run) for each, in the order in which they come."""
    import joblib

    todo = []
    for path in paths:
        known = kept.get(path)
        if known is None:
            todo.append(path)
        else:
            yield path, known, True
    with _cluster(dask):
        work = joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")
        calls = (
            joblib.delayed(_indexed)(index, path.resolve(), kept.source, kept.options)
            for index, path in enumerate(todo)
        )
        for index, numbers in work(calls):
            kept.put(todo[index], numbers)
            yield todo[index], numbers, False


@contextlib.contextmanager
def _cluster(address: str | None) -> Iterator[None]:
    """joblib's backend: processes here, or the Dask cluster at `address`."""
    if address is None:
        yield
        return
    import joblib
    from dask.distributed import Client

    try:
        client = Client(address, timeout=PATIENCE)  # type: ignore[no-untyped-call]  # dask has types in parts
    except (OSError, ValueError) as error:
        words = " ".join(str(error).split())[:120]
        raise RunError(f"--dask {address}: no cluster answers ({words})") from None
    with client, joblib.parallel_config(backend="dask"):
        yield


def write_table(path: Path, rows: dict[str, dict[str, Any]]) -> None:
    """One line per log."""
    import csv

    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    limits = ("sigma0_low", "sigma0_high", "Fc_low", "Fc_high")
    writer.writerow(["log", *SHOWN, *limits, "error"])
    for name, row in sorted(rows.items()):
        ends = [*row["ci95"]["sigma0"], *row["ci95"]["Fc"]] if "ci95" in row else [""] * 4
        writer.writerow([name, *(row.get(key, "") for key in SHOWN), *ends, row.get("error", "")])
    output.keep(path, text.getvalue())
