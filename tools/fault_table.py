#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Write the fault table of the node (lib/node/fault_table.h) into pages, or print it.

    tools/fault_table.py README.md docs/*.md

A page gets the table between its two marks. Without a page, the table is printed.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

TABLE = Path(__file__).parents[1] / "lib" / "node" / "fault_table.h"
MARKS = ("<!-- node:faults -->", "<!-- /node:faults -->")
HEAD = ("frame", "counted as", "state", "bristle", "answer")
ROW = re.compile(r'ROW\(\w+, "([^"]*)", "([^"]*)", (\w+), "([^"]*)", (true|false)\)')


def markdown() -> str:
    rows = [
        (*cells, "yes" if answered == "true" else "no")
        for *cells, answered in ROW.findall(TABLE.read_text(encoding="utf-8"))
    ]
    lines = [HEAD, ["---"] * len(HEAD), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def main(words: list[str]) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("pages", nargs="*", type=Path, metavar="PAGE", help="where the table is")
    pages = parser.parse_args(words).pages
    if not pages:
        print(markdown(), end="")
    for page in pages:
        write_between(page, MARKS, markdown())
    return 0


def write_between(page: Path, marks: tuple[str, str], table: str) -> None:
    """Replace what a page has between two marks; a page without them stays as it is."""
    try:
        text = page.read_text(encoding="utf-8")
    except OSError as error:
        sys.exit(f"error: {page}: {error.strerror}")
    before, first, rest = text.partition(marks[0])
    _, last, after = rest.partition(marks[1])
    if first and last:
        page.write_text(f"{before}{first}\n{table}{last}{after}", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
