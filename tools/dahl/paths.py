# SPDX-License-Identifier: MIT
"""Find files: in the package folder if dahl is installed, else in the checkout and its build
folder.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

from dahl.errors import RunError

PACKAGE = Path(__file__).resolve().parent
SHARE = PACKAGE / "share"  # files of a wheel (tools/wheel.cmake); absent in a checkout
INSTALLED = SHARE.is_dir()
ROOT = PACKAGE.parents[1]  # of a checkout; meaningless if INSTALLED
DBC = SHARE / "dahl.dbc" if INSTALLED else ROOT / "lib" / "node" / "dahl.dbc"
INCLUDE = SHARE / "include" if INSTALLED else ROOT / "lib" / "include"
LIB = SHARE / "lib" if INSTALLED else ROOT / "lib"  # C sources
PORT = SHARE if INSTALLED else ROOT / "port"  # folders fmu, mujoco, simulators: C sources
LICENSE = (SHARE if INSTALLED else ROOT) / "LICENSE"
KEYS = SHARE / "keys.csv" if INSTALLED else ROOT / "host_sim" / "keys.csv"
SCENES = SHARE / "scenes" if INSTALLED else ROOT / "host_sim" / "scenes"
OUTPUT = (
    Path("dahl-out") if INSTALLED else ROOT / "build"
)  # folder of the files that commands write


def build_folder() -> Path:
    """Return the build folder of a checkout: $DAHL_BUILD_DIR, else build/host."""
    return Path(os.environ.get("DAHL_BUILD_DIR", ROOT / "build" / "host"))


def built_file(variable: str, carried: str, *parts: str) -> Path:
    """Return a built file: $variable if set, else `carried` in an installed package, else `parts`
    in the build folder. Raises dahl.RunError if it does not exist.
    """
    usual = PACKAGE / carried if INSTALLED else build_folder().joinpath(*parts)
    path = Path(os.environ.get(variable) or usual)
    if path.exists():
        return path
    if INSTALLED:
        hint = "dahl-loop needs Linux" if variable == "DAHL_LOOP" else "reinstall this package"
        raise RunError(f"{path} does not exist; {hint}, or set {variable}")
    raise RunError(
        f"{path} does not exist; build it (tools/demo.sh, or cmake --preset host"
        f" -DDAHL_BUILD_TESTS=OFF && cmake --build build/host) or set {variable}"
    )


def library() -> Path:
    return built_file("DAHL_LIBRARY", "lib/libdahl.so", "lib", "libdahl.so")


def fmu_library() -> Path:
    """Return the path of the shared object of port/fmu."""
    return built_file("DAHL_FMU", "lib/dahl_fmu.so", "lib", "dahl_fmu.so")


def binding_module() -> Path:
    """Return the module of cffi that the build makes next to the shared library, if it can."""
    return (PACKAGE if INSTALLED else build_folder()) / "lib" / "_dahl.abi3.so"


def loop_program() -> Path:
    return built_file("DAHL_LOOP", "bin/dahl-loop", "host_sim", "dahl-loop")


def checkout(what: str) -> Path:
    """Return the folder of the checkout. Raises dahl.RunError if the package is installed."""
    if INSTALLED:
        raise RunError(f"{what} needs a checkout of dahl; this is an installed package")
    return ROOT


@contextlib.contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Create a folder and lock it for this process. The lock leaves no file and ends with the
    process. Raises dahl.RunError if another process holds it.
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
        raise RunError(
            f"{folder}: another run writes into it; wait, or choose another folder"
        ) from None
