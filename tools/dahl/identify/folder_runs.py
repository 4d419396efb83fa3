# SPDX-License-Identifier: MIT
"""Each log of a folder by itself, side by side, by joblib: on this machine's cores, or on a Dask
cluster. A result is kept by joblib as soon as it is there, so that a run can be taken up again; a
broken log is one line and stops nothing.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from dahl import Error, RunError, __version__, logs
from dahl.files import keep
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
    except RunError:  # no library, no memory: not the log's fault, and nothing to keep
        raise
    except Error as error:
        return {"error": str(error)}


def digest(path: Path) -> str:
    """What a file holds, in short; "" where it cannot be read, which one() then tells."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""


@cache
def method() -> str:
    """The version of the method: of everything here that turns a log into numbers."""
    package = Path(readers.__file__).parent
    sources = [Path(logs.__file__), *sorted(package.glob("*.py"))]
    return __version__ + "".join(map(digest, sources))


def known_by(key: tuple[str, ...], path: Path, source: Source, options: Options) -> dict[str, Any]:
    """one(), for joblib to keep: `key` is the content of the log and of the DBC, and the method."""
    del key
    return one(path, source, options)


def is_result(numbers: Any) -> bool:
    """Whether what was kept has the shape of what one() gives."""
    if not isinstance(numbers, dict):
        return False
    ends = numbers.get("ci95")
    whole = (
        isinstance(ends, dict)
        and isinstance(numbers.get("units"), dict)
        and all(
            isinstance(ends.get(name), list) and len(ends[name]) == 2 for name in ("sigma0", "Fc")
        )
    )
    return isinstance(numbers.get("error"), str) or (whole and numbers.keys() >= set(SHOWN))


class Kept:
    """Results in a folder, by joblib.Memory: each with the content, the path and the options that
    it belongs to, so that nothing else is ever taken for it.
    """

    def __init__(self, folder: Path, source: Source, options: Options) -> None:
        import joblib

        dbc = source.dbc and source.dbc.resolve()
        self.source, self.options = replace(source, dbc=dbc), options
        self.rest = (digest(dbc) if dbc else "", method())
        self.call = joblib.Memory(folder, verbose=0).cache(known_by)

    def asked(self, path: Path) -> tuple[Any, ...]:
        """The arguments of known_by() for a log."""
        path = path.resolve()
        return (digest(path), *self.rest), path, self.source, self.options

    def get(self, path: Path) -> dict[str, Any] | None:
        """The result of an earlier run, if it is still true and whole."""
        asked = self.asked(path)
        if not self.call.check_call_in_cache(*asked):
            return None
        kept = self.call.call_and_shelve(*asked)
        try:
            numbers: dict[str, Any] = kept.get()
        except Exception:  # what a damaged pickle raises is of any kind
            numbers = {}
        if is_result(numbers):
            return numbers
        kept.clear()
        return None


def _indexed(index: int, kept: Kept, path: Path) -> tuple[int, dict[str, Any]]:
    from joblib.memory import CacheWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CacheWarning)  # what cannot be kept is done again
        return index, kept.call(*kept.asked(path))


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
        calls = (joblib.delayed(_indexed)(index, kept, path) for index, path in enumerate(todo))
        for index, numbers in work(calls):
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
    writer.writerow(["log", *SHOWN, *limits, "sigma0_unit", "Fc_unit", "error"])
    for name, row in sorted(rows.items()):
        ends = [*row["ci95"]["sigma0"], *row["ci95"]["Fc"]] if "ci95" in row else [""] * 4
        units = [row.get("units", {}).get(key, "") for key in ("sigma0", "Fc")]
        found = (row.get(key, "") for key in SHOWN)
        writer.writerow([name, *found, *ends, *units, row.get("error", "")])
    keep(path, text.getvalue())
