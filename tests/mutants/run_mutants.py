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
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, replace
from pathlib import Path
from typing import TextIO

from mutate import Mutant, mutants_of
from workshop import PORT, PROGRAMS, ROOT, Fate, Program, Workshop

BUILD = ROOT / "build"
RESULT = BUILD / "mutants.json"


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


def work(mutant: Mutant) -> Fate:
    return _worker.judge(mutant)


def fates_of(mutants: list[Mutant], jobs: int, programs: list[Program]) -> Iterator[Fate]:
    with (
        tempfile.TemporaryDirectory(prefix="dahl-mutants-") as folder,
        ProcessPoolExecutor(jobs, initializer=start_worker, initargs=(folder, programs)) as pool,
    ):
        yield from pool.map(work, mutants, chunksize=4)


def without_duplicates(fates: Iterable[Fate]) -> list[Fate]:
    """Of mutants that compile to the same, all but the first are duplicates."""
    seen: set[str] = set()
    found = []
    for fate in fates:
        known = bool(fate.key) and fate.form + fate.key in seen
        found.append(replace(fate, kind="duplicate") if known else fate)
        seen.add(fate.form + fate.key)
    return found


def run(
    mutants: list[Mutant],
    jobs: int = 1,
    programs: Iterable[Program] = PROGRAMS,
    log: TextIO | None = None,
) -> list[Fate]:
    """The fate of each, with a line of progress every ten seconds; `log` takes each at once."""
    fates, counts, said = [], Counter[str](), time.monotonic()
    for fate in fates_of(mutants, jobs, list(programs)):
        fates.append(fate)
        if log:
            print(json.dumps(asdict(fate)), file=log, flush=True)
        counts[fate.kind] += 1
        if time.monotonic() - said > 10:
            said = time.monotonic()
            print(f"mutants: {len(fates)} of {len(mutants)}, {dict(counts)}", flush=True)
    return without_duplicates(fates)


def report(mutants: list[Mutant], fates: list[Fate], seconds: float) -> dict[str, object]:
    kinds = Counter(fate.kind for fate in fates)
    compiled = len(fates) - kinds["uncompiled"]
    return {
        "generated": len(mutants),
        "compiled": compiled,
        "equal": kinds["equal"],
        "duplicate": kinds["duplicate"],
        "distinct": compiled - kinds["equal"] - kinds["duplicate"],
        "killed": kinds["killed"],
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
        fates = run(mutants, chosen.jobs, programs, log=log)
    result = report(mutants, fates, time.monotonic() - start)
    chosen.to.write_text(json.dumps(result, indent=1))
    print(json.dumps({k: v for k, v in result.items() if k != "fates"}, indent=1))
    return 1 if result["alive"] else 0


if __name__ == "__main__":
    sys.exit(main())
