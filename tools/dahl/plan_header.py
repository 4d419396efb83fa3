# SPDX-License-Identifier: MIT
"""A prepared plan as a C header, ready for flash: dahl_prepare() of the library makes it, and the
struct in lib/dahl.h says what its words are called, so that no layout is known here.
"""

from __future__ import annotations

import ctypes
import re
from functools import cache
from typing import Any

from dahl import RunError, paths
from dahl.core import Plan

WORDS = {
    "uint32_t": ctypes.c_uint32,
    "int32_t": ctypes.c_int32,
    "uint64_t": ctypes.c_uint64,
    "int64_t": ctypes.c_int64,
}
SUFFIX = {
    ctypes.c_uint32: "u",
    ctypes.c_int32: "",
    ctypes.c_uint64: "ull",
    ctypes.c_int64: "ll",
}
LINE = 96  # characters


@cache
def plan_type() -> type[ctypes.Structure]:
    """dahl_plan_t as lib/dahl.h declares it."""
    try:
        text = (paths.ROOT / "lib" / "include" / "dahl.h").read_text(encoding="utf-8")
    except OSError as error:
        raise RunError(f"{error.filename}: {error.strerror}") from None
    return _structure(re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL), "dahl_plan_t")


def _structure(text: str, name: str) -> type[ctypes.Structure]:
    body = re.search(rf"typedef struct\s*\w*\s*\{{([^}}]*)\}}\s*{name};", text)
    if body is None:
        raise RunError(f"lib/dahl.h: no struct {name}")
    fields = []
    for kind, field, count in re.findall(r"(\w+)\s+(\w+)(?:\[(\d+)\])?;", body[1]):
        one = WORDS.get(kind) or _structure(text, kind)
        fields.append((field, one * int(count) if count else one))
    return type(name, (ctypes.Structure,), {"_fields_": fields})


def _initialiser(value: Any, kind: Any) -> str:
    if issubclass(kind, ctypes.Array):
        return "{" + ", ".join(_initialiser(one, kind._type_) for one in value) + "}"
    if issubclass(kind, ctypes.Structure):
        return "{" + ", ".join(_fields(value)) + "}"
    return f"{value}{SUFFIX[kind]}"


def _fields(value: ctypes.Structure) -> list[str]:
    return [
        f".{name} = {_initialiser(getattr(value, name), kind)}" for name, kind, *_ in value._fields_
    ]


def text(name: str, plan: Plan, comment: list[str]) -> str:
    """The header: `static const dahl_plan_t dahl_plan_NAME`, the words of dahl_prepare()."""
    words = plan_type().from_buffer_copy(plan._words)
    guard = f"DAHL_PLAN_{name.upper()}_H"
    lines = [
        "/*",
        *(f" * {line}".rstrip() for line in comment),
        " *",
        f" * dahl_prepare() of sigma0 = {plan.sigma0:.9g}, Fc = {plan.Fc:.9g},"
        f" theta_per_count = {plan.theta_per_count:.9g}; keep it const.",
        " */",
        f"#ifndef {guard}",
        f"#define {guard}",
        "",
        '#include "dahl.h"',
        "",
        f"static const dahl_plan_t dahl_plan_{name} = {{",
        *(folded for field in _fields(words) for folded in _folded(f"{field},")),
        "};",
        "",
        f"#endif /* {guard} */",
    ]
    return "\n".join(lines) + "\n"


def _folded(field: str) -> list[str]:
    """A long initialiser in lines of at most LINE characters, cut after a comma."""
    lines, indent = [], "    "
    while len(indent + field) > LINE:
        cut = field.rfind(", ", 0, LINE - len(indent)) + 1
        lines.append(indent + field[:cut])
        field, indent = field[cut:].lstrip(), "        "
    return [*lines, indent + field]
