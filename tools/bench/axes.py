# SPDX-License-Identifier: MIT
"""Commission random simulated axes, and print how often the result is true.

The tables are those of docs/commissioning.md. Their axes are the default: 300 rigid ones from 65000
and 120 flexible ones from 54000, in 1 to 2 minutes. With FIRST and COUNT, COUNT axes of both kinds
start at the number FIRST. A number always gives the same axis.
"""

from __future__ import annotations

import argparse
import csv
import json
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import median_high
from typing import Any

from dahl.binding.commission import REASONS
from dahl.binding.library import c
from laws import markdown

PROGRAM = Path(__file__).parents[2] / "build/host/tests/lib/commission_axes"
RIGID, FLEXIBLE = (65000, 300), (54000, 120)  # first and count of docs/commissioning.md
EXAMPLE = """example: 20 fresh axes of each kind, with a row for each axis in a file
  tools/bench.sh axes 70000 20 --rows axes.csv"""

Row = dict[str, Any]


def commission(kind: str, first: int, count: int) -> Iterator[Row]:
    """Yield the row of each axis as soon as it is known."""
    words = [str(PROGRAM), kind, str(first), str(count)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as program:
        for line in program.stdout or ():
            yield {"kind": kind, **json.loads(line)}
    if program.returncode != 0:
        raise SystemExit(f"error: {' '.join(words)} exited with {program.returncode}")


def measure(kind: str, first: int, count: int) -> list[Row]:
    """Return the rows, and show progress on a terminal or each tenth of the axes."""
    rows = []
    for row in commission(kind, first, count):
        rows.append(row)
        is_tenth = len(rows) * 10 // count > (len(rows) - 1) * 10 // count
        if sys.stderr.isatty() or is_tenth:
            end = "\r" if sys.stderr.isatty() and len(rows) < count else "\n"
            print(
                f"bench: {len(rows)} of {count} {kind} axes", end=end, file=sys.stderr, flush=True
            )
    return rows


def refusals(rows: Sequence[Row]) -> str:
    """Return the number of refused axes by the name of the refusal."""
    names = {getattr(c, f"DAHL_COMMISSION_{name}"): name for name in REASONS}
    codes = Counter(row["refusal"] for row in rows if not row["bounds"])
    return ", ".join(
        f"{count} refused as `{names[code]}`" if code in names else f"{count} not done in time"
        for code, count in codes.most_common()
    )


def report(title: str, rows: Sequence[Row]) -> str:
    """Return a sentence and a table: each column that is 0 or 1 and follows `bounds` is a line."""
    done = [row for row in rows if row["bounds"]]
    names = list(rows[0])[list(rows[0]).index("bounds") + 1 :]
    lines = [[name, str(sum(row[name] for row in done))] for name in names]
    head = [f"of the {len(done)} axes with bounds", "axes"]
    first = f"{len(rows)} random {title}, from {rows[0]['axis']}: {len(done)} gave bounds"
    return f"{', '.join(filter(None, (first, refusals(rows))))}.\n\n{markdown(head, lines)}"


def rigid_report(rows: Sequence[Row]) -> str:
    hands = [row["hand"] for row in rows if row["bounds"]]
    needs = f"{median_high(hands):.3f}" if hands else "unknown part"
    return (
        f"{report('rigid axes', rows)}\n\n"
        f"A hand then needs {needs} of its torque without compensation (median)."
    )


def flexible_report(rows: Sequence[Row]) -> str:
    done = [row for row in rows if row["bounds"]]
    tries = Counter(row["tries"] for row in done)
    by_try = ", ".join(str(tries[k]) for k in (1, 2, 3))
    most = max((row["inertia_low"] for row in done), default=0.0)
    return (
        f"{report('flexible axes', rows)}\n\n"
        f"Accepted at the first, second and third try, each with half the bandwidth: {by_try}. "
        f"The largest bound of the rotor is {most:.2f} times the rotor."
    )


def write_rows(path: Path, rows: Sequence[Row]) -> None:
    fields = dict.fromkeys(name for row in rows for name in row)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fields)
        writer.writeheader()
        writer.writerows(rows)


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="tools/bench.sh axes",
        description=__doc__,
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("first", metavar="FIRST", type=int, nargs="?", help="number of an axis")
    parser.add_argument("count", metavar="COUNT", type=int, nargs="?", help="axes of each kind")
    parser.add_argument("--only", choices=("rigid", "flexible"), help="one kind of axes")
    parser.add_argument("--rows", metavar="FILE", type=Path, help="write a CSV row for each axis")
    options = parser.parse_args(arguments)
    if options.first is not None and (options.first < 0 or (options.count or 0) < 1):
        parser.error("FIRST must be at least 0, and COUNT must be given and at least 1")
    return options


def main(arguments: Sequence[str]) -> int:
    options = parse(arguments)
    given = None if options.first is None else (options.first, options.count)
    kinds = {"rigid": (RIGID, rigid_report), "flexible": (FLEXIBLE, flexible_report)}
    rows: list[Row] = []
    for kind, (default, of_kind) in kinds.items():
        if options.only in (None, kind):
            found = measure(kind, *(given or default))
            print(of_kind(found), end="\n\n", flush=True)
            rows += found
    if options.rows:
        write_rows(options.rows, rows)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
