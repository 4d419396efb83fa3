# SPDX-License-Identifier: MIT
"""Build the C tests with counters, each form in a folder under build/coverage.

Sources and flags are those of CMakeLists.txt. Instrumentation is added, and the tests run fewer
ticks. Each file is built in two forms:
  native   as this machine builds it. coverage_cpu.h answers for the processor, so that each branch
           of cpu_dispatch.h runs on this machine.
  plain    as a compiler without extensions builds it (coverage_plain.h): the other side of each
           #if of compiler.h, fixed.h and cpu_dispatch.h, and one variant of each batch.
Neither form compiles multiply_v6m.h, which is assembly for ARMv6-M: tests/target runs it on a
Cortex-M0.
"""

from __future__ import annotations

import os
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]

# Codec and receiver. Sockets, serial ports and boards are tested through their programs.
FOLDERS = ("port", "port/loopback", "port/slcan", "port/socketcand", "host_sim", "lib/node")
STEMS = ("frame_queue", "frames", "loopback", "slcan", "text", "node")

COMPILER = HERE / "coverage_compiler.sh"
FLAGS = "-O0 -g -fprofile-instr-generate -fcoverage-mapping -fcoverage-mcdc"
FEW_TICKS = "-DTEST_TICKS=20000 -DTEST_KERNEL_STRIDE=65537 -DTEST_FINEST_BITS=20"


def lib_sources(root: Path = ROOT) -> list[Path]:
    """Return the sources of lib/ for a host. tests/target compares code for one core with the C."""
    elsewhere = ("node", "cores")
    return sorted(p for p in root.glob("lib/**/*.[ch]") if p.parent.name not in elsewhere)


def all_sources(root: Path = ROOT) -> list[Path]:
    """Return the sources of lib/, the codec and the receiver."""
    found = (path for folder in FOLDERS for path in sorted((root / folder).glob("*.[ch]")))
    return lib_sources(root) + [path for path in found if path.stem in STEMS]


@dataclass(frozen=True)
class Build:
    """One configuration of the project."""

    folder: Path
    is_plain: bool

    @property
    def programs(self) -> list[Path]:
        """Return its test programs."""
        parts = ("lib",) if self.is_plain else ("lib", "node", "port")
        paths = [path for part in parts for path in sorted(ROOT.glob(f"tests/{part}/test_*.c"))]
        return [self.folder / path.relative_to(ROOT).with_suffix("") for path in paths]

    def make(self) -> None:
        """Configure and build what has changed."""
        header = HERE / ("coverage_plain.h" if self.is_plain else "coverage_cpu.h")
        options = [
            "-DCMAKE_C_COMPILER=clang-19",
            f"-DCMAKE_C_COMPILER_LAUNCHER=sh;{COMPILER}",
            f"-DCMAKE_C_FLAGS=-include {header} {FLAGS} {FEW_TICKS}",
            "-DCMAKE_BUILD_TYPE=Debug",
            "-DDAHL_BUILD_TESTS=ON",
            f"-DDAHL_BUILD_PORT={'OFF' if self.is_plain else 'ON'}",
            f"-DDAHL_BUILD_SIM={'OFF' if self.is_plain else 'ON'}",
        ]
        call(["cmake", "-G", "Ninja", "-S", str(ROOT), "-B", str(self.folder), *options])
        call(["ninja", "-C", str(self.folder), *(program.name for program in self.programs)])


def call(command: Sequence[str], **environment: str) -> None:
    """Run a command. If it fails, raise an error with its output."""
    done = subprocess.run(
        command,
        check=False,
        capture_output=True,
        text=True,
        timeout=280,
        env=os.environ | environment,
    )
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(command)}\n{done.stdout}\n{done.stderr}")


def run_llvm(program: Path, profile: Path, cpu: Sequence[str] = ()) -> Path:
    """Run a test program, which must pass, and return its profile."""
    profile.parent.mkdir(parents=True, exist_ok=True)
    profile.unlink(missing_ok=True)
    call([str(program)], LLVM_PROFILE_FILE=str(profile), DAHL_CPU=",".join(cpu))
    return profile
