# SPDX-License-Identifier: MIT
"""Start dahl-loop: as a child of this process for a run file, or in place of this process as the
command `dahl-loop` of an installed package.
"""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING, Any

from dahl import paths
from dahl.errors import RunError

if TYPE_CHECKING:
    from dahl.sim.run_file import RunFile


def start(run: RunFile, *options: object, **how: Any) -> subprocess.Popen[Any]:
    """Start dahl-loop, which writes its counters into the run file and ends with this process.
    `how` are arguments of subprocess.Popen.
    """
    words = [paths.loop_program(), run.path, "--counters", run.counters]
    words += ["--with-parent", os.getpid(), *options]
    return subprocess.Popen([str(word) for word in words], pass_fds=run.fds, **how)


def main() -> str:
    """Return only if the program cannot start, with the line to print."""
    try:
        program = paths.loop_program()
        os.execv(program, ["dahl-loop", *sys.argv[1:]])
    except RunError as error:
        return f"error: {error}"
    except OSError as error:
        return f"error: {program}: {error.strerror}"
