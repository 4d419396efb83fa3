# SPDX-License-Identifier: MIT
"""The command `dahl-loop` of an installed package: replace this process by the compiled program."""

from __future__ import annotations

import os
import sys

from dahl import paths
from dahl.errors import RunError


def main() -> str:
    """Return only if the program cannot start, with the line to print."""
    try:
        program = paths.loop_program()
        os.execv(program, ["dahl-loop", *sys.argv[1:]])
    except RunError as error:
        return f"error: {error}"
    except OSError as error:
        return f"error: {program}: {error.strerror}"
