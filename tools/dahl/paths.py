# SPDX-License-Identifier: MIT
"""Where things lie: beside the modules in an installed package, in the tree and its build folder in
a checkout, where the package is installed in place.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

from dahl.errors import RunError

PACKAGE = Path(__file__).resolve().parent
SHARE = PACKAGE / "share"  # what a wheel carries (tools/wheel.cmake); a checkout has none
INSTALLED = SHARE.is_dir()
ROOT = PACKAGE.parents[1]  # of a checkout; of no meaning where INSTALLED
DBC = SHARE / "dahl.dbc" if INSTALLED else ROOT / "lib" / "node" / "dahl.dbc"
INCLUDE = SHARE / "include" if INSTALLED else ROOT / "lib" / "include"
SCENES = SHARE / "scenes" if INSTALLED else ROOT / "host_sim" / "scenes"
OUTPUT = Path("dahl-out") if INSTALLED else ROOT / "build"  # where commands leave their files


def build_folder() -> Path:
    """Of a checkout: $DAHL_BUILD_DIR, else build/host."""
    return Path(os.environ.get("DAHL_BUILD_DIR", ROOT / "build" / "host"))


def built(variable: str, carried: str, *parts: str) -> Path:
    """A built file: $variable if set, else `carried` in an installed package, else `parts` in the
    build folder. Raises RunError where there is none.
    """
    usual = PACKAGE / carried if INSTALLED else build_folder().joinpath(*parts)
    path = Path(os.environ.get(variable) or usual)
    if path.exists():
        return path
    if INSTALLED:
        raise RunError(f"{path} is not there; {_left_out()}, or set {variable}")
    raise RunError(
        f"{path} is not there; build it (tools/demo.sh does, or cmake --preset host"
        f" -DDAHL_BUILD_TESTS=OFF && cmake --build build/host) or set {variable}"
    )


def _left_out() -> str:
    """Why an installed package lacks a built file, and what to do."""
    try:
        lacking = (SHARE / "no-dahl-loop.txt").read_text(encoding="ascii").strip()
    except OSError:
        return "install this package again"
    return f"this package was built where {lacking} was missing: build it where that is installed"


def library() -> Path:
    """The shared library of lib/."""
    return built("DAHL_LIBRARY", "lib/libdahl.so", "lib", "libdahl.so")


def binding(name: str) -> Path:
    """A file that the build writes next to the shared library for Python, if it is there."""
    return (PACKAGE if INSTALLED else build_folder()) / "lib" / name


def loop_program() -> Path:
    """The program dahl-loop."""
    return built("DAHL_LOOP", "bin/dahl-loop", "host_sim", "dahl-loop")


def checkout(what: str) -> Path:
    """The tree that firmware is built from. Raises RunError where only the package is installed."""
    if INSTALLED:
        raise RunError(f"{what} is built from a checkout of dahl, and this is an installed package")
    return ROOT


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
