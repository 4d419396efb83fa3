# SPDX-License-Identifier: MIT
"""The fuzzers: their sources, how to build them, and runs of seconds or hours.

Programs, found inputs and states of long runs are in build/fuzz/NAME. An input that broke a law
stays there as crash-... and each later run tries it again until it passes.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from conftest import BUILD, ROOT, need
from sources import ALL, CORE, FLOAT, INCLUDES, NODE
from sources import PARTS as PART_SOURCES

HERE = "tests/fuzz"
PARTS = ("lib", "port", "host_sim", HERE)
CHECKS = "fuzzer,address,undefined,float-divide-by-zero,float-cast-overflow,implicit-conversion"
SOCKETS = [f"port/socketcand/{name}.c" for name in ("server", "client", "outbox", "text")] + [
    f"{HERE}/sockets.c"
]
STREAMS = [f"{HERE}/streams.c", "host_sim/stderr_messages.c", "host_sim/utf8.c"]
SCENE = [f"host_sim/{name}.c" for name in ("scene", "motion", "plant", "rotor", "recording")]
CALLS = [  # of the kernel, played by sockets.c
    *("socket", "close", "accept4", "recv", "send", "poll", "ppoll", "clock_gettime", "nanosleep"),
    *("setsockopt", "getsockopt", "bind", "listen", "getsockname", "connect", "shutdown"),
    *("getaddrinfo", "freeaddrinfo"),
]
NUMBERS = ["-fno-sanitize-coverage=trace-cmp"]  # no magic words to find in numbers


@dataclass(frozen=True)
class Fuzzer:
    """One target: NAME.c and its sources, or readers.py NAME if there are none."""

    name: str
    length: int  # bytes of an input at most
    floor: int  # executions in a minute, far below what a slow machine reaches
    sources: list[str | Path] = field(default_factory=list)
    options: list[str] = field(default_factory=list)
    libraries: list[str] = field(default_factory=list)
    soak: int = 1_000_000_000

    @property
    def is_python(self) -> bool:
        return not self.sources


FUZZERS = {
    one.name: one
    for one in (
        Fuzzer("step", 64, 200_000, ALL, NUMBERS),
        Fuzzer("prepare", 140, 20_000, ALL, NUMBERS),
        Fuzzer("parts", 128, 20_000, ALL, NUMBERS),
        Fuzzer("codec", 24, 200_000, [p for p in NODE if p.stem == "frames"]),
        Fuzzer("receiver", 300, 20_000, [*NODE, *CORE]),
        Fuzzer("slcan", 128, 50_000, ["port/slcan/slcan.c"]),
        Fuzzer("socketcand", 256, 4_000, SOCKETS, [f"-D{call}=play_{call}" for call in CALLS]),
        Fuzzer(
            "scene",
            1200,
            20_000,
            [*STREAMS, *SCENE, *NODE, *CORE, *PART_SOURCES, *FLOAT],
            ["-Dfopen=play_fopen"],
            ["-linih", "-lcsv"],
        ),
        Fuzzer(
            "recording",
            512,
            50_000,
            [*STREAMS, "host_sim/recording.c"],
            ["-Dfopen=play_fopen"],
            ["-lcsv"],
        ),
        Fuzzer("tables", 2048, 200, soak=1_000_000),
        Fuzzer("buses", 2048, 200, soak=1_000_000),
    )
}


@dataclass(frozen=True)
class Run:
    """The result of libFuzzer."""

    executions: int
    edges: int
    crash: Path | None
    text: str


def home(name: str) -> Path:
    """The folder of a fuzzer's products."""
    folder = BUILD.parent / "fuzz" / name
    (folder / "found").mkdir(parents=True, exist_ok=True)
    return folder


def digest(fuzzer: Fuzzer, root: Path = ROOT) -> str:
    """The digest of all sources of a program."""
    sums = hashlib.sha256(repr(fuzzer).encode())
    parts = (HERE, "tools/dahl") if fuzzer.is_python else PARTS
    for part in parts:
        for path in sorted((root / part).rglob("*.py" if fuzzer.is_python else "*.[ch]")):
            sums.update(path.read_bytes())
    return sums.hexdigest()


