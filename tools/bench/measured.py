# SPDX-License-Identifier: MIT
"""How near each model comes to measured friction, and what a tick of it costs: R2 on blocks of a
log that were not fitted, against instructions on Cortex-M3.

Each model is a sum of unit elements over the path, with an offset and a spring in all of them.
Their presliding lengths are of one grid; scipy's nnls finds the torques on the blocks for training,
and the elements that a model may have are picked one after the other, each time the one that helps
most there. Where a log is not in reach it is named, and what docs/ shows stays. (The pneumatic logs
are not here: they have spikes and gaps, which `dahl identify` cleans first.)
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import dahl
import numpy as np
import pandas
from dahl import data
from matplotlib.figure import Figure
from scipy.optimize import nnls
from target import BenchError

MARKS = ("<!-- bench:measured -->", "<!-- /bench:measured -->")
BLOCKS = 20  # of a log; every other one is fitted
GRID = 24  # presliding lengths, from a count to the whole motion
COUNTS = 2**16  # of the whole motion: its path as the library takes it


@dataclass(frozen=True)
class Source:
    """One measured log: where it is, and its columns of angle and torque."""

    title: str
    folder: str
    file: str
    read: Callable[[Path], tuple[np.ndarray, np.ndarray]]


def columns(angle: str | int, torque: str | int, **how: Any) -> Callable[[Path], Any]:
    """From a table of text."""

    def read(path: Path) -> tuple[np.ndarray, np.ndarray]:
        table = pandas.read_csv(path, **how)
        return table[angle].to_numpy(float), table[torque].to_numpy(float)

    return read


def rows(angle: int, torque: int) -> Callable[[Path], Any]:
    """From the rows of a JSON file."""

    def read(path: Path) -> tuple[np.ndarray, np.ndarray]:
        table = np.array(json.loads(path.read_text())["data"], float)
        return table[:, angle], table[:, torque]

    return read


DAMPERS = ("dataset-1_0.5Hz80lbtension", "dataset-3_0.5Hz30lbtension0.5amplitude")
SOURCES = (
    Source(
        "tribometer",
        "tribometer",
        "reciprocating.tsv",
        columns("Position [mm]", "Friction [uN]", sep="\t"),
    ),
    Source(
        "cycloidal, play",
        "cycloidal",
        "play_test1.csv",
        columns("deflection_deg", "torque_Nm"),
    ),
    Source(
        "cycloidal, stiffness",
        "cycloidal",
        "stiffness_test1.csv",
        columns("deflection_deg", "torque_Nm"),
    ),
    Source("steel damper", "nested_loops", "damper1.csv", columns(0, 1, header=None)),
    Source("band brake, set 1", "friction_damper", f"{DAMPERS[0]}.json", rows(1, 2)),
    Source("band brake, set 3", "friction_damper", f"{DAMPERS[1]}.json", rows(1, 2)),
)
MODELS = {  # elements of each kind at most, and the case of target.json that it costs
    "Coulomb": ("coulomb", 1, "coulomb"),
    "Dahl": ("dahl", 1, "one_count_q30"),
    "LuGre, Euler steps": ("lugre", 1, "euler"),
    "slip, 1": ("slip", 1, "slip_1_q30"),
    "slip, 2": ("slip", 2, "slip_2_q30"),
    "slip, 4": ("slip", 4, "slip_4_q30"),
    "Dahl and slip, 4": ("mixed", 4, "parallel_4"),
}


def responses(angle: np.ndarray) -> dict[str, np.ndarray]:
    """Of each kind the torques over Fc of unit elements along the path, a column for each length of
    the grid.
    """
    span = np.ptp(angle)
    place = np.rint((angle - angle[0]) / span * COUNTS).astype(np.int64)
    moves = np.diff(place, prepend=0).astype(np.int32)
    lengths = np.geomspace(COUNTS / 500, COUNTS, GRID)
    by_dahl = [dahl.Throughput(1.0, 1.0, 1 / n).run_counts(moves) for n in lengths]
    by_slip = [dahl.ThroughputSlip([1.0], [1.0], 1 / n).run_counts(moves) for n in lengths]
    steps = np.sign(moves).astype(float)
    held = pandas.Series(np.where(steps == 0, np.nan, steps)).ffill().fillna(0).to_numpy()
    found = {
        "coulomb": held[:, None],
        "dahl": np.column_stack(by_dahl),
        "slip": np.column_stack(by_slip),
        "lugre": np.column_stack([lugre(moves, n) for n in lengths]),
    }
    return found | {"mixed": np.hstack([found["dahl"], found["slip"]])}


def lugre(moves: np.ndarray, length: float) -> np.ndarray:
    """z over its largest value by a step of Euler's method a row; a step that would pass it ends
    there.
    """
    z, found = 0.0, []
    for u in (moves / length).tolist():
        z = min(1.0, max(-1.0, z + u - abs(u) * z))
        found.append(z)
    return np.array(found)


def fitted(elements: np.ndarray, beside: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """Torques of the elements, none negative, and of what stands beside them, of either sign."""
    found: np.ndarray = nnls(np.hstack([elements, beside, -beside]), torque)[0]
    count, more = elements.shape[1], beside.shape[1]
    return np.concatenate([found[:count], found[count : count + more] - found[count + more :]])


def picked(kind: np.ndarray, most: int, beside: np.ndarray, torque: np.ndarray) -> list[int]:
    """The elements of a model, one after the other, each time the one that leaves least. The
    triangle of the QR decomposition has the same sums of squares in a few rows.
    """
    whole: np.ndarray = np.asarray(np.linalg.qr(np.column_stack([kind, beside, torque]), mode="r"))
    units, others, wanted = np.split(whole, [kind.shape[1], whole.shape[1] - 1], axis=1)

    def left(some: list[int]) -> float:
        few = units[:, some]
        rest = wanted[:, 0] - np.hstack([few, others]) @ fitted(few, others, wanted[:, 0])
        return float(rest @ rest)

    chosen: list[int] = []
    for _ in range(min(most, kind.shape[1])):
        free = [k for k in range(kind.shape[1]) if k not in chosen]
        chosen.append(min(free, key=lambda k: left([*chosen, k])))
    return chosen


def held_out(kind: np.ndarray, most: int, angle: np.ndarray, torque: np.ndarray) -> float:
    """R2 on the blocks that were not fitted."""
    train = (np.arange(len(torque)) * BLOCKS // len(torque)) % 2 == 0
    beside = np.column_stack([np.ones(len(angle)), (angle - angle.mean()) / np.ptp(angle)])
    few = kind[:, picked(kind[train], most, beside[train], torque[train])]
    found = fitted(few[train], beside[train], torque[train])
    rest = (torque - np.hstack([few, beside]) @ found)[~train]
    return 1 - float(np.sum(rest**2) / np.sum((torque[~train] - torque[~train].mean()) ** 2))


def score(angle: np.ndarray, torque: np.ndarray) -> dict[str, float]:
    """R2 of each model on one log, whose torque is made to have the sign of the motion."""
    units = responses(angle)
    sign = 1.0 if np.sum(torque * units["coulomb"][:, 0]) >= 0 else -1.0
    scale = sign / np.std(torque)
    return {
        title: round(held_out(units[kind], most, angle, torque * scale), 4)
        for title, (kind, most, _) in MODELS.items()
    }


def measure() -> dict[str, dict[str, float]]:
    """R2 by log and by model. Raises BenchError naming the first log that is not in reach."""
    result = {}
    for source in SOURCES:
        folder = data.local_folder(source.folder)
        path = (folder or Path(source.folder)) / source.file
        if not path.is_file():
            raise BenchError(f"{source.folder}/{source.file} is not in reach (dahl data)")
        result[source.title] = score(*source.read(path))
    return result


def block(scores: dict[str, dict[str, float]], target: dict[str, Any]) -> str:
    """The table of docs/speed.md."""
    lines = [
        "| R2 on blocks that were not fitted | instructions, M3 | " + " | ".join(scores) + " |",
        "|---|---:" + "|---:" * len(scores) + "|",
    ]
    for title, (_, _, case) in MODELS.items():
        cells = (f"{r2[title]:.4f}".lstrip("0") for r2 in scores.values())
        lines.append(f"| {title} | {target['m3'].get(case, '-')} | {' | '.join(cells)} |")
    return "\n".join([MARKS[0], *lines, MARKS[1]])


def picture(scores: dict[str, dict[str, float]], target: dict[str, Any]) -> Figure:
    """What is left of the measured torque's spread, over the instructions of a tick."""
    figure = Figure(figsize=(9, 5), layout="constrained")
    axes = figure.subplots()
    costs = {title: target["m3"][case] for title, (_, _, case) in MODELS.items()}
    order = sorted(costs, key=lambda title: costs[title])
    for name, r2 in scores.items():
        rest = [(1 - r2[title]) ** 0.5 for title in order]
        axes.plot([costs[title] for title in order], rest, "o-", label=name)
    for title in order:
        axes.annotate(title, (costs[title], 1), xycoords=("data", "axes fraction"), rotation=60)
    axes.set(xscale="log", yscale="log", xlabel="instructions a tick, Cortex-M3")
    axes.set_ylabel("error on the measured torque / its spread")
    figure.legend(loc="outside right upper")
    return figure
