# SPDX-License-Identifier: MIT
"""Tables of text as measuring programs write them.

Columns are separated by tabs, semicolons, commas or blanks, with decimal points or commas. Names
stand in the line above the first row, with a line of units below them or not, after a preamble or
comments of any length. The encoding is UTF-8, UTF-16 or that of Windows.
"""

from __future__ import annotations

import csv
import io
import re
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dahl import Error
from dahl.identify import units

if TYPE_CHECKING:
    import pandas

HEAD_BYTES = 65536  # in which names and the first rows must stand
SEPARATORS = ("\t", ";", ",", r"\s+")
COMMENT = "#%"
DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")
MOMENT = re.compile(r"\d{4}-\d\d-\d\d.*|\d+:\d\d:\d\d.*")  # a date or a time of day
CONTROL = re.compile("[\x01-\x08\x0e-\x1f]")  # characters that no text of Windows has
OTHER_FORMATS = {  # by the first bytes
    b"PK\x03\x04": "a workbook (XLSX, ODS): save its table as CSV",
    b"\xd0\xcf\x11\xe0": "a workbook (XLS): save its table as CSV",
    b"TDSm": "a TDMS file: export its channels as CSV, MAT or Parquet",
    b"\x89HDF": "an HDF5 file: save its columns as CSV, MAT (-v7) or Parquet",
}


@dataclass(frozen=True)
class Form:
    """How a table is written."""

    encoding: str
    separator: str
    decimal: str
    names: list[str]
    first: int  # line of the first row, from 1 on


def read(path: Path) -> tuple[pandas.DataFrame, int]:
    """The table, and the number of the line of its first row. Raises dahl.Error."""
    import pandas as pd

    form = form_of(path)
    with warnings.catch_warnings(), path.open(encoding=form.encoding, newline="") as file:
        warnings.simplefilter("error", pd.errors.ParserWarning)
        for _ in range(form.first - 1):
            file.readline()
        try:
            frame = pd.read_csv(
                file,
                sep=form.separator,
                decimal=form.decimal,
                header=None,
                names=range(len(form.names)),
                skipinitialspace=True,
                low_memory=False,
                index_col=False,
            )
        except pd.errors.ParserWarning:
            raise Error(f"{path}:{form.first}: fewer names than a row has columns") from None
    frame.columns = form.names
    return frame, form.first


def form_of(path: Path) -> Form:
    """How a table is written, from its first lines. Raises dahl.Error."""
    encoding, text = _head(path)
    if not text.strip():
        raise Error(f"{path}: empty; a line of column names was expected")
    for separator in SEPARATORS:
        rows = _rows(text, separator)
        first = next((k for k, (_, row) in enumerate(rows) if _is_data(row)), None)
        if first is None:
            continue
        line, row = rows[first]
        names = _names([above for _, above in rows[:first]], len(row))
        return Form(encoding, separator, _decimal(rows[first:], separator), names, line)
    raise Error(f"{path}:1: no rows of numbers after the column names")


def _rows(text: str, separator: str) -> list[tuple[int, list[str]]]:
    """The rows of a text with their first lines, from 1 on; empty rows are left out."""
    if separator == r"\s+":
        split = [(k, line.split()) for k, line in enumerate(text.splitlines(), 1)]
        return [(k, row) for k, row in split if row]
    found, line = [], 1
    reader = csv.reader(io.StringIO(text), delimiter=separator, skipinitialspace=True)
    for row in reader:
        cells = [cell.strip() for cell in row]
        found += [(line, cells)] if any(cells) else []
        line = reader.line_num + 1
    return found


def _is_data(row: list[str]) -> bool:
    """Whether a row has two numbers or more, or a moment and a number, and few words."""
    known = [is_number(cell) or bool(MOMENT.fullmatch(cell)) for cell in row if cell]
    return sum(known) >= 2 and 2 * sum(known) >= len(known)


def _names(above: list[list[str]], columns: int) -> list[str]:
    """The names of the columns from the rows above the first one; numbers if there are none."""
    fitting = [row for row in above[-2:] if len(_without_mark(row)) == columns]
    if not fitting or _without_mark(above[-1]) != _without_mark(fitting[-1]):
        return [str(k + 1) for k in range(columns)]
    rows = [_without_mark(row) for row in fitting]
    if len(rows) == 2 and _is_units(rows[1]):
        pairs = zip(rows[0], (cell.strip("[]()") for cell in rows[1]), strict=True)
        return [f"{name} [{unit}]" if unit else name for name, unit in pairs]
    return rows[-1]


def _without_mark(row: list[str]) -> list[str]:
    """A row without the mark of a comment before it."""
    cells = [row[0].lstrip(COMMENT).strip(), *row[1:]]
    return cells[1:] if not cells[0] and row[0] else cells


def _is_units(row: list[str]) -> bool:
    words = [cell.strip("[]()") for cell in row if cell]
    return bool(words) and sum(map(units.is_unit, words)) * 2 >= len(words)


def _decimal(rows: list[tuple[int, list[str]]], separator: str) -> str:
    if separator == ",":
        return "."
    cells = (cell for _, row in rows for cell in row)
    return "," if any(DECIMAL_COMMA.fullmatch(cell) for cell in cells) else "."


def _head(path: Path) -> tuple[str, str]:
    """The encoding and the first complete lines of a file. Raises dahl.Error."""
    with path.open("rb") as file:
        raw = file.read(HEAD_BYTES)
    for start, words in OTHER_FORMATS.items():
        if raw.startswith(start):
            raise Error(f"{path}: {words}")
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "utf-16", raw[: len(raw) // 2 * 2].decode("utf-16", errors="ignore")
    whole = raw if len(raw) < HEAD_BYTES else raw[: raw.rfind(b"\n") + 1] or raw
    if b"\0" in whole:
        raise Error(f"{path}: not a text file (byte {whole.index(0)})")
    try:
        return "utf-8-sig", whole.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        text = whole.decode("cp1252", errors="replace")
        if "\ufffd" not in text and not CONTROL.search(text):
            return "cp1252", text
        raise Error(f"{path}: not a text file (byte {error.start})") from None


def is_number(text: str) -> bool:
    """Whether a cell holds a number, with a decimal point or comma."""
    try:
        float(text)
    except ValueError:
        return bool(DECIMAL_COMMA.fullmatch(text))
    return True
