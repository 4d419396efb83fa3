# SPDX-License-Identifier: MIT
"""Messages of compilers: an unused result warns, and a core that lacks something does not build."""

import re
import subprocess
from pathlib import Path

import pytest
from conftest import ROOT, need, with_compilers
from programs import call, run
from sources import as_one

LIB = ROOT / "lib"


def compiled(command: list[str], source: Path, folder: Path) -> subprocess.CompletedProcess[str]:
    need(command[0], "messages of compilers")
    return call(*command, f"-I{LIB}/include", "-c", "-o", folder / "x.o", source)


# --- an unused result -----------------------------------------------------------------------------

USE = """
#include "dahl_encoder.h"
#include "dahl_float.h"
#include "dahl_node.h"
typedef struct {
    dahl_plan_t plan;
    dahl_float_plan_t literal;
    dahl_encoder_t encoder;
    dahl_node_t node;
} all_t;
void begin(all_t *all, const dahl_params_t *params);
void begin(all_t *all, const dahl_params_t *params)
{
    STATEMENTS
    (void)all;
    (void)params;
}
"""
CALLS = [
    "dahl_prepare(&all->plan, params)",
    "dahl_float_prepare(&all->literal, params)",
    "dahl_encoder_init(&all->encoder, 65536, 1, 0)",
    "dahl_node_init(&all->node, params, 0)",
]
COMPILERS = ("gcc -std=c99", "gcc -std=c2x", "clang -std=c99", "g++ -std=c++17 -x c++")


@pytest.mark.parametrize("compiler", with_compilers(*COMPILERS))
def test_an_unused_result_of_prepare_warns(compiler: str, tmp_path: Path) -> None:
    source = tmp_path / "use.c"
    used = "".join(f"while ({each} != DAHL_OK) {{}}\n" for each in CALLS)
    for text, wanted in (("".join(f"{each};\n" for each in CALLS), len(CALLS)), (used, 0)):
        source.write_text(USE.replace("STATEMENTS", text))
        done = compiled([*compiler.split(), "-Wall", "-pedantic"], source, tmp_path)
        assert done.stderr.count("warning: ") == wanted, done.stderr
        assert len(re.findall(r"warning: .*(?:unused.result|nodiscard)", done.stderr)) == wanted


# --- all files in one --------------------------------------------------------------------------

# Of lib but for the batches in vectors, and of port for programs of a host.
PORTS = [
    *(ROOT / "port").glob("s*/*.c"),
    ROOT / "port/loopback/loopback.c",
]
FILES = [path for path in LIB.rglob("*.c") if path.stem not in ("trajectory", "channels")]
HOST = "-std=c99 -D_GNU_SOURCE= -Wall -Wextra -Werror -Wshadow"
UNITS = {f"{compiler} {HOST}": [*FILES, *PORTS] for compiler in ("gcc", "clang")}
UNITS["arm-none-eabi-gcc -mcpu=cortex-m3 -mthumb -std=c99 -Werror"] = FILES


@pytest.mark.parametrize("is_reversed", [False, True])
@pytest.mark.parametrize("command", with_compilers(*UNITS))
def test_all_files_compile_as_one(command: str, is_reversed: bool, tmp_path: Path) -> None:
    """In both orders: no static name, macro or type of a file depends on another file."""
    unit = as_one(tmp_path, sorted(UNITS[command], reverse=is_reversed))
    includes = [f"-I{ROOT}/port", "-fsyntax-only"]
    done = compiled([*command.split(), *includes], unit, tmp_path)
    assert done.returncode == 0, done.stderr


# --- the ABI of floats ------------------------------------------------------------------------

