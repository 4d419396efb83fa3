# SPDX-License-Identifier: MIT
"""Every mutant through every test: run_mutants.py [--file lib/gap.h] [--jobs 2]

Writes build/mutants.json: each mutant's fate and the counts. Exit code 0 only if none is alive.
Example:  build/venv/bin/python tests/mutants/run_mutants.py --file lib/gap.h
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Container, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, replace
from pathlib import Path
from typing import TextIO

from mutate import Mutant, mutants_of
from workshop import PORT, PROGRAMS, ROOT, Fate, Program, Workshop

BUILD = ROOT / "build"
RESULT = BUILD / "mutants.json"
LIST = Path(__file__).with_name("equivalent.toml")


def files() -> list[str]:
    """All of the library; of the rest codec, line readers and receiver."""
    lib = sorted(path for kind in "ch" for path in (ROOT / "lib").glob(f"*.{kind}"))
    return [str(path.relative_to(ROOT)) for path in lib] + [f"{name}.c" for name in PORT]


def all_mutants(only: Iterable[str] | None = None) -> list[Mutant]:
    chosen = list(only) if only else files()
    return [mutant for file in chosen for mutant in mutants_of(file, (ROOT / file).read_bytes())]


_worker: Workshop


def start_worker(folder: str, programs: list[Program]) -> None:
    global _worker  # noqa: PLW0603  (a process of the pool has one)
    own = Path(tempfile.mkdtemp(dir=folder))
    _worker = Workshop(own, BUILD / "deps" / "unity", programs)


def work(task: tuple[Mutant, bool]) -> Fate:
    return _worker.judge(*task)


def fates_of(
    mutants: list[Mutant], jobs: int, programs: list[Program], listed: Container[str]
) -> Iterator[Fate]:
    with (
        tempfile.TemporaryDirectory(prefix="dahl-mutants-") as folder,
        ProcessPoolExecutor(jobs, initializer=start_worker, initargs=(folder, programs)) as pool,
    ):
        tasks = [(mutant, mutant.id in listed) for mutant in mutants]
        yield from pool.map(work, tasks, chunksize=8)


def without_duplicates(fates: Iterable[Fate]) -> list[Fate]:
    """Of mutants that compile to the same, all but the first are duplicates."""
    seen: set[str] = set()
    found = []
    for fate in fates:
        known = bool(fate.key) and fate.form + fate.key in seen and fate.kind != "proven"
        found.append(replace(fate, kind="duplicate") if known else fate)
        seen.add(fate.form + fate.key)
    return found


def run(
    mutants: list[Mutant],
    jobs: int = 1,
    programs: Iterable[Program] = PROGRAMS,
    log: TextIO | None = None,
    listed: Container[str] = (),
) -> list[Fate]:
    """The fate of each, with a line of progress every ten seconds; `log` takes each at once. Those
    `listed` have a proof and meet the quick programs only."""
    fates, counts, said = [], Counter[str](), time.monotonic()
    for fate in fates_of(mutants, jobs, list(programs), listed):
        fates.append(fate)
        if log:
            print(json.dumps(asdict(fate)), file=log, flush=True)
        counts[fate.kind] += 1
        if time.monotonic() - said > 10:
            said = time.monotonic()
            print(f"mutants: {len(fates)} of {len(mutants)}, {dict(counts)}", flush=True)
    return without_duplicates(fates)


def counts_of(fates: Iterable[Fate]) -> dict[str, int]:
    """Of the mutants that compile, the distinct ones are neither the original nor each other."""
    kinds = Counter(fate.kind for fate in fates)
    compiled = kinds.total() - kinds["uncompiled"]
    distinct = compiled - kinds["equal"] - kinds["duplicate"]
    names = ("equal", "duplicate", "killed", "proven", "alive")
    counts = {"generated": kinds.total(), "compiled": compiled, "distinct": distinct}
    return counts | {name: kinds[name] for name in names}


def report(mutants: list[Mutant], fates: list[Fate], seconds: float) -> dict[str, object]:
    of_file = {mutant.id: mutant.file for mutant in mutants}
    by_file: dict[str, list[Fate]] = {}
    for fate in fates:
        by_file.setdefault(of_file[fate.id], []).append(fate)
    return {
        **counts_of(fates),
        "files": {file: counts_of(own) for file, own in by_file.items()},
        "killed_by": dict(Counter(fate.killer for fate in fates if fate.killer).most_common()),
        "alive": [fate.id for fate in fates if fate.kind == "alive"],
        "seconds": round(seconds, 1),
        "fates": [asdict(fate) for fate in fates],
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--file", action="append", help="only mutants of this file")
    parser.add_argument("--id", action="append", help="only mutants whose id contains this")
    parser.add_argument("--alive", type=Path, help="only those alive in an earlier result")
    parser.add_argument("--program", action="append", help="only these programs")
    parser.add_argument(
        "--all-tests", action="store_true", help="listed ones meet all programs too"
    )
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--to", type=Path, default=RESULT)
    chosen = parser.parse_args()
    os.nice(5)
    mutants = all_mutants(chosen.file)
    if chosen.id:
        mutants = [m for m in mutants if any(part in m.id for part in chosen.id)]
    if chosen.alive:
        alive = set(json.loads(chosen.alive.read_text())["alive"])
        mutants = [m for m in mutants if m.id in alive]
    start = time.monotonic()
    with chosen.to.with_suffix(".log").open("w") as log:
        programs = [p for p in PROGRAMS if not chosen.program or p.name in chosen.program]
        listed = {entry["id"] for entry in tomllib.loads(LIST.read_text())["mutant"]}
        fates = run(mutants, chosen.jobs, programs, log, set() if chosen.all_tests else listed)
    result = report(mutants, fates, time.monotonic() - start)
    chosen.to.write_text(json.dumps(result, indent=1))
    print(json.dumps({k: v for k, v in result.items() if k != "fates"}, indent=1))
    return 1 if result["alive"] else 0


if __name__ == "__main__":
    sys.exit(main())
