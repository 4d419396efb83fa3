#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Write the table of keys of scenes and run files in C and in Python, from host_sim/keys.csv.

Usage: run_keys.py     (a test compares its output with the committed files)

    host_sim/run_keys.def      rows for dahl-loop: sections, keys and faults of a run file
    tools/dahl/sim/keys.py     the tables SECTIONS and KEYS, between two marks

Columns of keys.csv. A row without a key describes its section.
    type     NUMBER, WHOLE, LIST (numbers separated by blanks) or TEXT
    low, high  both allowed; of a number, or of each in a list
    need     REQUIRED if the section is there, OPTIONAL, or OWN: required by one friction model
    of       of a section: sections that it needs; of a key of [motion]: the kinds that have it; of
             a fault: the counters of the node that rise
    in       scene: only scenes have the key; both: a run file too
"""

from __future__ import annotations

import csv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TABLE = ROOT / "host_sim" / "keys.csv"
BEGIN, END = (
    "# --- from host_sim/keys.csv by run_keys.py: begin",
    "# --- from host_sim/keys.csv: end",
)
HEAD = """/* SPDX-License-Identifier: MIT */
/*
 * Sections and keys of a run file, from keys.csv by tools/generators/run_keys.py; do not edit.
 *
 *   RUN_SECTION(name, needs)     needs: names of other sections, separated by blanks
 *   RUN_KEY(section, name, type, low, high, need, default, kinds)
 *   RUN_FAULT(NAME, name)        a key of section faults, a number from 0 to 1
 */
"""
NAMES = ("RUN_SECTION", "RUN_KEY", "RUN_FAULT")


def rows() -> list[dict[str, str]]:
    with TABLE.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def c_row(row: dict[str, str]) -> str:
    section, key = row["section"], row["key"]
    if not key:
        return f'RUN_SECTION({section}, "{row["of"]}")'
    if section == "faults":
        return f"RUN_FAULT({key.upper()}, {key})"
    low, high = row["low"] or "0", row["high"] or "0"
    default = "0" if row["type"] in ("TEXT", "LIST") else row["default"]
    kinds = " | ".join(row["of"].upper().replace("LOG", "COUNTS").split()) or "ANY"
    cells = (section, key, row["type"], low, high, row["need"], default, kinds)
    return f"RUN_KEY({', '.join(cells)})"


def c_table() -> str:
    guards = "".join(f"#ifndef {name}\n#define {name}(...)\n#endif\n" for name in NAMES)
    body = "".join(c_row(row) + "\n" for row in rows() if row["in"] == "both")
    return f"{HEAD}{guards}\n{body}\n" + "".join(f"#undef {name}\n" for name in NAMES)


def py_row(row: dict[str, str]) -> str:
    is_text = row["type"] in ("TEXT", "LIST")
    default = f'"{row["default"]}"' if is_text else row["default"]
    cells = [f'"{row[name]}"' for name in ("section", "key", "type", "need")]
    cells += [row["low"] or "0", row["high"] or "0", default]
    cells += [str(row["in"] == "scene"), f'"{row["of"]}"']
    while cells[-1] in ("False", '""'):  # defaults of Key
        cells.pop()
    return f"    Key({', '.join(cells)}),"


def py_tables() -> str:
    sections = (f'    "{row["section"]}": "{row["of"]}",' for row in rows() if not row["key"])
    keys = (py_row(row) for row in rows() if row["key"])
    return "\n".join(["SECTIONS = {", *sections, "}", "", "_ROWS = (", *keys, ")"])


def generated() -> dict[Path, str]:
    """Text of each file that derives from the table."""
    module = ROOT / "tools" / "dahl" / "sim" / "keys.py"
    before, _, rest = module.read_text(encoding="utf-8").partition(BEGIN)
    after = rest.partition(END)[2]
    return {
        ROOT / "host_sim" / "run_keys.def": c_table(),
        module: f"{before}{BEGIN}\n# fmt: off\n{py_tables()}\n# fmt: on\n{END}{after}",
    }


if __name__ == "__main__":
    for path, text in generated().items():
        path.write_text(text, encoding="utf-8")
