# SPDX-License-Identifier: MIT
"""The C files of the product by purpose, found by folder, so that a new file needs no change."""

import functools
from pathlib import Path

from programs import run

ROOT = Path(__file__).resolve().parents[1]
LIB = ROOT / "lib"


def _found(*folders: str, kind: str = "c") -> list[Path]:
    return sorted(path for folder in folders for path in (ROOT / folder).rglob(f"*.{kind}"))


CORE = _found("lib/arith", "lib/model")  # one element, as firmware links it
PARTS = [path for name in ("compensator", "cores", "parts") for path in _found(f"lib/{name}")]
ALL = [*CORE, *PARTS, *_found("lib/batch", "lib/commission", "lib/float")]
NODE = _found("lib/node")
FOLDERS = sorted(
    {path.parent for path in _found("lib", kind="h")} | {ROOT / "port", ROOT / "host_sim"}
)
INCLUDES = [f"-I{folder}" for folder in FOLDERS]


@functools.cache
def number(name: str, header: str = "dahl.h") -> float:
    """Return the value of a macro of a header by the preprocessor."""
    output = run("cc", "-E", "-dM", *INCLUDES, "-include", header, "-x", "c", "/dev/null")
    text = next(line.split()[2] for line in output.splitlines() if line.split()[1] == name)
    return float.fromhex(text) if text.startswith("0x") else float(text.rstrip("f"))


def as_one(folder: Path, files: list[Path] = CORE, name: str = "library.c") -> Path:
    """Write one C file that includes many, for a compiler or prover that must read all at once."""
    unit = folder / name
    unit.write_text("".join(f'#include "{path}"\n' for path in files))
    return unit


def with_main(test: Path, folder: Path) -> Path:
    """Write the main of a Unity test and return one C file of both."""
    main = folder / f"{test.stem}_main.c"
    run("cmake", f"-DSOURCE={test}", f"-DMAIN={main}", "-P", ROOT / "tests/unity_main.cmake")
    return main
