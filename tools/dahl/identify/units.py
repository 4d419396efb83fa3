# SPDX-License-Identifier: MIT
"""Units of angle and torque: what an option says, else what the name of a column says."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

from dahl import Error
from dahl.logs import meant

ANGLES = {  # rad or m per unit, linear or not
    "deg": (math.pi / 180, False),
    "rad": (1.0, False),
    "mrad": (1e-3, False),
    "turn": (2 * math.pi, False),
    "counts": (0.0, False),  # by --counts-per-turn
    "m": (1.0, True),
    "mm": (1e-3, True),
    "um": (1e-6, True),
    "in": (0.0254, True),
}
TORQUES = {  # N m or N per unit
    "Nm": 1.0,
    "mNm": 1e-3,
    "kNm": 1e3,
    "lbin": 0.112984829,
    "lbft": 1.3558179483,
    "N": 1.0,
    "mN": 1e-3,
    "uN": 1e-6,
    "kN": 1e3,
    "lb": 4.4482216153,
    "kip": 4448.2216153,
}
TIMES = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "msec": 1e-3, "us": 1e-6}  # s per unit
SAME = {
    "seconds": "s",
    "degree": "deg",
    "degrees": "deg",
    "°": "deg",
    "count": "counts",
    "µm": "um",
    "µN": "uN",
}
COLUMNS = {  # what a column is called when nobody says which one it is
    "angle": r"angle|theta|position|deflection|displacement|encoder|counts?$"
    r"|(?<![a-z])pos(?![a-z])",
    "torque": r"torque|friction|force|trq|load|moment|(?<![a-z])N_?m(?![a-z])",
    "time": r"^time|^t(?![a-z])",
}


def unit_in(name: str, known: Mapping[str, object], default: str) -> str:
    """The unit in a column's name: in brackets, or the last of its words."""
    bracket = re.search(r"[\[(]\s*([^\])]+?)\s*[\])]", name)
    first, *rest = re.split(r"[\s_]+", name)
    words = [bracket[1]] if bracket else [*rest[::-1], *([first] if len(first) > 2 else [])]
    for word in words:
        plain = SAME.get(word, word).replace(" ", "").replace("*", "").replace("-", "")
        for unit in known:
            if plain == unit or plain.lower() == unit.lower() != "n":
                return unit
    return default


def of(
    what: str, given: str, name: str, known: Mapping[str, object], usual: str
) -> tuple[str, list[str]]:
    """The unit that the user gave, else the one in the column's name, else the usual one, with a
    note that it was assumed. Raises dahl.Error.
    """
    unit = given or unit_in(name, known, "")
    if unit:
        return named(unit, known, f"--{what}-unit"), []
    return usual, [f"{what} taken in {usual}: '{name}' names no unit of it (--{what}-unit)"]


def named(value: str, known: Mapping[str, object], option: str) -> str:
    """A unit that the user gave. Raises dahl.Error with the nearest one."""
    if value not in known:
        raise Error(f"{option} {value}: no such unit{meant(value, list(known))}")
    return value


def column(
    what: str, given: str, names: Sequence[str], place: str, free: Sequence[str] | None = None
) -> str:
    """The name of a column: the one given (by name, or by number from 1), else the first whose name
    says so, of those that are free for it (all by default). Raises dahl.Error.
    """
    if given:
        return wanted(given, names, place)
    free = names if free is None else free
    fitting = [name for name in free if re.search(COLUMNS[what], name, re.IGNORECASE)]
    if fitting or what == "time":
        return fitting[0] if fitting else ""
    raise Error(f"{place}: which column is the {what}? Name it with --{what}{meant(what, names)}")


def wanted(given: str, names: Sequence[str], place: str) -> str:
    """A column by its name, or by its number from 1. Raises dahl.Error."""
    if given in names:
        return given
    if given.isdecimal() and 1 <= int(given) <= len(names):
        return names[int(given) - 1]
    raise Error(f"{place}: no column '{given}'{meant(given, names)}")
