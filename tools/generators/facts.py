#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Write what Python and the pages state about the C sources into committed files.

Usage: facts.py      (in build/venv; a test compares its output with the committed files)

    tools/dahl/facts.py                     friction models, period of the loop, emulated boards
    tools/dahl/binding/declarations.cdef    declarations of the library, for cffi
    docs/loop.md                            tables of models and faults, between their marks
    lib/node/dahl.dbc                       names of the values of parameter Model

The C preprocessor expands tables and constants; pycparser reads the declarations.
"""

from __future__ import annotations

import ast
import os
import re
import shlex
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from pycparser import c_ast, c_generator, c_parser

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("lib/include", "lib/node", "host_sim")
LINE = 100  # characters
COLUMNS = "name NAME Class number sigma0s Fcs plan key meaning low high".split()  # DAHL_MODELS


def preprocess(source: str, *words: str) -> str:
    """Return C after the preprocessor, which finds our headers."""
    command = [*shlex.split(os.environ.get("CC", "cc")), "-E", "-P", *words, "-x", "c", "-"]
    command += [f"-I{ROOT / folder}" for folder in FOLDERS]
    return subprocess.run(command, input=source, capture_output=True, text=True, check=True).stdout


def rows_of(header: str, macro: str, columns: int) -> list[list[Any]]:
    """Return the cells of a table of rows, which a header has as a macro of a macro."""
    names = [f"cell{n}" for n in range(columns)]
    row = f"#define ROW({', '.join(names)}) [{', '.join('#' + name for name in names)}],\n"
    expanded = preprocess(f'#include "{header}"\n{row}rows {macro}(ROW)').rpartition("rows")[2]
    rows = ast.literal_eval(f"[{expanded}]")
    return [[ast.literal_eval(one) if one[0] == '"' else one for one in cells] for cells in rows]


# --- tools/dahl/facts.py --------------------------------------------------------------------------

MODULE = '''# SPDX-License-Identifier: MIT
# Written from the C sources by tools/generators/facts.py.
"""Period of the loop, emulated boards and friction models, as the C sources have them."""

from __future__ import annotations

PERIOD_US = {period}  # from one EncoderState to the next (host_sim/timing.h)

BOARDS = {{  # of each emulated core: the machine of QEMU, the address of its page of parameters
{boards}
}}

# fmt: off
MODELS = (  # the rows of DAHL_MODELS (dahl_parts.h) without NAME; plan is True or False
{models}
)
# fmt: on
'''


def module() -> str:
    boards = (f'    "{core}": ("{machine}", 0x{page:X}),' for core, machine, page in boards_of())
    return MODULE.format(
        period=preprocess('#include "timing.h"\nPERIOD_US').split()[-1].rstrip("u"),
        boards="\n".join(boards),
        models="\n".join(map(_python_row, models())),
    )


def models() -> list[dict[str, Any]]:
    """Return the rows of DAHL_MODELS by their columns."""
    rows = rows_of("dahl_parts.h", "DAHL_MODELS", len(COLUMNS))
    found = [dict(zip(COLUMNS, row, strict=True)) for row in rows]
    numbers = ("number", "sigma0s", "Fcs", "plan", "low", "high")
    return [row | {name: ast.literal_eval(row[name]) for name in numbers} for row in found]


def _python_row(model: dict[str, Any]) -> str:
    cells = [f'"{cell}"' if isinstance(cell, str) else str(cell) for cell in model.values()]
    del cells[COLUMNS.index("NAME")]
    cells[COLUMNS.index("plan") - 1] = str(model["plan"] == 1)
    row = f"    ({', '.join(cells)}),"
    if len(row) <= LINE:
        return row
    lines = (", ".join(cells[:7]), ", ".join(cells[7:]))
    return "\n".join(["    (", *(f"        {line}," for line in lines), "    ),"])


def boards_of() -> list[tuple[str, str, int]]:
    """Return core, machine and page of each board: of the toolchain file and the linker scripts."""
    folder = ROOT / "port" / "cortex_m"
    toolchain = (folder / "toolchain.cmake").read_text(encoding="utf-8")
    found = []
    for core, machine in re.findall(r"^dahl_core\((\w+) (\S+)", toolchain, re.MULTILINE):
        script = (folder / f"{machine}.ld").read_text(encoding="utf-8")
        (page,) = re.findall(r"^param_page = (\w+);", script, re.MULTILINE)
        found.append((core, machine, int(page, 0)))
    return found


# --- declarations for cffi ------------------------------------------------------------------------

HEADERS = "dahl dahl_encoder dahl_parts dahl_compensator dahl_commission dahl_float".split()
HEADERS += "dahl_batch dahl_can_bus dahl_frames dahl_node rotor controller compare/compare".split()
STANDARD = ("stdint", "stdbool", "stddef")  # cffi knows their types
TYPES = "size_t bool".split() + [f"{u}int{n}_t" for u in ("", "u") for n in (8, 16, 32, 64)]
CONSTANT = re.compile(r"#define DAHL_\w+ (?:0x[0-9a-fA-F]+|\d+)u?")  # a whole number


def declarations() -> str:
    """Return the whole numbers, types and functions that Python calls, one a line."""
    includes = "".join(f'#include "{header}.h"\n' for header in HEADERS)
    with tempfile.TemporaryDirectory() as folder:
        for name in STANDARD:
            Path(folder, f"{name}.h").touch()
        words = ("-dD", "-nostdinc", "-U__GNUC__", f"-I{folder}")
        lines = preprocess(includes, *words).splitlines()
    constants = [line for line in lines if CONSTANT.fullmatch(line)]
    known = "".join(f"typedef int {name};" for name in TYPES)
    code = known + "\n".join(line for line in lines if not line.startswith("#"))
    nodes = c_parser.CParser().parse(code).ext[len(TYPES) :]
    note = "// Written from the C headers by tools/generators/facts.py."
    return "\n".join([note, *constants, *map(_declaration, nodes)]) + "\n"


def _declaration(node: Any) -> str:
    if isinstance(node, c_ast.FuncDef):  # an inline function
        node = node.decl
        node.funcspec, node.storage = [], []
    return " ".join(c_generator.CGenerator().visit(node).split()) + ";"


# --- pages and the DBC ----------------------------------------------------------------------------

MODEL_HEAD = ("`[friction] model`", "its keys", "torque ratio is of", "parameter Model")
MODEL_KEYS = {  # by the numbers of sigma0 and of Fc
    (1, 1): "`sigma0`, `Fc`",
    (0, 0): "one `sigma0` and one `Fc` for each of 1 to 8 elements",
    (1, 2): "one `sigma0`; two `Fc`: {limits}",
}
WHOLE = {0: "the sum of Fc", 1: "Fc", 2: "the larger Fc"}  # by the number of Fc
REACTION = ("counted as", "state", "bristle", "answer")
FAULT_TABLES = {  # macros of fault_table.h, by the mark: the columns before the reaction
    "counters": ("FAULT_COUNTERS", ("counter", "MaxStep", "third in a row")),
    "faults": ("FAULT_EVENTS", ("frame or event",)),
}


def page(text: str) -> str:
    """Return docs/loop.md with its tables of models and faults."""
    text = _between(text, "models", MODEL_HEAD, [_model_row(model) for model in models()])
    for mark, (macro, columns) in FAULT_TABLES.items():
        head = (*columns, *REACTION)
        rows = [
            (*cells, "yes" if answered == "true" else "no")
            for _, *cells, answered in rows_of("fault_table.h", macro, 1 + len(head))
        ]
        text = _between(text, mark, head, rows)
    return text


def _between(text: str, mark: str, head: tuple[str, ...], rows: list[Any]) -> str:
    begin, end = f"<!-- node:{mark} -->\n", f"<!-- /node:{mark} -->"
    before, _, rest = text.partition(begin)
    lines = (f"| {' | '.join(row)} |\n" for row in (head, ["---"] * len(head), *rows))
    return f"{before}{begin}{''.join(lines)}{end}{rest.partition(end)[2]}"


def _model_row(model: dict[str, Any]) -> tuple[str, ...]:
    key, meaning = model["key"], model["meaning"]
    own = f"`{key}`, {meaning}" if key else meaning
    own += f", {model['low']:g} to {model['high']:g}" if model["high"] else ""
    keys = MODEL_KEYS[model["sigma0s"], model["Fcs"]] + (f"; {own}" if own else "")
    keys = keys.format(limits="Fs, Fc" if key == "stribeck" else "forward, backward")
    number = str(model["number"])
    if model["sigma0s"] == 0:
        number = f"{number} + number of elements".removeprefix("0 + ")
    return f"`{model['name']}`", keys, WHOLE[model["Fcs"]], number


def bus_description(text: str) -> str:
    """Return dahl.dbc with the values of Model. A number that depends on elements has no name."""
    named = sorted((row["number"], row["Class"]) for row in models() if row["sigma0s"])
    words = " ".join(f'{number} "{name}"' for number, name in named)
    return re.sub(r"^(VAL_ \d+ Model) .*;$", rf"\1 {words} ;", text, flags=re.MULTILINE)


def generated() -> dict[Path, str]:
    """Text of each file that derives from the C sources."""
    loop, dbc = ROOT / "docs" / "loop.md", ROOT / "lib" / "node" / "dahl.dbc"
    return {
        ROOT / "tools/dahl/facts.py": module(),
        ROOT / "tools/dahl/binding/declarations.cdef": declarations(),
        loop: page(loop.read_text(encoding="utf-8")),
        dbc: bus_description(dbc.read_text(encoding="utf-8")),
    }


if __name__ == "__main__":
    for path, text in generated().items():
        path.write_text(text, encoding="utf-8")
