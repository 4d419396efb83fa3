# SPDX-License-Identifier: MIT
"""The error classes of the package: `except dahl.Error` catches all of them."""

from __future__ import annotations


def printable(text: str) -> str:
    """Return the text in one line without control characters, safe to print on a terminal."""
    return "".join(c if c.isprintable() else " " if c.isspace() else "?" for c in text)


class Error(ValueError):
    """An input that the user can correct; one line names value, limit and place.

    Wrong types and unknown keywords raise it too, so `except dahl.Error` is enough for all input.
    """

    def __str__(self) -> str:
        return printable(super().__str__())


class RunError(Error):
    """A run failed for a reason outside the input, for example a lost bus or a missing program.

    Commands exit with 1 instead of 2.
    """


class Timeout(RunError, TimeoutError):
    """No answer came in time. It is also a TimeoutError, like those of sockets and asyncio."""
