# SPDX-License-Identifier: MIT
"""Sections and keys of scenes and run files: the table of host_sim/keys.csv, and the numbers that
one friction model has as its own key (DAHL_MODELS). tools/generators/run_keys.py lists its columns.

A scene is for people, and only this package reads it. A run file is what dahl-loop reads: one line
`section.key = value` for each key, without the keys that only a scene has.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass

from dahl import paths
from dahl.binding import models


@dataclass(frozen=True)
class Key:
    """One key of a section. low and high are both allowed; of a number, or of each in a list."""

    section: str
    name: str
    type: str  # NUMBER, WHOLE, LIST or TEXT
    need: str  # REQUIRED if the section is there, OPTIONAL, or OWN: of one friction model
    low: float = 0
    high: float = 0
    default: float | str = ""
    is_of_scene: bool = False  # a run file does not have it
    of: str = ""  # kinds of [motion] that have the key, or counters of the node that a fault raises

    @property
    def place(self) -> str:
        return f"[{self.section}] {self.name}"


def _key(row: dict[str, str]) -> Key:
    is_text = row["type"] in ("TEXT", "LIST")
    default: float | str = row["default"] if is_text else float(row["default"])
    low, high = (float(row[name] or 0) for name in ("low", "high"))
    section, name, kind, need = (row[name] for name in ("section", "key", "type", "need"))
    return Key(section, name, kind, need, low, high, default, row["in"] == "scene", row["of"])


def _read() -> tuple[dict[str, str], list[Key]]:
    """Return the sections, with those that each needs, and all keys."""
    with paths.KEYS.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    owners = [model for model in models.table().values() if model.has_own_number]
    own = [Key("friction", one.key, "NUMBER", "OWN", one.low, one.high, 0.0) for one in owners]
    sections = {row["section"]: row["of"] for row in rows if not row["key"]}
    return sections, [_key(row) for row in rows if row["key"]] + own


SECTIONS, _ROWS = _read()
KEYS = {(key.section, key.name): key for key in _ROWS}


def names(section: str) -> tuple[str, ...]:
    """Return the names of all keys of a section, in the order of the table."""
    return tuple(name for place, name in KEYS if place == section)


def node_settings() -> tuple[str, ...]:
    """Return the keys of [friction] that set a node and not its friction: the optional numbers."""
    return tuple(
        key.name
        for key in _ROWS
        if (key.section, key.need) == ("friction", "OPTIONAL")
        and key.type != "TEXT"
        and key.name != "node"
    )