M4, M33 = "-mcpu=cortex-m4 -mfpu=fpv4-sp-d16", "-mcpu=cortex-m33 -mfpu=fpv5-sp-d16"
ABIS = {  # flags of the assembly, and of C that passes a float in another register
    "m0, m4 hard": ("-mcpu=cortex-m0", f"{M4} -mfloat-abi=hard"),
    "m3, m4 hard": ("-mcpu=cortex-m3", f"{M4} -mfloat-abi=hard"),
    "m4 soft, hard": (f"{M4} -mfloat-abi=soft", f"{M4} -mfloat-abi=hard"),
    "m4 softfp, hard": (f"{M4} -mfloat-abi=softfp", f"{M4} -mfloat-abi=hard"),
    "m4 hard, softfp": (f"{M4} -mfloat-abi=hard", f"{M4} -mfloat-abi=softfp"),
    "m4 hard, m3": (f"{M4} -mfloat-abi=hard", "-mcpu=cortex-m3"),
    "m33 softfp, hard": (f"{M33} -mfloat-abi=softfp", f"{M33} -mfloat-abi=hard"),
    "m33 hard, soft": (f"{M33} -mfloat-abi=hard", f"{M33} -mfloat-abi=soft"),
}
HEADERS = "".join(path.read_text() for path in (LIB / "include").glob("*.h"))
PASS_FLOATS = {*re.findall(r"^float (dahl_\w+)\(", HEADERS, re.M), "dahl_torque_from"}


@pytest.mark.checks
@pytest.mark.parametrize("compiler", ["arm-none-eabi-gcc", "clang --target=arm-none-eabi"])
@pytest.mark.parametrize("case", ABIS)
def test_assembly_does_not_link_with_c_of_another_float_abi(
    case: str, compiler: str, tmp_path: Path
) -> None:
    """A file is refused if it passes a float. With C of its own ABI, each links."""
    own, other = (f"{flags} -mthumb".split() for flags in ABIS[case])
    (main := tmp_path / "main.c").write_text("float passed;\n")
    for name, flags in (("own", own), ("other", other)):
        run("arm-none-eabi-gcc", *flags, "-c", main, "-o", tmp_path / f"{name}.o")
    refusals = 0
    for file in (LIB / "cores").glob("*.S"):
        words = [*compiler.split(), *own, "-DDAHL_SAME_FLAGS"]
        assert compiled(words, file, tmp_path).returncode == 0
        names = set(re.findall(r" T (\w+)", run("arm-none-eabi-nm", tmp_path / "x.o")))
        for user in ("own", "other"):
            is_refused = user == "other" and bool(names & PASS_FLOATS)
            files = [tmp_path / f"{user}.o", tmp_path / "x.o", "-o", tmp_path / "both.o"]
            said = run("arm-none-eabi-ld", "-r", *files, code=int(is_refused))
            assert ("VFP register arguments" in said) == is_refused
            refusals += is_refused
    assert refusals >= 3


# --- a core that lacks something -----------------------------------------------------------------

AFTER_LIMITS = "#include <limits.h>\n#include <stdint.h>\n"
FAKES = {
    "bytes of 16 bits": ("-D__CHAR_BIT__=16", "", "dahl needs bytes of 8 bits"),
    "a float of 53 bits": ("-D__FLT_MANT_DIG__=53", "", "32-bit format of IEEE 754"),
    "a decimal float": ("-D__FLT_RADIX__=10", "", "32-bit format of IEEE 754"),
    "a float of 8 bytes": ("-Dfloat=double", "", "dahl_needs_a_float_of_4_bytes"),
    "ones' complement": (
        "",
        AFTER_LIMITS + "#undef INT_MIN\n#define INT_MIN (-INT_MAX)\n",
        "dahl needs two's complement",
    ),
    "no uint32_t": ("", AFTER_LIMITS + "#undef UINT32_MAX\n", "dahl needs uint32_t"),
}


@pytest.mark.parametrize("fake", FAKES)
def test_a_core_that_lacks_something_does_not_build(fake: str, tmp_path: Path) -> None:
    flag, header, message = FAKES[fake]
    (tmp_path / "core.h").write_text(header)
    command = ["gcc", "-std=c99", "-include", str(tmp_path / "core.h"), *([flag] if flag else [])]
    done = compiled(command, as_one(tmp_path), tmp_path)
    assert done.returncode != 0 and message in done.stderr


@pytest.mark.checks
def test_an_int_of_8_bits_does_not_build(tmp_path: Path) -> None:
    command = ["avr-gcc", "-mmcu=atmega2560", "-std=c99", "-mint8"]
    done = compiled(command, as_one(tmp_path), tmp_path)
    assert done.returncode != 0 and "int of 16 bits or more" in done.stderr
