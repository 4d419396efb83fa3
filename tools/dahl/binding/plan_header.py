# SPDX-License-Identifier: MIT
"""A prepared plan as a header for C99 and C++11, ready for flash, of Dahl's model or of one of
dahl_parts.h. dahl_prepare() and its like make the words; the field names come from the public
headers.
"""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dahl.binding import models
from dahl.binding.library import c
from dahl.errors import Error
from dahl.version import __version__

if TYPE_CHECKING:
    from typing import TypeAlias

    AnyPlan: TypeAlias = models.AnyPlan

SUFFIX = {"uint8_t": "u", "uint32_t": "u", "int32_t": "", "uint64_t": "ull", "int64_t": "ll"}
LINE = 96  # characters
HEAD = re.compile(
    r"/\*(?:(?!\*/).)*dahl_(?:\w+_)?prepare\(\) of .*?\*/\n#ifndef DAHL_PLAN_\w+_H\n", re.DOTALL
)


def _kind(plan: type) -> tuple[str, str, tuple[str, ...]]:
    """Return the prefix of the C names of a plan, its header, and the names of its parameters."""
    parameters = tuple(inspect.signature(plan).parameters)
    for row in models.table().values():
        if row.has_plan and row.class_name == plan.__name__:
            return f"dahl_{row.name}_", "dahl_parts.h", parameters
    return "dahl_", "dahl.h", parameters


def identifier(name: str) -> str:
    """A name that C takes."""
    plain_name = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_").lower()
    if not plain_name:
        raise Error(f"--name {name}: letters, digits and _ were expected")
    return plain_name


def is_plan(path: Path) -> bool:
    """Whether a file is a header that was made here."""
    try:
        return HEAD.match(path.read_text(encoding="utf-8")) is not None
    except UnicodeDecodeError:
        return False


def _initialiser(value: Any, kind: Any) -> str:
    if kind.kind == "array":
        return "{" + ", ".join(_initialiser(one, kind.item) for one in value) + "}"
    if kind.kind == "struct":
        return "{" + ", ".join(initial for _, initial in _fields(value, kind)) + "}"
    return f"{value}{SUFFIX[kind.cname]}"


def _fields(value: Any, kind: Any) -> list[tuple[str, str]]:
    return [(name, _initialiser(getattr(value, name), one.type)) for name, one in kind.fields]


def _parameters(plan: AnyPlan, names: tuple[str, ...]) -> str:
    """Name = value, of several elements as many values."""
    values = ((name, getattr(plan, name)) for name in names)
    return ", ".join(
        f"{name} = "
        + " ".join(f"{v:.9g}" for v in (value if isinstance(value, tuple) else [value]))
        for name, value in values
    )


def text(name: str, plan: AnyPlan | dict[str, AnyPlan], comment: list[str]) -> str:
    """The header: `static const dahl_plan_t dahl_plan_NAME` (or dahl_slip_plan_t, ...), the words
    of dahl_prepare() (dahl_slip_prepare(), ...) in the order of the struct, since C++ has had
    designated initialisers only since C++20; of several plans each with an ending of its own.
    Another version of the library may order them otherwise, and is refused when the header is
    compiled.
    """
    plans = plan if isinstance(plan, dict) else {"": plan}
    kinds = [_kind(type(one)) for one in plans.values()]
    guard = f"DAHL_PLAN_{name.upper()}_H"
    major, minor, _ = __version__.split(".")
    said = [
        f"{prefix}prepare() of {_parameters(one, names)}; keep it const."
        for one, (prefix, _, names) in zip(plans.values(), kinds, strict=True)
    ]
    lines = [
        "/*",
        *(f" * {line}".rstrip() for line in comment),
        *([" *"] if comment else []),
        *(f" * {line}" for line in said),
        " */",
        f"#ifndef {guard}",
        f"#define {guard}",
        "",
        *(f'#include "{header}"' for header in sorted({header for _, header, _ in kinds})),
        "",
        f"#if DAHL_VERSION_MAJOR != {major} || DAHL_VERSION_MINOR != {minor}",
        f'#error "this plan was made for dahl {major}.{minor}: make it again with this version"',
        "#endif",
        "",
        *(line for ending, one in plans.items() for line in _words(f"{name}{ending}", one)),
        f"#endif /* {guard} */",
    ]
    return "\n".join(lines) + "\n"


def with_load(header: str, name: str, at_zero: float, per_unit: float) -> str:
    """A header of a plan for dahl_loaded_step_counts() with a function for its load_q30 from a
    measured load: load_q30 = 2^30 (at_zero + per_unit load), 0 .. 2^31 - 1, 0 for NaN.
    """
    header = header.replace('#include "dahl.h"', '#include "dahl_parts.h"')
    end = header.rindex("#endif /* ")
    function = [
        "/* load_q30 of dahl_loaded_step_counts() for a load as the log has it. */",
        f"static inline uint32_t dahl_plan_{name}_load_q30(float load)",
        "{",
        f"    const float share = {_float(at_zero)} + {_float(per_unit)} * load;",
        "",
        "    return share >= 2 ? 2147483647u : share > 0 ? (uint32_t)(share * 1073741824) : 0u;",
        "}",
        "",
    ]
    return header[:end] + "\n".join(function) + "\n" + header[end:]


def _float(value: float) -> str:
    """A literal of C."""
    text = f"{value:.9g}"
    return f"{text}f" if re.search(r"[.e]", text) else f"{text}.0f"


def _words(name: str, plan: AnyPlan) -> list[str]:
    """One plan."""
    prefix = _kind(type(plan))[0]
    words = _fields(plan._prepared, c.typeof(f"{prefix}plan_t"))
    return [
        f"static const {prefix}plan_t dahl_plan_{name} = {{",
        *(line for field, value in words for line in _folded(f"/* {field} */ {value},")),
        "};",
        "",
    ]


def _folded(field: str) -> list[str]:
    """A long initialiser in lines of at most LINE characters, cut after a comma."""
    lines, indent = [], "    "
    while len(indent + field) > LINE:
        cut = field.rfind(", ", 0, LINE - len(indent)) + 1
        lines.append(indent + field[:cut])
        field, indent = field[cut:].lstrip(), "        "
    return [*lines, indent + field]
