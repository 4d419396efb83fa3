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
    "mdeg": (math.pi / 180e3, False),
    "rad": (1.0, False),
    "mrad": (1e-3, False),
    "urad": (1e-6, False),
    "arcmin": (math.pi / 10800, False),
    "arcsec": (math.pi / 648000, False),
    "gon": (math.pi / 200, False),
    "turn": (2 * math.pi, False),
    "counts": (0.0, False),  # by --counts-per-turn
    "m": (1.0, True),
    "cm": (1e-2, True),
    "mm": (1e-3, True),
    "um": (1e-6, True),
    "in": (0.0254, True),
    "ft": (0.3048, True),
}
TORQUES = {  # N m or N per unit
    "Nm": 1.0,
    "mNm": 1e-3,
    "uNm": 1e-6,
    "cNm": 1e-2,
    "kNm": 1e3,
    "MNm": 1e6,
    "kgfcm": 0.0980665,
    "gfcm": 9.80665e-5,
    "ozin": 0.00706155183,
    "lbin": 0.112984829,
    "lbft": 1.3558179483,
    "N": 1.0,
    "mN": 1e-3,
    "uN": 1e-6,
    "kN": 1e3,
    "MN": 1e6,
    "kgf": 9.80665,
    "gf": 9.80665e-3,
    "lb": 4.4482216153,
    "kip": 4448.2216153,
}
FORCE_UNITS = ("N", "mN", "uN", "kN", "MN", "kgf", "gf", "lb", "kip")
TIMES = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "msec": 1e-3, "us": 1e-6, "ns": 1e-9}  # s per unit
SAME = {
    "second": "s",
    "seconds": "s",
    "millisecond": "ms",
    "milliseconds": "ms",
    "microseconds": "us",
    "degree": "deg",
    "degrees": "deg",
    "°": "deg",
    "radian": "rad",
    "radians": "rad",
    "turns": "turn",
    "rev": "turn",
    "revs": "turn",
    "revolution": "turn",
    "revolutions": "turn",
    "count": "counts",
    "Ncm": "cNm",
    "Nmm": "mNm",
    "ftlb": "lbft",
    "ftlbf": "lbft",
    "lbfft": "lbft",
    "inlb": "lbin",
    "inlbf": "lbin",
    "lbfin": "lbin",
    "inoz": "ozin",
    "ozfin": "ozin",
    "lbf": "lb",
    "kgcm": "kgfcm",
    "gcm": "gfcm",
    "inch": "in",
    "inches": "in",
}
PAIRED = r"lb|oz|nm$"  # two words that are one unit
SIGNS = str.maketrans({**dict.fromkeys(" *-.·⋅"), **dict.fromkeys("µμ", "u")})
BRACKETS = re.compile(r"[\[(]\s*([^\])]+?)\s*[\])]")
TURNS = r"angle|theta"  # what is called so is no length: theta_m is that of the motor
SHORT_LENGTHS = ("m", "in")
COLUMNS = {  # what a column is called when nobody says which one it is
    "angle": r"angle|theta|position|deflection|displacement|encoder|counts?$|winkel|weg(?![a-z])"
    r"|(?<![a-z])pos(?![a-z])",
    "torque": r"torque|friction|force|trq|load|moment|kraft|(?<![a-z])N_?m(?![a-z])",
    # T and T_degC are temperatures
    "time": r"^time|^zeit|^(?-i:t)$|^t[\s_(\[]+[mun]?s(ec|econds)?(?![a-z])",
}

DERIVED = (  # of an angle or a torque, which are none: rates and what a controller lacks
    r"(?<![a-z])(vel|speed|rate|d+ot|acc(el|$|[^a-z])|err(or)?(?![a-z]))|theta_?d+ot"
)
ASKED = r"(?<![a-z])(ref|set|target|cmd|command|desired|demand)"  # what was wanted, not measured
FORCES = r"force|load|kraft"  # which a torque may be called too


def unit_in(name: str, known: Mapping[str, object], default: str) -> str:
    """The unit in a column's name: in brackets, the last ones first, or the last of its words, of
    which two may be one unit, as in torque_ft_lb.
    """
    first, *rest = re.split(r"[\s_]+", name)
    pairs = [one + other for one, other in zip([first, *rest], rest, strict=False)]
    words = [pair for pair in pairs[::-1] if re.search(PAIRED, pair, re.IGNORECASE)]
    words += [*rest[::-1], *([first] if len(first) > 2 else [])]
    if re.search(TURNS, name, re.IGNORECASE):
        words = [word for word in words if word not in SHORT_LENGTHS]
    if BRACKETS.search(name):
        return bracketed(name, known) or default
    return next((unit for word in words if (unit := _known_as(word, known))), default)


def is_unit(word: str) -> bool:
    """Whether a word is a unit of an angle, a torque or a time."""
    return any(_known_as(word, known) for known in (ANGLES, TORQUES, TIMES))


def bracketed(name: str, known: Mapping[str, object]) -> str:
    """The last unit that stands in brackets in a column's name; "" for none."""
    words = BRACKETS.findall(name)[::-1]
    return next((unit for word in words if (unit := _known_as(word, known))), "")


def _known_as(word: str, known: Mapping[str, object]) -> str:
    """The unit that a word means, else that which it means in small letters; "" for none."""
    plain = word.translate(SIGNS)
    plain = SAME.get(plain) or SAME.get(plain.lower(), plain)
    if plain in known:
        return plain
    return next((unit for unit in known if plain.lower() == unit.lower() != "n"), "")


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
) -> tuple[str, list[str]]:
    """The name of a column: the one given (by name, or by number from 1), else the first whose name
    says so, of those that are free for it (all by default); a measured one before one that was
    wanted, a torque before a force. With a note where others say so as well. Raises dahl.Error.
    """
    if given:
        return wanted(given, names, place), []
    free = names if free is None else free
    fitting = [name for name in free if re.search(COLUMNS[what], name, re.IGNORECASE)]
    if what == "time":
        return next(iter(fitting), ""), []
    fitting = [name for name in fitting if not re.search(DERIVED, name, re.IGNORECASE)]
    if not fitting:
        raise Error(
            f"{place}: which column is the {what}? Name it with --{what}{meant(what, names)}"
        )
    first, *others = [one for one in fitting if _doubt(one) == min(map(_doubt, fitting))]
    beside = " or ".join(f"'{one}'" for one in others)
    return first, [f"{what} taken from '{first}', not from {beside} (--{what})"] * bool(others)


def _doubt(name: str) -> int:
    """How much speaks against a column whose name fits: it was wanted, or is a force."""
    return 2 * bool(re.search(ASKED, name, re.I)) + bool(re.search(FORCES, name, re.I))


def wanted(given: str, names: Sequence[str], place: str) -> str:
    """A column by its name, with or without its unit in brackets, or by its number from 1. Raises
    dahl.Error.
    """
    if given in names:
        return given
    without_unit = [name for name in names if BRACKETS.sub("", name).strip() == given.strip()]
    if len(without_unit) == 1:
        return without_unit[0]
    if given.isdecimal() and 1 <= int(given) <= len(names):
        return names[int(given) - 1]
    raise Error(f"{place}: no column '{given}'{meant(given, names)}")
