# SPDX-License-Identifier: MIT
"""Scene `park-steer` of the demo: a power steering at standstill, with and without compensation.

Two friction nodes on a bus inside this process. Leaves park-steer.png, run.log (the frames of the
run with compensation) and summary.json.
"""

from __future__ import annotations

import argparse
import json
import shlex
from typing import TYPE_CHECKING, Any

from dahl.commands.compare_laws import FOREIGN, refuse_options
from dahl.version import __version__

if TYPE_CHECKING:
    from dahl.sim.park_steer import Run

SCENE = "park-steer"
WRITTEN = (f"{SCENE}.png", "run.log", "summary.json")
ROWS = {
    "width_Nm": "width of the hysteresis loop [N m]",
    "drag_Nm": "of it, viscous drag [N m]",
    "largest_hand_Nm": "largest hand torque [N m]",
    "hand_J": "work of the hand [J]",
    "tyres_J": "work against the tyres [J]",
    "assist_J": "work of the assist [J]",
}


def run(args: argparse.Namespace, console: Any) -> int:
    """Simulate, write the files and print the table. Returns 0."""
    from dahl.io import files
    from dahl.io.candump import candump_line
    from dahl.report import park_steer as picture

    refuse_options(args, SCENE, "has its own bus and no log", (*FOREIGN, "seed"))
    plain, assisted = _simulate_with_progress(console)
    columns = {"without": plain.numbers(), "with": assisted.numbers()}
    numbers = {"scene": SCENE, "version": __version__, **columns}
    numbers |= {"command": shlex.join(["dahl", *args.words])}
    picture.draw(args.output / WRITTEN[0], plain, assisted)
    files.write_atomic(args.output / WRITTEN[1], "".join(map(candump_line, assisted.frames)))
    files.write_atomic(args.output / WRITTEN[2], json.dumps(numbers, indent=2) + "\n")
    console.print(_table(columns))
    console.print("files   " + ", ".join(str(args.output / name) for name in WRITTEN))
    if args.json:
        print(json.dumps(numbers, indent=2))
    return 0


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


def _table(columns: dict[str, dict[str, float]]) -> Any:
    from rich.table import Table

    table = Table()
    table.add_column("one cycle of the hand wheel")
    for name in columns:
        table.add_column(f"{name} assist", justify="right")
    for key, meaning in ROWS.items():
        table.add_row(meaning, *(f"{numbers[key]:.2f}" for numbers in columns.values()))
    return table
