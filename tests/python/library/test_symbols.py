# SPDX-License-Identifier: MIT
"""Symbol tables: the library uses no heap and no globals, and libm only in the float form."""

import re
from pathlib import Path

import pytest
from conftest import ROOT, built
from dahl.binding import models
from programs import run
from sources import INCLUDES, NODE

FLOAT_FORM = {"expm1f"}  # libm's
VECTORS = {"__cpu_model"}  # of libgcc: the batches detect vectors on x86-64
LINKED = ("dahl_", "_GLOBAL_OFFSET_TABLE_")  # by this library, and by the linker
PARTS = set(models.table()) - {"dahl"}
OWN = re.compile(r"(frames|node|slcan)_")
COPIES = {"memcpy", "memset"}  # the compiler adds them
TABLES = re.compile(r"dahl_model_\w+")  # const: in .data.rel.ro, which the loader makes read-only


def foreign_and_writable(objects: Path) -> dict[str, set[str]]:
    found: dict[str, set[str]] = {}
    name = objects.name
    for line in run("nm", objects).splitlines():
        name = line[:-1] if line.endswith(".o:") else name
        symbol = re.fullmatch(r"[\da-f ]*([A-Za-z]) (\S+)", line)
        if symbol is None:
            continue
        kind, word = symbol.groups()
        foreign = kind == "U" and not word.startswith(LINKED)
        if foreign or (kind in "bBdDcCsS" and not TABLES.fullmatch(word)):
            found.setdefault(name, set()).add(word)
    return found


def test_the_library_has_no_foreign_and_no_writable_symbol() -> None:
    assert foreign_and_writable(built("lib", "libdahl.a")) == {}


def parts(file: Path) -> dict[str, set[str]]:
    names = re.findall(r" T dahl_(\w+)", run("nm", file))
    return {name: PARTS & {name.replace("part", "parallel").split("_")[0]} for name in names}


def test_a_part_that_is_not_called_is_not_linked(tmp_path: Path) -> None:
    library, main, program = built("lib", "libdahl.a"), tmp_path / "main.c", tmp_path / "program"
    calls = parts(library)
    assert {"slip", "parallel"} <= set().union(*calls.values())
    for call, own in calls.items():
        name = f"dahl_{call}"
        main.write_text(f"extern int {name}(void);\nint main(void) {{ return {name}(); }}\n")
        run("gcc", "-O1", main, library, "-lm", "-o", program)
        assert set().union(*parts(program).values()) == own, name


def test_the_float_form_needs_expm1f_and_the_others_need_no_libm() -> None:
    assert (
        set().union(*foreign_and_writable(built("lib", "libdahl_float.a")).values()) == FLOAT_FORM
    )
    for needed in foreign_and_writable(built("lib", "libdahl_commission.a")).values():
        assert needed <= COPIES
    for needed in foreign_and_writable(built("lib", "libdahl_batch.a")).values():
        assert needed <= VECTORS | COPIES


@pytest.mark.parametrize("source", [*NODE, ROOT / "port/slcan/slcan.c"], ids=lambda path: path.stem)
def test_a_node_needs_no_heap_and_no_stdio(source: Path, tmp_path: Path) -> None:
    made = tmp_path / "node.o"
    run("gcc", "-std=c99", "-O2", *INCLUDES, "-c", source, "-o", made)
    needed = {
        word for word in foreign_and_writable(made).get("node.o", set()) if not OWN.match(word)
    }
    assert needed <= COPIES | {"strcpy"}
