# SPDX-License-Identifier: MIT
"""Scene `compensation` of the demo: laws of friction compensation side by side.

It is a simulation in Python without a bus. Leaves compensation.png and summary.json.
"""

from __future__ import annotations

import argparse
import json
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dahl.errors import InputError
from dahl.report.simulated import COMPENSATION, table
from dahl.version import __version__

if TYPE_CHECKING:
    from dahl.sim.compensation import Comparison

SCENE = COMPENSATION
PICTURE = f"{SCENE}.png"
DEFAULT_SEED = 1
# Options of a run on a bus or of a user's own log.
FOREIGN = (
    *("log", "angle", "torque", "time", "sigma0", "fc", "counts_per_turn", "angle_unit"),
    *("torque_scale", "offset", "spring", "bus", "target", "seconds"),
)


def run(args: argparse.Namespace, console: Any) -> int:
    """Simulate, write both files and print the ratios. Returns 0."""
    from dahl.io import files
    from dahl.report import compensation as picture
    from dahl.report import run_files, terminal

    refuse_options(args, SCENE, "has no bus and no log", FOREIGN)
    seed = DEFAULT_SEED if args.seed is None else args.seed
    run_files.remove_earlier(args.output)
    written = (PICTURE, "summary.json")
    run_files.set_aside(args.output, *written)
    comparison = _compare_with_progress(seed, console)
    numbers = {"scene": SCENE, "seed": seed, "version": __version__, **comparison.numbers}
    numbers |= {"command": shlex.join(["dahl", *args.words])}
    files.write_atomic(args.output / "summary.json", json.dumps(numbers, indent=2) + "\n")
    picture.draw(args.output / PICTURE, comparison)
    console.print(terminal.table(table(numbers, args.output)))
    console.print("files   " + ", ".join(str(args.output / name) for name in written))
    if args.json:
        print(json.dumps(numbers, indent=2))
    return 0


def draw(path: Path, numbers: dict[str, Any], console: Any) -> None:
    """Simulate again with the seed of a summary, and write the picture. Raises dahl.Error."""
    from dahl.report import compensation as picture

    seed = numbers.get("seed", DEFAULT_SEED)
    if not isinstance(seed, int) or not 0 <= seed < 2**64:
        place = path.with_name("summary.json")
        raise InputError(f"{place}: seed = {seed}: a number from 0 to 2^64 - 1 was expected")
    picture.draw(path, _compare_with_progress(seed, console))


def refuse_options(
    args: argparse.Namespace, scene: str, reason: str, foreign: tuple[str, ...]
) -> None:
    """Raise dahl.Error if one of these options is given."""
    given = [name for name in foreign if getattr(args, name) is not None]
    if given:
        names = ", ".join("LOG" if one == "log" else f"--{one.replace('_', '-')}" for one in given)
        raise InputError(f"--scene {scene} {reason}; leave out {names}")


def _compare_with_progress(seed: int, console: Any) -> Comparison:
    from rich.progress import Progress

    from dahl.sim import compensation

    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("simulate", total=compensation.count_runs())
        return compensation.compare(seed, lambda: progress.advance(task))
