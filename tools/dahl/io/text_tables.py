# SPDX-License-Identifier: MIT
"""Read text tables as measuring programs write them.

Tabs, semicolons, commas or blanks separate the columns. Numbers have decimal points or commas.
Names stand above the first row, after a preamble or comments; a line of units may follow them. A
line of numbers alone is a row, never names. The encoding is UTF-8, UTF-16 or Windows-1252. The
first 64 KiB show how a table is written.
"""

from __future__ import annotations

import codecs
import csv
import io
import re
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice, zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

from dahl.errors import InputError
from dahl.io import units

if TYPE_CHECKING:
    import pandas

HEAD_BYTES = 65536  # must hold the names and some rows
BLANKS = r"\s+"
SEPARATORS = ("\t", ";", ",", BLANKS)  # the first one wins if several fit equally
MARKS = ("#", "%")  # start a comment
DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")
MOMENT = re.compile(r"\d{4}-\d\d-\d\d[\d:., TZ+-]*|\d+:\d\d:\d\d([.,]\d+)?")
BINARY = re.compile("[\x01-\x08\x0e-\x1f\ufffd]")  # characters that no Windows text has
OTHER_FORMATS = {  # by the first bytes
    b"PK\x03\x04": "a workbook (XLSX, ODS) or another ZIP: save its table as CSV",
    b"\xd0\xcf\x11\xe0": "a workbook (XLS): save its table as CSV",
    b"TDSm": "a TDMS file: export its channels as CSV, MAT or Parquet",
    b"\x89HDF": "an HDF5 file: save its columns as CSV, MAT (-v7) or Parquet",
}
Row = tuple[int, list[str]]  # number of its first line, from 1 on, and its cells


@dataclass(frozen=True)
class Table:
    """A table, and the places that errors name."""

    frame: pandas.DataFrame
    head: str  # place of the names
    place: Callable[[int], str]  # place of a row, from 0 on

    @property
    def names(self) -> list[str]:
        return [str(name) for name in self.frame.columns]


@dataclass(frozen=True)
class Form:
    """How a table is written."""

    encoding: str
    separator: str
    decimal: str
    mark: str | None  # starts a comment between the rows
    names: list[str]
    head: int  # line of the names, from 1 on
    first: int  # line of the first row


def read(path: Path, min_columns: int = 2) -> Table:
    """Read a table with at least `min_columns` columns of numbers. Raises dahl.Error."""
    import pandas as pd

    form = form_of(path, min_columns)
    with warnings.catch_warnings(), path.open(encoding=form.encoding) as file:
        warnings.simplefilter("error", pd.errors.ParserWarning)
        for _ in range(form.first - 1):
            file.readline()
        try:
            frame = pd.read_csv(
                file,
                sep=form.separator,
                decimal=form.decimal,
                comment=form.mark,
                header=None,
                names=range(len(form.names)),
                skipinitialspace=True,
                low_memory=False,
                index_col=False,
            )
        except (ValueError, pd.errors.ParserWarning) as error:
            raise InputError(_fault(path, form, str(error))) from None
    frame.columns = form.names
    filled = frame.notna().any(axis=1).to_numpy().nonzero()[0]
    frame = frame[: filled[-1] + 1] if len(filled) else frame  # spreadsheets add empty rows
    return Table(frame, f"{path}:{form.head}", partial(_place, path, form))


def form_of(path: Path, min_columns: int = 2) -> Form:
    """Find out how a table is written. Raises dahl.Error."""
    encoding, lines = _head(path)
    if not "".join(lines).strip():
        raise InputError(f"{path}: empty; a line of column names was expected")
    separator, rows, first = _split(path, lines, min_columns)
    above, body = rows[:first], rows[first:]
    names, head = _names(path, above, body, separator)
    has_commas = any(DECIMAL_COMMA.fullmatch(cell) for _, row in body for cell in row)
    marks = [row[0][0] for _, row in [*body, *above[::-1]] if row[0].startswith(MARKS)]
    mark = marks[0] if marks else None
    return Form(encoding, separator, "," if has_commas else ".", mark, names, head, body[0][0])


