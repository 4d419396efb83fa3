# SPDX-License-Identifier: MIT
"""Print the counts as tables: in the terminal, and as blocks of the pages."""

from __future__ import annotations

import struct
import sys
from collections.abc import Callable
from functools import partial
from typing import Any

import call_costs
import numpy as np
from dahl.binding import models
from rich.console import Console
from rich.table import Table

MARKS = ("<!-- bench:target -->", "<!-- /bench:target -->")


def rows_of(model: models.Model) -> tuple[tuple[str, str], ...]:
    """Return the rows of a model with two limits."""
    return (
        (f"`dahl_{model.name}_step_counts_q30`", f"{model.name}_q30"),
        (f"`dahl_{model.name}_step_counts`, F in N m", f"{model.name}_float"),
    )


SOFT = models.with_key("breakaway").name
ROWS = [
    ("`dahl_step_counts_q30`, one count", "one_count_q30"),
    ("`dahl_step_counts`, one count, F in N m", "one_count_float"),
    ("`dahl_step_counts_q30` by the C, one count", "one_count_c_q30"),
    ("`dahl_step_counts` by the C, one count, F in N m", "one_count_c_float"),
    ("`dahl_step_counts_q30`, 8 counts", "eight_counts_q30"),
    ("`dahl_step_counts_q30`, 1000 counts", "1000_counts_q30"),
    ("`dahl_step_counts_q30`, INT32_MIN counts", "int32_min_q30"),
    ("`dahl_step_counts_q30`, worst of all counts", "counts_worst_q30"),
    ("`dahl_step_counts_q30`, reversal", "reversal_q30"),
    ("`dahl_step_counts_q30`, no motion", "zero_q30"),
    ("`dahl_step`, worst of all travel", "angle_worst"),
    ("`dahl_step` by the C, worst of all travel", "angle_c_worst"),
    ("`dahl_counts_between`, readings below the modulus", "counts_between_below"),
    ("`dahl_encoder_move`, readings modulo a power of two", "encoder_move"),
    ("`dahl_encoder_move`, readings modulo 10000", "encoder_move_other"),
    ("`dahl_encoder_move`, a reading that is a jump", "encoder_move_jump"),
    ("a whole control tick in integers, F in units", "control_tick_units"),
    ("a whole control tick in float, F in N m", "control_tick"),
    ("`dahl_slip_step_counts_q30`, 2 elements", "slip_2_q30"),
    ("`dahl_slip_step_counts_q30`, 4 elements", "slip_4_q30"),
    ("`dahl_slip_step_counts_q30`, 8 elements", "slip_8_q30"),
    ("`dahl_slip_step_counts`, 4 elements", "slip_4"),
    ("`dahl_parallel_step_counts`, 2 Dahl elements", "parallel_2"),
    ("`dahl_parallel_step_counts`, 4 Dahl elements", "parallel_4"),
    ("`dahl_parallel_step_counts_q30`, 2 Dahl elements", "parallel_2_q30"),
    ("`dahl_parallel_step_counts_q30`, 4 Dahl elements", "parallel_4_q30"),
    ("`dahl_parallel_step_counts_q30`, a Dahl and a slip element", "mixed_2_q30"),
    ("`dahl_parallel_step_counts_q30`, 3 Dahl elements and a slip element", "mixed_4_q30"),
    *(row for model in models.table().values() if model.has_two_limits for row in rows_of(model)),
    ("`dahl_loaded_step_counts_q30`", "loaded_q30"),
    ("`dahl_loaded_step_counts_q30`, the load grew", "loaded_more_q30"),
    ("`dahl_loaded_step_counts`, F in N m", "loaded_float"),
    (f"`dahl_{SOFT}_step_counts_q30`, elastic", "elastic_q30"),
    (f"`dahl_{SOFT}_step_counts_q30`, plastic", "plastic_q30"),
    (f"`dahl_{SOFT}_step_counts_q30`, across the breakaway", "crossing_q30"),
    (f"`dahl_{SOFT}_step_counts`, across the breakaway, F in N m", "crossing_float"),
    ("`dahl_work_step_counts`, up to 8 counts", "work_step"),
    ("`dahl_work_step_counts_q30`, up to 8 counts", "work_step_q30"),
    ("`dahl_counts_to_torque`, counts of .077 presliding lengths", "counts_to_torque"),
    ("`dahl_counts_to_torque`, counts of 1e-6 presliding lengths", "counts_to_torque_fine"),
    ("`dahl_tip_torque`, 1000 counts", "tip_torque_1000"),
    ("`dahl_tip_torque`, counts of 1e-6 presliding lengths", "tip_torque_fine"),
    ("`dahl_compensator_move` and `dahl_compensator_torque`, worst", "compensator_tick"),
    ("`dahl_commission_tick`, worst of all stages", "commission_tick"),
    ("*newlib `expm1f` step*", "newlib_expm1f"),
    ("*newlib `expf` step*", "newlib_expf"),
    ("*newlib `exp` (double) step*", "newlib_exp_double"),
    ("*picolibc `expm1f` step*", "picolibc_expm1f"),
    ("*picolibc `expf` step*", "picolibc_expf"),
    ("*picolibc `exp` (double) step*", "picolibc_exp_double"),
    ("*forward Euler step*", "euler"),
    ("*RK4 step*", "rk4"),
    ("*table with interpolation step*", "table"),
    ("code bytes: `dahl_prepare` and `dahl_step_counts_q30`", "code_bytes"),
    ("code bytes: also `dahl_step_counts` and `dahl_step`", "code_bytes_angle"),
    ("const data bytes", "const_bytes_angle"),
    ("writable static bytes", "static_bytes_angle"),
]


