# SPDX-License-Identifier: MIT
"""Count instructions, bytes and stack of the library on small cores in QEMU.

Usage: target.py [--quick] [--mhz CLOCK] [CORE...]. The image of a core (tools/bench/target) makes
all its calls from one place, and a plugin of QEMU counts the instructions from entry to return. The
counts are exact and the same on every machine. The cycles of Cortex-M0, M3 and M4F follow from the
trace and from the tables of the manuals (cycles.py). Writes build/bench/target.json. The core `avr`
runs in simavr instead (avr.py).
"""

from __future__ import annotations

import argparse
import fcntl
import json
import math
import os
import re
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import call_costs
import cycles
from dahl.binding import models
from dahl.facts import BOARDS

ROOT = Path(__file__).resolve().parents[2]
OUT = ROOT / "build" / "bench"
RESULT = OUT / "target.json"
PLUGIN = OUT / "plugin.so"

ARM = ("arm-none-eabi-", "qemu-system-arm", "newlib")
RISCV = ("riscv64-unknown-elf-", "qemu-system-riscv32", "picolibc")


class BenchError(Exception):
    """An error that the user reads as one line."""


@dataclass(frozen=True)
class Core:
    """A core: its preset, its title, the machine of QEMU, and its tools."""

    name: str
    title: str
    machine: str
    tools: tuple[str, str, str] = ARM

    @property
    def build(self) -> Path:
        return ROOT / "build" / self.name

    def tool(self, name: str) -> str:
        return self.tools[0] + name


CORES = {
    core.name: core
    for core in (
        *(Core(name, f"Cortex-{name.upper()}", machine) for name, (machine, _) in BOARDS.items()),
        Core("rv32", "RV32IMAC", "virt", RISCV),
    )
}

ALL = [*CORES, "avr"]

# Functions that a user links for each path. A path may need only the library and the integer
# helpers of the compiler.
PATHS = {
    "q30": ["dahl_prepare", "dahl_step_counts_q30"],
    "counts": ["dahl_prepare", "dahl_step_counts_q30", "dahl_step_counts", "dahl_torque"],
    "angle": [
        "dahl_prepare",
        "dahl_step_counts_q30",
        "dahl_step_counts",
        "dahl_torque",
        "dahl_step",
    ],
}

# Kind of memory of each section.
KINDS = {".text": "code", ".rodata": "const", ".srodata": "const"}
KINDS |= dict.fromkeys((".data", ".bss", ".sdata", ".sbss", ".tdata", ".tbss"), "static")


def run(*command: object, timeout: float = 300, **options: Any) -> str:
    """Run a command and return its standard output. If it fails, raise BenchError."""
    words = [str(word) for word in command]
    try:
        done = subprocess.run(
            words, capture_output=True, text=True, check=False, timeout=timeout, **options
        )
    except FileNotFoundError as error:
        raise BenchError(f"{words[0]} is not installed; tools/setup.sh installs it") from error
    except subprocess.TimeoutExpired as error:
        raise BenchError(f"{words[0]} did not end within {timeout:g} s") from error
    if done.returncode != 0:
        tail = (done.stderr.strip() or done.stdout.strip()).splitlines()[-12:]
        raise BenchError(f"{' '.join(words[:4])} failed:\n" + "\n".join(tail))
    return str(done.stdout)


