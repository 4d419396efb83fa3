# SPDX-License-Identifier: MIT
"""Where things lie: the project (this package is installed in place), the build, the programs in
it.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

from dahl import RunError

ROOT = Path(__file__).resolve().parents[2]
DBC = ROOT / "lib" / "node" / "dahl.dbc"
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


@contextlib.contextmanager
def owned(folder: Path) -> Iterator[None]:
    """Make a folder and be the only one that writes into it. The lock is on the folder itself, so
    it leaves no file, and goes with the process that holds it. Raises RunError where it is held.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        _lock(lock, folder)
        yield
    finally:
        os.close(lock)


def _lock(lock: int, folder: Path) -> None:
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise RunError(f"{folder}: another run is writing there; wait, or name another") from None