CYCLE_ROWS = [
    ("`dahl_step_counts_q30`, one count", "one_count_q30"),
    ("`dahl_step_counts`, one count, F in N m", "one_count_float"),
    ("`dahl_step`, worst of all travel", "angle_worst"),
    ("a whole control tick in integers, F in units", "control_tick_units"),
    ("a whole control tick in float, F in N m", "control_tick"),
    ("`dahl_compensator_move` and `dahl_compensator_torque`", "compensator_tick"),
    *(
        (f"`dahl_node_receive`, {call_costs.RECEIVED[case]}", case)
        for case in ("node_encoder", "node_param_model")
    ),
    ("*newlib `expm1f` step*", "newlib_expm1f"),
]


def cells(result: dict[str, dict[str, Any]], key: str) -> list[str]:
    return [str(core[key]) if key in core else "-" for core in result.values()]


def timed(result: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return the cores with cycles."""
    return {name: core for name, core in result.items() if "cycles" in core}


def format_cycles(name: str, cycles: list[int]) -> str:
    """Return the cycles: on M0 of both multipliers, on other cores an interval."""
    least, most = cycles
    return f"{least} ({most})" if name == "m0" else f"{least} to {most}"


def format_times(name: str, cycles: list[int], mhz: float) -> str:
    least, most = (f"{number / mhz:.3g}" for number in cycles)
    return f"{least} ({most})" if name == "m0" else f"{least} to {most}"


def cycle_cells(
    cores: dict[str, dict[str, Any]], key: str, cell: Callable[[str, list[int]], str]
) -> list[str]:
    return [
        cell(name, core["cycles"][key]) if key in core["cycles"] else "-"
        for name, core in cores.items()
    ]


def make_console() -> Console:
    return Console(width=None if sys.stdout.isatty() else 110)


def cycles_table(
    title: str, cores: dict[str, dict[str, Any]], cell: Callable[[str, list[int]], str]
) -> Table:
    table = Table(title=f"{title}, zero wait states; Cortex-M0 with a multiplier of 1 (32) cycles")
    table.add_column("")
    for core in cores.values():
        table.add_column(core["core"], justify="right")
    for row, key in CYCLE_ROWS:
        table.add_row(row.replace("*", "").replace("`", ""), *cycle_cells(cores, key, cell))
    return table


def show_times(result: dict[str, dict[str, Any]], mhz: float) -> None:
    """Print the microseconds at a clock."""
    title = f"Microseconds at {mhz:g} MHz"
    make_console().print(cycles_table(title, timed(result), partial(format_times, mhz=mhz)))


CYCLE_MARKS = ("<!-- bench:cycles -->", "<!-- /bench:cycles -->")


def cycles_block(result: dict[str, dict[str, Any]]) -> str:
    """Return the block of docs/microcontroller.md with the cycles."""
    cores = timed(result)
    head = ["cycles per call", *(core["core"] for core in cores.values())]
    lines = ["| " + " | ".join(head) + " |", "|---|" + "---:|" * len(cores)]
    for row, key in CYCLE_ROWS:
        lines.append("| " + " | ".join([row, *cycle_cells(cores, key, format_cycles)]) + " |")
    return "\n".join([CYCLE_MARKS[0], *lines, CYCLE_MARKS[1]])


SPEED_MARKS = ("<!-- bench:speed -->", "<!-- /bench:speed -->")
WITH_ELEMENT = "compensator_tick and one_count_q30"
SPEED_ROWS = [  # title, key, worst error
    ("`dahl_step_counts_q30`, one count", "one_count_q30", "1.21e-9 of Fc"),
    ("`dahl_step_counts`, one count", "one_count_float", "0.52 ulp of Fc"),
    ("`dahl_step`, by angle", "angle_worst", "0.6 ulp of Fc"),
    ("whole control tick in integers", "control_tick_units", "half a unit"),
    ("whole control tick in N m", "control_tick", "0.52 ulp of Fc"),
    ("compensator's tick with its element", WITH_ELEMENT, "1.07e-4 of the torque"),
    ("newlib `expm1f` step", "newlib_expm1f", "grows with each reversal"),
]


def with_sum(costs: dict[str, Any]) -> dict[str, Any]:
    """Return the costs, also of a tick of the compensator and the element that it needs."""
    law, element = (np.asarray(costs[key]) for key in WITH_ELEMENT.split(" and "))
    return costs | {WITH_ELEMENT: (law + element).tolist()}


def speed_block(result: dict[str, dict[str, Any]]) -> str:
    """Return the rows at the top of docs/speed.md: cycles and worst error."""
    cores = timed(result)
    cores = {name: core | {"cycles": with_sum(core["cycles"])} for name, core in cores.items()}
    head = ["cycles of the worst call", *(core["core"] for core in cores.values()), "worst error"]
    lines = ["| " + " | ".join(head) + " |", "|---|" + "---:|" * len(cores) + "---|"]
    for row, key, error in SPEED_ROWS:
        each = cycle_cells(cores, key, format_cycles)
        lines.append("| " + " | ".join([row, *each, error]) + " |")
    return "\n".join([SPEED_MARKS[0], *lines, SPEED_MARKS[1]])


def signed(word: int, bits: int) -> int:
    return word - (1 << bits) if word >> (bits - 1) else word


def float_of(bits: int) -> float:
    found: float = struct.unpack("f", struct.pack("I", bits))[0]
    return found


def of_counts(travel: int, state: int, move: int) -> str:
    ratio = signed(state, 64) / 2**62
    return f"{signed(move, 32)} counts of travel {float_of(travel):.2g} from {ratio:.3g} Fc"


def of_angle(travel: int, state: int, move: int) -> str:
    ratio = signed(state, 64) / 2**62
    return f"{float_of(move):.3g} rad, count of travel {float_of(travel):.2g}, from {ratio:.3g} Fc"


def of_reading(modulus: int, last: int, reading: int) -> str:
    return f"reading {reading} after {last}, modulo {modulus or 2**32}"


def of_ratio(Fc_units: int, _: int, ratio: int) -> str:
    return f"ratio {signed(ratio, 32)}, Fc {Fc_units} units"


def of_compensator(torque: int, ratio: int, dcounts: int) -> str:
    last, element = signed(torque, 32) / 2**30, signed(ratio, 64) / 2**30
    return f"{signed(dcounts, 32)} counts, element {element:.3g} Fc, last torque {last:.3g} Fc"


WORST_ROWS: list[tuple[str, str, Callable[[int, int, int], str]]] = [
    ("`dahl_encoder_move`", "encoder_move", of_reading),
    ("`dahl_step_counts_q30`", "step_counts_q30", of_counts),
    ("`dahl_step_counts`", "step_counts", of_counts),
    ("`dahl_step`", "step", of_angle),
    ("`dahl_to_units`", "to_units", of_ratio),
    ("a whole control tick in integers", "control_tick_units", of_counts),
    ("a whole control tick in float", "control_tick", of_counts),
    ("`dahl_compensator_move` and `_torque`", "compensator_tick", of_compensator),
]
WORST_MARKS = ("<!-- bench:worst -->", "<!-- /bench:worst -->")


def worst_block(result: dict[str, dict[str, Any]]) -> str:
    """Return the block of docs/microcontroller.md with the worst calls. The input is that of M0."""
    cores = timed(result)
    titles = [core["core"] for core in cores.values()]
    head = ["worst call: instructions / cycles", *titles, "input with the most cycles on Cortex-M0"]
    lines = ["| " + " | ".join(head) + " |", "|---|" + "---:|" * len(cores) + "---|"]
    for row, key, describe in WORST_ROWS:
        worst = {name: core["worst"][key] for name, core in cores.items()}
        each = [
            f"{call['instructions']} / {format_cycles(name, call['cycles'])}"
            for name, call in worst.items()
        ]
        found = worst["m0"]["input"]
        lines.append("| " + " | ".join([row, *each, describe(*found) if found else "any"]) + " |")
    return "\n".join([WORST_MARKS[0], *lines, WORST_MARKS[1]])


def calls_table(result: dict[str, dict[str, Any]]) -> Table:
    """Return a table of instructions, stack and flash of each public call."""
    head, groups = call_costs.rows_of_table(result)
    table = Table(title="Worst measured call: instructions, bytes of stack, bytes of flash")
    table.add_column("")
    for title in head:
        table.add_column(title, justify="right")
    for _, rows in groups:
        for title, numbers in rows:
            table.add_row(title.replace("`", ""), *map(str, numbers))
    return table


def show(result: dict[str, dict[str, Any]]) -> None:
    table = Table(title="Instructions per call, entry to return; bytes")
    table.add_column("")
    for core in result.values():
        table.add_column(core["core"], justify="right")
    for title, key in ROWS:
        table.add_row(title.replace("*", "").replace("`", ""), *cells(result, key))
    console = make_console()
    console.print(table)
    console.print(calls_table(result))
    if timed(result):
        console.print(cycles_table("Cycles per call", timed(result), format_cycles))
    console.print(bare_link(result).replace("`", ""))


def words(names: list[str]) -> str:
    return ", ".join(f"`{name}`" for name in names) or "no function"


def bare_link(result: dict[str, dict[str, Any]]) -> str:
    """List the functions of the compiler's library that dahl calls, by core."""
    needs = [
        f"{core['core']} {words(core['helpers'])} (with `-O0`: {words(core['helpers_O0'])})"
        for core in result.values()
        if core.get("helpers") or core.get("helpers_O0")
    ]
    listed = "; ".join(needs) or "no core needs one"
    return f"With `-nostdlib`, provide these functions of the compiler's library: {listed}."


def markdown(result: dict[str, dict[str, Any]]) -> str:
    """Return the block of docs/microcontroller.md, with its marks."""
    head = ["instructions per call, entry to return", *(core["core"] for core in result.values())]
    lines = ["| " + " | ".join(head) + " |", "|---|" + "---:|" * len(result)]
    lines += ["| " + " | ".join([title, *cells(result, key)]) + " |" for title, key in ROWS]
    compilers = sorted({core["compiler"] for core in result.values()})
    note = f"Counted in QEMU with a plugin, `-O2`, {' and '.join(compilers)}."
    note += " On Cortex-M the library's ticks are those in assembly"
    note += " (`lib/cores`), except in the rows by the C. RV32IMAC has the C alone."
    return "\n".join([MARKS[0], *lines, "", note, bare_link(result), MARKS[1]])


LIBC_MARKS = ("<!-- bench:libc -->", "<!-- /bench:libc -->")
LIBC_CORES = ("m0", "m3", "m4f", "m33", "rv32")
LIBC_ROWS = [("`dahl_step_counts`, one count", "one_count_float")]
LIBC_ROWS += [
    (f"{libc} {title} step", f"{libc}_{name}")
    for title, name in (("`expm1f`", "expm1f"), ("`expf`", "expf"), ("`exp`", "exp_double"))
    for libc in ("newlib", "picolibc")
]


def libc_block(result: dict[str, dict[str, Any]]) -> str:
    """Return the block of docs/speed.md with the steps by the exponentials of C libraries."""
    cores = {name: result[name] for name in LIBC_CORES}
    head = ["instructions of one count", *(core["core"] for core in cores.values())]
    lines = ["| " + " | ".join(head) + " |", "|---|" + "---:|" * len(cores)]
    lines += ["| " + " | ".join([title, *cells(cores, key)]) + " |" for title, key in LIBC_ROWS]
    return "\n".join([LIBC_MARKS[0], *lines, LIBC_MARKS[1]])


SHORT_MARKS = ("<!-- bench:short -->", "<!-- /bench:short -->")
SHORT_ROWS = [  # title, key, worst error
    ("`dahl_step_counts_q30`, one count: F/Fc in Q30", "one_count_q30", "1.21e-9 of Fc"),
    ("`dahl_step_counts`, one count: F in N m", "one_count_float", "0.52 ulp of Fc"),
    ("the compensator's two calls and its element", WITH_ELEMENT, "1.07e-4 of the torque"),
    ("newlib `expm1f` step", "newlib_expm1f", "grows with each reversal"),
]


def short(result: dict[str, dict[str, Any]]) -> str:
    """Return the block of README.md: three cores and the worst error."""
    cores = {name: with_sum(result[name]) for name in ("m0", "m3", "m4f")}
    head = ["", *(core["core"] for core in cores.values()), "worst error"]
    lines = ["| " + " | ".join(head).strip() + " |", "|---|" + "---:|" * len(cores) + "---|"]
    lines += [
        f"| {title} | {' | '.join(cells(cores, key))} | {e} |" for title, key, e in SHORT_ROWS
    ]
    return "\n".join([SHORT_MARKS[0], *lines, SHORT_MARKS[1]])
