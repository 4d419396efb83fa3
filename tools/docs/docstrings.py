# SPDX-License-Identifier: MIT
"""Markup for the docstrings of dahl. Without it, the site would join lines of columns and code."""

import re

ROW = re.compile(r"( *)(\S(?:.*?\S)?) {2,}([^\s#].*)")  # not code with a comment


def add_markup(text: str) -> str:
    """Make a list of each paragraph of columns, and Python of each other indented paragraph."""
    return "\n\n".join(with_markup(paragraph) for paragraph in re.split(r"\n[ \t]*\n", text))


def with_markup(paragraph: str) -> str:
    """Return a paragraph with markup. It has columns if its first line and another one have. A
    deeper line continues the row above.
    """
    lines = paragraph.split("\n")
    rows = [ROW.fullmatch(line) for line in lines]
    if rows[0] is None or sum(row is not None for row in rows) < 2:
        return f".. code-block:: python\n\n{paragraph}" if paragraph[:4].isspace() else paragraph
    items: list[str] = []
    for line, row in zip(lines, rows, strict=True):
        if row and row[1] == rows[0][1]:
            items.append(f"- ``{row[2]}``: " + re.sub(" {2,}", "; ", row[3], count=1))
        else:
            items[-1] += " " + re.sub(" {2,}", " ", line.strip())
    return "\n".join(items)
