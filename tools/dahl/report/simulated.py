# SPDX-License-Identifier: MIT
"""Tables of the scenes that `dahl demo` simulates without dahl-loop: compensation, park-steer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dahl.errors import InputError

COMPENSATION, PARK_STEER = "compensation", "park-steer"  # names of the scenes
COLUMNS = ("without", "with")  # assist, of park-steer
ROWS = {
    "width_Nm": "width of the hysteresis loop [N m]",
    "drag_Nm": "of it, viscous drag [N m]",
    "largest_hand_Nm": "largest hand torque [N m]",
    "hand_J": "work of the hand [J]",
    "tyres_J": "work against the tyres [J]",
    "assist_J": "work of the assist [J]",
}


@dataclass(frozen=True)
class Table:
    """Cells as text; `names` columns at the left are names, the others numbers."""

    title: str
    head: tuple[str, ...]
    rows: list[tuple[str, ...]]
    names: int


def _compensation(numbers: dict[str, Any]) -> Table:
    """Return the ratios of all laws but "none"; a lower one is better."""
    axes = {axis: numbers[axis] for axis in ("position", "hand")}
    laws = tuple(law for law in next(iter(axes["position"].values())) if law != "none")
    rows = [
        (axis, case, *(f"{values[law]['ratio']:.3f}" for law in laws))
        for axis, cases in axes.items()
        for case, values in cases.items()
    ]
    title = "error over that without compensation (less is better)"
    return Table(title, ("axis", "case", *laws), rows, names=2)


def _park_steer(numbers: dict[str, Any]) -> Table:
    columns = [numbers[name] for name in COLUMNS]
    rows = [(text, *(f"{one[key]:.2f}" for one in columns)) for key, text in ROWS.items()]
    head = ("one cycle of the hand wheel", *(f"{name} assist" for name in COLUMNS))
    return Table("", head, rows, names=1)


TABLES: dict[str, Callable[[dict[str, Any]], Table]] = {
    COMPENSATION: _compensation,
    PARK_STEER: _park_steer,
}


def is_simulated(numbers: dict[str, Any]) -> bool:
    """Return whether a summary is that of such a scene."""
    return str(numbers.get("scene")) in TABLES and "scene_file" not in numbers


def table(numbers: dict[str, Any], path: Path) -> Table:
    """Return the table of a summary. Raises dahl.Error if a number is missing; any program may have
    written the file.
    """
    name = str(numbers["scene"])
    try:
        return TABLES[name](numbers)
    except (KeyError, TypeError, ValueError, AttributeError, StopIteration) as error:
        raise InputError(f"{path}: not the numbers of scene {name} ({error!r})") from None
