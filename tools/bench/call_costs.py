# SPDX-License-Identifier: MIT
"""Public calls of the library: worst measured instructions, stack and flash of each.

A new call needs a case in tools/bench/target: set bench_function to it and call it with bench_call.
The plugin sees which function a case calls. Then `tools/bench.sh target` has its row.
"""

from __future__ import annotations

import re
from typing import Any

from dahl.binding import models
from dahl.binding.library import DECLARATIONS

NOT_MEASURED = re.compile(
    r"dahl_(float|batch|throughput|can|frames|rotor|controller|compare|rival|true_friction)_?"
)
CALLED_BY_CALLS = {"dahl_encoder_rare_move", "dahl_part_move", "dahl_slip_part_move"}
INLINE = re.compile(r"dahl_node_use_\w+")  # inline calls of dahl_node_use()

IN_A_TICK = re.compile(
    r"dahl_((\w+_)?step(_counts|_at_speed)?(_q30)?|torque|velocity_torque(_q30)?|to_units|counts_between"
    r"|encoder_move|compensator_(move|torque)|residual_(torque|note|q24)"
    r"|damping_apply|commission_(tick|load))"
)

# Rows of dahl_node_receive(), by case: what it receives
RECEIVED = {
    "node_encoder": "EncoderState, up to 8 counts",
    "node_encoder_any": "EncoderState, any count, fault and setting",
    "node_encoder_parallel_8_any": "the same with 8 Dahl elements in parallel",
    "node_param_model": "ParamWrite that changes Sigma0, Fc or ThetaPerCount",
    "node_param_other": "any other ParamWrite",
    "node_others": "Reset and other frames",
}

# Columns of the table: the worst of these cores
COLUMNS = {
    "Cortex-M0": ("m0",),
    "M3 to M33": ("m3", "m4f", "m7", "m33"),
    "RV32IMAC": ("rv32",),
}
QUANTITIES = ("instructions", "stack", "flash")

OTHER_MODELS = [name for name in models.table() if name != "dahl"]

# Types, by part: the plan, which may be const in flash, and the state in RAM
TYPES: dict[str, tuple[str | None, str | None]] = {
    "Dahl": ("dahl_plan_t", "dahl_state_t"),
    **{name: (f"dahl_{name}_plan_t", f"dahl_{name}_state_t") for name in OTHER_MODELS},
    "each element of a parallel mix, in addition": ("dahl_part_t", None),
    "table over speed": ("dahl_velocity_plan_t", None),
    "work": (None, "dahl_work_t"),
    "encoder": (None, "dahl_encoder_t"),
    "compensator": ("dahl_compensator_plan_t", "dahl_compensator_t"),
    "residual observer": ("dahl_residual_plan_t", "dahl_residual_t"),
    "presliding damping": ("dahl_damping_plan_t", "dahl_damping_t"),
    "commissioning, while it runs": (None, "dahl_commission_t"),
    "node, model dahl": (None, "dahl_node_t"),
    **{f"node, storage of {name}": (None, f"dahl_node_{name}_t") for name in OTHER_MODELS},
}

MARKS = ("<!-- bench:calls -->", "<!-- /bench:calls -->")
MEMORY_MARKS = ("<!-- bench:memory -->", "<!-- /bench:memory -->")


def public_calls() -> list[str]:
    """Return the functions of all parts that firmware calls, in the order of the headers."""
    functions = re.findall(r"^\w[\w* ]*\b(dahl_\w+)\(", DECLARATIONS.read_text(), re.MULTILINE)
    functions = [x for x in functions if x not in CALLED_BY_CALLS and not INLINE.fullmatch(x)]
    return [x for x in functions if not NOT_MEASURED.match(x)]


def groups(names: list[str]) -> list[tuple[str, list[tuple[str, str]]]]:
    """Return the groups of the table: a title, and the title and key of each row."""
    node = [name for name in names if name.startswith("dahl_node_")]
    in_a_tick = [name for name in names if IN_A_TICK.fullmatch(name)]
    seldom = [name for name in names if name not in {*node, *in_a_tick}]
    received = [(f"`dahl_node_receive`, {what}", case) for case, what in RECEIVED.items()]
    of_node = [(f"`{name}`", name) for name in node if name != "dahl_node_receive"]
    return [
        ("in a tick", [(f"`{name}`", name) for name in in_a_tick]),
        ("at start-up, or if parameters change", [(f"`{name}`", name) for name in seldom]),
        ("friction node", [*received, *of_node]),
    ]


Rows = list[tuple[str, list[int]]]


def rows_of_table(result: dict[str, dict[str, Any]]) -> tuple[list[str], list[tuple[str, Rows]]]:
    """Return the titles of the columns, and the groups with the numbers of each row. A column has
    the worst of its cores.
    """
    columns = {t: [c for c in cores if c in result] for t, cores in COLUMNS.items()}
    columns = {title: cores for title, cores in columns.items() if cores}
    head = [f"{quantity}: {title}" for quantity in QUANTITIES for title in columns]

    def numbers(key: str) -> list[int]:
        return [
            max(result[core]["calls"][key][quantity] for core in cores)
            for quantity in QUANTITIES
            for cores in columns.values()
        ]

    names = [name for name in next(iter(result.values()))["calls"] if name not in RECEIVED]
    return head, [
        (group, [(title, numbers(key)) for title, key in rows]) for group, rows in groups(names)
    ]


def block(result: dict[str, dict[str, Any]]) -> str:
    """Return the block of docs/microcontroller.md with a row for each public call."""
    head, found = rows_of_table(result)
    lines = [f"| worst measured call | {' | '.join(head)} |", "|---|" + "---:|" * len(head)]
    for group, rows in found:
        lines.append(f"| **{group}** |" + " |" * len(head))
        lines += [f"| {title} | {' | '.join(map(str, numbers))} |" for title, numbers in rows]
    return "\n".join([MARKS[0], *lines, MARKS[1]])


def memory_block(result: dict[str, dict[str, Any]]) -> str:
    """Return the block of docs/microcontroller.md with the bytes of each plan and state."""
    types = result["m0"]["types"]
    lines = ["| bytes | plan: flash or RAM | state: RAM |", "|---|---:|---:|"]
    for part, (plan, state) in TYPES.items():
        cells = [str(types[name]) if name else "-" for name in (plan, state)]
        lines.append(f"| {part} | {' | '.join(cells)} |")
    return "\n".join([MEMORY_MARKS[0], *lines, MEMORY_MARKS[1]])
