# SPDX-License-Identifier: MIT
"""Measure the friction of an axis with its own motor and encoder, without a torque sensor.

Choose one: -i drives an axis over CAN (24 s), --simulate shows it on a simulated axis, --table
writes the motions for a drive that can play a table, LOG reads the recording of that table. Start
in the middle of the travel, at rest. Clear twice the travel to both sides, and keep hands away.

It prints a verdict with one next step, and writes JSON and a picture. If all bounds are known, it
writes a header for dahl_compensator.h too. A table alone shows friction and load, but no bounds.

It exits with 1 if the axis is refused: docs/commissioning.md has each refusal.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from dahl.commands.arguments import add_output, positive, whole
from dahl.commands.bus_arguments import add_bus_arguments
from dahl.commands.identify import add_columns, source_of
from dahl.errors import InputError

if TYPE_CHECKING:
    from dahl.binding.commission import Commission
    from dahl.report.commission import Report

HELP = "an axis measures its own friction, without a torque sensor"
EXAMPLE = """examples:
  dahl commission --simulate
  dahl commission -i socketcan -c can0 --drive odrive --node 0 --counts-per-turn 16384 \\
      --inertia 2e-4 --torque-limit 0.5 --name rig
  dahl commission --table sweeps.csv
  dahl commission recorded.csv --angle pos_turns --torque torque_Nm"""

DRIVES = ("odrive", "moteus")  # of dahl.can.drives
UNLIMITED = 1e6  # kg m2 and N m, of a recording
FINE_COUNT_RAD = 1e-5  # of a recording without a known encoder
OF_LIVE = ("node", "inertia", "torque_limit", "angle_limit", "speed_limit", "period", "bandwidth")
OF_COLUMNS = (
    *("angle", "torque", "time", "angle_unit", "torque_unit", "torque_constant", "time_unit"),
    *("dbc", "skip_gaps", "trust_units"),
)
OF_AXIS = ("inertia", "torque_limit", "counts_per_turn")  # that a live axis needs


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("log", nargs="?", type=Path, metavar="LOG", help="a recording of --table")
    add = parser.add_argument
    add("--simulate", action="store_true", help="a simulated axis of 0.5 N m and 0.002 kg m2")
    add("--table", type=Path, metavar="CSV", help="write the motions: s, rad, rad/s, rad/s2")
    add_columns(parser.add_argument_group("columns of LOG"))
    group = parser.add_argument_group("a live axis")
    words = "frames of the drive (default odrive)"
    group.add_argument("--drive", choices=DRIVES, default="odrive", help=words)
    group.add_argument(
        "--node", type=whole(0, 127), metavar="N", help="of the drive (default 0; moteus 1)"
    )
    for name, metavar, words in (
        ("--inertia", "J", "kg m2, of all that moves, within a factor of 1.5"),
        ("--torque-limit", "T", "N m, largest torque: 4 times the friction is enough"),
        ("--travel", "A", "rad to either side, 0.2 to 3 (default 0.35)"),
        ("--angle-limit", "A", "rad, largest angle (default twice the travel)"),
        ("--speed-limit", "V", "rad/s, largest speed (default 10)"),
        ("--period", "S", "s between the angles of the drive, 5e-5 to 2e-3 (default 1e-3)"),
        ("--bandwidth", "HZ", "of the position loop, at most 0.035/period (default 35)"),
    ):
        group.add_argument(name, type=positive, metavar=metavar, help=words)
    add_bus_arguments(parser)
    output = parser.add_argument_group("output")
    output.add_argument("--json", metavar="FILE", help="write JSON; - prints only that")
    output.add_argument("--name", default="axis", help="of files and header (default axis)")
    add_output(output)


def run(args: argparse.Namespace) -> int:
    from dahl.binding import plan_header

    is_live = bool(getattr(args, "interface", None))
    _refuse_unused(args, is_live)
    if [bool(args.log), args.simulate, args.table is not None, is_live].count(True) != 1:
        raise InputError("give one of -i, --simulate, --table and LOG (see dahl commission --help)")
    if args.table:
        return _write_table(args)
    name = plan_header.identifier(args.name)
    report = _read(args) if args.log else _drive(args) if is_live else _simulate()
    _print(args, report, name)
    return 1 if report.refusal else 0


def _refuse_unused(args: argparse.Namespace, is_live: bool) -> None:
    """Raise dahl.Error for an option without use in this kind of run."""
    unused = () if is_live else OF_LIVE
    for name in (*unused, *["travel"] * args.simulate):
        if getattr(args, name) is not None:
            raise InputError(f"--{name.replace('_', '-')}: has no use without a live axis, -i")
    needs_no_counts = not is_live and args.log is None
    for name in (*OF_COLUMNS * (args.log is None), *["counts_per_turn"] * needs_no_counts):
        if getattr(args, name):
            raise InputError(f"--{name.replace('_', '-')}: has no use without LOG")


def _print(args: argparse.Namespace, report: Report, name: str) -> None:
    from dahl.io.files import write_atomic
    from dahl.report.terminal import console

    if args.json and args.json != "-":
        write_atomic(Path(args.json), report.as_json())
    written = report.write_files(name, args.output)
    if args.json == "-":
        sys.stdout.write(report.as_json())
        return
    out = console()
    out.print(report.table())
    out.print("files   " + ", ".join(map(str, written)), soft_wrap=True)


def _given(args: argparse.Namespace) -> dict[str, float]:
    """Return the options of dahl.Commission that are given."""
    names = ("inertia", "torque_limit", "travel", "angle_limit", "speed_limit")
    return {name: getattr(args, name) for name in names if getattr(args, name) is not None}


def _simulate() -> Report:
    from dahl.report.commission import Report
    from dahl.report.terminal import Bar, console
    from dahl.sim import axis

    with Bar(console(stderr=True), leaves_nothing=True) as bar:
        advance = bar.begin(len(axis.STAGES), "stages")
        done = axis.commission(axis.simulated(), axis.Shaft(), watch=axis.each_stage(advance))
    return Report(done, "simulated axis")


# --- a live axis ----------------------------------------------------------------------------------


def _drive(args: argparse.Namespace) -> Report:
    from dahl.can import drives
    from dahl.can.bus import named, open_from, shown
    from dahl.report.commission import Report
    from dahl.report.terminal import Bar, console
    from dahl.sim import axis

    axis_of_user = _commission(args)
    number = drives.DEFAULT_NODES[args.drive] if args.node is None else args.node
    frames = drives.DRIVES[args.drive](number)
    rates = {} if args.bandwidth is None else {"bandwidth": args.bandwidth}
    fastest = axis.MAX_BANDWIDTH_TICKS / axis_of_user.period
    if args.bandwidth is not None and args.bandwidth > 1.0001 * fastest:
        raise InputError(f"--bandwidth {args.bandwidth:g}: at most 0.035/period = {fastest:.3g} Hz")
    with open_from(args) as bus, Bar(console(stderr=True), leaves_nothing=True) as bar:
        plant = drives.Axis(
            bus, frames, round(args.counts_per_turn), axis_of_user.period, args.drive == "moteus"
        )
        watch = axis.each_stage(bar.begin(len(axis.STAGES), "stages"))
        try:
            done = axis.commission(axis_of_user, plant, watch=watch, **rates)
        finally:
            plant.stop()
    return Report(done, f"{args.drive} on {shown(named(args))}")


def _commission(args: argparse.Namespace) -> Commission:
    from dahl.binding.commission import Commission

    missing = [name for name in OF_AXIS if getattr(args, name) is None]
    if missing:
        names = ", ".join("--" + name.replace("_", "-") for name in missing)
        raise InputError(f"a live axis needs {names}")
    if not 1 <= args.counts_per_turn < 2**32:
        raise InputError(f"--counts-per-turn {args.counts_per_turn:g}: from 1 to 2^32 was expected")
    theta = 2 * math.pi / args.counts_per_turn
    return Commission(period=args.period or 1e-3, theta_per_count=theta, **_given(args))


# --- a table and its recording --------------------------------------------------------------------


def _write_table(args: argparse.Namespace) -> int:
    from dahl.identify import export
    from dahl.io import files
    from dahl.sim import sweep_table

    files.refuse_foreign_files([args.table], "choose another name")
    table = sweep_table.motion(args.travel or 0.35)
    columns = table.time, table.angle, table.speed, table.acceleration
    args.table.parent.mkdir(parents=True, exist_ok=True)
    names, forms = "time_s,angle_rad,speed_rad_s,acceleration_rad_s2", "%.6f,%.9g,%.9g,%.9g"
    export.write_csv(args.table, columns, names, forms)
    print(
        f"{args.table}: {table.time[-1]:.1f} s, {table.travel:g} rad to either side, up to"
        f" {abs(table.speed).max():.2g} rad/s. Record angle and torque, then run"
        " dahl commission LOG"
    )
    return 0


def _refuse_result(path: Path) -> None:
    """Raise dahl.Error if the file is a result of dahl commission or dahl identify."""
    try:
        found = json.loads(path.read_text())
    except (OSError, ValueError):
        return  # no JSON: the reader says what it is
    if isinstance(found, dict):
        raise InputError(f"{path}: a result, not a recording; give the recording of --table as LOG")


def _read(args: argparse.Namespace) -> Report:
    from dahl.binding.commission import Commission
    from dahl.io import readers
    from dahl.report.commission import Report
    from dahl.sim import sweep_table

    _refuse_result(args.log)
    log = readers.read(args.log, source_of(args), may_restart=False)
    if log.questions:
        raise InputError(f"{args.log}: {next(iter(log.questions.values()))}")
    table = sweep_table.motion(args.travel or 0.35)
    placed = sweep_table.place(log, table)
    count = min(max(log.resolution, 1e-8), 0.01) if log.resolution else FINE_COUNT_RAD
    limits = {"inertia": UNLIMITED, "torque_limit": UNLIMITED, **_given(args)}
    axis = Commission(period=table.period, theta_per_count=count, **limits)
    done = sweep_table.replay(axis, placed)
    return Report(done, f"recording {args.log}")
