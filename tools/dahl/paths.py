# SPDX-License-Identifier: MIT
"""Where things lie: the project (this package is installed in place), the build, the programs in
it.
"""

from __future__ import annotations

import os
from pathlib import Path

from dahl import RunError

ROOT = Path(__file__).resolve().parents[2]
DBC = ROOT / "port" / "dahl.dbc"
SCENES = ROOT / "host_sim" / "scenes"
DEMO = ROOT / "build" / "demo"


def build_folder() -> Path:
    """$DAHL_BUILD_DIR, else build/host."""
    return Path(os.environ.get("DAHL_BUILD_DIR", ROOT / "build" / "host"))


def built(variable: str, *parts: str) -> Path:
    """A built file: $variable if set, else inside the build folder. Raises RunError where there is
    none.
    """
    path = Path(os.environ.get(variable) or build_folder().joinpath(*parts))
    if not path.exists():
        raise RunError(
            f"{path} is not there; build it"
            f" (cmake --preset host && cmake --build build/host) or set {variable}"
        )
    return path


def library() -> Path:
    """The shared library of lib/."""
    return built("DAHL_LIBRARY", "lib", "libdahl.so")


def loop_program() -> Path:
    """The program dahl-loop."""
    return built("DAHL_LOOP", "host_sim", "dahl-loop")
