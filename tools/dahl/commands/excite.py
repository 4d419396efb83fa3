# SPDX-License-Identifier: MIT
"""Propose the motion that finds sigma0 and Fc within a wanted interval, for a given encoder.

It needs a guess of both parameters: from a first log (--from FILE.json, written by dahl identify,
if it claims them) or by options. A guess may be wrong by a factor of 2 or 3. For a position loop,
give its inertia and bandwidth, or a log of the loop that shows them (--loop). It writes the motion
as CSV (time, angle, counts) and as a scene for dahl-loop.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from dahl.commands.arguments import add_output, positive
from dahl.errors import InputError
from dahl.io import files

if TYPE_CHECKING:
    from dahl.identify.design import Motion, Wanted
    from dahl.io.log import Log

HELP = "the motion for an identification"
EXAMPLE = """examples:
  dahl excite --sigma0 100 --fc 0.5 --counts-per-turn 16384 --within 1
  dahl excite --from build/identify/rig.json --mm --counts-per-turn 10000 --within 0.5
  dahl excite --sigma0 100 --fc 0.5 --counts-per-turn 65536 --loop jog.csv --reference target_rad"""

MAX_ROWS = 5_000_000  # a larger CSV is of no use


def add_arguments(parser: argparse.ArgumentParser) -> None:
    guess = parser.add_argument_group("guess")
    noise = "standard deviation of the torque sensor, in Fc (default 0.05)"
    guess.add_argument("--from", dest="known", type=Path, metavar="JSON", help="an identification")
    guess.add_argument("--sigma0", type=positive, metavar="X", help="N m/rad (linear: N/m)")
    guess.add_argument("--fc", type=positive, metavar="Y", help="N m (linear: N)")
    guess.add_argument("--noise", type=positive, default=0.05, metavar="PART", help=noise)
    add = parser.add_argument
    add("--counts-per-turn", type=positive, required=True, metavar="N", help="of the encoder")
    add("--mm", action="store_true", help="linear: counts per millimetre, N/m, N")
    within = "wanted half width of the 95 %% interval of sigma0 (default 1)"
    add("--within", type=positive, default=1.0, metavar="PERCENT", help=within)
    add("--rate", type=positive, default=1000.0, metavar="HZ", help="rows per s (default 1000)")
    add("--speed", type=positive, default=math.inf, metavar="V", help="highest, rad/s (m/s)")
    inertia = "of all that moves, kg m^2 (linear: kg): its torque stays below that of friction"
    add("--inertia", type=positive, default=0.0, metavar="J", help=inertia)
    bandwidth = "of the position loop, which then can follow the motion"
    add("--bandwidth", type=positive, default=math.inf, metavar="HZ", help=bandwidth)
    loop = "quick strokes in the loop: columns as of dahl identify, with units in their names"
    add("--loop", type=Path, metavar="LOG", help=loop)
    add("--reference", metavar="COLUMN", help="its wanted angle; without it give --bandwidth too")
    constant = "N m/A (linear: N/A), if the log has a motor current"
    add("--torque-constant", type=positive, default=0.0, metavar="K", help=constant)
    add("--name", default="excite", help="of the files")
    add("--force", action="store_true", help="overwrite files that are not written by dahl")
    add_output(parser)


def run(args: argparse.Namespace) -> None:
    from dahl.binding import plan_header
    from dahl.identify import design

    wanted, name = _wanted(args), plan_header.identifier(args.name)
    table, played = (args.output / f"{name}{end}" for end in (".csv", ".ini"))
    if not args.force:
        files.refuse_foreign_files((table, played), "use --name, or --force to overwrite it")
    motion = design.propose(wanted)
    if motion.rows > MAX_ROWS:
        raise InputError(
            f"--within {args.within:g}: this needs {motion.cycles} cycles, {motion.seconds:.0f} s;"
            " ask for less, or use a quieter torque sensor"
        )
    args.output.mkdir(parents=True, exist_ok=True)
    written = [_write_csv(table, wanted, motion), _write_scene(played, name, wanted, motion)]
    _print_motion(motion, "m" if args.mm else "rad")
    print("files      " + ", ".join(map(str, written)))


def _print_motion(motion: Motion, unit: str) -> None:
    from dahl.identify.design import PACES, PLACES

    quick, far = motion.rows_per_cycle / motion.rate, motion.amplitude
    print(
        f"motion     strokes of {min(PLACES) * far:.4g} to {far:.4g} {unit} to either side,"
        f" {motion.cycles} cycles of {quick:.4g} to {max(PACES) * quick:.4g} s"
    )
    print(f"reversals  {motion.reversals} in {motion.seconds:.4g} s, {motion.rows} rows")
    for name, part in motion.within.items():
        print(f"expected   {name} within {100 * part:.2g} % (95 %), at best")


def _wanted(args: argparse.Namespace) -> Wanted:
    from dahl.binding.friction import Plan
    from dahl.identify.design import Wanted

    if args.known:
        args.sigma0, args.fc = _known(args.known, args.mm, args.sigma0, args.fc)
    if args.sigma0 is None or args.fc is None:
        raise InputError("a guess is needed: --sigma0 and --fc, or --from JSON")
    turn = 1e-3 if args.mm else 2 * math.pi
    count = turn / args.counts_per_turn
    Plan(args.sigma0, args.fc, count)  # names a parameter that is out of range
    part = args.within / 100
    if args.loop is None and (args.reference or args.torque_constant):
        raise InputError("--reference and --torque-constant describe the log of --loop")
    loop = (args.inertia, args.bandwidth) if args.loop is None else _loop_of(args)
    return Wanted(args.sigma0, args.fc, count, args.noise, part, args.rate, args.speed, *loop)


def _loop_of(args: argparse.Namespace) -> tuple[float, float]:
    """Return inertia and bandwidth by a log of the loop; an option gives what it does not show."""
    from dahl.identify import loop_log

    if (args.reference is None) == math.isinf(args.bandwidth):
        raise InputError(f"--loop {args.loop}: give either --reference or --bandwidth")
    log = _read_loop(args)
    inertia = args.inertia or loop_log.inertia_of(log)
    bandwidth = args.bandwidth
    if args.reference is not None:
        reference = _read_loop(args, args.reference).theta
        bandwidth = loop_log.bandwidth_of(log, reference, inertia)
    print(f"loop       inertia {inertia:.3g} {'kg' if args.mm else 'kg m^2'}, {bandwidth:.3g} Hz")
    return inertia, bandwidth


def _read_loop(args: argparse.Namespace, angle: str = "") -> Log:
    from dahl.io.readers import Source, read

    source = Source(angle=angle, torque_constant=args.torque_constant)
    log = read(args.loop, source, may_restart=False)
    if log.questions or log.linear != args.mm:
        asked = [*log.questions.values(), "are its turns and millimetres those of --mm?"]
        raise InputError(f"{args.loop}: {asked[0]}")
    return log


def _known(
    path: Path,
    linear: bool,
    sigma0: float | None,
    Fc: float | None,  # noqa: N803
) -> tuple[float, float]:
    """Return the claimed numbers of an identification; options give those that are not claimed."""
    found, numbers = files.read_json(path), []
    try:
        if found.get("linear", linear) != linear:
            raise InputError(
                f"{path}: {'turns: leave out' if linear else 'linear motion: give'} --mm"
            )
        for name, option, given in (("sigma0", "--sigma0", sigma0), ("Fc", "--fc", Fc)):
            is_claimed = found["identifiable"][name]
            if is_claimed and given is not None:
                raise InputError(f"--from {path} and {option} {given:g}: one guess, not two")
            if not is_claimed and given is None:
                raise InputError(f"{path}: {name} is not claimed; give a guess of it with {option}")
            numbers.append(given or positive(str(found[name])))
    except (KeyError, TypeError, AttributeError, argparse.ArgumentTypeError):
        raise InputError(f"{path}: not written by dahl identify (sigma0 and Fc)") from None
    return numbers[0], numbers[1]


def _write_csv(path: Path, wanted: Wanted, motion: Motion) -> Path:
    import numpy as np

    from dahl.identify import export

    theta = motion.theta()
    counts = np.round(theta / wanted.theta_per_count)
    columns = (np.arange(len(theta)) / motion.rate, theta, counts)
    export.write_csv(path, columns, "time_s,theta,counts", "%.6f,%.9g,%d")
    return path


def _write_scene(path: Path, name: str, wanted: Wanted, motion: Motion) -> Path:
    from dahl.sim import scene_writer

    file = path.with_suffix(".csv").name
    numbers = ("sigma0", "Fc", "theta_per_count")
    sections = {
        "scene": {"title": f"{name}: a motion for identification"},
        "friction": {key: getattr(wanted, key) for key in numbers},
        "motion": {"kind": "log", "file": file, "angle": "counts", "counts_per_unit": 1},
        **scene_writer.STATUS,
    }
    expected = f"sigma0 expected within {100 * motion.within['sigma0']:.2g} %"
    text = scene_writer.text_of(sections, f"written by dahl excite: {expected}")
    files.write_atomic(path, text)
    return path