def _split(path: Path, lines: list[str], min_columns: int) -> tuple[str, list[Row], int]:
    """Return the separator that yields most numbers, the rows, and the index of the first row.

    A single column counts only if no separator yields two, since "1,2" may be one number or two.
    """
    splits = [(separator, _complete_rows(lines, separator)) for separator in SEPARATORS]
    for columns in range(2, min_columns - 1, -1):
        firsts = [_first_row(rows, columns) for _, rows in splits]
        found = [(*one, k) for one, k in zip(splits, firsts, strict=True) if k is not None]
        if found:
            return max(found, key=lambda one: _number_part(one[1][one[2] :]))
    raise InputError(
        f"{path}:1: no rows with {'two numbers' if min_columns > 1 else 'numbers'}, between tabs,"
        f" semicolons, commas or blanks, in the first {len(lines)} lines"
    )


def _head(path: Path) -> tuple[str, list[str]]:
    """Return the encoding and the first complete lines. Raises dahl.Error for other formats."""
    with path.open("rb") as file:
        raw = file.read(HEAD_BYTES)
    for start, name in OTHER_FORMATS.items():
        if raw.startswith(start):
            raise InputError(f"{path}: {name}")
    is_wide = raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    encoding, is_whole = "utf-16" if is_wide else "utf-8-sig", len(raw) < HEAD_BYTES
    if b"\0" in raw and not is_wide:
        raise InputError(f"{path}: not a text file (byte {raw.index(0)})")
    try:
        text = codecs.getincrementaldecoder(encoding)().decode(raw, final=is_whole)
    except UnicodeDecodeError as error:
        encoding, text = "cp1252", raw.decode("cp1252", errors="replace")
        if is_wide or BINARY.search(text):
            raise InputError(f"{path}: not a text file (byte {error.start})") from None
    lines = list(io.StringIO(text, newline=None))
    return encoding, lines if is_whole else lines[:-1] or lines


def _complete_rows(lines: list[str], separator: str) -> list[Row]:
    """Return the rows of lines. A quote that is never closed is an ordinary character."""
    rows = list(_rows(lines, separator))
    is_open = "".join(lines).count('"') % 2 and any("\n" in x for _, row in rows[-1:] for x in row)
    return list(_rows(lines, separator, has_quotes=False)) if is_open else rows


def _rows(lines: Iterable[str], separator: str, has_quotes: bool = True) -> Iterator[Row]:
    """Yield the rows that are not blank, as pandas counts them."""
    if separator == BLANKS:
        lines, separator = (line.replace("\t", " ") for line in lines), " "
    reader = csv.reader(
        lines,
        delimiter=separator,
        skipinitialspace=True,
        quoting=csv.QUOTE_MINIMAL if has_quotes else csv.QUOTE_NONE,
    )
    line = 1
    for row in reader:
        cells = [cell.strip() for cell in row]
        if separator == " ":
            cells = [cell for cell in cells if cell]
        if len(cells) > 1 or any(cells):
            yield line, cells
        line = reader.line_num + 1


def is_number(cell: str) -> bool:
    """Whether a cell holds a number, with a decimal point or comma, or a moment."""
    try:
        float(cell)
    except ValueError:
        return bool(DECIMAL_COMMA.fullmatch(cell) or MOMENT.fullmatch(cell))
    return True


def _number_part(rows: list[Row]) -> float:
    """Return the part of the filled cells that hold numbers, 0 to 1."""
    cells = [cell for _, row in rows for cell in row if cell]
    return sum(map(is_number, cells)) / max(len(cells), 1)


def _first_row(rows: list[Row], columns: int) -> int | None:
    """Return the index of the first row with at least `columns` numbers, or None.

    It has its numbers in the same columns as most rows. Rows with a number directly above it belong
    to the table too: they have an empty or a wrong cell. If the topmost of them has few numbers, it
    is the line of names.
    """
    shapes = [tuple(map(is_number, row)) for _, row in rows]
    counts = Counter(shape for shape in shapes if sum(shape) >= columns)
    if not counts:
        return None
    usual = counts.most_common(1)[0][0]
    first = top = shapes.index(usual)
    while top and any(shapes[top - 1]) and len(shapes[top - 1]) == len(usual):
        top -= 1
    has_names_above = top > 0 and len(shapes[top - 1]) == len(usual)
    has_names = not has_names_above and 2 * sum(shapes[top]) < sum(usual)
    return min(top + has_names, first)


