# SPDX-License-Identifier: MIT
"""Recorded logs: tables of numbers (CSV, TSV) and frames of a bus. Whatever is wrong is named by
file, line and column.
"""

from __future__ import annotations

import contextlib
import csv
import difflib
import gc
import io
import math
import re
import sys
import tempfile
import traceback
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dahl.errors import Error

if TYPE_CHECKING:
    import can


def read_table(
    path: Path | str, columns: Sequence[str], time: str | None = None
) -> dict[str, np.ndarray]:
    """Columns of a table with a header line: {name: array of shape (rows,), float64, in the file's
    own units}.

    Columns are separated by tab, semicolon or comma, whichever the header has. `time` names a
    column that must not go backward. Raises dahl.Error for a file that is absent, empty or no text,
    for a column that is not there (with the nearest name) or there twice, and for a row that is
    shorter or longer than the header or holds something that is not a finite number.
    """
    path = Path(path)
    lines = _text_of(path).splitlines()
    if not lines or not lines[0].strip():
        raise Error(f"{path}: empty; a first line with column names was expected")
    rows = _rows_of(path, lines)
    header = [name.strip() for name in next(rows)[1]]
    wanted = list(dict.fromkeys([*columns, *([time] if time else [])]))
    places = {name: _place(path, header, name) for name in wanted}
    values: dict[str, list[float]] = {name: [] for name in wanted}
    for place, row in rows:
        if any(field.strip() for field in row):
            _take_row(place, row, header, places, values)
            _check_time(place, time, values)
    if not values[wanted[0]]:
        raise Error(f"{path}:1: no rows after the column names")
    return {name: np.array(column) for name, column in values.items()}


def _text_of(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise Error(f"{path}: no such file") from None
    except UnicodeDecodeError as error:
        raise Error(f"{path}: not a text file (byte {error.start})") from None
    except OSError as error:
        raise Error(f"{path}: {error.strerror}") from None


def _rows_of(path: Path, lines: list[str]) -> Iterator[tuple[str, list[str]]]:
    """Each row with its place. Raises dahl.Error for a field beyond what csv takes."""
    rows = csv.reader(lines, delimiter=_delimiter(lines[0]))
    try:
        for row in rows:
            yield f"{path}:{rows.line_num}", row
    except csv.Error as error:
        raise Error(f"{path}:{rows.line_num}: {error}") from None


def _delimiter(header: str) -> str:
    return max("\t;,", key=header.count)


def _place(path: Path, header: list[str], name: str) -> int:
    """Index of a column, or an error with the name that was perhaps meant."""
    if header.count(name) > 1:
        raise Error(f"{path}:1: {header.count(name)} columns '{name}': which one is meant?")
    if name in header:
        return header.index(name)
    raise Error(f"{path}:1: no column '{name}'{meant(name, header)}")


def meant(name: str, known: Sequence[str]) -> str:
    """The rest of a complaint about an unknown name: the nearest known one, and all of them."""
    lower = {word.lower(): word for word in known}
    near = difflib.get_close_matches(name.lower(), lower, n=1, cutoff=0.4)
    hint = f"; did you mean '{lower[near[0]]}'?" if near else ""
    shown = ", ".join(known[:MANY]) + (f", and {len(known) - MANY} more" * (len(known) > MANY))
    return f"{hint} (there are: {shown})"


def _take_row(
    place: str,
    row: list[str],
    header: list[str],
    places: dict[str, int],
    values: dict[str, list[float]],
) -> None:
    if len(row) < len(header):
        raise Error(
            f"{place}: column '{header[len(row)]}': missing,"
            f" the line ends after {len(row)} of {len(header)} columns"
        )
    if len(row) > len(header):  # such as that of decimal commas between commas
        raise Error(f"{place}: the row has {len(row)} fields, the header {len(header)}")
    for name, index in places.items():
        values[name].append(_number(f"{place}: column '{name}'", row[index]))


def _number(place: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise Error(f"{place}: '{text.strip()[:60]}' is not a number") from None
    if not math.isfinite(value):
        raise Error(f"{place}: '{text.strip()[:60]}' is not a finite number")
    return value


def _check_time(place: str, time: str | None, values: dict[str, list[float]]) -> None:
    if time and len(values[time]) > 1 and values[time][-1] < values[time][-2]:
        raise Error(
            f"{place}: column '{time}': {values[time][-1]:g} after {values[time][-2]:g},"
            " time goes backward"
        )


MANY = 30  # names that a complaint lists
CAN_LOGS = (".asc", ".blf", ".log", ".mf4", ".trc")  # that python-can writes and reads
CANDUMP_LINE = re.compile(
    r"\(\d+\.\d+\) +\S+ +([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#"
    r"(R\d?|#[0-9A-Fa-f])?([0-9A-Fa-f]{2})*( [RT])?\s*"
)


class _Counted(io.StringIO):
    """Lines of a text, each of the right form or an error, with the number of the last one; a file
    for python-can.
    """

    number = 0

    def __next__(self) -> str:  # type: ignore[override]  # of bytes, says typeshed of IOBase
        line = super().__next__()
        self.number += 1
        if line.strip() and not CANDUMP_LINE.fullmatch(line):
            raise ValueError(f"'{line.strip()[:60]}'")
        return line


def read_candump(path: Path | str) -> list[can.Message]:
    """All frames of a candump log (`(seconds) bus id#data`), by python-can. Raises dahl.Error
    naming file and line.
    """
    import can

    text = _Counted(_text_of(Path(path)))
    try:
        messages = list(can.CanutilsLogReader(text))
    except (ValueError, IndexError, AssertionError) as error:
        raise Error(f"{path}:{text.number}: not a line of a candump log ({error})") from None
    if not messages:
        raise Error(f"{path}: no frames in it")
    return messages


def _forget_readers(error: BaseException) -> None:
    """A reader that was left half made still holds its copy, and complains when it is collected:
    so now, and unheard.
    """
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        traceback.clear_frames(error.__traceback__)
        gc.collect()
    finally:
        sys.unraisablehook = hook


@contextlib.contextmanager
def copies_of_its_own(path: Path) -> Iterator[None]:
    """asammdf copies an MF4 that was not closed well, and leaves the copy where it cannot read it:
    so in a folder that goes.
    """
    if path.suffix.lower() != ".mf4":
        yield
        return
    import asammdf

    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        asammdf.set_global_option("temporary_folder", folder)
        try:
            yield
        except BaseException as error:
            _forget_readers(error)
            raise
        finally:
            asammdf.set_global_option("temporary_folder", None)


def frames_of(path: Path) -> Iterator[can.Message]:
    """The frames of a log, by python-can. Raises dahl.Error for a file that is not what its ending
    says, or cut off.
    """
    import can

    if path.suffix.lower() == ".log":
        yield from read_candump(path)
        return
    if path.suffix.lower() not in CAN_LOGS:
        raise Error(f"{path}: no log of frames by its ending; {', '.join(CAN_LOGS)} was expected")
    count = 0
    try:
        with copies_of_its_own(path), can.LogReader(path) as reader:
            for message in reader:
                count += 1
                yield message
            if getattr(reader, "file_size", 0) > path.stat().st_size:  # BLF says how long it is
                raise Error("the file is shorter than it says")
    except Exception as error:  # each reader of python-can has its own kinds
        words = " ".join(str(error).split())[:120] or type(error).__name__
        raise Error(f"{path}: broken or cut off after {count} frames ({words})") from None
    if count == 0:
        raise Error(f"{path}: no frames in it")
