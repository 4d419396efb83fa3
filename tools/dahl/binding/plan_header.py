# SPDX-License-Identifier: MIT
"""A prepared plan as a header for C99 and C++11, ready for flash, of Dahl's model or of one of
dahl_parts.h. dahl_prepare() and its like make the values. The field names come from the public
headers.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dahl.binding import models
from dahl.binding.library import c
from dahl.errors import InputError
from dahl.version import __version__

if TYPE_CHECKING:
    from typing import TypeAlias

    AnyPlan: TypeAlias = models.AnyPlan

SUFFIX = {"uint8_t": "u", "uint32_t": "u", "int32_t": "", "uint64_t": "ull", "int64_t": "ll"}
LINE = 96  # characters
HEAD = re.compile(
    r"/\*(?:(?!\*/).)*dahl_(?:\w+_)?prepare\(\) of .*?\*/\n#ifndef DAHL_PLAN_\w+_H\n", re.DOTALL
)


def _c_names(plan: type) -> tuple[str, str, tuple[str, ...]]:
    """Return the prefix of the C names of a plan, its header, and the names of its parameters."""
    parameters = tuple(inspect.signature(plan).parameters)
    for row in models.table().values():
        if row.has_plan and row.class_name == plan.__name__:
            return f"dahl_{row.name}_", "dahl_parts.h", parameters
    return "dahl_", "dahl.h", parameters


def identifier(name: str) -> str:
    """Return a name as a part of C identifiers. Raises dahl.Error if it has no letter or digit."""
    plain_name = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_").lower()
    if not plain_name:
        raise InputError(f"--name {name}: letters, digits and _ were expected")
    return plain_name


def is_plan(path: Path) -> bool:
    """Return whether this module wrote a file."""
    try:
        return HEAD.match(path.read_text(encoding="utf-8")) is not None
    except UnicodeDecodeError:
        return False


def _include(header: str) -> list[str]:
    """Return the lines that include a header. The dahl.h of tools/amalgamate.sh replaces each."""
    if header == "dahl.h":
        return ['#include "dahl.h"']
    guard = header.upper().replace(".", "_")
    return ['#include "dahl.h"', f"#ifndef {guard}", f'#include "{header}"', "#endif"]


def _initialiser(value: Any, kind: Any) -> str:
    if kind.kind == "array":
        return "{" + ", ".join(_initialiser(one, kind.item) for one in value) + "}"
    if kind.kind == "struct":
        return "{" + ", ".join(initial for _, initial in _fields(value, kind)) + "}"
    if kind.kind == "enum":
        return str(kind.elements[value])
    return _float(value) if kind.cname == "float" else f"{value}{SUFFIX[kind.cname]}"


def _fields(value: Any, kind: Any) -> list[tuple[str, str]]:
    return [(name, _initialiser(getattr(value, name), one.type)) for name, one in kind.fields]


def _parameters(plan: AnyPlan, names: tuple[str, ...]) -> str:
    """Return `name = value` of each parameter; several elements have as many values."""
    values = ((name, getattr(plan, name)) for name in names)
    return ", ".join(
        f"{name} = "
        + " ".join(f"{v:.9g}" for v in (value if isinstance(value, tuple) else [value]))
        for name, value in values
    )


def text(name: str, plan: AnyPlan | dict[str, AnyPlan], comment: list[str]) -> str:
    """Return the header: `static const dahl_plan_t dahl_plan_NAME`, or dahl_slip_plan_t and so on.

    Several plans are given by the endings of their names. The values of dahl_prepare() stand in the
    order of the structure, since C++ has designated initialisers only from C++20 on. Another
    version of the library may have another order, so the header does not compile with it.
    """
    plans = plan if isinstance(plan, dict) else {"": plan}
    kinds = [_c_names(type(one)) for one in plans.values()]
    guard = f"DAHL_PLAN_{name.upper()}_H"
    major, minor, _ = __version__.split(".")
    notes = [
        f"{prefix}prepare() of {_parameters(one, names)}; keep it const."
        for one, (prefix, _, names) in zip(plans.values(), kinds, strict=True)
    ]
    lines = [
        "/*",
        *(f" * {line}".rstrip() for line in comment),
        *([" *"] if comment else []),
        *(f" * {line}" for line in notes),
        " */",
        f"#ifndef {guard}",
        f"#define {guard}",
        "",
        *_include(max(header for _, header, _ in kinds)),
        "",
        f"#if DAHL_VERSION_MAJOR != {major} || DAHL_VERSION_MINOR != {minor}",
        f'#error "this plan was made for dahl {major}.{minor}: make it again with this version"',
        "#endif",
        "",
        *(line for ending, one in plans.items() for line in _definition(f"{name}{ending}", one)),
        f"#endif /* {guard} */",
    ]
    return "\n".join(lines) + "\n"


def with_load(header: str, name: str, at_zero: float, per_unit: float) -> str:
    """Return the header of a plan with a function that converts a measured load to the load_q30 of
    dahl_loaded_step_counts(): 2^30 (at_zero + per_unit load), 0 .. 2^31 - 1; 0 for NaN.
    """
    header = header.replace('#include "dahl.h"', "\n".join(_include("dahl_parts.h")), 1)
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


def bounds(
    name: str,
    Fc_low: float,  # noqa: N803
    length_long: float,
    sigma0_high: float,
    torque: str,
    angle: str,
) -> str:
    """Return the lines after a header with the bounds for dahl_compensator.h: the floats below
    Fc_low and above the others, with the units of torque and angle.
    """
    prefix = f"DAHL_PLAN_{name.upper()}"
    low, long = _float(rounded(Fc_low, 0.0)), _float(rounded(length_long, np.inf))
    high = _float(rounded(sigma0_high, np.inf))
    return (
        "\n/* Bounds for dahl_compensator.h, from the 95 % intervals. The length is that which the"
        " encoder\n * sees, with the twist of a shaft. */\n"
        f"#ifndef {prefix}_FC_LOW\n"
        f"#define {prefix}_FC_LOW {low} /* {torque} */\n"
        f"#define {prefix}_LENGTH_LONG {long} /* {angle} */\n"
        f"#define {prefix}_SIGMA0_HIGH {high} /* {torque}/{angle} */\n"
        "#endif\n"
    )


def commission(name: str, params: Any, load: Sequence[float], travel: float) -> str:
    """Return the lines after a header for an axis that commissioned itself: the parameters of its
    compensator, and a function that returns the bits of dahl_commission_load().
    """
    members = _fields(params, c.typeof("dahl_compensator_params_t"))
    guard, last = f"DAHL_PLAN_{name.upper()}_COMPENSATOR", len(load) - 1
    half, values = len(load) // 2, "{" + ", ".join(map(_float, load)) + "}"
    lines = [
        "",
        "/* For dahl_compensator_prepare(), if the firmware adds the load to its command. */",
        f"#ifndef {guard}",
        f"#define {guard}",
        *_include("dahl_compensator.h"),
        "",
        f"static const dahl_compensator_params_t dahl_plan_{name}_compensator = {{",
        *(f"    /* {field} */ {value}," for field, value in members),
        "};",
        "",
        "/* Torque in N m that holds the axis at an angle in rad from the middle of its travel. */",
        f"static inline float dahl_plan_{name}_load(float angle)",
        "{",
        *_fold(f"static const float load[{len(load)}] = {values};"),
        f"    const float travel = {_float(travel)};",
        f"    const float x = (angle + travel) * {half} / travel - 0.5f;",
        f"    const int bin = x > 0 ? x < {last} ? (int)x : {last} : 0;",
        "",
        f"    return bin < {last} && x > 0"
        " ? load[bin] + (x - (float)bin) * (load[bin + 1] - load[bin]) : load[bin];",
        "}",
        "#endif",
    ]
    return "\n".join(lines) + "\n"


def rounded(value: float, towards: float) -> float:
    """Return the nearest float, or the next one if it is on the wrong side of the value."""
    near = np.float32(value)
    above = float(near) - value  # in double: a float32 compares with a number in float32
    is_wrong = above > 0 if towards == 0 else above < 0
    return float(np.nextafter(near, np.float32(towards)) if is_wrong else near)


def _float(value: float) -> str:
    text = f"{value:.9g}"
    return f"{text}f" if re.search(r"[.e]", text) else f"{text}.0f"


def _definition(name: str, plan: AnyPlan) -> list[str]:
    prefix = _c_names(type(plan))[0]
    words = _fields(plan._prepared, c.typeof(f"{prefix}plan_t"))
    return [
        f"static const {prefix}plan_t dahl_plan_{name} = {{",
        *(line for field, value in words for line in _fold(f"/* {field} */ {value},")),
        "};",
        "",
    ]


def _fold(field: str) -> list[str]:
    """Return a long initialiser in lines of at most LINE characters, cut after a comma."""
    lines, indent = [], "    "
    while len(indent + field) > LINE:
        cut = field.rfind(", ", 0, LINE - len(indent)) + 1
        lines.append(indent + field[:cut])
        field, indent = field[cut:].lstrip(), "        "
    return [*lines, indent + field]
