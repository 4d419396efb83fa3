# SPDX-License-Identifier: MIT
"""Compare friction models with measured logs: R2 against instructions on a Cortex-M3.

Each model is a sum of unit elements over the path, plus an offset and a spring. The presliding
lengths form a grid. nnls of SciPy finds the torques on the training blocks of a log; R2 is computed
on the other blocks. Elements are added one at a time: each time the one that reduces the residual
most. If a log is missing, its name is printed and docs/ keeps its table.
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
from dahl.io import data
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.ndimage import median_filter
from scipy.optimize import nnls
from target import BenchError

MARKS = ("<!-- bench:measured -->", "<!-- /bench:measured -->")
BLOCKS = 50  # blocks of a log, many more than cycles; every other one is for training
GRID = 24  # presliding lengths, from a count to the whole motion
COUNTS = 2**16  # of the whole motion: the resolution of the path
SPIKES = 15  # rows of the running median that removes the spikes of a laser


@dataclass(frozen=True)
class Source:
    """One measured log: its file, and its columns of angle and torque."""

    title: str
    folder: str
    file: str
    read: Callable[[Path], tuple[np.ndarray, np.ndarray]]


def columns(angle: str | int, torque: str | int, **how: Any) -> Callable[[Path], Any]:
    """Read a text table."""

    def read(path: Path) -> tuple[np.ndarray, np.ndarray]:
        table = pandas.read_csv(path, **how)
        return table[angle].to_numpy(float), table[torque].to_numpy(float)

    return read


def without_spikes(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read a pneumatic log: position of a laser, and force."""
    position, force = columns(4, 6, sep="\t", header=None)(path)
    return median_filter(position, SPIKES, mode="nearest"), force


def rows(angle: int, torque: int) -> Callable[[Path], Any]:
    """Read the rows of a JSON file."""

    def read(path: Path) -> tuple[np.ndarray, np.ndarray]:
        table = np.array(json.loads(path.read_text())["data"], float)
        return table[:, angle], table[:, torque]

    return read


TRIBOMETER = columns("Position [mm]", "Friction [uN]", sep="\t")
CYCLOIDAL = columns("deflection_deg", "torque_Nm")
DAMPERS = {
    "set 1": "dataset-1_0.5Hz80lbtension",
    "set 3": "dataset-3_0.5Hz30lbtension0.5amplitude",
    "set 4, load moves": "dataset-4_harmonic0.015forward",
}
SOURCES = (
    Source("tribometer", "tribometer", "reciprocating.tsv", TRIBOMETER),
    *(
        Source(f"cycloidal drive, {test} {n}", "cycloidal", f"{test}_test{n}.csv", CYCLOIDAL)
        for test, n in (("play", 1), ("play", 2), ("play", 3), ("stiffness", 1), ("stiffness", 2))
    ),
    Source("steel damper", "nested_loops", "damper1.csv", columns(0, 1, header=None)),
    *(
        Source(f"band brake, {name}", "friction_damper", f"{file}.json", rows(1, 2))
        for name, file in DAMPERS.items()
    ),
    *(
        Source(
            f"pneumatic seal, {ring} {bar} bar", "pneumatic", f"{ring}_{bar}bar.csv", without_spikes
        )
        for ring, bar in (("Circle", 1), ("Circle", 5), ("PK", 3))
    ),
)
MODELS = {  # maximum of elements of each kind, and the case of target.json with the cost
    "Coulomb": ("coulomb", 1, "coulomb"),
    "Dahl": ("dahl", 1, "one_count_q30"),
    "LuGre, Euler steps": ("lugre", 1, "euler"),
    "slip, 1": ("slip", 1, "slip_1_q30"),
    "slip, 2": ("slip", 2, "slip_2_q30"),
    "slip, 4": ("slip", 4, "slip_4_q30"),
    "Dahl and slip, 4": ("mixed", 4, "mixed_4_q30"),
}


def responses(angle: np.ndarray) -> dict[str, np.ndarray]:
    """Return F/Fc of unit elements along the path, by kind: one column for each length of the
    grid.
    """
    span = np.ptp(angle)
    place = np.rint((angle - angle[0]) / span * COUNTS).astype(np.int64)
    moves = np.diff(place, prepend=0).astype(np.int32)
    lengths = np.geomspace(COUNTS / 500, COUNTS, GRID)
    by_dahl = [dahl.Throughput(1.0, 1.0, 1 / n).run_counts(moves) for n in lengths]
    by_slip = [dahl.Slip([1.0], [1.0], 1 / n).run_counts(moves) for n in lengths]
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
    """Return z over its largest value, with one Euler step for each row. A step that would exceed
    the largest value is cut there.
    """
    z, found = 0.0, []
    for u in (moves / length).tolist():
        z = min(1.0, max(-1.0, z + u - abs(u) * z))
        found.append(z)
    return np.array(found)