def build(core: Core, *targets: str) -> None:
    """Configure and build targets of one core. A build folder may be of an older tree. The lock
    prevents two builds in one folder at a time.
    """
    core.build.mkdir(parents=True, exist_ok=True)
    with (core.build / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        run("cmake", "--preset", core.name, cwd=ROOT)
        run("cmake", "--build", core.build, "--target", *targets, cwd=ROOT)


def build_plugin() -> None:
    OUT.mkdir(parents=True, exist_ok=True)
    part = PLUGIN.with_suffix(f".{os.getpid()}")
    run("cc", "-std=c99", "-O2", "-shared", "-fPIC", "-o", part, ROOT / "tools/bench/plugin.c")
    part.replace(PLUGIN)


def symbols(core: Core, image: Path) -> dict[str, tuple[int, str]]:
    lines = (line.split() for line in run(core.tool("nm"), image).splitlines())
    return {words[2]: (int(words[0], 16), words[1]) for words in lines if len(words) == 3}


def emulate(core: Core, image: Path) -> tuple[str, str]:
    """Run an image with the plugin. Return its output, and the counts."""
    counts, costs = (OUT / f"{name}.{core.name}.{os.getpid()}" for name in ("counts", "costs"))
    at = symbols(core, image)
    places = ",".join(f"{word}={at['bench_' + word][0]:#x}" for word in ("site", "back", "mark"))
    places += f",floor={at['__heap_start' if core.tools is RISCV else 'heap_start'][0]:#x}"
    options = [
        "-nographic",
        "-monitor",
        "none",
        "-serial",
        "none",
        "-semihosting-config",
        "enable=on,target=native",
    ]
    if core.tools is RISCV:
        options += ["-bios", "none"]
    if core.name in cycles.TABLES:
        costs.write_text(cycles.cost_lines(core.name, run(core.tool("objdump"), "-d", image)))
        places += f",costs={costs}"
    try:
        plugin = f"{PLUGIN},{places},out={counts}"
        text = run(core.tools[1], "-M", core.machine, *options, "-plugin", plugin, "-kernel", image)
        return text, counts.read_text()
    finally:
        counts.unlink(missing_ok=True)
        costs.unlink(missing_ok=True)


@dataclass(frozen=True)
class Call:
    """Instructions of a call, its least and most cycles (0 if the core has no table), its bytes of
    stack, and the address of its function modulo 2 MiB.
    """

    count: int
    least: int
    most: int
    stack: int
    address: int


def read_cases(text: str, counts: str) -> tuple[dict[str, list[Call]], dict[str, int]]:
    """Return the calls of each case by name, and the bytes of each type of the library."""
    names = re.findall(r"^case (\S+)", text, re.MULTILINE)
    sections = [
        [Call(*map(int, line.split())) for line in part.splitlines()]
        for part in counts.split("-\n")[1:]
    ]
    if not names or len(names) != len(sections):
        raise BenchError(f"the image named {len(names)} cases and the plugin saw {len(sections)}")
    objects = {
        name: int(value) for name, value in re.findall(r"^bytes (\S+) (\d+)", text, re.MULTILINE)
    }
    return dict(zip(names, sections, strict=True)), objects


def instructions(cases: dict[str, list[Call]]) -> dict[str, list[int]]:
    return {name: [call.count for call in each] for name, each in cases.items()}


def stated_cycles(core: Core, cases: dict[str, list[Call]]) -> dict[str, list[int]]:
    """Return one number for each call: on M0 that of a multiplier of 1 cycle, else the most."""
    return {
        name: [call.least if core.name == "m0" else call.most for call in each]
        for name, each in cases.items()
    }


# Rows with cycles: the key of target.json and the cases of the image.
CYCLE_CASES = {
    "one_count_q30": ("one_count_forward_q30", "one_count_backward_q30"),
    "one_count_float": ("one_count_forward_float", "one_count_backward_float"),
    "angle_worst": ("angle_worst",),
    "control_tick_units": ("control_tick_units",),
    "control_tick": ("control_tick",),
    "compensator_tick": ("compensator_tick",),
    "node_encoder": ("node_encoder",),
    "node_param_model": ("node_param_model",),
    "newlib_expm1f": ("expm1f",),
}


def cycle_numbers(cases: dict[str, list[Call]]) -> dict[str, list[int]]:
    """Return the least and the most cycles of the worst call of each row."""
    result = {}
    for key, names in CYCLE_CASES.items():
        each = [call for name in names for call in cases[name]]
        result[key] = [max(call.least for call in each), max(call.most for call in each)]
    return result


CODE_MASK = 2 * 1024 * 1024 - 2  # of the address of a function in the counts; Thumb sets bit 0

WORST = "worst:"


def inputs_of(text: str) -> dict[str, list[tuple[int, int, int]]]:
    """Return the inputs of the calls of each case, if the image printed them."""
    result = {}
    for part in re.split("^case ", text, flags=re.MULTILINE)[1:]:
        lines = re.findall(r"^input (\w+) (\w+) (\w+)$", part, re.MULTILINE)
        if lines:
            result[part.split()[0]] = [
                (int(first, 16), int(state, 16), int(move, 16)) for first, state, move in lines
            ]
    return result


def worst_numbers(cases: dict[str, list[Call]], text: str) -> dict[str, dict[str, Any]]:
    """Return instructions and cycles of the worst call of each search, and the input of the call
    with the most cycles. The input is None if all calls cost the same.
    """
    result = {}
    for name, inputs in inputs_of(text).items():
        each = cases[name]
        if len(each) != len(inputs):
            raise BenchError(f"{name} has {len(each)} calls and {len(inputs)} inputs")
        worst = max(range(len(each)), key=lambda k: (each[k].most, each[k].count))
        result[name.removeprefix(WORST)] = {
            "instructions": max(call.count for call in each),
            "cycles": [max(call.least for call in each), each[worst].most],
            "searched": len(each),
            "input": inputs[worst] if len({call.count for call in each}) > 1 else None,
        }
    return result


def cache_value(core: Core, key: str) -> str:
    found = re.search(
        rf"^{key}:\w+=(.*)$", (core.build / "CMakeCache.txt").read_text(), re.MULTILINE
    )
    return found.group(1) if found else ""


def link(core: Core, name: str, symbols: list[str], *libraries: object) -> Path:
    """Link an image of some functions and what they call."""
    image = core.build / "bench" / f"size_{name}.elf"
    flags = cache_value(core, "CMAKE_C_FLAGS").split()
    wanted = [f"-Wl,-u,{symbol}" for symbol in symbols]
    command = [core.tool("gcc"), *flags, "-nostdlib", "-Wl,--gc-sections", "-o", image]
    command += [f"-Wl,-e,{symbols[0]}", *wanted]
    run(*command, *libraries, "-lgcc")
    return image


def link_path(core: Core, name: str, archive: Path | None = None) -> Path:
    return link(core, name, PATHS[name], archive or core.build / "lib" / "libdahl.a")


def sizes(core: Core, image: Path) -> dict[str, int]:
    """Return the bytes of code, const data and writable static data."""
    lines = (line.split() for line in run(core.tool("size"), "-A", image).splitlines())
    by_section = {
        words[0]: int(words[1]) for words in lines if len(words) == 3 and words[0].startswith(".")
    }
    total = dict.fromkeys(("code", "const", "static"), 0)
    for section, size in by_section.items():
        kind = KINDS.get(".".join(section.split(".")[:2]))
        if kind:
            total[kind] += size
    return total


def objects_at(core: Core, level: str) -> list[Path]:
    """Compile the C of core and parts at one level of optimisation, such as -O0."""
    folder = core.build / "bench" / f"at{level}"
    folder.mkdir(parents=True, exist_ok=True)
    flags = [
        *cache_value(core, "CMAKE_C_FLAGS").split(),
        level,
        "-std=c99",
        "-I",
        ROOT / "lib/include",
    ]
    objects = []
    for source in sorted(
        path
        for part in ("arith", "model", "parts", "compensator")
        for path in (ROOT / "lib" / part).glob("*.c")
    ):
        objects.append(folder / f"{source.stem}.o")
        run(core.tool("gcc"), *flags, "-c", source, "-o", objects[-1])
    return objects


def helpers(core: Core, *objects: Path) -> list[str]:
    """Return the symbols that a bare link needs from the compiler's library."""
    names = run(core.tool("nm"), *objects).splitlines()
    words = [line.split() for line in names]
    defined = {word[-1] for word in words if len(word) == 3}
    return sorted({word[1] for word in words if len(word) == 2 and word[0] == "U"} - defined)


def measure_sizes(core: Core) -> dict[str, int]:
    result: dict[str, int] = {}
    for name in PATHS:
        size = sizes(core, link_path(core, name))
        suffix = "" if name == "q30" else f"_{name}"
        result |= {f"{kind}_bytes{suffix}": size[kind] for kind in ("code", "const", "static")}
    return result


def flash(core: Core, name: str) -> int:
    """Return the bytes of code and constants of an image that makes this call alone."""
    library = core.build / "lib"
    archives = [library / f"libdahl{part}.a" for part in ("_node", "_commission", "")]
    image = link(core, name, [name], *archives, "-lc")
    size = sizes(core, image)
    return size["code"] + size["const"]


def measure_calls(core: Core, cases: dict[str, list[Call]], image: Path) -> dict[str, Any]:
    """Return the worst instructions and stack of each public call, and its flash. The frames that
    dahl_node_receive() reads have a row each.
    """
    public = call_costs.public_calls()
    everywhere = [call for each in cases.values() for call in each]
    rows = {name: (name, everywhere) for name in public}
    rows |= {case: ("dahl_node_receive", cases[case]) for case in call_costs.RECEIVED}
    result, at = {}, symbols(core, image)
    for row, (name, candidates) in rows.items():
        address = at[name][0] & CODE_MASK if name in at else -1
        made = [call for call in candidates if call.address == address]
        if not made:
            raise BenchError(f"{name}() has no case in tools/bench/target")
        result[row] = {
            "instructions": max(call.count for call in made),
            "stack": max(call.stack for call in made),
            "flash": flash(core, name),
        }
    return result


# Beginnings of the cases of dahl_parts.h and dahl_compensator.h, and Coulomb for measured.py
PARTS = (
    *(f"{name}_" for name in models.table() if name != "dahl"),
    *("mixed_", "clamped_", "elastic_", "plastic_", "crossing_"),
    *("work_", "counts_to_torque", "tip_torque", "velocity_", "compensator_", "residual_"),
    *("damping_", "commission_"),
    "coulomb",
)


def library_numbers(cases: dict[str, list[int]]) -> dict[str, int]:
    """Return the results of the library: for each name the worst of its calls."""
    worst = {name: max(counts) for name, counts in cases.items()}
    result = {}
    for form in ("q30", "float"):
        for move in ("one_count", "one_count_c", "eight_counts", "1000_counts"):
            result[f"{move}_{form}"] = max(
                worst[f"{move}_forward_{form}"], worst[f"{move}_backward_{form}"]
            )
        for move in ("zero", "int32_min", "reversal", "counts_worst"):
            result[f"{move}_{form}"] = worst[f"{move}_{form}"]
    dense = cases["dense_q30"]
    result |= {"dense_q30_least": min(dense), "dense_q30_most": max(dense)}
    others = (
        "angle_zero",
        "angle_worst",
        "angle_c_worst",
        "prepare",
        "torque",
        "set_torque",
        "change_plan",
        "counts_between",
        "counts_between_below",
        "encoder_move",
        "encoder_move_other",
        "encoder_move_jump",
        "to_units",
        "control_tick",
        "control_tick_units",
    )
    result |= {name: worst[name] for name in others}
    result |= {name: count for name, count in worst.items() if name.startswith(PARTS)}
    return result


def rival_numbers(cases: dict[str, list[int]], libc: str) -> dict[str, int]:
    names = {"expm1f": f"{libc}_expm1f", "expf": f"{libc}_expf", "exp_double": f"{libc}_exp_double"}
    plain = {"euler": "euler", "rk4": "rk4", "table": "table"}
    result = {key: max(cases[case]) for case, key in (names | plain).items()}
    return result | {f"{key}_worst": max(cases[f"{case}_worst"]) for case, key in names.items()}


MOTION = "motion:"


def motion_numbers(cases: dict[str, list[int]]) -> dict[str, dict[str, float]]:
    """Return the mean cost of a tick, by motion and method."""
    result: dict[str, dict[str, float]] = {}
    for name, counts in cases.items():
        if name.startswith(MOTION):
            motion, way = name.removeprefix(MOTION).split(":")
            result.setdefault(motion, {})[way] = round(sum(counts) / len(counts), 1)
    return result


def measure(core: Core, libcs: list[str]) -> dict[str, object]:
    build(core, *(f"bench_{libc}" for libc in libcs))
    result: dict[str, Any] = {
        "core": core.title,
        "board": core.machine,
        "compiler": run(core.tool("gcc"), "--version").splitlines()[0],
    }
    for libc in reversed(libcs):
        image = core.build / "bench" / f"bench_{libc}"
        text, counts = emulate(core, image)
        counted, types = read_cases(text, counts)
        cases = instructions(counted)
        result |= library_numbers(cases) | rival_numbers(cases, libc)
        result.setdefault("motions", {})[libc] = motion_numbers(cases)
        if core.name in cycles.TABLES:
            in_cycles = motion_numbers(stated_cycles(core, counted))
            result.setdefault("motion_cycles", {})[libc] = in_cycles
    result["worst"] = worst_numbers(counted, text)
    result["calls"] = measure_calls(core, counted, image)
    result["types"] = types
    if core.name in cycles.TABLES:
        result["cycles"] = cycle_numbers(counted)
    return (
        result
        | measure_sizes(core)
        | {
            "helpers": helpers(core, core.build / "lib" / "libdahl.a"),
            "helpers_O0": helpers(core, *objects_at(core, "-O0")),
        }
    )


def put(path: Path, content: bytes) -> None:
    """Replace a file by a complete one."""
    part = path.with_name(f".{os.getpid()}{path.name}")
    try:
        part.write_bytes(content)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def write(path: Path, result: Mapping[str, object]) -> None:
    put(path, (json.dumps(result, indent=1) + "\n").encode())


def measure_all(names: list[str], quick: bool) -> dict[str, dict[str, Any]]:
    build_plugin()
    result = {}
    for name in names:
        core = CORES[name]
        libcs = (
            ["picolibc"] if core.tools is RISCV else ["newlib"] if quick else ["newlib", "picolibc"]
        )
        result[name] = measure(core, libcs)
    return result


def clock(word: str) -> float:
    try:
        mhz = float(word)
    except ValueError:
        mhz = math.nan
    if not 0 < mhz < math.inf:
        raise BenchError(f"--mhz {word}: not a clock; give a number of MHz above 0, such as 48")
    return mhz


def measure_and_show(names: list[str], quick: bool, mhz: float | None) -> None:
    from table import show, show_times

    if not names:
        return
    result = measure_all(names, quick)
    write(RESULT, result)
    show(result)
    if mhz is not None:
        show_times(result, mhz)


def measure_and_show_avr() -> None:
    import avr
    from table import make_console

    result = avr.measure()
    write(avr.RESULT, result)
    avr.show(result, make_console().print)


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="tools/bench.sh target", description=__doc__.split("\n\n")[0]
    )
    parser.add_argument(
        "cores", nargs="*", metavar="CORE", help=f"some of {' '.join(ALL)} (default: all)"
    )
    parser.add_argument("--quick", action="store_true", help="leave picolibc out")
    parser.add_argument(
        "--mhz", metavar="CLOCK", help="also print microseconds at this clock, for example --mhz 48"
    )
    options = parser.parse_args(arguments)
    mhz = None if options.mhz is None else clock(options.mhz)
    unknown = set(options.cores) - {*ALL}
    if unknown:
        parser.error(f"unknown core {sorted(unknown)[0]}; known are {' '.join(ALL)}")
    names = options.cores or ALL
    if mhz is not None and not cycles.TABLES.keys() & set(names):
        known = " ".join(cycles.TABLES)
        raise BenchError(f"--mhz: no cycles are known for {' '.join(names)}; add one of {known}")
    measure_and_show([name for name in names if name in CORES], options.quick, mhz)
    if "avr" in names:
        measure_and_show_avr()
    return 0


if __name__ == "__main__":
    import target  # the module that avr.py imports: its BenchError is caught below

    try:
        sys.exit(target.main(sys.argv[1:]))
    except target.BenchError as problem:
        print(f"error: {problem}", file=sys.stderr)
        sys.exit(1)
