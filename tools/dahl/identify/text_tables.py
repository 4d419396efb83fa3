# SPDX-License-Identifier: MIT
"""Tables of text as programs for measuring write them: columns between tabs, semicolons, commas or
blanks, numbers with a decimal point or comma, names in the first line or none, comments before
them (# or %), a line of units below, in UTF-8 or the letters of Windows.
"""

from __future__ import annotations

import contextlib
import csv
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dahl import Error

if TYPE_CHECKING:
    import pandas

HEAD = 65536  # bytes by which the form of a table is told
BLANKS = r"\s+"
COMMENT = "#%"
DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")
CONTROL = re.compile("[\x01-\x08\x0e-\x1f]")  # which no text of Windows has
LINE_END = re.compile("\r\n|\r|\n")  # and no others: as pandas reads

Line = tuple[int, str]  # number, from 0 on, and text


@dataclass(frozen=True)
class Form:
    """How a table is written."""

    encoding: str
    separator: str
    decimal: str
    names: list[str] | None  # None: pandas takes them from the first line that is not skipped
    skipped: list[int]  # lines, from 0 on
    first: int  # line of the first row, from 1 on


def read(path: Path) -> tuple[pandas.DataFrame, int]:
    """The table, and the number of the line of its first row. Raises dahl.Error."""
    import pandas as pd

    form = form_of(path)
    with warnings.catch_warnings():
        warnings.simplefilter("error", pd.errors.ParserWarning)
        try:
            frame = pd.read_csv(
                path,
                sep=form.separator,
                decimal=form.decimal,
                header=None if form.names else 0,
                skiprows=form.skipped,
                skipinitialspace=True,
                low_memory=False,
                encoding=form.encoding,
                index_col=False,
            )
        except pd.errors.ParserWarning:
            raise Error(f"{path}:1: fewer names than a row has columns") from None
    frame.columns = [str(name).strip() for name in form.names or frame.columns]
    if frame.empty:
        raise Error(f"{path}:1: no rows after the column names")
    return frame, form.first


def form_of(path: Path) -> Form:
    """How a table is written, by its first lines. Raises dahl.Error."""
    encoding, text = _head(path)
    lines = [(i, line) for i, line in enumerate(LINE_END.split(text)) if line.strip()]
    comments = 0
    while comments < len(lines) and lines[comments][1].lstrip()[0] in COMMENT:
        comments += 1
    skipped, rows = [i for i, _ in lines[:comments]], lines[comments:]
    above = lines[comments - 1][1].lstrip().lstrip(COMMENT) if comments else ""
    if not rows:
        raise Error(f"{path}: empty; a first line with column names was expected")
    separator = _separator_of_numbers(rows[0][1])
    if separator:
        names = cells(above, separator)
        if len(names) != len(cells(rows[0][1], separator)):  # a comment, and no names
            names = [str(i + 1) for i in range(len(cells(rows[0][1], separator)))]
        return Form(encoding, separator, _decimal(rows, separator), names, skipped, rows[0][0] + 1)
    named, below = _names_and_rows(rows)
    names_line = "\n".join(line for _, line in named)
    separator = _separator_of_names(names_line)
    decimal = _decimal(below, separator)
    first = below[0][0] + 1 if below else named[-1][0] + 2
    units = _units(cells(names_line, separator), below, separator)
    if units is None:
        return Form(encoding, separator, decimal, None, skipped, first)
    skipped += [*range(named[0][0], named[-1][0] + 1), below[0][0]]
    return Form(encoding, separator, decimal, units, skipped, below[1][0] + 1)


def _names_and_rows(rows: Sequence[Line]) -> tuple[Sequence[Line], Sequence[Line]]:
    """The lines of the names, of which a quoted one may go over several, and the lines below."""
    quotes = np.cumsum([line.count('"') for _, line in rows])
    closed = int(np.argmin(quotes % 2)) + 1  # 1 too where a quote is never closed, as of inches
    return rows[:closed], rows[closed:]


def _head(path: Path) -> tuple[str, str]:
    """The encoding and the first whole lines of a file. Raises dahl.Error."""
    with path.open("rb") as file:
        raw = file.read(HEAD)
    whole = raw if len(raw) < HEAD else raw[: raw.rfind(b"\n") + 1] or raw
    if b"\0" in whole:
        raise Error(f"{path}: not a text file (byte {whole.index(0)})")
    try:
        return "utf-8-sig", whole.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        with contextlib.suppress(UnicodeDecodeError):
            text = whole.decode("cp1252")
            if not CONTROL.search(text):
                return "cp1252", text
        raise Error(f"{path}: not a text file (byte {error.start})") from None


def cells(line: str, separator: str) -> list[str]:
    """What stands between the separators of a line."""
    if separator == BLANKS:
        return line.split()
    found = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    return [cell.strip() for cell in found]


def _separator_of_numbers(line: str) -> str:
    """By which a line falls into numbers; "" where it does not."""
    for separator in ("\t", ";", ",", BLANKS):
        if separator == BLANKS or separator in line:
            found = cells(line, separator)
            if found and all(is_number(cell, comma=separator != ",") for cell in found):
                return separator
    return ""


def _separator_of_names(line: str) -> str:
    return max("\t;,", key=line.count) if re.search("[\t;,]", line) else BLANKS


def _decimal(rows: Sequence[Line], separator: str) -> str:
    """The sign before the decimals: a comma where some number has one."""
    if separator == ",":
        return "."
    some = (cell for _, line in rows for cell in cells(line, separator))
    return "," if any(DECIMAL_COMMA.fullmatch(cell) for cell in some) else "."


def _units(names: Sequence[str], below: Sequence[Line], separator: str) -> list[str] | None:
    """The names with the units of the line below, as columns are called; None where there are no
    units but numbers below.
    """
    if len(below) < 2 or not _separator_of_numbers(below[1][1]):
        return None
    units = [unit.strip("[]()") for unit in cells(below[0][1], separator)]
    words = [unit for unit in units if unit and not is_number(unit)]
    if len(units) != len(names) or not words or len(words) < sum(map(bool, units)):
        return None
    pairs = zip(names, units, strict=True)
    return [f"{name} [{unit}]" if unit else name for name, unit in pairs]


def is_number(text: str, comma: bool = True) -> bool:
    """Whether a cell holds a number, with a decimal comma too."""
    try:
        float(text)
    except ValueError:
        return comma and bool(DECIMAL_COMMA.fullmatch(text))
    return True