def compile_c(fuzzer: Fuzzer, program: Path, root: Path = ROOT) -> None:
    """Build a fuzzer in C out of the tree at root."""
    clang = need("clang-19", f"no input of {fuzzer.name} breaks its laws")
    command = [clang, "-std=c99", "-O1", "-g", f"-fsanitize={CHECKS}", "-fno-sanitize-recover=all"]
    command += ["-D_POSIX_C_SOURCE=200809L", "-ffp-contract=off", *fuzzer.options]
    command += [*INCLUDES, f"-I{HERE}"]
    command += [f"{HERE}/{fuzzer.name}.c", *map(str, fuzzer.sources), "-o", str(program)]
    done = subprocess.run(
        [*command, *fuzzer.libraries, "-lm"], cwd=root, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def python_command(name: str, folder: Path, root: Path = ROOT) -> list[str]:
    """The command of a fuzzer in Python, of the tree at root."""
    (folder / "file").mkdir(exist_ok=True)
    return [sys.executable, str(root / HERE / "readers.py"), name, str(folder / "file")]


def program_of(name: str) -> list[str]:
    """The command of a fuzzer; build it if its sources have changed."""
    fuzzer, folder = FUZZERS[name], home(name)
    if fuzzer.is_python:
        return python_command(name, folder)
    stamp, sums = folder / "program.sha256", digest(fuzzer)
    if not stamp.exists() or stamp.read_text(encoding="utf-8") != sums:
        compile_c(fuzzer, folder / "program")
        stamp.write_text(sums, encoding="utf-8")
    return [str(folder / "program")]


def options_of(name: str, folder: Path) -> list[str]:
    """The options of each run."""
    fuzzer = FUZZERS[name]
    words = ROOT / HERE / f"{name}.dict"
    found = [f"-dict={words}"] if words.exists() else []
    if fuzzer.is_python:  # the reader of MAT files tries them in a process that may crash
        found += ["-handle_segv=0", "-handle_bus=0", "-handle_fpe=0", "-handle_abrt=0"]
    return [
        *found,
        f"-max_len={fuzzer.length}",
        f"-artifact_prefix={folder}/",
        "-timeout=60",  # of one input; the first one of a reader imports what it reads with
        "-report_slow_units=60",
        "-rss_limit_mb=2048",
        "-malloc_limit_mb=1024",
        "-print_final_stats=1",
    ]


def seeds_of(name: str) -> list[Path]:
    """Folders with seeds."""
    folder = home(name)
    seeds = [ROOT / HERE / "corpus" / name]
    if FUZZERS[name].is_python:
        made = folder / "seeds"
        if not made.exists():
            command = [sys.executable, str(ROOT / HERE / "readers.py"), "seeds", str(made), name]
            subprocess.run(command, check=True, capture_output=True, timeout=120)
        seeds.append(made)
    if name == "scene":
        seeds.append(ROOT / "host_sim" / "scenes")
    return [seed for seed in seeds if seed.exists()]


def call(command: list[str], limit: float) -> Run:
    """Run libFuzzer to its end and parse its output."""
    environment = os.environ | {"ASAN_OPTIONS": "quarantine_size_mb=8:detect_leaks=1"}
    done = subprocess.run(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        timeout=limit,
        check=False,
        env=environment,
    )
    text = done.stdout.decode("utf-8", "replace")
    executions = re.findall(r"number_of_executed_units: +(\d+)", text)
    edges = re.findall(r"cov: (\d+)", text)
    crash = re.search(r"Test unit written to (\S+)", text)
    assert done.returncode == 0 or crash or executions, text[-3000:]
    return Run(
        int(executions[-1]) if executions else 0,
        int(edges[-1]) if edges else 0,
        Path(crash[1]) if crash else None,
        text,
    )


def fuzz(name: str, program: list[str], folder: Path, seconds: int, *more: str) -> Run:
    """Run for some seconds; inputs that add coverage stay in folder/found."""
    (folder / "found").mkdir(parents=True, exist_ok=True)
    options = [*options_of(name, folder), f"-max_total_time={seconds}", *more]
    corpora = [str(folder / "found"), *map(str, seeds_of(name))]
    return call([*program, *options, *corpora], seconds * 3 + 120)


def replay(name: str) -> Run:
    """Run each seed, and each input that broke a law; delete those that pass now."""
    folder = home(name)
    old = sorted(folder.glob("crash-*"))
    run = call(
        [*program_of(name), *options_of(name, folder), "-runs=0", *map(str, seeds_of(name))], 200
    )
    if run.crash is None:
        for path in old:
            again = call([*program_of(name), *options_of(name, folder), str(path)], 100)
            if again.crash is not None or "ERROR" in again.text:
                return Run(again.executions, again.edges, path, again.text)
            path.unlink()
    return run


def complaint(name: str, run: Run) -> str:
    """The message of a failed run: the law, the input, and the command to repeat it."""
    law = re.search(r".*(law broken|runtime error|ERROR: |Error: |Uncaught).*", run.text)
    again = " ".join([*program_of(name), str(run.crash)])
    return f"{name}: {law[0] if law else run.text[-2000:]}\n  again: {again}"


def soak(
    name: str, folder: Path, goal: int, seconds: int, report: Callable[[str], None], chunks: int = 0
) -> int:
    """Run `goal` executions of these sources in chunks of some seconds, one process for each core.

    An interrupted run continues at its last chunk. If chunks is not 0, stop after that many.
    """
    state, sums = folder / "soak.json", digest(FUZZERS[name])
    kept = json.loads(state.read_text(encoding="utf-8")) if state.exists() else {}
    total = kept["executions"] if kept.get("sources") == sums else 0
    program, cores = program_of(name), os.cpu_count() or 1
    while total < goal:
        with ThreadPoolExecutor(cores) as pool:
            each = [pool.submit(fuzz, name, program, folder, seconds) for _ in range(cores)]
            runs = [one.result() for one in each]
        for run in runs:
            assert run.crash is None, complaint(name, run)
        now = sum(run.executions for run in runs)
        total += now
        state.write_text(json.dumps({"sources": sums, "executions": total}), encoding="utf-8")
        hours = max(goal - total, 0) / max(now, 1) * seconds / 3600
        speed = f"{now / seconds:.3g}/s, {hours:.1f} h to go"
        report(f"{name}: {total:.3g} of {goal:.0e} executions, {speed}")
        chunks -= 1
        if chunks == 0:
            break
    return total
