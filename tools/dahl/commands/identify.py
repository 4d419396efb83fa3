# SPDX-License-Identifier: MIT
"""Find sigma0 and Fc from measured logs, with intervals, and say whether they can be trusted.

LOG is a table (CSV, TSV, JSON, MAT, NPZ, Parquet) or a CAN log (candump .log, ASC, BLF, TRC, MF4)
with --dbc; an MF4 of measured channels needs no DBC. Columns and units are found by the names of
the columns if no option gives them. All LOGs are fitted together. --each fits the logs of a folder
one by one, --follow a live bus.

It writes a picture, JSON and a scene that replays the log. If both parameters are identifiable and
their plan explains the raw motion, it writes a header with a const plan too. A log needs about 100
bytes of memory a row.

It exits with 0 also if a parameter is not identifiable (JSON: identifiable), with 2 if a log or an
option is wrong, with 1 if something is missing, such as a bus.
"""

from __future__ import annotations

import argparse
import contextlib
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dahl.commands.arguments import add_limits, add_output, number, positive, whole
from dahl.commands.bus_arguments import add_bus_arguments
from dahl.errors import Error, InputError, RunError, meant

if TYPE_CHECKING:
    from dahl.identify.estimate import Options
    from dahl.identify.result import Result
    from dahl.io.log import Log
    from dahl.io.readers import Source

HELP = "from a measured log to sigma0 and Fc"
EXAMPLE = """examples:
  dahl identify "$(dahl data tribometer)/reciprocating.tsv" --name rig
  dahl identify shaft.csv --angle angle_deg --torque torque_Nm --counts-per-turn 16384
  dahl identify run1.csv run2.csv --check run3.csv --json -
  dahl identify brake.csv --angle angle_deg --torque torque_Nm --load clamp_N
  dahl identify drive.blf --dbc car.dbc --angle SteeringAngle --torque ColumnTorque
  dahl identify --each logs/ --jobs 4
  dahl identify --follow -i socketcan -c can0 --dbc car.dbc --angle A --torque T --within 2"""

