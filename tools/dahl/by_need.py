# SPDX-License-Identifier: MIT
"""What tools/demo.sh sets up suffices for `dahl demo`; the first other command that needs more
brings it, by tools/setup.sh, where this package runs from build/venv of a checkout.
"""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.util import find_spec
from types import ModuleType
from typing import cast

from dahl import RunError, paths

NEEDS = {
    "identify": ("scipy", "pandas", "joblib"),
    "excite": ("scipy",),
    "monitor": ("plotext",),
    "report": ("jinja2",),
}
WITHOUT_MF4 = ("demo", "monitor", "record")  # unless a word of the command line ends in .mf4
TRIED = "DAHL_SETUP_TRIED"  # set for the second start, so that there is no third


def bring(command: str, words: list[str]) -> None:
    """Return if the packages of a command are there; else set them up and start it again."""
    lacking = [name for name in NEEDS.get(command, ()) if find_spec(name) is None]
    if not lacking:
        return
    setup = paths.ROOT / "tools" / "setup.sh"
    here = os.path.realpath(sys.prefix) == os.path.realpath(paths.ROOT / "build" / "venv")
    if not here or TRIED in os.environ:
        raise RunError(f"{command} needs Python packages that are not here: {' '.join(lacking)}")
    if subprocess.run([setup, "identify"], stdout=sys.stderr, check=False).returncode:
        raise RunError(f"{command} needs {' '.join(lacking)}; tools/setup.sh identify failed")
    os.execve(sys.executable, [sys.executable, "-m", "dahl", *words], {**os.environ, TRIED: "1"})


def spare_mf4(command: str, words: list[str]) -> None:
    """Leave out asammdf, which python-can imports wherever it is installed: most of the start of a
    command that reads and writes no MF4. For the program, where no other command follows.
    """
    if command in WITHOUT_MF4 and not any(word.lower().endswith(".mf4") for word in words):
        sys.modules.setdefault("asammdf", cast(ModuleType, None))  # its import then fails
