# SPDX-License-Identifier: MIT
"""Scene `park-steer` of the demo: a power steering at standstill, with and without compensation.

Two friction nodes on a bus inside this process. Leaves park-steer.png, run.log (the frames of the
run with compensation) and summary.json.
"""

from __future__ import annotations

import argparse
import json
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dahl.commands.compare_laws import FOREIGN, refuse_options
from dahl.report.simulated import PARK_STEER, table
from dahl.version import __version__

if TYPE_CHECKING:
    from dahl.sim.park_steer import Run

SCENE = PARK_STEER
PICTURE = f"{SCENE}.png"
WRITTEN = (PICTURE, "run.log", "summary.json")


def run(args: argparse.Namespace, console: Any) -> int:
    """Simulate, write the files and print the table. Returns 0."""
    from dahl.io import files
    from dahl.io.candump import candump_line
    from dahl.report import park_steer as picture
    from dahl.report import run_files, terminal

    refuse_options(args, SCENE, "has its own bus and no log", (*FOREIGN, "seed"))
    run_files.remove_earlier(args.output)
    run_files.set_aside(args.output, *WRITTEN)
    plain, assisted = _simulate_with_progress(console)
    columns = {"without": plain.numbers(), "with": assisted.numbers()}
    numbers = {"scene": SCENE, "version": __version__, **columns}
    numbers |= {"command": shlex.join(["dahl", *args.words])}
    picture.draw(args.output / WRITTEN[0], plain, assisted)
    files.write_atomic(args.output / WRITTEN[1], "".join(map(candump_line, assisted.frames)))
    files.write_atomic(args.output / WRITTEN[2], json.dumps(numbers, indent=2) + "\n")
    console.print(terminal.table(table(numbers, args.output)))
    console.print("files   " + ", ".join(str(args.output / name) for name in WRITTEN))
    if args.json:
        print(json.dumps(numbers, indent=2))
    return 0


def draw(path: Path, _: dict[str, Any], console: Any) -> None:
    """Simulate again, and write the picture."""
    from dahl.report import park_steer as picture

    picture.draw(path, *_simulate_with_progress(console))


def _simulate_with_progress(console: Any) -> tuple[Run, Run]:
    """Return the runs without and with compensation."""
    from rich.progress import Progress

    from dahl.sim import park_steer

    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("simulate", total=2 * park_steer.count_ticks())
        return (
            park_steer.simulate(0.0, lambda: progress.advance(task)),
            park_steer.simulate(park_steer.GAIN, lambda: progress.advance(task)),
        )