OF_MANY, OF_A_BUS = ("jobs", "dask"), ("within", "seconds", "frames")
UNUSED = {  # options without use, by kind of run
    "LOG": (*OF_MANY, *OF_A_BUS),
    "--each": ("json", "name", "force", "no_files", "check", *OF_A_BUS),
    "--follow": ("check", *OF_MANY),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("logs", nargs="*", type=Path, metavar="LOG", help="measured log")
    columns = parser.add_argument_group("columns")
    add_columns(columns)
    _add_load(columns)
    _add_fit(parser.add_argument_group("fit"))
    _add_each(parser.add_argument_group("many logs, one by one"))
    _add_live(parser.add_argument_group("a live bus"))
    add_bus_arguments(parser)
    _add_files(parser.add_argument_group("output"))


def _add_load(group: argparse._ArgumentGroup) -> None:
    words = "a load that friction may follow, as a normal force; several are added"
    _add_list(group, "--load", "NAME", words)


def add_columns(group: argparse._ArgumentGroup) -> None:
    """Add the options of columns and units that source_of() reads."""
    angles = "deg, rad, mrad, arcmin, turn, counts, m, mm, um, in, ..."
    _add_text(group, "--angle", "NAME", "column or signal, or its number from 1 on")
    _add_text(group, "--torque", "NAME", "the same for the torque")
    _add_text(group, "--time", "NAME", "the same for the time in s")
    _add_text(group, "--angle-unit", "UNIT", angles)
    _add_text(group, "--torque-unit", "UNIT", "Nm, mNm, kNm, N, mN, uN, kN, lb, kip, A, mA, ...")
    constant = "torque is K times a motor current, N m/A (linear motion: N/A)"
    group.add_argument("--torque-constant", type=positive, default=0.0, metavar="K", help=constant)
    _add_text(group, "--time-unit", "UNIT", "s, ms, us")
    counts = "of the encoder (linear motion: per millimetre; default: found in the log)"
    group.add_argument("--counts-per-turn", type=number, metavar="N", help=counts)
    group.add_argument("--dbc", type=Path, metavar="FILE", help="how to decode a CAN log")
    _add_flag(group, "--skip-gaps", "leave out rows without a number")
    _add_flag(group, "--trust-units", "do not check whether the units are plausible")


def _add_fit(group: argparse._ArgumentGroup) -> None:
    from dahl.io.log import TERMS

    terms = f"{','.join(TERMS)} or none, added to friction (default: those that pay)"
    model = "dahl, slip-1 .. slip-4, dahl-2, mixed-2 .. mixed-4, asymmetric, coulomb (default:"
    model += " the simplest that explains left-out cycles as well as the best)"
    median = "running median of the angle; 1: none (default: if the angle flickers)"
    group.add_argument("--terms", metavar="LIST", help=terms)
    _add_text(group, "--model", "NAME", model)
    _add_flag(group, "--no-delay", "fit no delay of the torque")
    group.add_argument("--median", type=whole(0, 99), default=0, metavar="ROWS", help=median)
    _add_list(group, "--check", "LOG", "a log to predict, without fitting it", Path)


def _add_each(group: argparse._ArgumentGroup) -> None:
    folder = "all logs of a folder; can be resumed"
    group.add_argument("--each", type=Path, metavar="DIR", help=folder)
    group.add_argument(
        "--jobs", type=whole(-1, 1024), default=-1, metavar="N", help="-1: all cores"
    )
    group.add_argument("--dask", metavar="ADDRESS", help="run on a Dask cluster, tcp://HOST:PORT")


def _add_live(group: argparse._ArgumentGroup) -> None:
    within = "end if the half width of both intervals is at most this (default 2)"
    _add_flag(group, "--follow", "estimate again and again from -i and -c")
    group.add_argument("--within", type=positive, default=2.0, metavar="PERCENT", help=within)
    add_limits(group)


def _add_files(group: argparse._ArgumentGroup) -> None:
    target = "of the encoder that the plan is for (default: that of the log)"
    group.add_argument("--json", metavar="FILE", help="write JSON; - prints only that")
    group.add_argument(
        "--name", default="", help="of files and plan (default: that of the first log)"
    )
    add_output(group)
    group.add_argument(
        "--target-counts-per-turn", type=positive, default=0.0, metavar="N", help=target
    )
    _add_flag(group, "--force", "write a plan even if there are reasons against it")
    _add_flag(group, "--no-files", "write no files")


def _add_text(group: argparse._ArgumentGroup, name: str, metavar: str, words: str) -> None:
    group.add_argument(name, default="", metavar=metavar, help=words)


def _add_flag(group: argparse._ArgumentGroup, name: str, words: str) -> None:
    group.add_argument(name, action="store_true", help=words)


def _add_list(
    group: argparse._ArgumentGroup, name: str, metavar: str, words: str, kind: type = str
) -> None:
    group.add_argument(name, type=kind, action="append", default=[], metavar=metavar, help=words)


def source_of(args: argparse.Namespace) -> Source:
    """Return the options of columns and units."""
    from dahl.io.readers import Source

    counts = args.counts_per_turn
    if counts is not None and not 0 < counts < 2**32:
        raise InputError(
            f"--counts-per-turn {counts:g}: a number above 0 and below 2^32 was expected"
        )
    given: dict[str, Any] = {
        name: getattr(args, name, None) for name in Source.__dataclass_fields__
    }
    load = tuple(getattr(args, "load", ()))
    return Source(**{**given, "load": load, "counts_per_turn": counts or 0.0})


def options_of(args: argparse.Namespace) -> Options:
    from dahl.identify.estimate import Options
    from dahl.identify.laws import OPTIONS
    from dahl.io.log import TERMS

    terms = None
    if args.terms is not None:
        terms = () if args.terms == "none" else tuple(filter(None, args.terms.split(",")))
        wrong = next((term for term in terms if term not in TERMS), None)
        if wrong:
            raise InputError(f"--terms {wrong}: no such term{meant(wrong, list(TERMS))}")
    model = args.model.lower()
    if model and model not in OPTIONS:
        raise InputError(f"--model {args.model}: no such model{meant(model, list(OPTIONS))}")
    target = args.target_counts_per_turn
    return Options(terms, not args.no_delay, args.median, args.trust_units, target, model)


def run(args: argparse.Namespace) -> int:
    from dahl.binding import plan_header
    from dahl.identify import estimate
    from dahl.io import readers

    if [bool(args.logs), bool(args.each), args.follow].count(True) != 1:
        raise InputError("give LOGs, or --each DIR, or --follow (see dahl identify --help)")
    _refuse_unused(args)
    _refuse_duplicates(args)
    if args.each:
        return _each(args)
    if args.follow:
        return _follow(args)
    if folder := next((log for log in args.logs if log.is_dir()), None):
        raise InputError(f"{folder}: a folder; --each {folder} takes the logs in it one by one")
    source, options = source_of(args), options_of(args)
    name = plan_header.identifier(args.name or _name_of(args.logs[0]))
    _refuse_overwriting(args, name)
    logs, broken = _read_logs(args, source, options)
    try:
        result = estimate.identify(logs, options)
    except MemoryError:
        rows = sum(log.rows for log in logs)
        raise RunError(f"{rows} rows do not fit into memory (100 bytes a row)") from None
    for path in args.check:
        result.checks[str(path)] = estimate.check(result, readers.read(path, source))
    _report(args, result, name)
    return 2 if broken else 0


def _refuse_unused(args: argparse.Namespace) -> None:
    """Raise dahl.Error for an option without use in this kind of run."""
    kind = "--each" if args.each else "--follow" if args.follow else "LOG"
    for name in UNUSED[kind]:
        if getattr(args, name) != args.command_parser.get_default(name):
            raise InputError(f"--{name.replace('_', '-')}: has no use with {kind}")


def _refuse_duplicates(args: argparse.Namespace) -> None:
    """Raise dahl.Error for a log that is given twice: its rows would count twice."""
    known: list[Path] = []
    for log in filter(Path.exists, (*args.logs, *args.check)):
        if any(map(log.samefile, known)):
            raise InputError(f"{log}: given twice")
        known.append(log)


def _name_of(log: Path) -> str:
    """Return the name of a log, or "log" if it has no character that C allows in a name."""
    return log.stem if re.search(r"\w", log.stem, re.ASCII) else "log"


def _refuse_overwriting(args: argparse.Namespace, name: str) -> None:
    """Raise dahl.Error if this run would overwrite a log that it reads, or a foreign file."""
    from dahl.io.files import refuse_foreign_files

    endings = () if args.no_files else (".csv", ".ini", ".json", ".png")
    written = {args.output / f"{name}{end}" for end in endings}
    for log in filter(Path.exists, (*args.logs, *args.check)):
        if any(map(log.samefile, filter(Path.exists, written))):
            raise InputError(
                f"{log}: what is written into {args.output} would destroy it; use --name"
            )
        if args.json and Path(args.json).exists() and log.samefile(args.json):
            raise InputError(f"{log}: --json {args.json} would destroy it")
    if not args.no_files:
        refuse_foreign_files(
            (args.output / f"{name}{end}" for end in (".csv", ".ini")), "use --name"
        )


def _read_logs(
    args: argparse.Namespace, source: Source, options: Options
) -> tuple[list[Log], list[Error]]:
    """Return the logs that a fit can use, and print an error for each other one.

    Raises dahl.Error if no log is left.
    """
    from dahl.identify import preprocess
    from dahl.io import readers

    logs, broken = [], []
    for path in args.logs:
        try:
            log = readers.read(path, source)
            preprocess.check(log, options.trust_units)
            logs.append(log)
        except Error as error:
            broken.append(error)
    if not logs:
        *first, last = broken
        _print_errors(first)
        raise last
    _print_errors(broken)
    return logs, broken


def _print_errors(errors: list[Error]) -> None:
    for error in errors:
        print(f"error: {error}", file=sys.stderr)


def _each(args: argparse.Namespace) -> int:
    """Identify all logs of a folder into one table; return 2 if a log was broken."""
    from rich.progress import Progress
    from rich.table import Table

    from dahl.identify import batch
    from dahl.report.terminal import console

    if args.jobs == 0:
        raise InputError("--jobs 0: a number of processes from 1 on, or -1 for all cores")
    paths = batch.logs_in(args.each)
    store = batch.Store(args.output / "each", source_of(args), options_of(args))
    rows, earlier = {}, 0
    with Progress(console=console(stderr=True)) as progress:
        task = progress.add_task("identify", total=len(paths))
        for path, numbers, known in batch.run(paths, store, args.jobs, args.dask):
            rows[path.name] = numbers
            earlier += known
            progress.advance(task)
    batch.write_table(args.output / "each.csv", rows)
    table = Table("log", "sigma0", "Fc", "R2", "verdict")
    keys = ("sigma0", "Fc", "r2")
    for name, row in sorted(rows.items()):
        units = row.get("units", {})
        shown = [f"{row[key]:.5g} {units.get(key, '')}".strip() for key in keys if "r2" in row]
        shown = shown or [""] * len(keys)
        table.add_row(name, *shown, row.get("verdict", "broken"))
    out = console()
    out.print(table)
    out.print(
        f"table   {args.output / 'each.csv'}; {earlier} of {len(rows)} from earlier runs",
        soft_wrap=True,
    )
    broken = [Error(row["error"]) for row in rows.values() if "error" in row]
    _print_errors(broken)
    return 2 if broken else 0


def _follow(args: argparse.Namespace) -> int:
    """Identify on a live bus until the intervals are narrow enough."""
    from dahl.binding import plan_header
    from dahl.can.bus import Reception, open_from, read_ahead
    from dahl.identify import follow
    from dahl.interrupt import Stop

    source, name = source_of(args), plan_header.identifier(args.name or "bus")
    _refuse_overwriting(args, name)
    follow.signals_of(source)  # report a bad DBC before any bus is opened
    with open_from(args) as bus, Stop() as stop:
        frames = read_ahead(Reception(bus, stop, args.seconds, args.frames))
        with contextlib.closing(frames):
            result = follow.follow(
                frames, source, options_of(args), args.within / 100, _print_estimate
            )
    _report(args, result, name)
    return 0


def _print_estimate(rows: int, result: Result | None, why: str) -> None:
    """Print one line for each estimate on a live bus."""
    numbers = ""
    if result is not None:
        parts = [
            f"{name} {p.value:.5g} (within {100 * p.half_width:.2g} %)"
            for name, p in (("sigma0", result.sigma0), ("Fc", result.Fc))
        ]
        numbers = ", ".join(parts) + "; "
    print(f"{rows} rows: {numbers}{why}", file=sys.stderr, flush=True)


def _report(args: argparse.Namespace, result: Result, name: str) -> None:
    from dahl.identify import export, report
    from dahl.io.files import write_atomic
    from dahl.report.terminal import console

    quiet = args.json == "-"
    if quiet:
        sys.stdout.write(report.as_json(result))
    elif args.json:
        write_atomic(Path(args.json), report.as_json(result))
    written = []
    if not args.no_files:
        written = report.write_files(result, name, args.output, args.force)
    if quiet:
        return
    out = console()
    out.print(*report.tables(result), sep="\n")
    if written:
        out.print("files   " + ", ".join(map(str, written)), soft_wrap=True)
    if written and written[-1].suffix != ".h":
        why = "; ".join(export.runnable_model(result).against)
        out.print(f"no plan for firmware: {why} (--force writes one)", soft_wrap=True)
