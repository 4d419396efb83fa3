# SPDX-License-Identifier: MIT
"""Print the tables of docs/compensation.md that compare laws of friction compensation.

Each cell is the mean over some seeds of the noise. The worst seed follows in brackets, if it is
more than 5 % above the mean. With `--docs`, also write the page.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence

from dahl.sim.compensation import CASES, Numbers, compare, laws_of
from report import DOCS, write_block

SEEDS = range(1, 6)
SHOWN_ABOVE = 1.05  # worst over mean
NAMES = {"sign": "`sign(v)`", "tanh": "`tanh(v)`"}
HOLDS = {  # of the third table: axis and case by title
    "PD, 17 bits": ("position", "17 bits"),
    "PD, 14 bits": ("position", "14 bits, noise 2"),
    "PD, 14 bits, delay 3": ("position", "14 bits, noise 2, delay 3"),
    "cascade, 14 bits": ("position", "14 bits, noise 2, cascade"),
    "hand, 17 bits": ("hand", "17 bits, noise 1"),
    "hand, 14 bits, delay 3": ("hand", "14 bits, noise 2, delay 3"),
}


def cell(values: Sequence[float], shown: Callable[[float], str]) -> str:
    """Return the mean, and the worst if it is far above."""
    mean, worst = sum(values) / len(values), max(values)
    is_apart = worst > SHOWN_ABOVE * mean and shown(worst) != shown(mean)
    return f"{shown(mean)} ({shown(worst)})" if is_apart else shown(mean)


def two_digits(value: float) -> str:
    return f"{value:#.2g}" if value < 10 else f"{value:.0f}"


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    text = "\n".join("| " + " | ".join(line) + " |" for line in lines)
    return text.replace("| --- |", "|---|").replace(" ---: |", "---:|")


def ratios(axis: str, title: str, found: Sequence[Numbers]) -> str:
    laws = [law for law in laws_of(axis) if law != "none"]
    rows = []
    for case in CASES[axis]:
        values = [[one[axis][case.name][law]["ratio"] for one in found] for law in laws]
        rows.append([case.name, *(cell(value, "{:.3f}".format) for value in values)])
    return markdown([title, *(NAMES.get(law, law) for law in laws)], rows)


def hold(axis: str, case: str, law: str, found: Sequence[Numbers]) -> str:
    """Return the error in mrad, or the torque of the hand in N m, and the noise in mN m."""
    if law not in laws_of(axis):
        return ""
    of_law = [one[axis][case][law] for one in found]
    unit = 1e3 if axis == "position" else 1.0
    errors = cell([unit * one["hold"] for one in of_law], two_digits)
    return f"{errors}, {cell([1e3 * one['noise'] for one in of_law], '{:.0f}'.format)}"


def tables(found: Sequence[Numbers]) -> dict[str, str]:
    """Return the blocks of the page by the names of their marks."""
    rows = [
        [NAMES.get(law, law), *(hold(*where, law, found) for where in HOLDS.values())]
        for law in laws_of("position")
    ]
    return {
        "laws": ratios("position", "position loop", found),
        "hands": ratios("hand", "hand", found),
        "holds": markdown(["law", *HOLDS], rows),
    }


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="tools/bench.sh laws", description=__doc__.partition("\n\n")[0]
    )
    parser.add_argument("--docs", action="store_true", help="also write the page")
    options = parser.parse_args(arguments)
    found = tables([compare(seed).numbers for seed in SEEDS])
    print("\n\n".join(found.values()))
    for name, table in found.items() if options.docs else ():
        marks = f"<!-- bench:{name} -->", f"<!-- /bench:{name} -->"
        write_block(DOCS / "compensation.md", marks, f"{marks[0]}\n{table}\n{marks[1]}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
