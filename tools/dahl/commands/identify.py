# SPDX-License-Identifier: MIT
"""
Find sigma0 and Fc from measured logs, with intervals, and say whether they can be trusted.

LOG is a table (CSV, TSV, JSON, MAT, Parquet) or a CAN log (candump .log, ASC, BLF, TRC, MF4) with
--dbc. Columns and units are taken from the names of the columns where no option says otherwise. All
LOGs are fitted together. Leaves a picture, JSON, a scene that replays the log, and, where both
parameters are identifiable, a header with a const plan.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from dahl import Error, places
from dahl.arguments import whole

if TYPE_CHECKING:
    from dahl.identify.readers import Source
    from dahl.identify.study import Options, Result

HELP = "from a measured log to sigma0 and Fc"
EXAMPLE = """examples:
  dahl identify shaft.csv --angle angle_deg --torque torque_Nm --counts-per-turn 16384
  dahl identify run1.csv run2.csv --check run3.csv --json -
  dahl identify drive.blf --dbc car.dbc --angle SteeringAngle --torque ColumnTorque"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("logs", nargs="*", type=Path, metavar="LOG", help="measured log")
    what = parser.add_argument_group("what the columns are")
    what.add_argument("--angle", default="", metavar="NAME", help="column or signal, or its number")
    what.add_argument("--torque", default="", metavar="NAME", help="the same for the torque")
    what.add_argument("--time", default="", metavar="NAME", help="the same for the time in s")
    what.add_argument(
        "--angle-unit", default="", metavar="UNIT", help="deg, rad, mrad, turn, counts, m, mm, um, in"
    )
    what.add_argument(
        "--torque-unit", default="", metavar="UNIT", help="Nm, mNm, kNm, N, mN, uN, kN, lb, kip, ..."
    )
    what.add_argument(
        "--counts-per-turn", type=float, default=0.0, metavar="N",
        help="of the encoder (linear motion: per millimetre); else seen from the log",
    )
    what.add_argument("--dbc", type=Path, metavar="FILE", help="how to decode a CAN log")
    what.add_argument("--skip-gaps", action="store_true", help="leave out rows without a number")
    what.add_argument("--trust-units", action="store_true", help="do not check whether units can be")
    how = parser.add_argument_group("how to fit")
    how.add_argument(
        "--terms", metavar="LIST",
        help="offset,spring,viscous,inertia or none beside friction (default: those that pay)",
    )
    how.add_argument("--no-delay", action="store_true", help="torque and angle are in time")
    how.add_argument(
        "--median", type=whole(0, 99), default=0, metavar="ROWS",
        help="running median of the angle, 1: none (default: what fits best)",
    )
    how.add_argument(
        "--check", type=Path, action="append", default=[], metavar="LOG",
        help="a log that is not fitted but predicted",
    )
    out = parser.add_argument_group("what to leave")
    out.add_argument("--json", metavar="FILE", help="numbers as JSON; - prints them alone")
    out.add_argument("--name", default="", help="of files and plan (default: the first log's)")
    out.add_argument(
        "-o", "--output", type=Path, default=places.ROOT / "build" / "identify", metavar="FOLDER",
        help="where files go",
    )
    out.add_argument("--no-files", action="store_true", help="leave none")


def source_of(args: argparse.Namespace) -> Source:
    """What the arguments say about columns and units."""
    from dahl.identify.readers import Source

    if not 0 <= args.counts_per_turn < 2**32:
        raise Error(f"--counts-per-turn {args.counts_per_turn:g}: a number above 0 was expected")
    return Source(**{name: getattr(args, name) for name in Source.__dataclass_fields__})


def options_of(args: argparse.Namespace) -> Options:
    """What the arguments say about the fit."""
    from dahl.identify.study import Options
    from dahl.identify.sweep import CORE
    from dahl.logs import meant

    terms = None
    if args.terms is not None:
        terms = tuple(filter(None, args.terms.replace("none", "").split(",")))
        wrong = next((term for term in terms if term not in CORE), None)
        if wrong:
            raise Error(f"--terms {wrong}: no such term{meant(wrong, CORE)}")
    return Options(terms, not args.no_delay, args.median, args.trust_units)


def run(args: argparse.Namespace) -> None:
    from dahl.identify import output, readers, study

    if not args.logs:
        raise Error("no LOG given (see dahl identify --help)")
    source, options = source_of(args), options_of(args)
    result = study.identify([readers.read(path, source) for path in args.logs], options)
    for path in args.check:
        result.checks[str(path)] = study.check(result, readers.read(path, source))
    _report(args, result, output.identifier(args.name or args.logs[0].stem))


def _report(args: argparse.Namespace, result: Result, name: str) -> None:
    from rich.console import Console

    from dahl.identify import output

    quiet = args.json == "-"
    if quiet:
        sys.stdout.write(output.as_json(result))
    elif args.json:
        Path(args.json).write_text(output.as_json(result), encoding="utf-8")
    written = [] if args.no_files else output.write_all(result, name, args.output)
    if quiet:
        return
    console = Console(highlight=False)
    console.print(output.table(result))
    if written:
        console.print("files   " + ", ".join(map(str, written)), soft_wrap=True)
    if written and written[-1].suffix != ".h":
        console.print("no plan for firmware: not both parameters are identifiable")
