# SPDX-License-Identifier: MIT
"""Write results.json and the pictures speed, pareto and growth from target.json and host.json.

With `--docs`, also write the tables and pictures of docs/. With `--cycles`, show cycles instead of
instructions: of Cortex-M0 with a multiplier of 1 cycle, of M3 and M4F the most.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import avr
import call_costs
import figures
import host as host_bench
import measured
import published
import results
import table
import target as target_bench
from results import CORES
from target import OUT, ROOT, BenchError

RESULT = OUT / "results.json"
PICTURES = (
    "speed.png",
    "pareto.png",
    "growth.png",
)  # for docs/speed.md; the .svg files stay in build/bench
DOCS = ROOT / "docs"
WAYS_MARKS = ("<!-- bench:ways -->", "<!-- /bench:ways -->")
HOST_MARKS = ("<!-- bench:host -->", "<!-- /bench:host -->")
PYTHON_MARKS = ("<!-- bench:python -->", "<!-- /bench:python -->")
LOG_CALLS = {
    "friction": "**`Friction.run_counts(moves, out)`**",
    "throughput": "**`Throughput.run_counts(moves, out=out)`**",
    "numpy": "NumPy, one ufunc: `np.negative(angles, out)`",
    "numba": "numba, the textbook loop in double",
    "jax_double": "JAX, `associative_scan` in double",
}


def load(path: Path, command: str) -> dict[str, Any]:
    if not path.exists():
        raise BenchError(f"no build/bench/{path.name}; run tools/bench.sh {command} first")
    found: dict[str, Any] = json.loads(path.read_text())
    return found


def format_error(value: float) -> str:
    return "diverges" if value > figures.TOP else f"{value:.0e}"


def format_cost(value: float) -> str:
    return f"{value:.0f}"


def ways_table(target: dict[str, Any], host: dict[str, Any]) -> str:
    """Return the block of docs/speed.md with error and instructions of each method."""
    cores = [core for core in CORES if core in target]
    by_core = {core: results.core_points(target, host, core) for core in cores}
    head = [
        "way to compute a tick",
        "worst error of F/Fc",
        "on giant jumps",
        *(target[core]["core"] for core in cores),
    ]
    lines = ["| " + " | ".join(head) + " |", "|---|" + "---:|" * (len(head) - 1)]
    for rank, point in enumerate(by_core[cores[0]]):
        costs = [format_cost(by_core[core][rank].mean_cost()) for core in cores]
        errors = [format_error(point.worst()), format_error(point.error[results.JUMPS])]
        title = f"**{point.title}**" if point.ours else point.title
        lines.append("| " + " | ".join([title, *errors, *costs]) + " |")
    return "\n".join([WAYS_MARKS[0], *lines, *missed_limits(host), WAYS_MARKS[1]])


def missed_limits(host: dict[str, Any]) -> list[str]:
    """List the solvers that miss a limit with any number of parts."""
    names = [
        f"{results.SOLVERS[entry['way'].removesuffix('_parts')]} {entry['limit']:.0e}"
        for entry in host["parts"]
        if entry["parts"] == 0
    ]
    most = host_bench.PARTS_MOST
    return ["", f"Not reached with {most} parts a tick: {', '.join(names)}."] if names else []


HOST_ROWS = {  # our calls of which only the time is measured here: their error is that of another
    "throughput_counts_16": ("**`dahl_throughput_counts_channels`**, 16", "throughput_counts"),
    "throughput_counts_16_apart": ("16 channels of different stiffness", "throughput_counts"),
}
HOST_KEYS = (
    "throughput_counts",
    "throughput_angle",
    *HOST_ROWS,
    "batch_counts",
    "vector_exp",
    "sleef",
    "double_state",
    "expm1f",
    "core_math",
    *results.OUTSIDE,
)


def host_table(result: dict[str, Any]) -> list[str]:
    """Return the table of time and error on the host: ours, the plain loops, and other packages."""
    titles = {way.key: f"**{way.title}**" if way.ours else way.title for way in results.WAYS}
    titles |= results.OUTSIDE | {key: title for key, (title, _) in HOST_ROWS.items()}
    lines = [
        "| on this host | ns a tick | times a copy | on the worst motion | worst error of F/Fc |",
        "|---|---:|---:|---:|---:|",
    ]
    for key in HOST_KEYS:
        point = result["points"]["host"].get(HOST_ROWS.get(key, ("", key))[1])
        copies = result["copies"].get(key)
        if point:
            ns = copies["ns"] if key in HOST_ROWS else point["cost"]
            time = f"{ns:,.{0 if ns >= 10 else 2}f}"
            cells = [titles[key], time, *copy_cells(copies), format_error(point["worst"])]
            lines.append("| " + " | ".join(cells) + " |")
    return lines


def copy_cells(copies: dict[str, Any] | None) -> list[str]:
    """Return the distance to a copy: on average, and on the worst motion with its name."""
    if copies is None:
        return ["", ""]
    return [f"{copies['mean']:.1f}", f"{copies['most']:.1f} ({copies['motion']})"]


def host_block(result: dict[str, Any]) -> str:
    """Return the block of docs/speed.md about the host, with its processor and compiler."""
    x = result["host"]
    lines = []
    if "threads_2_x" in x:
        lines.append(
            "- `Throughput.run_counts(moves, threads=2)` is"
            f" {x['threads_2_x']:.1f} times as fast as one thread on a log of"
            f" {result['machine']['ticks']['threads']:,} ticks"
        )
    lines += [f"- not compared here: {name} ({why})" for name, why in result["missing"].items()]
    note = f"{result['machine']['cpu']}, {result['machine']['compiler']}. Times a copy: beside a"
    note += " plain copy of the arrays in the same run, geometric mean over the hard motions."
    return "\n".join([HOST_MARKS[0], *host_table(result), "", *lines, "", note, HOST_MARKS[1]])


def single_lines(calls: dict[str, Any]) -> list[str]:
    single = calls["single"]
    pairs = (
        ("`Friction.step_counts`", "step_counts", "float", '`float("1.5")`'),
        ("`Node.receive`", "receive", "message", "`can.Message(...)`"),
        ("`Node.receive` with `now`", "receive_now", "message", "`can.Message(...)`"),
    )
    return [
        f"- {title}: {single[ours] / 1000:.2f} us, {single[ours] / single[other]:.1f} times {than}"
        for title, ours, other, than in pairs
    ]


def direction_line(logs: dict[str, Any]) -> str:
    """Return how long a tick of the exact form takes with random directions, and with one."""
    random, forward = (
        ns / logs["ticks"][-1] for ns in (logs["ns"]["friction"][-1], logs["one_direction"])
    )
    return (
        f"- `Friction.run_counts`: {random:.1f} ns a tick of the longest log, whose directions are"
        f" random, and {forward:.1f} ns if all are forward, which a processor predicts"
    )


def log_rows(calls: dict[str, Any]) -> tuple[list[str], list[list[str]]]:
    logs = calls["logs"]
    head = ["us a call, by ticks of the log", *(f"{n:,}" for n in logs["ticks"])]
    rows = [
        [title, *(f"{ns / 1000:,.{0 if ns >= 1e5 else 1}f}" for ns in logs["ns"][name])]
        for name, title in LOG_CALLS.items()
        if name in logs["ns"]
    ]
    return head, rows


def python_block(result: dict[str, Any]) -> str:
    """Return the block of docs/speed.md about calls from Python."""
    calls = result["calls"]
    head, rows = log_rows(calls)
    lines = ["| " + " | ".join(row) + " |" for row in (head, *rows)]
    lines.insert(1, "|---|" + "---:|" * (len(head) - 1))
    missing = [f"- not compared here: {k} ({why})" for k, why in calls["logs"]["missing"].items()]
    note = f"{result['machine']['cpu']}, Python {calls['python']}; least of many calls in turns."
    lines = [*lines, "", *single_lines(calls), direction_line(calls["logs"]), *missing, "", note]
    return "\n".join([PYTHON_MARKS[0], *lines, PYTHON_MARKS[1]])


def show(result: dict[str, Any], unit: str) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console(width=None if sys.stdout.isatty() else 110)
    for core, points in result["points"].items():
        cost = "ns a tick" if core == "host" else f"{unit} a tick"
        printed = Table(title=f"{figures.TITLES[core]}: {cost}, worst error of F/Fc")
        for column in ("way", cost, "worst"):
            printed.add_column(column, justify="left" if column == "way" else "right")
        for key, point in sorted(points.items(), key=lambda item: item[1]["cost"]):
            style = "bold" if point["ours"] else None
            worst = format_error(point["worst"])
            printed.add_row(key, f"{point['cost']:.4g}", worst, style=style)
        console.print(printed)
    head, rows = log_rows(result["calls"])
    printed = Table(*head)
    for row in rows:
        printed.add_row(*(cell.replace("**", "").replace("`", "") for cell in row))
    console.print(printed)
    for line in single_lines(result["calls"]):
        console.print(line.replace("`", ""), markup=False)
    for key, value in result["host"].items():
        console.print(f"{key:32} {value:10.2f}")
    for entry in result["dominated"]:
        console.print(f"beaten: {entry}")
    console.print(f"of our points, {len(result['dominated'])} are beaten in both axes")


def page_with_block(page: Path, marks: tuple[str, str], block: str) -> str:
    """Return the text of a page with a new block between two marks."""
    text = page.read_text()
    start, end = text.find(marks[0]), text.find(marks[1])
    if start < 0 or end < 0:
        raise BenchError(f"{page.relative_to(ROOT)} lacks the lines {marks[0]} and {marks[1]}")
    return text[:start] + block + text[end + len(marks[1]) :]


def write_block(page: Path, marks: tuple[str, str], block: str) -> None:
    target_bench.put(page, page_with_block(page, marks, block).encode())


def draw(target: dict[str, Any], host: dict[str, Any], unit: str) -> None:
    for name, figure in (
        ("speed", figures.pareto(target, host, ("m4f",), unit)),
        ("pareto", figures.pareto(target, host, unit=unit)),
        ("growth", figures.growth(target, host, unit)),
    ):
        for kind in ("png", "svg"):
            figures.save(figure, OUT / f"{name}.{kind}")


def write_docs(target: dict[str, Any], host: dict[str, Any]) -> None:
    if host["quick"]:
        raise BenchError("build/bench/host.json is of a quick run; docs/ needs a full one")
    if set(target) < set(target_bench.CORES) or len(target["m4f"]["motions"]) == 1:
        raise BenchError(
            "build/bench/target.json is of some cores or of a quick run; docs/ needs a full one"
        )
    on_avr = load(avr.RESULT, "target avr")
    write_block(ROOT / "README.md", table.SHORT_MARKS, table.short(target))
    write_block(DOCS / "microcontroller.md", table.MARKS, table.markdown(target))
    write_block(DOCS / "microcontroller.md", call_costs.MARKS, call_costs.block(target))
    write_block(
        DOCS / "microcontroller.md", call_costs.MEMORY_MARKS, call_costs.memory_block(target)
    )
    write_block(DOCS / "microcontroller.md", table.CYCLE_MARKS, table.cycles_block(target))
    write_block(DOCS / "microcontroller.md", table.WORST_MARKS, table.worst_block(target))
    write_block(DOCS / "microcontroller.md", avr.MARKS, avr.block(on_avr))
    write_block(DOCS / "speed.md", table.SPEED_MARKS, table.speed_block(target))
    write_block(DOCS / "speed.md", WAYS_MARKS, ways_table(target, host))
    write_block(DOCS / "speed.md", table.LIBC_MARKS, table.libc_block(target))
    write_block(DOCS / "speed.md", published.MARKS, published.block(target))
    result = results.combine(target, host)
    write_block(DOCS / "speed.md", HOST_MARKS, host_block(result))
    write_block(DOCS / "speed.md", PYTHON_MARKS, python_block(result))
    for name in PICTURES:
        target_bench.put(DOCS / "pictures" / name, (OUT / name).read_bytes())
    write_measured(target)
    print("bench: tables of README.md and docs/, and docs/pictures/ written")


def write_measured(target: dict[str, Any]) -> None:
    """Write the comparison with measured logs. If a log is missing, docs/ keeps its table."""
    try:
        scores = measured.measure()
    except BenchError as error:
        print(f"bench: the comparison with measured logs is unchanged: {error}")
        return
    write_block(DOCS / "speed.md", measured.MARKS, measured.block(scores, target))
    figures.save(measured.picture(scores, target), DOCS / "pictures" / "measured.png")


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="tools/bench.sh report", description=__doc__.split("\n\n")[0]
    )
    choice = parser.add_mutually_exclusive_group()
    choice.add_argument("--docs", action="store_true", help="write tables and pictures of docs/")
    choice.add_argument("--cycles", action="store_true", help="show cycles, not instructions")
    options = parser.parse_args(arguments)
    target = load(target_bench.RESULT, "target")
    host = load(host_bench.RESULT, "host")
    target_bench.write(RESULT, results.combine(target, host))
    shown, unit = target, figures.COUNTED
    if options.cycles:
        shown, unit = results.in_cycles(target), "cycles"
        if not shown:
            raise BenchError(
                "build/bench/target.json has no cycles; run tools/bench.sh target again"
            )
    draw(shown, host, unit)
    show(results.combine(shown, host), unit)
    print("bench: build/bench/results.json and the pictures speed, pareto and growth written")
    if options.docs:
        write_docs(target, host)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except BenchError as problem:
        print(f"error: {problem}", file=sys.stderr)
        sys.exit(2)
