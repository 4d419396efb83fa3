# SPDX-License-Identifier: MIT
"""What the library needs and keeps, from its symbol tables: no heap, no globals, no libm but in the
float form, and that is linked only when called. The batches ask which vectors there are.
"""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest
from conftest import ROOT, built

FLOAT_FORM = {"expm1f"}  # libm's
VECTORS = {"__cpu_model", "_GLOBAL_OFFSET_TABLE_"}  # libgcc's, for the batches on x86-64
COPIES = {"memcpy", "memset"}  # the compiler's own idea


def run(*command: object) -> str:
    done = subprocess.run(
        [str(word) for word in command], capture_output=True, text=True, check=True
    )
    return done.stdout


def faults(objects: Path) -> dict[str, set[str]]:
    """Object file -> symbols that it takes from elsewhere than the library, or keeps writable."""
    found: dict[str, set[str]] = {}
    name = objects.name
    for line in run("nm", objects).splitlines():
        name = line[:-1] if line.endswith(".o:") else name
        symbol = re.fullmatch(r"[\da-f ]*([A-Za-z]) (\S+)", line)
        if symbol is None:
            continue
        kind, word = symbol.groups()
        foreign = kind == "U" and not word.startswith("dahl_")
        if foreign or kind in "bBdDcCsS":
            found.setdefault(name, set()).add(word)
    return found


def test_the_library_needs_nothing_and_keeps_nothing() -> None:
    assert faults(built("lib", "libdahl.a")) == {}


def test_the_components_need_little_more() -> None:
    assert faults(built("lib", "libdahl_float.a")) == {"float.c.o": FLOAT_FORM}
    for needed in faults(built("lib", "libdahl_batch.a")).values():
        assert needed <= VECTORS | COPIES


@pytest.mark.parametrize(
    ("source", "symbol"),
    [
        ("int dahl_x(void) { static int calls; return ++calls; }", "calls"),
        ("int dahl_global = 3;", "dahl_global"),
        ("#include <stdlib.h>\nvoid *dahl_x(void) { return malloc(8); }", "malloc"),
        ("#include <math.h>\nfloat dahl_x(float x) { return expf(x); }", "expf"),
    ],
)
def test_each_fault_is_seen(tmp_path: Path, source: str, symbol: str) -> None:
    (tmp_path / "x.c").write_text(source)
    run("gcc", "-c", tmp_path / "x.c", "-o", tmp_path / "x.o")
    assert any(word.startswith(symbol) for word in faults(tmp_path / "x.o")["x.o"])
