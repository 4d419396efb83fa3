# SPDX-License-Identifier: MIT
"""Numbers on the command line, refused with their limits where argparse reads them."""

from __future__ import annotations

import argparse
from collections.abc import Callable


def whole(low: int, high: int) -> Callable[[str], int]:
    """A type for argparse: an integer from low to high."""

    def read(text: str) -> int:
        if not text.lstrip("-").isdecimal() or not low <= int(text) <= high:
            raise argparse.ArgumentTypeError(f"{text}: not an integer from {low} to {high}")
        return int(text)

    return read


def seconds(text: str) -> float:
    """A type for argparse: a duration."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.001 <= value <= 1e9:
        raise argparse.ArgumentTypeError(f"{text}: not a number from 0.001 to 1e9")
    return value


def add_limits(parser: argparse.ArgumentParser) -> None:
    """--frames and --seconds, after which a client of a bus ends."""
    count = whole(1, 2**63)
    parser.add_argument("--frames", type=count, metavar="N", help="end after N frames")
    parser.add_argument("--seconds", type=seconds, metavar="S", help="end after S seconds")
