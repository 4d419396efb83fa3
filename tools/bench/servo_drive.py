# SPDX-License-Identifier: MIT
"""Measure examples/servo_drive in QEMU: flash, RAM, stack and the worst tick. With --docs, write
the table into its page.

The drive commissions its axis, moves, changes its parameters, and meets a fault of its encoder. The
plugin counts each tick, without the main program. The stack is that of the main program and of the
interrupt on top of it.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cycles
import target
from dahl import codec
from target import CORES, OUT, ROOT

FOLDER = ROOT / "examples/servo_drive"
sys.path.insert(0, str(FOLDER))
from shaft import Bench, Command, spi_frame  # noqa: E402

MARKS = ("<!-- bench:servo_drive -->", "<!-- /bench:servo_drive -->")
NAMES = ("m0", "m4f")
STACK_BYTES = 8192  # more than the drive may use


Worst = tuple[int, int]  # instructions and cycles of the worst tick
Spans = dict[str, list[range]]  # ticks of each phase


@dataclass(frozen=True)
class Result:
    """Bytes, and the worst tick of each phase."""

    title: str
    flash: int
    ram: int
    stack: int
    ticks: dict[str, Worst]


def stack_of(bench: Bench, top: int) -> int:
    """Return the bytes below `top` that were written. The memory of QEMU is zero at the start."""
    for address in range(top - STACK_BYTES, top, 4):
        if bench.peek(address):
            return top - address
    raise target.BenchError("no stack was used")


def play(bench: Bench) -> Spans:
    """Use each part of the drive."""
    spans: Spans = {"commissioning": [], "new parameters": []}

    def during(phase: str, act: Callable[[], object]) -> None:
        first = bench.ticks - 1
        act()
        spans[phase].append(range(first, bench.ticks + 2))

    bench.run(0.3)
    bench.send(Command.COMMISSION)
    during("commissioning", lambda: bench.run(60, lambda: bench.drive["Stored"] == "Good"))
    for goal in (9000, -9000):
        bench.hold(0.6, goal)
        during("new parameters", lambda: bench.write(codec.Param.FC, 400000 + bench.count))
    bench.encoder = lambda count: bytes(4)
    bench.run(0.3)
    bench.encoder = spi_frame
    bench.run(0.3)
    bench.send(Command.CLEAR)
    bench.send(Command.SAVE)
    bench.run(0.2)
    if bench.drive["State"] != "Off" or bench.drive["Stage"] != 6:
        raise target.BenchError(f"the drive does not work: {bench.drive}")
    return spans


def worst_ticks(ticks: list[Worst], spans: Spans) -> dict[str, Worst]:
    """Return the worst tick of each phase, and of all other ticks."""
    rest = set(range(len(ticks))).difference(*(span for each in spans.values() for span in each))
    phases = {"running": sorted(rest)}
    phases |= {name: [tick for span in each for tick in span] for name, each in spans.items()}
    return {
        name: (max(ticks[k][0] for k in each), max(ticks[k][1] for k in each))
        for name, each in phases.items()
    }


def measure(name: str, folder: Path) -> Result:
    core = CORES[name]
    target.build(core, "servo_drive")
    image = core.build / "tests/target/servo_drive"
    at = {symbol: place for symbol, (place, _) in target.symbols(core, image).items()}
    costs, counts = folder / "costs", folder / "counts"
    costs.write_text(cycles.cost_lines(name, target.run(core.tool("objdump"), "-d", image)))
    places = f"site={at['tick_site']:#x},back={at['tick_back']:#x},floor={at['heap_start']:#x}"
    plugin = f"{target.PLUGIN},{places},costs={costs},out={counts}"
    with Bench(name, image, folder, "-plugin", plugin) as bench:
        spans = play(bench)
        stack = stack_of(bench, at["stack_top"])
    lines = [tuple(map(int, line.split())) for line in counts.read_text().splitlines()]
    kind = 1 if name == "m0" else 2  # cycles: of a multiplier of 1 cycle, else the most
    ticks = worst_ticks([(line[0], line[kind]) for line in lines], spans)
    size = target.sizes(core, image)
    return Result(core.title, size["code"] + size["const"], size["static"], stack, ticks)


def table(results: list[Result]) -> str:
    phases = list(results[0].ticks)
    head = ["core", "flash", "RAM", "stack", *(f"worst tick, {phase}" for phase in phases)]
    lines = ["| " + " | ".join(head) + " |", "|---|" + "---:|" * (len(head) - 1)]
    for one in results:
        times = [f"{one.ticks[phase][0]} ({one.ticks[phase][1]})" for phase in phases]
        row = [one.title, *(f"{size} B" for size in (one.flash, one.ram, one.stack)), *times]
        lines.append("| " + " | ".join(row) + " |")
    return "\n".join([MARKS[0], *lines, MARKS[1]])


def measure_all() -> str:
    """Return the block of the page."""
    OUT.mkdir(parents=True, exist_ok=True)
    target.build_plugin()
    results = []
    for name in NAMES:
        with tempfile.TemporaryDirectory(dir=OUT) as folder:
            results.append(measure(name, Path(folder)))
    return table(results)


def main(arguments: list[str]) -> int:
    block = measure_all()
    print(block)
    if arguments == ["--docs"]:
        page = FOLDER / "README.md"
        before, _, rest = page.read_text().partition(MARKS[0])
        target.put(page, f"{before}{block}{rest.partition(MARKS[1])[2]}".encode())
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except target.BenchError as problem:
        print(f"error: {problem}", file=sys.stderr)
        sys.exit(1)
