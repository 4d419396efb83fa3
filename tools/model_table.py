#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Write the table of friction models (DAHL_MODELS in dahl_parts.h) as Markdown between the
two marks of each page, and as value tables of each .dbc file. Without a file, print the Markdown.
Run it with build/venv/bin/python.

    tools/model_table.py docs/loop.md lib/node/dahl.dbc
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from dahl.binding import models
from fault_table import write_between

MARKS = ("<!-- node:models -->", "<!-- /node:models -->")
HEAD = ("`[friction] model`", "its keys", "torque ratio is of", "parameter Model")
KEYS = {  # by the numbers of sigma0 and of Fc
    (1, 1): "`sigma0`, `Fc`",
    (0, 0): "one `sigma0` and one `Fc` for each of 1 to 8 elements",
    (1, 2): "one `sigma0`; one `Fc` for each direction: forward, backward",
}
WHOLE = {0: "the sum of Fc", 1: "Fc", 2: "the larger Fc"}  # by the number of Fc


def row(model: models.Model) -> tuple[str, ...]:
    own = f"`{model.key}`, {model.meaning}" if model.key else model.meaning
    keys = KEYS[model.sigma0s, model.Fcs] + (f"; {own}" if own else "")
    number = str(model.number)
    if model.sigma0s == 0:
        number = f"{number} + number of elements".removeprefix("0 + ")
    return f"`{model.name}`", keys, WHOLE[model.Fcs], number


def markdown() -> str:
    """Return the table, one line a row."""
    lines = [HEAD, ["---"] * len(HEAD), *map(row, models.table().values())]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def write_values(dbc: Path) -> None:
    """Replace the value tables of Model. A number that depends on elements has no name."""
    named = (row for row in models.table().values() if row.sigma0s)
    rows = sorted(named, key=lambda row: row.number)
    words = " ".join(f'{row.number} "{row.class_name}"' for row in rows)
    text = dbc.read_text(encoding="utf-8")
    text = re.sub(r"^(VAL_ \d+ Model) .*;$", rf"\1 {words} ;", text, flags=re.MULTILINE)
    dbc.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    for path in map(Path, sys.argv[1:]):
        if path.suffix == ".dbc":
            write_values(path)
        else:
            write_between(path, MARKS, markdown())
    if not sys.argv[1:]:
        print(markdown(), end="")
