# SPDX-License-Identifier: MIT
"""Every line, every side of every branch and every condition (MC/DC) of lib/, of the codecs of
port/ and of the receiver is exercised by the C tests of tests/lib, tests/node and tests/port.

The tool is clang's source coverage. No line is excluded. A hole is printed as file:line:column.
"""

from __future__ import annotations

import re
from pathlib import Path

import coverage_build
import coverage_llvm
import pytest
from conftest import need
from sources import BATCHES

ROOT = coverage_build.ROOT
FOLDER = ROOT / "build/coverage"
NATIVE = coverage_build.Build(FOLDER / "native", False)
PLAIN = coverage_build.Build(FOLDER / "plain", True)

# Processor features that the batches need, one more in each row: with these rows each condition
# decides once.
CPUS = [(), ("avx2",), ("avx2", "fma")]
CPUS += [(*CPUS[2], "avx512bw"), (*CPUS[2], "avx512bw", "avx512dq")]
CPUS += [(*CPUS[4], "avx512vl")]
VECTORS = {"none": CPUS[0], "AVX2": CPUS[2], "AVX-512": CPUS[5]}
CLAIM = "100 % of lines, branches and MC/DC"

# Sources that are compiled once for each set of vectors.
BY_CPU = ("test_batch", "test_fast_parallel")  # programs that ask the processor for vectors
VARIED = re.compile(r"channels|fast$")


def has(cpu: tuple[str, ...]) -> bool:
    """Return whether this machine's processor has these features."""
    try:
        words = Path("/proc/cpuinfo").read_text(encoding="utf-8").split()
    except OSError:
        words = []
    return set(cpu) <= set(words)


def name_of(cpu: tuple[str, ...]) -> str:
    return "_".join(cpu) or "none"


def tools() -> None:
    for tool in ("clang-19", "llvm-profdata-19", "llvm-cov-19", "cmake", "ninja"):
        need(tool, CLAIM)


@pytest.fixture(scope="session")
def native() -> list[Path]:
    """Return the profiles of all programs; fast batches run once for each processor."""
    tools()
    NATIVE.make()
    profiles = FOLDER / "profiles"
    runs = []
    for program in NATIVE.programs:
        name = program.name
        if name not in BY_CPU:
            runs.append(coverage_build.run_llvm(program, profiles / f"{name}.profraw"))
        for cpu in filter(has, CPUS if name in BY_CPU else ()):
            place = profiles / f"{name.removeprefix('test_')}_{name_of(cpu)}.profraw"
            runs.append(coverage_build.run_llvm(program, place, cpu))
    return runs


def report(files: dict[Path, coverage_llvm.FileCoverage]) -> None:
    """Print a line for each file, for pytest -rP."""
    for path, coverage in sorted(files.items()):
        numbers = (f"{kind} {n}/{all_}" for kind, (n, all_) in coverage.totals().items())
        print(f"{str(path.relative_to(ROOT)):36}", *numbers)


def called(path: Path, coverage: coverage_llvm.FileCoverage) -> coverage_llvm.FileCoverage:
    """Remove the functions of a batch that this processor does not call."""
    return coverage.without_uncalled() if path in BATCHES else coverage


def unseen(files: dict[Path, coverage_llvm.FileCoverage]) -> list[str]:
    """Return the sources without a counted line: they are in no program."""
    return [
        f"{path.relative_to(ROOT)}:1:1: in no program"
        for path, coverage in files.items()
        if path.suffix == ".c" and not coverage.lines
    ]


def expect_none(holes: list[str], of: str) -> None:
    assert not holes, f"{len(holes)} holes in the coverage of {of}:\n" + "\n".join(holes)


def test_lines_branches_and_conditions(native: list[Path], tmp_path: Path) -> None:
    """As this machine builds it, with each branch of the batches."""
    profile = coverage_llvm.merge(native, tmp_path / "all.profdata")
    files = coverage_llvm.measure(profile, NATIVE.programs, coverage_build.all_sources())
    report(files)
    if not all(map(has, CPUS)):
        files = {path: called(path, coverage) for path, coverage in files.items()}
    holes = unseen(files) + coverage_llvm.holes_of(files, ROOT)
    if not all(map(has, CPUS)):
        holes = [hole for hole in holes if "dispatch.h" not in hole]
    expect_none(holes, "lib, codec and receiver")


@pytest.mark.parametrize("vectors", VECTORS)
def test_batches_with_each_set_of_vectors(native: list[Path], vectors: str, tmp_path: Path) -> None:
    """The variants share most of their source, so each is counted in a separate run. The test of
    all variants checks that each function is called.
    """
    if not has(VECTORS[vectors]):
        pytest.skip(f"unproven: {CLAIM} of the {vectors} batches: this processor has none")
    runs = [path for path in native if path.stem == f"batch_{name_of(VECTORS[vectors])}"]
    profile = coverage_llvm.merge(runs, tmp_path / "batch.profdata")
    sources = [path for path in BATCHES if VARIED.search(path.stem)]
    programs = [program for program in NATIVE.programs if program.name == "test_batch"]
    files = coverage_llvm.measure(profile, programs, sources)
    files = {path: called(path, coverage) for path, coverage in files.items()}
    report(files)
    expect_none(coverage_llvm.holes_of(files, ROOT), f"the batches with vectors: {vectors}")


@pytest.mark.long
def test_lines_branches_and_conditions_without_extensions(tmp_path: Path) -> None:
    """As a plain C99 compiler builds lib/."""
    tools()
    PLAIN.make()
    runs = [
        coverage_build.run_llvm(program, FOLDER / "profiles" / f"plain_{program.name}.profraw")
        for program in PLAIN.programs
    ]
    profile = coverage_llvm.merge(runs, tmp_path / "all.profdata")
    files = coverage_llvm.measure(profile, PLAIN.programs, coverage_build.lib_sources())
    report(files)
    holes = unseen(files) + coverage_llvm.holes_of(files, ROOT)
    expect_none(holes, "lib without extensions of the compiler")
