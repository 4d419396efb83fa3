# SPDX-License-Identifier: MIT
"""Print the counts as tables: in the terminal, and as blocks of the pages."""

from __future__ import annotations

import sys
from typing import Any

MARKS = ("<!-- bench:target -->", "<!-- /bench:target -->")

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
    ("`dahl_torque`", "torque"),
    ("`dahl_set_torque`, worst", "set_torque"),
    ("`dahl_change_plan`, worst", "change_plan"),
    ("`dahl_counts_between`, readings below the modulus", "counts_between_below"),
    ("`dahl_counts_between`, worst", "counts_between"),
    ("`dahl_prepare`", "prepare"),
    ("`dahl_encoder_move`, readings modulo a power of two", "encoder_move"),
    ("`dahl_encoder_move`, readings modulo 10000", "encoder_move_other"),
    ("`dahl_encoder_move`, a reading that is a jump", "encoder_move_jump"),
    ("`dahl_to_units`", "to_units"),
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
    ("`dahl_slip_prepare`, 8 elements", "slip_prepare_8"),
    ("`dahl_asymmetric_step_counts_q30`", "asymmetric_q30"),
    ("`dahl_asymmetric_step_counts`, F in N m", "asymmetric_float"),
    ("`dahl_asymmetric_prepare`", "asymmetric_prepare"),
    ("`dahl_loaded_step_counts_q30`", "loaded_q30"),
    ("`dahl_loaded_step_counts_q30`, the load grew", "loaded_more_q30"),
    ("`dahl_loaded_step_counts`, F in N m", "loaded_float"),
    ("`dahl_clamped_step`, F in N m", "clamped_float"),
    ("`dahl_elastoplastic_step_counts_q30`, elastic", "elastic_q30"),
    ("`dahl_elastoplastic_step_counts_q30`, plastic", "plastic_q30"),
    ("`dahl_elastoplastic_step_counts_q30`, across the breakaway", "crossing_q30"),
    ("`dahl_elastoplastic_step_counts`, across the breakaway, F in N m", "crossing_float"),
    ("`dahl_work_step_counts`, one count", "work_step"),
    ("`dahl_work_step_counts_q30`, one count", "work_step_q30"),
    ("`dahl_work`", "work_read"),
    ("`dahl_counts_to_torque`, worst", "counts_to_torque"),
    ("`dahl_counts_to_torque`, counts of 1e-6 presliding lengths", "counts_to_torque_fine"),
    ("`dahl_tip_torque`, 1000 counts", "tip_torque_1000"),
    ("`dahl_tip_torque`, worst", "tip_torque"),
    ("`dahl_tip_torque`, counts of 1e-6 presliding lengths", "tip_torque_fine"),
    ("`dahl_velocity_torque_q30`", "velocity_torque_q30"),
    ("`dahl_velocity_torque`", "velocity_torque"),
    ("`dahl_compensator_move` and `dahl_compensator_torque`, worst", "compensator_tick"),
    ("`dahl_compensator_pull`", "compensator_pull"),
    ("`dahl_adaptation_step`, worst", "adaptation_step"),
    ("`dahl_compensator_prepare`", "compensator_prepare"),
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
    ("plan bytes", "plan_bytes"),
    ("state bytes", "state_bytes"),
    ("deepest stack bytes", "stack_bytes"),
]


def cells(result: dict[str, dict[str, Any]], key: str) -> list[str]:
    return [str(core[key]) if key in core else "-" for core in result.values()]


def show(result: dict[str, dict[str, Any]]) -> None:
    """Print a table in the terminal."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title="Instructions per call, entry to return; bytes")
    table.add_column("")
    for core in result.values():
        table.add_column(core["core"], justify="right")
    for title, key in ROWS:
        table.add_row(title.replace("*", "").replace("`", ""), *cells(result, key))
    console = Console(width=None if sys.stdout.isatty() else 110)
    console.print(table)
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
    note += " QEMU does not model cycles. On Cortex-M the library's ticks are those in assembly"
    note += " (`lib/cores`), except in the rows by the C. RV32IMAC has the C alone."
    return "\n".join([MARKS[0], *lines, "", note, bare_link(result), MARKS[1]])


SHORT_MARKS = ("<!-- bench:short -->", "<!-- /bench:short -->")
SHORT_ROWS = [  # title, key, worst error
    ("`dahl_step_counts_q30`, one count: F/Fc in Q30", "one_count_q30", "1.21e-9 of Fc"),
    ("`dahl_step_counts`, one count: F in N m", "one_count_float", "0.52 ulp of Fc"),
    ("the same by the C alone, Q30", "one_count_c_q30", "1.21e-9 of Fc"),
    ("the same by the C alone, F in N m", "one_count_c_float", "0.52 ulp of Fc"),
    ("`dahl_step`, by angle: F in N m", "angle_worst", "0.6 ulp of Fc"),
    ("newlib `expm1f` step", "newlib_expm1f", "grows with each reversal"),
]


def short(result: dict[str, dict[str, Any]]) -> str:
    """Return the block of README.md: three cores and the worst error."""
    cores = {name: result[name] for name in ("m0", "m3", "m4f")}
    head = ["", *(core["core"] for core in cores.values()), "worst error"]
    lines = ["| " + " | ".join(head).strip() + " |", "|---|" + "---:|" * len(cores) + "---|"]
    lines += [
        f"| {title} | {' | '.join(cells(cores, key))} | {e} |" for title, key, e in SHORT_ROWS
    ]
    return "\n".join([SHORT_MARKS[0], *lines, SHORT_MARKS[1]])
