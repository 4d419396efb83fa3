# SPDX-License-Identifier: MIT
"""Coverage-guided fuzzers of all input to the C. Each seed runs, then a fixed number of executions
from a fixed random seed, so that a failure is due to a change; 20 times as many with --full. With
--soak it is 1e9 executions on all cores, with inputs that differ in each run.

The properties are in tests/fuzz/*.c. Programs and inputs are in build/fuzz. An input that broke a
property stays there as NAME/crash-... and is a seed of each later run.
"""

import os
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest
from conftest import BUILD, ROOT, need
from dahl.binding import models
from dahl.sim.keys import KEYS

HERE = ROOT / "tests/fuzz"
PROGRAMS = BUILD.parent / "fuzz/programs"
CLAIM = "no input breaks the properties of tests/fuzz"
SOAK_EXECUTIONS = 1_000_000_000


@dataclass(frozen=True)
class Fuzzer:
    """Bytes of an input at most, and executions that need some 5 s of a processor."""

    length: int
    executions: int


FUZZERS = {
    "step": Fuzzer(64, 1_000_000),
    "prepare": Fuzzer(200, 80_000),
    "parts": Fuzzer(140, 60_000),
    "codec": Fuzzer(24, 1_500_000),
    "receiver": Fuzzer(300, 400_000),
    "slcan": Fuzzer(128, 500_000),
    "socketcand": Fuzzer(256, 100_000),
    "run_file": Fuzzer(1200, 250_000),
    "counts": Fuzzer(512, 300_000),
}


def call(*words: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(word) for word in words],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
        env=os.environ | {"ASAN_OPTIONS": "quarantine_size_mb=8:detect_leaks=1"},
        check=False,
    )


def run_file_words() -> str:
    """Return the dictionary of run files: a line with each key, motion and model."""
    kinds = [f"motion.kind={kind}" for kind in ("segments", "steering", "counts")]
    names = [f"{key.section}.{key.name}=1" for key in KEYS.values() if not key.is_of_scene]
    lines = names + kinds + [f"friction.model={name}" for name in models.table()]
    return "".join(f'"{line}\\x0a"\n' for line in lines)


@pytest.fixture(scope="module")
def programs() -> Path:
    clang = need("clang-19", CLAIM)
    words = ["-G", "Ninja", "-S", HERE, "-B", PROGRAMS, f"-DCMAKE_C_COMPILER={clang}"]
    for command in (["cmake", *words], ["ninja", "-C", PROGRAMS]):
        done = call(*command)
        assert done.returncode == 0, done.stdout[-3000:]
    (PROGRAMS / "run_file.dict").write_text(run_file_words())
    return PROGRAMS


def fuzz(program: Path, found: Path, *options: str) -> subprocess.CompletedProcess[str]:
    name = program.name
    crashes = BUILD.parent / "fuzz" / name
    for folder in (crashes, found):
        folder.mkdir(parents=True, exist_ok=True)
    seeds = [HERE / "corpus" / name, crashes]
    files = (folder / f"{name}.dict" for folder in (HERE, PROGRAMS))
    words = [f"-dict={path}" for path in files if path.exists()]
    words += [f"-artifact_prefix={crashes}/", f"-max_len={FUZZERS[name].length}"]
    words += ["-timeout=60", "-rss_limit_mb=2048", "-malloc_limit_mb=1024", *options]
    return call(program, *words, found, *(path for path in seeds if path.exists()))


def complaint(program: Path, text: str) -> str:
    found = re.search(r".*(property broken|runtime error|ERROR: ).*", text)
    crash = re.search(r"Test unit written to (\S+)", text)
    return f"{found[0] if found else text[-2000:]}\n  again: {program} {crash[1] if crash else ''}"


@pytest.mark.timeout(1800)
@pytest.mark.parametrize("name", FUZZERS)
def test_no_input_breaks_a_property(
    name: str, programs: Path, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    is_full = request.config.getoption("--full") or request.config.getoption("--long")
    executions = FUZZERS[name].executions * (20 if is_full else 1)
    done = fuzz(programs / name, tmp_path, "-seed=1", f"-runs={executions}", "-print_final_stats=1")
    assert done.returncode == 0, complaint(programs / name, done.stdout)
    count = re.search(r"number_of_executed_units: +(\d+)", done.stdout)
    assert count is not None and int(count[1]) >= executions, done.stdout[-2000:]


@pytest.mark.soak
@pytest.mark.timeout(0)
@pytest.mark.parametrize("name", FUZZERS)
def test_a_billion_inputs_break_no_property(name: str, programs: Path) -> None:
    """One process for each core. An interrupted run keeps the inputs that it has found."""
    found = BUILD.parent / "fuzz" / f"{name}_found"
    options = [f"-fork={os.cpu_count()}", f"-runs={SOAK_EXECUTIONS}"]
    done = fuzz(programs / name, found, *options)
    assert done.returncode == 0, complaint(programs / name, done.stdout)
