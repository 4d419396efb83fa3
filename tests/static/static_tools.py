# SPDX-License-Identifier: MIT
"""Sources and compiler flags of the static checks."""

import importlib.util
from pathlib import Path

import programs
import sources
from conftest import ROOT

LIB = sources.ALL
CODEC = [p for p in sources.NODE if p.stem == "frames"] + [ROOT / "port/slcan/slcan.c"]
NODE = [p for p in sources.NODE if p.stem != "frames"]
FIRMWARE = LIB + CODEC + NODE  # linked into firmware, without start-up code
START_UP = sorted(p for core in ("cortex_m", "riscv", "avr") for p in ROOT.glob(f"port/{core}/*.c"))
FOUND = importlib.util.find_spec("mujoco")
MUJOCO = Path(FOUND.origin).parent if FOUND and FOUND.origin else None  # None: not installed
NOT_READ = [*START_UP, *([] if MUJOCO else ROOT.glob("port/mujoco/*.c"))]
DESK = sorted({*ROOT.glob("port/**/*.c"), *ROOT.glob("host_sim/**/*.c")} - {*FIRMWARE, *NOT_READ})
HEADERS = sorted(p for part in ("lib", "port", "host_sim") for p in ROOT.glob(f"{part}/**/*.h"))
HEADERS = [path for path in HEADERS if MUJOCO or path.parent.name != "mujoco"]

INCLUDES = sources.INCLUDES
MUJOCO_INCLUDES = ["-isystem", str(MUJOCO / "include")] if MUJOCO else []
PLAIN = ["-std=c99", "-D_POSIX_C_SOURCE=200809L", *INCLUDES, *MUJOCO_INCLUDES]

# Warnings for all C of the product. -Wswitch-enum is off because -Wswitch-default requires a
# branch for all other cases.
BOTH = """
    -pedantic -Wall -Wextra -Wconversion -Wsign-conversion -Wdouble-promotion -Wfloat-conversion
    -Wfloat-equal -Wundef -Wshadow -Wcast-qual -Wmissing-prototypes -Wstrict-prototypes
    -Wold-style-definition -Wformat=2 -Wswitch-default -Wpointer-arith -Wwrite-strings
    -Wredundant-decls -Wnested-externs -Wbad-function-cast -Wunused-macros -Wdate-time -Wvla
    -Wnull-dereference -Wimplicit-fallthrough -Wmissing-declarations -Wmissing-field-initializers
    """.split()
GCC = (
    [*PLAIN, "-Werror", *BOTH]
    + """
    -Warith-conversion -Wcast-align=strict -Wformat-signedness -Wlogical-op -Wduplicated-cond
    -Wduplicated-branches -Wjump-misses-init -Walloca -Walloc-zero -Wunused-const-variable=2
    -Wtrampolines -Wstack-protector -Wshift-overflow=2 -Wstringop-overflow=4 -Warray-bounds=2
    -Wattribute-alias=2 -Wenum-conversion -Woverride-init -Wmaybe-uninitialized
    -Wstrict-overflow=2 -Wimplicit-fallthrough=5
    """.split()
)

# All warnings of clang except these.
NOT_MEANT = {
    "padded": "members are ordered by meaning; no struct is sent as it lies in memory",
    "unsafe-buffer-usage": "it is for C++; C reaches an array by a pointer",
    "declaration-after-statement": "C99 has it; a name stands next to its value",
    "switch-enum": "-Wswitch-default requires the branch for all other cases",
    "disabled-macro-expansion": "sa_handler of <signal.h> is such a macro",
}
CLANG = [*PLAIN, "-Werror", "-Weverything", *(f"-Wno-{word}" for word in NOT_MEANT)]


def call(*command: object, cwd: Path | None = None) -> tuple[int, str]:
    done = programs.call(*command, cwd=cwd)
    return done.returncode, done.stdout + done.stderr


def clean(*command: object, cwd: Path | None = None) -> None:
    status, text = call(*command, cwd=cwd)
    assert (status, text) == (0, ""), text
