# SPDX-License-Identifier: MIT
"""The counts as a table: on the terminal, and as the block of README.md between the two comments of
MARKS.

`table.py` rewrites that block from build/bench/target.json; `table.py --check` only says whether it
would change.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
README = ROOT / "README.md"
RESULT = ROOT / "build" / "bench" / "target.json"
MARKS = ("<!-- bench:target -->", "<!-- /bench:target -->")

ROWS = [
    ("one count, F/Fc in Q30", "one_count_q30"),
    ("one count, F in N m", "one_count_float"),
    ("8 counts, Q30", "eight_counts_q30"),
    ("1000 counts, Q30", "1000_counts_q30"),
    ("INT32_MIN counts, Q30", "int32_min_q30"),
    ("worst of all counts, Q30", "counts_worst_q30"),
    ("reversal, Q30", "reversal_q30"),
    ("no motion, Q30", "zero_q30"),
    ("by angle, worst of all travel", "angle_worst"),
    ("prepare", "prepare"),
    ("*newlib `expm1f` step*", "newlib_expm1f"),
    ("*newlib `expf` step*", "newlib_expf"),
    ("*newlib `exp` (double) step*", "newlib_exp_double"),
    ("*picolibc `expm1f` step*", "picolibc_expm1f"),
    ("*picolibc `expf` step*", "picolibc_expf"),
    ("*picolibc `exp` (double) step*", "picolibc_exp_double"),
    ("*forward Euler step*", "euler"),
    ("*RK4 step*", "rk4"),
    ("*table with interpolation step*", "table"),
    ("code bytes: prepare and counts, Q30", "code_bytes"),
    ("code bytes: and by angle, N m", "code_bytes_angle"),
    ("const data bytes", "const_bytes_angle"),
    ("writable static bytes", "static_bytes_angle"),
    ("plan bytes", "plan_bytes"),
    ("state bytes", "state_bytes"),
    ("deepest stack bytes", "stack_bytes"),
]


def cells(result: dict[str, dict[str, Any]], key: str) -> list[str]:
    return [str(core[key]) if key in core else "-" for core in result.values()]


def show(result: dict[str, dict[str, Any]]) -> None:
    """A table on the terminal."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title="Instructions per call, entry to return; bytes")
    table.add_column("")
    for core in result.values():
        table.add_column(core["core"], justify="right")
    for title, key in ROWS:
        table.add_row(title.replace("*", "").replace("`", ""), *cells(result, key))
    Console(width=None if sys.stdout.isatty() else 110).print(table)


def markdown(result: dict[str, dict[str, Any]]) -> str:
    """The same as the block of the README, marks included."""
    head = ["instructions per call, entry to return", *(core["core"] for core in result.values())]
    lines = ["| " + " | ".join(head) + " |", "|---|" + "---:|" * len(result)]
    lines += ["| " + " | ".join([title, *cells(result, key)]) + " |" for title, key in ROWS]
    compilers = sorted({core["compiler"] for core in result.values()})
    note = f"Counted in QEMU with a plugin, `-O2`, {' and '.join(compilers)}."
    note += " QEMU does not model cycles."
    return "\n".join([MARKS[0], *lines, "", note, MARKS[1]])


def replaced(text: str, block: str) -> str:
    """README text with its block replaced; the text itself where it has no block."""
    return re.sub(f"{MARKS[0]}.*?{MARKS[1]}", lambda _: block, text, flags=re.DOTALL)


def main(arguments: list[str]) -> int:
    if not RESULT.exists():
        print("error: no build/bench/target.json; run tools/bench.sh target first", file=sys.stderr)
        return 2
    text = README.read_text()
    if MARKS[0] not in text or MARKS[1] not in text:
        print(f"error: README.md lacks the lines {MARKS[0]} and {MARKS[1]}", file=sys.stderr)
        return 2
    new = replaced(text, markdown(json.loads(RESULT.read_text())))
    if "--check" in arguments:
        print(
            "README.md is up to date"
            if new == text
            else "README.md differs: run tools/bench.sh readme"
        )
        return int(new != text)
    README.write_text(new)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
