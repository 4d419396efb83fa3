# SPDX-License-Identifier: MIT
"""Units of angles, torques and times, and how the names of columns spell them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping

from dahl.errors import InputError, meant

DEGREE, POUND, G = math.pi / 180, 4.4482216153, 9.80665  # rad, N, m/s^2
INCH = 0.0254  # m
PREFIXES = {"": 1.0, "m": 1e-3, "u": 1e-6, "k": 1e3, "M": 1e6}
ROTATIONS = {"deg": DEGREE, "mdeg": DEGREE / 1e3, "arcmin": DEGREE / 60, "arcsec": DEGREE / 3600}
ROTATIONS |= {"rad": 1.0, "mrad": 1e-3, "urad": 1e-6, "gon": math.pi / 200, "turn": 2 * math.pi}
ROTATIONS |= {"counts": math.nan}  # rad; the user gives the counts of a turn
LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": INCH, "ft": 12 * INCH}  # m
MOMENTS = {f"{prefix}Nm": size for prefix, size in PREFIXES.items()} | {"cNm": 1e-2}  # N m
MOMENTS |= {"kgfcm": G / 100, "gfcm": G / 1e5, "lbft": POUND * 12 * INCH, "lbin": POUND * INCH}
MOMENTS |= {"ozin": POUND / 16 * INCH}
FORCES = {f"{prefix}N": size for prefix, size in PREFIXES.items()}  # N
FORCES |= {"kgf": G, "gf": G / 1e3, "lb": POUND, "kip": 1e3 * POUND}
CURRENTS = {"A": 1.0, "mA": 1e-3}  # A; a torque constant makes them a torque
ANGLES, TORQUES = ROTATIONS | LENGTHS, MOMENTS | FORCES | CURRENTS
TIMES = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "msec": 1e-3, "us": 1e-6, "ns": 1e-9}  # s
QUANTITIES: dict[str, Mapping[str, float]] = {"angle": ANGLES, "torque": TORQUES, "time": TIMES}

SPELLINGS = {
    "s": "second seconds",
    "sec": "secs",
    "ms": "millisecond milliseconds millis",
    "us": "microseconds micros",
    "ns": "nanosec nanosecs nanoseconds nsecs",
    "deg": "degree degrees °",
    "rad": "radian radians",
    "turn": "turns rev revs revolution revolutions",
    "counts": "count",
    "in": "inch inches",
    "cNm": "Ncm",
    "mNm": "Nmm",
    "lbft": "ftlb ftlbf lbfft",
    "lbin": "inlb inlbf lbfin",
    "ozin": "inoz ozfin",
    "kgfcm": "kgcm",
    "gfcm": "gcm",
    "lb": "lbf",
    "A": "ampere amperes amps",
}
UNIT_OF = {word: unit for unit, words in SPELLINGS.items() for word in words.split()}
OTHER_UNITS = "V mV W °C C K % bar Pa Hz rpm 1/min g kg -".split()  # in a line of units
TWO_WORDS = r"lb|oz|nm$"  # in units of two words, such as ft_lb
IGNORED = str.maketrans({**dict.fromkeys(" *-.·⋅"), **dict.fromkeys("µμ", "u")})
BRACKETS = re.compile(r"[\[(]\s*([^\])]+?)\s*[\])]")
ROTATING = r"angle|theta"  # such a column has no length: theta_m is the angle of the motor
SHORT_LENGTHS = ("m", "in")
SHORT_TIMES = ("ms", "us", "ns")  # that may be the first word too: ms_today


def unit_in(name: str, known: Iterable[str], default: str) -> str:
    """Return the unit in a column's name: the last one in brackets, else the last word.

    Two words may be one unit, as in torque_ft_lb.
    """
    if BRACKETS.search(name):
        return unit_in_brackets(name, known) or default
    first, *rest = re.split(r"[\s_]+", name)
    pairs = [one + other for one, other in zip([first, *rest], rest, strict=False)]
    words = [pair for pair in reversed(pairs) if re.search(TWO_WORDS, pair, re.IGNORECASE)]
    words += [*reversed(rest), *([first] if len(first) > 2 or first in SHORT_TIMES else [])]
    if re.search(ROTATING, name, re.IGNORECASE):
        words = [word for word in words if word not in SHORT_LENGTHS]
    return next((unit for word in words if (unit := _unit(word, known))), default)


def unit_in_brackets(name: str, known: Iterable[str]) -> str:
    """Return the last unit in brackets in a column's name, or ""."""
    words = reversed(BRACKETS.findall(name))
    return next((unit for word in words if (unit := _unit(word, known))), "")


def is_unit(word: str) -> bool:
    """Whether a word is a unit, also of a quantity that identification does not use."""
    return word in OTHER_UNITS or any(_unit(word, known) for known in QUANTITIES.values())


def _unit(word: str, known: Iterable[str]) -> str:
    """Return the unit that a word means, by its exact letters first, or ""."""
    plain = word.translate(IGNORED)
    plain = UNIT_OF.get(plain) or UNIT_OF.get(plain.lower(), plain)
    if plain in known:
        return plain
    return next((unit for unit in known if plain.lower() == unit.lower() not in ("n", "a")), "")


def stated(what: str, given: str, name: str) -> str:
    """Return the unit that an option gives or a column's name has, or ""."""
    return given or unit_in(name, QUANTITIES[what], "")


def choose(what: str, given: str, name: str, usual: str) -> tuple[str, list[str]]:
    """Return the unit of a quantity, and notes: the one given, else that of the column's name.

    The usual unit is assumed with a note if there is neither. Raises dahl.Error for an unknown one.
    """
    known, option = QUANTITIES[what], f"--{what}-unit"
    if given and given not in known:
        raise InputError(f"{option} {given}: no such unit{meant(given, list(known))}")
    unit, notes = stated(what, given, name), []
    if not unit_in(name, known, "") and (other := _other_quantity(what, name)):
        notes = [f"the {what} column '{name}' has a unit of {other}: is it the right column?"]
    if not unit:
        notes.append(f"{what} assumed in {usual}: '{name}' names no unit of it ({option})")
    return unit or usual, notes


def _other_quantity(what: str, name: str) -> str:
    """Return the quantity whose unit a column's name has, if it is not `what`."""
    others = (other for other in QUANTITIES if other != what)
    return next((other for other in others if unit_in(name, QUANTITIES[other], "")), "")
