# SPDX-License-Identifier: MIT
"""What tools/demo.sh sets up suffices for `dahl demo`; the first other command that needs more
brings it, by tools/setup.sh, where this package runs from build/venv of a checkout.
"""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.util import find_spec

from dahl import RunError, paths

NEEDS = {
    "identify": ("scipy", "pandas", "joblib"),
    "excite": ("scipy",),
    "monitor": ("plotext",),
    "report": ("jinja2",),
}
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
