# SPDX-License-Identifier: MIT
"""Types of argparse for numbers: a number out of range is an error that names its limits."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable
from pathlib import Path

from dahl import paths

DEFAULT_SEED, MAX_SEED = 1, 2**64 - 1


def whole(low: int, high: int) -> Callable[[str], int]:
    """Return a type of argparse: an integer from low to high."""

    def read(text: str) -> int:
        if not re.fullmatch(r"-?\d{1,30}", text) or not low <= int(text) <= high:
            raise argparse.ArgumentTypeError(f"{text}: not an integer from {low} to {high}")
        return int(text)

    return read


def comma_hint(text: str) -> str:
    """Return the end of an error about a number with a comma, "" if it has none."""
    return "; the decimal sign is a point" if re.search(r"\d,\d", text) else ""


def number(text: str) -> float:
    """Parse any number, also infinity and NaN."""
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text}: not a number{comma_hint(text)}") from None


def finite(text: str) -> float:
    """Parse a finite number."""
    return _number(text, -1e30, 1e30)


def seconds(text: str) -> float:
    """Parse a duration in s."""
    return _number(text, 0.001, 1e9)


def positive(text: str) -> float:
    """Parse a number above 0."""
    return _number(text, 1e-30, 1e30)


def _number(text: str, low: float, high: float) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        limits = f"from {low:g} to {high:g}"
        raise argparse.ArgumentTypeError(f"{text}: not a number {limits}{comma_hint(text)}")
    return value


def add_output(parser: argparse._ActionsContainer) -> None:
    """-o, the folder that identification leaves its files in."""
    folder = paths.OUTPUT / "identify"
    parser.add_argument(
        "-o", "--output", type=Path, default=folder, metavar="FOLDER", help="where files go"
    )


def add_limits(parser: argparse._ActionsContainer) -> None:
    """--frames and --seconds, after which a client of a bus ends."""
    count = whole(1, 2**63)
    parser.add_argument("--frames", type=count, metavar="N", help="end after N frames")
    parser.add_argument("--seconds", type=seconds, metavar="S", help="end after S seconds")
