# SPDX-License-Identifier: MIT
"""Measure errors and speed of all methods on this host; write build/bench/host.json.

Errors against long double are the same on all machines with the same libm. Times are not: compare
them within one run only. `--quick` runs shorter motions.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import outside
from target import OUT, ROOT, BenchError, run
from target import write as write_json

PROGRAM = ROOT / "build/host/tools/bench/host/host_bench"
RESULT = OUT / "host.json"
VENV = OUT / "venv"
SIGMA0, FC = 100.0, 0.5
TURN = float(np.float32(6.2831853))
OUTSIDE = ("sweep_12", "two_one_24", "sine_12", "creep_18", "leap_14")
GROWN = ("leap_14", "drift_30", "sweep_24", "dither_16", "walk_20")
SOLVERS = ("euler_parts", "rk4_parts", "backward_parts", "trapezoid_parts")
RATES = (100, 300, 1000, 3000, 10000, 30000, 100000)
PARTS_MOST = 4096


@dataclass(frozen=True)
class Sizes:
    """Number of ticks of each measurement. Both modes use the same ticks for published errors."""

    errors: int
    parts: int
    growth: int
    speed: int
    threads: int
    outside: int


QUICK = Sizes(
    errors=200_000, parts=200_000, growth=1_000_000, speed=200_000, threads=2_000_000, outside=5_000
)
WHOLE = Sizes(
    errors=200_000,
    parts=200_000,
    growth=1_000_000_000,
    speed=500_000,
    threads=50_000_000,
    outside=20_000,
)


def say(text: str) -> None:
    print(f"bench: {text}", flush=True)


def build(core_math: Path | None) -> None:
    say("building")
    if core_math and not core_math.is_file():
        raise BenchError(f"--core-math {core_math} is not a file")
    given = core_math.resolve() if core_math else ""
    run("cmake", "--preset", "host", f"-DCORE_MATH={given}", cwd=ROOT)
    run("cmake", "--build", ROOT / "build/host", "--target", "host_bench", "dahl_shared", cwd=ROOT)


def rows(*arguments: object, timeout: float = 1500) -> list[dict[str, Any]]:
    text = run(PROGRAM, *arguments, timeout=timeout)
    return [json.loads(line) for line in text.splitlines()]


DIVERGED = 1e99  # replaces infinity and NaN, which JSON does not have


def number(text: object) -> float:
    value = float(str(text))
    return value if value < DIVERGED else DIVERGED


def measure_errors(sizes: Sizes) -> dict[str, dict[str, list[float]]]:
    """Return worst and RMS error of F/Fc, by scenario and method."""
    say(f"errors: {sizes.errors:,} ticks of each motion, every way")
    result: dict[str, dict[str, list[float]]] = {}
    for row in rows("errors", sizes.errors):
        pair = [number(row["worst"]), number(row["rms"])]
        result.setdefault(row["scenario"], {})[row["way"]] = pair
    return result


def solver_error(way: str, parts: int, scenario: str, ticks: int) -> float:
    return number(rows("parts-error", way, parts, scenario, ticks)[0]["worst"])


def fewest_parts(way: str, limit: float, ticks: int = 20_000) -> int:
    """Return the least parts of a tick, a power of 2, that meet the limit on sine_12, or 0."""
    parts = 1
    while parts <= PARTS_MOST:
        if solver_error(way, parts, "sine_12", ticks) <= limit:
            return parts
        parts *= 2
    return 0


def measure_parts(sizes: Sizes, scenarios: list[str]) -> list[dict[str, Any]]:
    """Return the parts that each solver needs for 1e-3 and 1e-6, and its errors with them."""
    say("solvers with sub-steps for 1e-3 and 1e-6")
    result = []
    for way in SOLVERS:
        for limit in (1e-3, 1e-6):
            parts = fewest_parts(way, limit)
            entry = {"way": way, "limit": limit, "parts": parts}
            if parts:
                entry["worst"] = {s: solver_error(way, parts, s, sizes.parts) for s in scenarios}
            result.append(entry)
    return result


def measure_rates() -> list[dict[str, Any]]:
    say("parts that 1e-3 takes at each sampling rate")
    return [row for rate in RATES for row in rows("parts", rate, 1e-3)]


def measure_growth(sizes: Sizes) -> list[dict[str, Any]]:
    say(f"growth of the error to {sizes.growth:,} ticks, {len(GROWN)} motions")
    with ThreadPoolExecutor(2) as pool:
        found = pool.map(lambda name: rows("growth", name, sizes.growth), GROWN)
    return [{**row, "worst": number(row["worst"])} for part in found for row in part]


def measure_speed(sizes: Sizes) -> dict[str, dict[str, float]]:
    """Return ns per tick, by scenario and method. No other work may run at the same time."""
    say("speed")
    result: dict[str, dict[str, float]] = {}
    for row in rows("speed", sizes.speed):
        result.setdefault(row["scenario"], {})[row["way"]] = row["ns"]
    return result


def outside_task(sizes: Sizes) -> dict[str, Any]:
    scenarios = {}
    for name in OUTSIDE:
        lines = run(PROGRAM, "moves", name, sizes.outside).splitlines()
        pairs = [line.split() for line in lines]
        scenarios[name] = {
            "theta": TURN / 2 ** int(name.split("_")[-1]),
            "moves": [int(move) for move, _ in pairs],
            "exact": [float(w) for _, w in pairs],
        }
    return {"scenarios": scenarios, "sigma0": SIGMA0, "Fc": FC, "solved": 300}


def measure_outside(sizes: Sizes) -> dict[str, dict[str, Any]]:
    """Return errors and ns per tick of each method of outside.py, or why one is missing."""
    say(f"rivals from outside: {', '.join(outside.WAYS)}")
    python = VENV / "bin" / "python"
    if not (VENV / ".complete").exists():
        reason = "build/bench/venv could not be made; see build/setup.log"
        return {name: {"missing": reason} for name in outside.WAYS}
    text = run(
        python,
        ROOT / "tools/bench/outside.py",
        input=json.dumps(outside_task(sizes)),
        cwd=OUT,
        timeout=600,
    )
    result: dict[str, dict[str, Any]] = json.loads(text.splitlines()[-1])
    for name, entry in result.items():
        if "missing" in entry:
            say(f"not compared: {name}: {entry['missing']}")
    return result


def best_time(work: Callable[[], object], rounds: int = 7) -> float:
    times = []
    for _ in range(rounds):
        start = perf_counter()
        work()
        times.append(perf_counter() - start)
    return min(times)


def measure_calls() -> dict[str, Any]:
    """Return ns of single calls from Python, and of a call for a log of each length."""
    import dahl

    say("calls from Python, also of numba and JAX")
    rivals = VENV / "bin" / "python"
    python = rivals if (VENV / ".complete").exists() else sys.executable
    script = ROOT / "tools/bench/python_calls.py"
    path = {"PYTHONPATH": str(Path(dahl.__file__).parents[1])}  # the rivals' venv has no dahl
    calls = {
        "python": platform.python_version(),
        "single": json.loads(run(sys.executable, script, "single")),
        "logs": json.loads(run(python, script, "logs", env=os.environ | path)),
    }
    for name, reason in calls["logs"]["missing"].items():
        say(f"not compared for logs: {name}: {reason}")
    return calls


def ns_per_tick(calls: dict[str, Any]) -> dict[str, float]:
    """Return ns per tick from Python: one call per tick, and one call for all ticks."""
    longest, ns = calls["logs"]["ticks"][-1], calls["logs"]["ns"]
    return {
        "step_ns": calls["single"]["step_counts"],
        "batch_ns": ns["friction"][-1] / longest,
        "throughput_ns": ns["throughput"][-1] / longest,
    }


def measure_threads(ticks: int) -> dict[str, float]:
    """Return ns per tick of one long log, by number of threads."""
    import dahl

    moves = np.random.default_rng(1).integers(-8, 9, ticks).astype(np.int32)
    out, fast = np.empty(ticks, np.float32), dahl.Throughput(SIGMA0, FC, TURN / 2**14)
    numbers = sorted({1, 2, len(os.sched_getaffinity(0))})
    run = lambda threads: fast.run_counts(moves, out=out, threads=threads)  # noqa: E731
    return {str(n): best_time(partial(run, n)) / ticks * 1e9 for n in numbers}


def cpu(text: str) -> str:
    """Return name, family, model and vectors of the first processor in /proc/cpuinfo."""
    lines = [line.partition(":") for line in text.partition("\n\n")[0].splitlines()]
    fields = {key.strip(): value.strip() for key, _, value in lines}
    if "model name" not in fields:
        return "unknown processor"
    flags = fields.get("flags", "").split()
    vectors = "AVX-512" if "avx512bw" in flags else "AVX2" if "avx2" in flags else "no AVX2"
    family = f"family {fields.get('cpu family', '?')}, model {fields.get('model', '?')}"
    return f"{fields['model name']} ({family}, {vectors})"


def measure(quick: bool, core_math: Path | None) -> dict[str, Any]:
    sizes = QUICK if quick else WHOLE
    build(core_math)
    calls = measure_calls()
    errors = measure_errors(sizes)
    return {
        "quick": quick,
        "cpu": cpu(Path("/proc/cpuinfo").read_text()),
        "compiler": run("cc", "--version").splitlines()[0],
        "ticks": vars(sizes),
        "errors": errors,
        "parts": measure_parts(sizes, list(errors)),
        "rates": measure_rates(),
        "speed": measure_speed(sizes),
        "python": ns_per_tick(calls),
        "calls": calls,
        "threads": measure_threads(sizes.threads),
        "outside": measure_outside(sizes),
        "growth": measure_growth(sizes),
    }


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="tools/bench.sh host", description=__doc__.split("\n\n")[0]
    )
    parser.add_argument("--quick", action="store_true", help="shorter motions: under 2 minutes")
    words = "also race the expm1f.c of CORE-MATH (src/binary32/expm1), which this tree cannot hold"
    parser.add_argument("--core-math", type=Path, metavar="FILE", help=words)
    given, start = parser.parse_args(arguments), perf_counter()
    write_json(RESULT, measure(given.quick, given.core_math))
    say(f"build/bench/host.json written, {perf_counter() - start:.0f} s")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except (BenchError, subprocess.SubprocessError) as problem:
        print(f"error: {problem}", file=sys.stderr)
        sys.exit(1)
