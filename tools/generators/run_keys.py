#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Write host_sim/run_keys.def, the sections, keys and faults of a run file for dahl-loop, from the
tables of tools/dahl/sim/keys.py.

Usage: run_keys.py     (in build/venv; a test compares its output with the committed file)

Columns of host_sim/keys.csv. A row without a key describes its section.
    type     NUMBER, WHOLE, LIST (numbers separated by blanks) or TEXT
    low, high  both allowed; of a number, or of each in a list
    need     REQUIRED if the section is there, OPTIONAL, or OWN: required by one friction model
    of       of a section: sections that it needs; of a key of [motion]: the kinds that have it; of
             a fault: the counters of the node that rise
    in       scene: only scenes have the key; both: a run file too
"""

from __future__ import annotations

from pathlib import Path

from dahl.sim.keys import KEYS, SECTIONS, Key

ROOT = Path(__file__).resolve().parents[2]
HEAD = """/* SPDX-License-Identifier: MIT */
/*
 * Sections and keys of a run file, by tools/generators/run_keys.py from keys.csv and DAHL_MODELS.
 *
 *   RUN_SECTION(name, needs)     needs: names of other sections, separated by blanks
 *   RUN_KEY(section, name, type, low, high, need, default, kinds)
 *   RUN_OWN(name, low, high)     a key of section friction, a number that one model has
 *   RUN_FAULT(NAME, name)        a key of section faults, a number from 0 to 1
 */
"""
NAMES = ("RUN_SECTION", "RUN_KEY", "RUN_OWN", "RUN_FAULT")


def digits(value: float) -> str:
    return repr(value).removesuffix(".0")


def row_of(key: Key) -> str:
    name, limits = key.name, f"{digits(key.low)}, {digits(key.high)}"
    if key.need == "OWN" and key.type == "NUMBER":
        return f"RUN_OWN({name}, {limits})"
    if key.section == "faults":
        return f"RUN_FAULT({name.upper()}, {name})"
    default = "0" if isinstance(key.default, str) else digits(key.default)
    kinds = " | ".join(key.of.upper().replace("LOG", "COUNTS").split()) or "ANY"
    return f"RUN_KEY({key.section}, {name}, {key.type}, {limits}, {key.need}, {default}, {kinds})"


def table() -> str:
    guards = "".join(f"#ifndef {name}\n#define {name}(...)\n#endif\n" for name in NAMES)
    keys = [key for key in KEYS.values() if not key.is_of_scene]
    used = {key.section for key in keys}
    rows = [f'RUN_SECTION({name}, "{needs}")' for name, needs in SECTIONS.items() if name in used]
    rows += map(row_of, keys)
    ends = "".join(f"#undef {name}\n" for name in NAMES)
    return f"{HEAD}{guards}\n" + "".join(f"{row}\n" for row in rows) + f"\n{ends}"


def generated() -> dict[Path, str]:
    """Text of the file that derives from the table."""
    return {ROOT / "host_sim" / "run_keys.def": table()}


if __name__ == "__main__":
    for path, text in generated().items():
        path.write_text(text, encoding="utf-8")
