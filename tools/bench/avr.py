# SPDX-License-Identifier: MIT
"""Count cycles, instructions and stack of calls on an ATmega2560 in simavr (simavr.c).

An AVR has neither caches nor wait states, so the cycles are those of the chip. Its cases are those
of the other cores that fit into 8 KiB of RAM. Writes build/bench/avr.json.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import target
from rich.table import Table
from target import OUT, ROOT, BenchError, Call, Core

RESULT = OUT / "avr.json"
CORE = Core("avr", "ATmega2560", "simavr", ("avr-", "simavr", "avr-libc"))
MHZ = 16
PLACES = ("bench_site", "bench_back", "bench_mark", "__stop_program")

# Rows: title, cases of the image, functions to link for the flash
IN_Q30 = ("dahl_encoder_move", "dahl_step_counts_q30", "dahl_to_units")
IN_FLOAT = ("dahl_encoder_move", "dahl_step_counts")
MEASURED_LAW = ("dahl_compensator_move", "dahl_compensator_torque")
ONE_COUNT = ("one_count_forward_{}", "one_count_backward_{}")
ROWS: dict[str, tuple[str, tuple[str, ...], tuple[str, ...]]] = {
    "one_count_q30": ("`dahl_step_counts_q30`, one count", ONE_COUNT, IN_Q30[1:2]),
    "counts_q30": ("the same, worst of all counts", ("counts_worst_q30",), IN_Q30[1:2]),
    "one_count_float": ("`dahl_step_counts`, one count, F in N m", ONE_COUNT, IN_FLOAT[1:]),
    "counts_float": ("the same, worst of all counts", ("counts_worst_float",), IN_FLOAT[1:]),
    "angle": ("`dahl_step`, worst of all travel", ("angle_worst",), ("dahl_step",)),
    "encoder": (
        "`dahl_encoder_move`, worst",
        ("encoder_move", "encoder_move_other", "encoder_move_jump"),
        IN_Q30[:1],
    ),
    "control_tick_units": (
        "a whole control tick in integers, F in units",
        ("control_tick_units",),
        IN_Q30,
    ),
    "control_tick": ("a whole control tick in float, F in N m", ("control_tick",), IN_FLOAT),
    "compensator_tick": (
        "`dahl_compensator_move` and `dahl_compensator_torque`",
        ("compensator_tick", "worst:compensator_tick"),
        MEASURED_LAW,
    ),
    "prepare": ("`dahl_prepare`", ("prepare",), ("dahl_prepare",)),
    "compensator_prepare": (
        "`dahl_compensator_prepare`",
        ("compensator_prepare",),
        ("dahl_compensator_prepare",),
    ),
}
MARKS = ("<!-- bench:avr -->", "<!-- /bench:avr -->")
HEAD = ("worst call", "cycles", f"us at {MHZ} MHz", "bytes of stack", "bytes of flash")


def build_runner() -> Path:
    program = OUT / "simavr_counts"
    OUT.mkdir(parents=True, exist_ok=True)
    part = program.with_suffix(f".{os.getpid()}")
    words = ["-std=gnu99", "-O2", "-o", part, ROOT / "tools/bench/simavr.c", "-lsimavr", "-lelf"]
    try:
        target.run("cc", *words)
    except BenchError as error:
        raise BenchError(f"{error}\nDebian's libsimavr-dev and libelf-dev are needed") from error
    part.replace(program)
    return program


def simulate(image: Path) -> dict[str, list[Call]]:
    at = target.symbols(CORE, image)
    counts = OUT / f"counts.avr.{os.getpid()}"
    try:
        places = [hex(at[name][0]) for name in PLACES]
        text = target.run(build_runner(), image, *places, counts)
        return target.read_cases(text, counts.read_text())[0]
    finally:
        counts.unlink(missing_ok=True)


def flash(key: str, functions: tuple[str, ...]) -> int:
    """Return the bytes of code and constants of an image with these functions alone. Constants are
    copied to RAM, and so count as data.
    """
    image = target.link(CORE, key, list(functions), CORE.build / "lib" / "libdahl.a", "-lm", "-lc")
    return sum(target.sizes(CORE, image).values())


def numbers(calls: list[Call]) -> dict[str, int]:
    return {
        "cycles": max(call.most for call in calls),
        "instructions": max(call.count for call in calls),
        "stack": max(call.stack for call in calls),
    }


def measure() -> dict[str, Any]:
    target.build(CORE, "bench_avr")
    cases = simulate(CORE.build / "bench" / "bench_avr")
    result: dict[str, Any] = {
        "core": CORE.title,
        "compiler": target.run(CORE.tool("gcc"), "--version").splitlines()[0],
        "known": numbers(cases["known"]),
    }
    for key, (_, names, functions) in ROWS.items():
        form = key.rpartition("_")[2]
        calls = [call for name in names for call in cases[name.format(form)]]
        result[key] = numbers(calls) | {"flash": flash(key, functions)}
    return result


def rows(result: dict[str, Any]) -> list[list[str]]:
    def cells(title: str, row: dict[str, int]) -> list[str]:
        time = f"{row['cycles'] / MHZ:.0f}"
        return [title, str(row["cycles"]), time, str(row["stack"]), str(row["flash"])]

    return [cells(title, result[key]) for key, (title, _, _) in ROWS.items()]


def block(result: dict[str, Any]) -> str:
    """Return the block of docs/microcontroller.md."""
    lines = [f"| {' | '.join(HEAD)} |", "|---|" + "---:|" * (len(HEAD) - 1)]
    lines += [f"| {' | '.join(row)} |" for row in rows(result)]
    note = f"Counted in simavr as an {result['core']}, `-O2`, {result['compiler']}."
    return "\n".join([MARKS[0], *lines, "", note, MARKS[1]])


def show(result: dict[str, Any], print_table: Callable[[Table], None]) -> None:
    table = Table(title=f"Worst call on an {result['core']} in simavr")
    for column in HEAD:
        table.add_column(column, justify="left" if column == HEAD[0] else "right")
    for row in rows(result):
        table.add_row(*(cell.replace("`", "") for cell in row))
    print_table(table)