def fitted(elements: np.ndarray, beside: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """Return the torques of the elements, at least 0, and the coefficients of offset and spring."""
    found: np.ndarray = nnls(np.hstack([elements, beside, -beside]), torque)[0]
    count, more = elements.shape[1], beside.shape[1]
    return np.concatenate([found[:count], found[count : count + more] - found[count + more :]])


def picked(kind: np.ndarray, most: int, beside: np.ndarray, torque: np.ndarray) -> list[int]:
    """Select the elements of a model one at a time: each time the one with the least residual. The
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
    """Return R2 on the blocks that are not for training."""
    train = (np.arange(len(torque)) * BLOCKS // len(torque)) % 2 == 0
    beside = np.column_stack([np.ones(len(angle)), (angle - angle.mean()) / np.ptp(angle)])
    few = kind[:, picked(kind[train], most, beside[train], torque[train])]
    found = fitted(few[train], beside[train], torque[train])
    rest = (torque - np.hstack([few, beside]) @ found)[~train]
    return 1 - float(np.sum(rest**2) / np.sum((torque[~train] - torque[~train].mean()) ** 2))


def score(angle: np.ndarray, torque: np.ndarray) -> dict[str, float]:
    """Return R2 of each model on one log. The torque gets the sign of the motion first, as Dahl
    elements have it.
    """
    units = responses(angle)
    sign = 1.0 if (torque - torque.mean()) @ units["dahl"].mean(axis=1) >= 0 else -1.0
    scale = sign / np.std(torque)
    return {
        title: round(held_out(units[kind], most, angle, torque * scale), 4)
        for title, (kind, most, _) in MODELS.items()
    }


def measure() -> dict[str, dict[str, float]]:
    """Return R2 by log and by model. Raise BenchError with the name of the first missing log."""
    result = {}
    for source in SOURCES:
        folder = data.local_folder(source.folder)
        path = (folder or Path(source.folder)) / source.file
        if not path.is_file():
            raise BenchError(f"{source.folder}/{source.file} is not in reach (dahl data)")
        result[source.title] = score(*source.read(path))
    return result


def block(scores: dict[str, dict[str, float]], target: dict[str, Any]) -> str:
    """Return the table of docs/speed.md."""
    costs = (str(target["m3"].get(case, "-")) for _, _, case in MODELS.values())
    lines = [
        f"| R2 on blocks that were not fitted | {' | '.join(MODELS)} |",
        "|---|" + "---:|" * len(MODELS),
        f"| *instructions a tick, Cortex-M3* | {' | '.join(costs)} |",
    ]
    for name, r2 in scores.items():
        cells = (f"{r2[title]:.4f}".lstrip("0") for title in MODELS)
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join([MARKS[0], *lines, MARKS[1]])


def draw_machine(panel: Axes, logs: dict[str, dict[str, float]], costs: dict[str, int]) -> None:
    """Draw a point for each model and log of a machine, and a line at the least value so far."""
    order = sorted(costs, key=lambda title: costs[title])
    x = [costs[title] for title in order]
    for name, r2 in logs.items():
        rest = np.sqrt([1 - r2[title] for title in order])
        points = panel.plot(x, rest, "o", ms=5, label=name)[0]
        panel.step(x, np.minimum.accumulate(rest), where="post", color=points.get_color(), lw=1)
    panel.set(xscale="log", yscale="log")
    panel.set_xticks(x, [f"{title} ({costs[title]})" for title in order], rotation=90, fontsize=8)
    panel.set_yticks([0.05, 0.1, 0.2, 0.5, 1.0], ["0.05", "0.1", "0.2", "0.5", "1"])
    panel.set_ylim(top=1.6)
    panel.minorticks_off()
    panel.grid(alpha=0.3)
    if len(logs) > 1:
        panel.legend(fontsize=8, loc="upper right")


def picture(scores: dict[str, dict[str, float]], target: dict[str, Any]) -> Figure:
    """Draw the unexplained share of the torque over the instructions of a tick. Each machine has a
    panel; its name is the part of a log's name before the comma.
    """
    machines: dict[str, dict[str, dict[str, float]]] = {}
    for title, r2 in scores.items():
        machine, _, log = title.partition(", ")
        machines.setdefault(machine, {})[log or machine] = r2
    costs = {title: target["m3"][case] for title, (_, _, case) in MODELS.items()}
    wide = min(3, len(machines))
    high = -(-len(machines) // wide)
    figure = Figure(figsize=(4 * wide, 4.2 * high), layout="constrained")
    panels = figure.subplots(high, wide, sharey=True, squeeze=False).ravel()
    for panel, (machine, logs) in zip(panels, machines.items(), strict=False):
        draw_machine(panel, logs, costs)
        panel.set_title(machine)
    for panel in panels[len(machines) :]:
        panel.remove()
    figure.supylabel("error on the measured torque / its spread")
    figure.supxlabel("model (instructions a tick, Cortex-M3); lines: the best so far")
    return figure
