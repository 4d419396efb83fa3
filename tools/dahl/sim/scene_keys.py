# SPDX-License-Identifier: MIT
"""Sections, keys and faults of scene files.

They are read from host_sim/scene_keys.def, from which dahl-loop is compiled too.
"""

from __future__ import annotations

import csv
import functools
import re
from dataclasses import dataclass

from dahl import paths

ROW = re.compile(r"^SCENE_([A-Z_]+)\((.*)\)$", re.MULTILINE)


@dataclass(frozen=True)
class Key:
    """One key of a section. low and high are both allowed; of a number, or of each in a list."""

    section: str
    name: str
    type: str  # NUMBER, WHOLE, LIST or TEXT
    low: float
    high: float
    need: str  # REQUIRED if the section is there, OPTIONAL, or OWN: of one friction model
    default: float


@functools.cache
def _text() -> str:
    return (paths.SIM / "scene_keys.def").read_text("utf-8")


def rows(table: str) -> list[list[str]]:
    """Return the cells of all rows of a table: SECTION, KEY, FAULT or PLOT_KEY."""
    lines = [cells for name, cells in ROW.findall(_text()) if name == table]
    return list(csv.reader(lines, skipinitialspace=True))


@functools.cache
def text_size() -> int:
    """Return the bytes of a text in dahl-loop, with its final 0."""
    found = re.search(r"#define SCENE_TEXT (\d+)u", _text())
    assert found is not None
    return int(found[1])


@functools.cache
def keys() -> dict[tuple[str, str], Key]:
    """Return all keys that dahl-loop reads, by section and name."""
    found = [_key(*cells) for cells in rows("KEY")]
    found += [
        Key("faults", name, "NUMBER", 0.0, 1.0, need="OPTIONAL", default=0.0)
        for _, name, *_ in rows("FAULT")
    ]
    return {(key.section, key.name): key for key in found}


def _key(*cells: str) -> Key:
    section, name, _, kind, low, high, need, _, _, default, _ = cells
    numbers = (_number(low), _number(high))
    return Key(section, name, kind, *numbers, need, _number(default))


def _number(literal: str) -> float:
    return float.fromhex(literal) if "0x" in literal else float(literal)


@functools.cache
def plot_keys() -> dict[tuple[str, str], str]:
    """Return the defaults of the keys that only dahl plot reads, by section and name."""
    return {(section, name): default for section, name, _, default, _ in rows("PLOT_KEY")}


def names(section: str) -> tuple[str, ...]:
    """Return the names of all keys of a section, in the order of the table."""
    return tuple(name for place, name in (*keys(), *plot_keys()) if place == section)


def node_settings() -> tuple[str, ...]:
    """Return the keys of [friction] that set a node and not its friction: the optional numbers."""
    return tuple(
        key.name
        for key in keys().values()
        if (key.section, key.need) == ("friction", "OPTIONAL")
        and key.type != "TEXT"
        and key.name != "node"
    )