def _names(path: Path, above: list[Row], body: list[Row], separator: str) -> tuple[list[str], int]:
    """Return the names of the columns and their line. Columns without a name have numbers."""
    width = len(body[0][1])
    least = max(len(_without_empty_end(row)) for _, row in body if len(row) == width)
    numbers = [str(number) for number in range(1, width + 1)]
    rows = []  # lines with letters, without comments that cannot be names
    for line, row in above:
        cells = _header_cells(row, separator, width)
        is_fit = least <= len(cells) <= width
        if any(map(str.isalpha, "".join(row))) and (is_fit or not row[0].startswith(MARKS)):
            rows.append((line, cells, is_fit))
    if not rows:
        return numbers, body[0][0]
    labels: list[str] = []
    if len(rows) > 1 and _is_units(rows[-1][1]) and rows[-2][2]:
        labels = rows.pop()[1]
    line, names, is_fit = rows[-1]
    if is_fit:
        return [_name(*cells) for cells in zip_longest(names, labels, numbers, fillvalue="")], line
    if len(names) == 1:  # a title
        return numbers, line
    raise InputError(f"{path}:{line}: {len(names)} names over {width} columns")


def _name(name: str, label: str, number: str) -> str:
    unit = label.strip("[]()-")
    return f"{name} [{unit}]" if name and unit else name or number


def _header_cells(row: list[str], separator: str, width: int) -> list[str]:
    """Return the cells of a line of names or units, without the mark of a comment before them."""
    cells = _without_empty_end([row[0].lstrip("".join(MARKS)).strip('" '), *row[1:]])
    if cells and not cells[0] and len(cells) > width:
        cells = cells[1:]
    if separator != BLANKS or len(cells) <= width:
        return cells
    merged = cells[:1]  # 'angle [deg]' is one name
    for cell in cells[1:]:
        if cell.startswith(("[", "(")):
            merged[-1] += f" {cell}"
        else:
            merged.append(cell)
    return merged


def _without_empty_end(cells: list[str]) -> list[str]:
    used = [place for place, cell in enumerate(cells, 1) if cell]
    return cells[: used[-1]] if used else []


def _is_units(cells: list[str]) -> bool:
    """Whether at least half of the words are units."""
    words = [cell.strip("[]()") for cell in cells if cell]
    return 0 < len(words) <= 2 * sum(map(units.is_unit, words))


def _body(path: Path, form: Form) -> Iterator[Row]:
    with path.open(encoding=form.encoding) as file:
        for line, row in _rows(islice(file, form.first - 1, None), form.separator):
            if not (form.mark and row[0].startswith(form.mark)):
                yield line + form.first - 1, row


def _place(path: Path, form: Form, row: int) -> str:
    """Return file and line of a row, from 0 on."""
    line, _ = next(islice(_body(path, form), row, None), (form.first + row, []))
    return f"{path}:{line}"


def _fault(path: Path, form: Form, words: str) -> str:
    """Return the place and the reason of what pandas rejected."""
    raw, line = path.read_bytes(), form.first - 1
    try:
        raw.decode(form.encoding)
        for line, row in _body(path, form):
            if len(row) > len(form.names):
                return f"{path}:{line}: {len(row)} cells over {len(form.names)} columns"
    except UnicodeDecodeError as error:
        line, code = raw[: error.start].count(b"\n") + 1, form.encoding.removesuffix("-sig")
        return f"{path}:{line}: byte {error.start} is no text in {code.upper()}"
    except csv.Error as error:
        return f"{path}:{line + 1}: {error}"
    return f"{path}:{line}: {words.rpartition('error: ')[2].strip()[:160]}"
