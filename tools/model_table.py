#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Write the table of friction models (DAHL_FRAMES_MODELS in dahl_frames.h) as Markdown between the
two marks of each page; without a page, print it. Run it with build/venv/bin/python.

    tools/model_table.py docs/loop.md
"""

from __future__ import annotations

import sys
from pathlib import Path

from dahl.binding import models
from fault_table import write_between

MARKS = ("<!-- node:models -->", "<!-- /node:models -->")
HEAD = ("`[friction] model`", "its keys", "torque ratio is of", "parameter Model")
KEYS = {  # by the numbers of sigma0 and of Fc
    (1, 1): "`sigma0`, `Fc`",
    (0, 0): "one `sigma0` and one `Fc` for each of 1 to 8 elements",
    (1, 2): "one `sigma0`; `Fc` forward and backward",
}
WHOLE = {0: "the sum of Fc", 1: "Fc", 2: "the larger Fc"}  # by the number of Fc


def row(model: models.Model) -> tuple[str, ...]:
    """Return the cells of a model."""
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


if __name__ == "__main__":
    for page in map(Path, sys.argv[1:]):
        write_between(page, MARKS, markdown())
    if not sys.argv[1:]:
        print(markdown(), end="")
