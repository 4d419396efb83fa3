# SPDX-License-Identifier: MIT
"""The error classes of the package: `except dahl.Error` catches all of them. A wrong type of an
argument, and an argument that a call does not have, is a TypeError.
"""

from __future__ import annotations

TYPE_CHECKING = False  # importing typing would double the time of `dahl --help`
if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

MAX_LISTED_NAMES = 30  # in an error


def nearest(word: str, known: Sequence[str], cutoff: float) -> str:
    """Return the known word nearest to a word in any case; "" if none is near."""
    import difflib

    lower = {one.lower(): one for one in known}
    near = difflib.get_close_matches(word.lower(), lower, n=1, cutoff=cutoff)
    return lower[near[0]] if near else ""


def meant(name: str, known: Sequence[str]) -> str:
    """Return the end of an error about an unknown name: the nearest known one, and all of them."""
    near = nearest(name, known, cutoff=0.4)
    hint = f"; did you mean '{near}'?" if near else ""
    more = len(known) - MAX_LISTED_NAMES
    shown = ", ".join(known[:MAX_LISTED_NAMES]) + (f", and {more} more" if more > 0 else "")
    return f"{hint} (known: {shown})"


def printable(text: str) -> str:
    """Return the text in one line without control characters, safe to print on a terminal."""
    return "".join(c if c.isprintable() else " " if c.isspace() else "?" for c in text)


def hide(excinfo: Any) -> bool:
    """Return whether pytest hides the frames of a module from a traceback, if its
    __tracebackhide__ is this function: an error of dahl points at the line of the test.
    """
    return excinfo is not None and isinstance(excinfo.value, Error)


class Error(Exception):
    """Base of all errors."""

    def __str__(self) -> str:
        return printable(super().__str__())


class InputError(Error, ValueError):
    """A value that the user can correct; one line names value, limit and place. Commands exit with
    2.
    """


class RunError(Error):
    """A run failed for a reason outside the input, for example a missing program.

    Commands exit with 1 instead of 2.
    """


class BusError(RunError, ConnectionError):
    """A bus does not open, is lost, or refuses a frame. It is also a ConnectionError and OSError,
    like those of sockets.
    """


class Timeout(RunError, TimeoutError):
    """No answer came in time. It is also a TimeoutError, like those of sockets and asyncio."""
