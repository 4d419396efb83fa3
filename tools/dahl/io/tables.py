# SPDX-License-Identifier: MIT
"""Open tables: text, JSON, MAT, NPZ and Parquet. An error names file, line or row."""

from __future__ import annotations

import contextlib
import faulthandler
import os
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dahl.errors import Error, InputError
from dahl.io import files, text_tables
from dahl.io.files import one_line
from dahl.io.text_tables import Table

if TYPE_CHECKING:
    import pandas


def open_table(path: Path, min_columns: int = 2) -> Table:
    """Open a table with at least so many columns of numbers. Raises dahl.Error."""
    kinds = {".json": _from_json, ".mat": _from_mat, ".npz": _from_npz, ".parquet": _from_parquet}
    kind = kinds.get(path.suffix.lower())
    try:
        if kind is None:
            return text_tables.read(path, min_columns)
        return Table(kind(path), f"{path}", partial(row_of, path))
    except Error:
        raise
    except Exception as error:  # each library raises other kinds for a damaged file
        form = path.suffix or "a table"
        raise InputError(f"{path}: cannot be read as {form}: {one_line(error)}") from None


def row_of(path: Path, row: int) -> str:
    return f"{path}: row {row + 1}"


def _from_json(path: Path) -> pandas.DataFrame:
    """Read a list of rows, an object of columns, or an object that holds one of them."""
    import pandas as pd

    rows = _rows_in(files.read_json(path))
    if rows is None:
        raise InputError(f"{path}: no list of rows and no columns of equal length in it")
    frame = pd.DataFrame(rows)
    if all(isinstance(name, int) for name in frame.columns):
        frame.columns = [str(i + 1) for i in range(frame.shape[1])]
    return frame


def _rows_in(content: Any) -> Any:
    """Return the first list of rows, or object of columns of one length, in nested objects."""
    if isinstance(content, list):
        return content if content and isinstance(content[0], (dict, list)) else None
    if not isinstance(content, dict):
        return None
    columns = {
        name: value
        for name, value in content.items()
        if isinstance(value, list) and value and isinstance(value[0], (int, float))
    }
    if len(columns) > 1 and len(set(map(len, columns.values()))) == 1:
        return columns
    found = map(_rows_in, content.values())
    return next((rows for rows in found if rows is not None), None)


def _from_mat(path: Path) -> pandas.DataFrame:
    """Read the vectors of a MAT file."""
    from scipy.io import loadmat

    if _crashes(lambda: loadmat(path)):
        raise InputError(f"{path}: broken: reading it crashes")
    try:
        content = loadmat(path, squeeze_me=True, struct_as_record=False)
    except NotImplementedError:
        raise InputError(f"{path}: MATLAB 7.3 (HDF5); save it with -v7") from None
    return _longest(path, {k: v for k, v in content.items() if not k.startswith("__")})


def _from_npz(path: Path) -> pandas.DataFrame:
    """Read the vectors of an archive of numpy."""
    columns = {}
    with np.load(path, allow_pickle=False) as content:
        for name in content.files:
            with contextlib.suppress(ValueError):  # objects of Python are no vectors
                columns[name] = content[name].squeeze()
    return _longest(path, columns)


def _longest(path: Path, content: dict[str, Any]) -> pandas.DataFrame:
    """Return the longest vectors of one length, two at least: a log has an angle and a torque."""
    import pandas as pd

    columns = dict(_vectors("", content))
    lengths = Counter(map(len, columns.values()))
    shared = [length for length, number in lengths.items() if number > 1]
    if not shared:
        raise InputError(f"{path}: no two vectors of one length in it")
    return pd.DataFrame({k: v for k, v in columns.items() if len(v) == max(shared)})


def _crashes(read_file: Callable[[], object]) -> bool:
    """Try in a child process: scipy crashes on a damaged type (scipy pull request 25349)."""
    child = os.fork()
    if child == 0:
        faulthandler.disable()
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        with contextlib.suppress(Exception):  # the second reading reports these
            read_file()
        os._exit(0)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])


def _vectors(prefix: str, content: dict[str, Any]) -> Iterator[tuple[str, np.ndarray]]:
    """Yield vectors by name: fields as `structure.field`, columns of matrices by number."""
    for name, value in content.items():
        if hasattr(value, "_fieldnames"):
            yield from _vectors(f"{prefix}{name}.", vars(value))
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiu":
            if value.ndim == 1:
                yield f"{prefix}{name}", value
            for number, column in enumerate(value.T if value.ndim == 2 else (), 1):
                yield f"{prefix}{name}.{number}", column


def _from_parquet(path: Path) -> pandas.DataFrame:
    """Read the columns, and the index if it has a name."""
    import pandas as pd

    frame = pd.read_parquet(path)
    return frame.reset_index(allow_duplicates=True) if any(frame.index.names) else frame
