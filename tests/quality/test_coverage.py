# SPDX-License-Identifier: MIT
"""The C tests reach every region, every side of every branch and every condition (MC/DC) of lib/,
of the codecs of port/ and of the receiver, by the summary of `llvm-cov`. No line is excluded.

The sources are built with the flags of CMakeLists.txt, counters, and fewer ticks. coverage_cpu.h
answers for the processor, so that each branch of cpu_dispatch.h runs on this machine. tests/static
runs the forms for compilers without extensions, tests/target the code for ARMv6-M (multiply_v6m.h,
torque_from.c, a branch of scale.h) on a Cortex-M0.
"""

import json
import os
import re
from collections.abc import Sequence
from pathlib import Path

from conftest import ROOT, need
from programs import run

HERE = Path(__file__).parent
FOLDER = ROOT / "build/coverage"
CLAIM = "100 % of regions, branches and MC/DC"
FLAGS = "-O0 -g -fprofile-instr-generate -fcoverage-mapping -fcoverage-mcdc"
FEW_TICKS = "-DTEST_TICKS=20000 -DTEST_KERNEL_STRIDE=65537 -DTEST_FINEST_BITS=20"

# Codecs and receiver. Sockets, serial ports and boards are tested through their programs.
PORT = re.compile(r"port/.*\b(frame_queue|loopback|slcan|text)\.[ch]$")
LIB = re.compile(r"lib/(?!cores/).*\.[ch]$")

# Processor features that the batches need, one more in each row, so that each condition decides
# once.
FEATURES = ("avx2", "fma", "avx512bw", "avx512dq", "avx512vl")
CPUS = [FEATURES[:count] for count in (0, 1, 2, 3, 4, 5)]
EMPTY = {"kernel_table.c", "torque_from.c"}  # without code on this machine: in no program
BY_CPU = ("test_batch",)  # programs that ask the processor for vectors


def sources(*patterns: re.Pattern[str]) -> list[Path]:
    paths = [path for part in ("lib", "port") for path in sorted((ROOT / part).rglob("*.[ch]"))]
    return [p for p in paths if any(each.match(str(p.relative_to(ROOT))) for each in patterns)]


def build(*parts: str) -> list[Path]:
    for tool in ("clang-19", "llvm-profdata-19", "llvm-cov-19", "cmake", "ninja"):
        need(tool, CLAIM)
    options = [
        "-DCMAKE_C_COMPILER=clang-19",
        f"-DCMAKE_C_COMPILER_LAUNCHER={HERE / 'coverage_compiler.sh'}",
        f"-DCMAKE_C_FLAGS=-include {HERE}/coverage_cpu.h {FLAGS} {FEW_TICKS}",
        "-DCMAKE_BUILD_TYPE=Debug",
        "-DDAHL_BUILD_TESTS=ON",
        "-DDAHL_BUILD_PORT=ON",
        "-DDAHL_BUILD_SIM=ON",
    ]
    tests = [path for part in parts for path in sorted(ROOT.glob(f"tests/{part}/test_*.c"))]
    run("cmake", "-G", "Ninja", "-S", ROOT, "-B", FOLDER, *options)
    run("ninja", "-C", FOLDER, *(path.stem for path in tests))
    return [FOLDER / path.relative_to(ROOT).with_suffix("") for path in tests]


def gaps(programs: Sequence[Path], runs: Sequence[Path], files: Sequence[Path]) -> list[str]:
    """Return a line for each file and kind that the merged runs do not reach completely."""
    profile = runs[0].with_name("merged.profdata")
    run("llvm-profdata-19", "merge", "-o", profile, *runs)
    objects = [word for program in programs for word in ("-object", program)]
    words = ["llvm-cov-19", "export", "-summary-only", f"-instr-profile={profile}", *objects]
    summary = json.loads(run(*words, "-sources", *files))["data"][0]["files"]
    reached = {one["filename"] for one in summary}
    code = [path for path in files if path.suffix == ".c" and path.name not in EMPTY]
    found = [f"{path}: in no program" for path in code if str(path) not in reached]
    return found + [
        f"{one['filename']}: {kind} {one['summary'][kind]['covered']}/"
        f"{one['summary'][kind]['count']}; see llvm-cov-19 show -instr-profile={profile}"
        for one in summary
        for kind in ("functions", "regions", "branches", "mcdc")
        if one["summary"][kind]["covered"] < one["summary"][kind]["count"]
    ]


def profiled(program: Path, profile: Path, cpu: Sequence[str] = ()) -> Path:
    own = {"LLVM_PROFILE_FILE": str(profile), "DAHL_CPU": ",".join(cpu)}
    run(program, env=os.environ | own)
    return profile


def test_each_region_branch_and_condition_is_reached(tmp_path: Path) -> None:
    """Programs that use vectors run once for each processor that this machine can stand for."""
    programs = build("lib", "node", "port")
    has = set(Path("/proc/cpuinfo").read_text(encoding="utf-8").split())
    cpus = [cpu for cpu in CPUS if has.issuperset(cpu)]
    runs = [
        profiled(program, tmp_path / f"{program.name}_{len(cpu)}.profraw", cpu)
        for program in programs
        for cpu in (cpus if program.name in BY_CPU else [()])
    ]
    files = sources(LIB, PORT)
    if cpus != CPUS:
        files = [path for path in files if path.parent.name != "batch"]
        print(f"unproven: {CLAIM} of lib/batch: this processor lacks some of {FEATURES}")
    found = gaps(programs, runs, files)
    assert not found, "\n".join(found)
