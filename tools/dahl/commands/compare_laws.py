# SPDX-License-Identifier: MIT
"""Scene `compensation` of the demo: laws of friction compensation side by side.

It is a simulation in Python without a bus. Leaves compensation.png and summary.json.
"""

from __future__ import annotations

import argparse
import json
import shlex
from typing import TYPE_CHECKING, Any

from dahl.errors import Error
from dahl.version import __version__

if TYPE_CHECKING:
    from dahl.sim.compensation import Comparison

SCENE = "compensation"
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

    refuse_options(args, SCENE, "has no bus and no log", FOREIGN)
    seed = DEFAULT_SEED if args.seed is None else args.seed
    comparison = _compare_with_progress(seed, console)
    numbers = {"scene": SCENE, "seed": seed, "version": __version__, **comparison.numbers}
    numbers |= {"command": shlex.join(["dahl", *args.words])}
    files.write_atomic(args.output / "summary.json", json.dumps(numbers, indent=2) + "\n")
    picture.draw(args.output / f"{SCENE}.png", comparison)
    console.print(_table(comparison.numbers))
    written = (f"{SCENE}.png", "summary.json")
    console.print("files   " + ", ".join(str(args.output / name) for name in written))
    if args.json:
        print(json.dumps(numbers, indent=2))
    return 0


def refuse_options(
    args: argparse.Namespace, scene: str, reason: str, foreign: tuple[str, ...]
) -> None:
    """Raise dahl.Error if one of these options is given."""
    given = [name for name in foreign if getattr(args, name) is not None]
    if given:
        names = ", ".join("LOG" if one == "log" else f"--{one.replace('_', '-')}" for one in given)
        raise Error(f"--scene {scene} {reason}; leave out {names}")


def _compare_with_progress(seed: int, console: Any) -> Comparison:
    from rich.progress import Progress

    from dahl.sim import compensation

    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("simulate", total=compensation.count_runs())
        return compensation.compare(seed, lambda: progress.advance(task))


def _table(numbers: dict[str, dict[str, dict[str, dict[str, float]]]]) -> Any:
    """Return the ratios of all laws but "none"; a lower one is better."""
    from rich.table import Table

    title = "error over that without compensation (less is better)"
    table = Table(title=title, title_justify="left")
    laws = [law for law in next(iter(numbers["position"].values())) if law != "none"]
    for name in ("axis", "case", *laws):
        table.add_column(name, justify="right" if name in laws else "left")
    for axis, cases in numbers.items():
        for case, values in cases.items():
            table.add_row(axis, case, *(f"{values[law]['ratio']:.3f}" for law in laws))
    return table
