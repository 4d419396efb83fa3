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
from dahl.binding import models
from sources import INCLUDES, NODE

FLOAT_FORM = {"expm1f"}  # libm's
VECTORS = {"__cpu_model", "_GLOBAL_OFFSET_TABLE_"}  # libgcc's, for the batches on x86-64
PARTS = set(models.table()) - {"dahl"}
OWN = re.compile(r"(frames|node|slcan)_")
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


def parts(file: Path) -> dict[str, set[str]]:
    """Each function of the library in a file: the part that it is of, if it is of one."""
    names = re.findall(r" T dahl_(\w+)", run("nm", file))
    return {name: PARTS & {name.replace("part", "parallel").split("_")[0]} for name in names}


def test_a_part_that_is_not_called_is_not_linked(tmp_path: Path) -> None:
    """For each call of the library: what comes with it is of no part but its own."""
    library, main, program = built("lib", "libdahl.a"), tmp_path / "main.c", tmp_path / "program"
    calls = parts(library)
    assert {"slip", "parallel"} <= set().union(*calls.values())
    for call, own in calls.items():
        name = f"dahl_{call}"
        main.write_text(f"extern int {name}(void);\nint main(void) {{ return {name}(); }}\n")
        run("gcc", "-O1", main, library, "-lm", "-o", program)
        assert set().union(*parts(program).values()) == own, name


def test_the_components_need_little_more() -> None:
    assert set().union(*faults(built("lib", "libdahl_float.a")).values()) == FLOAT_FORM
    for needed in faults(built("lib", "libdahl_batch.a")).values():
        assert needed <= VECTORS | COPIES


@pytest.mark.parametrize("source", [*NODE, ROOT / "port/slcan/slcan.c"], ids=lambda path: path.stem)
def test_what_a_node_links_has_no_heap_and_prints_nothing(source: Path, tmp_path: Path) -> None:
    made = tmp_path / "node.o"
    run("gcc", "-std=c99", "-O2", *INCLUDES, "-c", source, "-o", made)
    needed = {word for word in faults(made).get("node.o", set()) if not OWN.match(word)}
    assert needed <= COPIES | {"strcpy", "_GLOBAL_OFFSET_TABLE_"}
