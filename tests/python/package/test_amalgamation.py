# SPDX-License-Identifier: MIT
"""The library as dahl.c and dahl.h (tools/amalgamate.sh), alone in a flat folder."""

import re
import shutil
import tarfile
from itertools import product
from pathlib import Path

import pytest
from conftest import ROOT, need, with_compilers
from dahl import Plan, Slip
from dahl.binding import plan_header
from dahl.binding.library import c
from programs import run

TOOL = ROOT / "tools/amalgamate.sh"
PARTS = ("parts", "compensator", "commission", "node")
STRICT = "-Wall -Wextra -pedantic -Wconversion -Wsign-conversion -Wundef -Wshadow -Werror".split()
GOLDEN = ROOT / "tests/lib/golden_bits.txt"
CORES = ("arm-none-eabi-gcc -mcpu=cortex-m0 -mthumb", "arm-none-eabi-gcc -mcpu=cortex-m4 -mthumb")
AVR = "avr-gcc -mmcu=atmega2560"  # gcc 5: no C17
MACROS = [
    *("abs(x)=0", "min(a,b)=0", "max(a,b)=0", "round(x)=0", "sq(x)=0", "bit(b)=0", "F(x)=0"),
    *("B1=1", "A0=1", "PI=3", "TWO_PI=6", "HIGH=1", "LOW=0", "INPUT=0", "OUTPUT=1", "DEFAULT=1"),
    *("near=", "far=", "small=char", "IN=", "OUT=", "CONST=const", "TRUE=1", "ERROR=0", "I=1"),
    *("RESET=0", "SET=1", "CRC=1", "CAN=1", "__IO=volatile", "SP=1", "DT=1"),
]
STANDARDS = ("c99", "c11", "c17", "c2x")
CPP = """#include "dahl.h"
int main()
{
    dahl_params_t params = {100.0f, 0.5f, 1e-4f};
    dahl_plan_t plan;
    dahl_state_t state = {0};
    dahl_encoder_t encoder = {};
    if (dahl_prepare(&plan, &params) || dahl_encoder_init(&encoder, 65536, 1, 0)) {
        return 1;
    }
    dahl_encoder_home(&encoder, 65535);
    return dahl_step_counts(&plan, &state, dahl_encoder_move(&encoder, 8)) > 0 ? 0 : 2;
}
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return the folder of each selection: nothing more, each part, all."""
    folders = {}
    for name in ("", *PARTS, ",".join(PARTS)):
        folder = tmp_path_factory.mktemp("amalgamation")
        run(TOOL, *(["--with", name] if name else []), "-o", folder)
        assert {path.name for path in folder.iterdir()} == {"dahl.c", "dahl.h"}
        folders["all" if "," in name else name or "friction"] = folder
    return folders


def test_the_head_says_how_to_write_it_again_and_contains_the_licence(
    made: dict[str, Path], tmp_path: Path
) -> None:
    licence = (ROOT / "LICENSE").read_text().split()
    for file in ("dahl.c", "dahl.h"):
        text = (made["commission"] / file).read_text()
        head = text.split("*/")[1]
        (command,) = re.findall(r"tools/\S+\.sh.*", head)
        run(ROOT / command.split()[0], *command.split()[1:], "-o", tmp_path)
        assert (tmp_path / file).read_text() == text
        assert run("git", "-C", ROOT, "rev-parse", "HEAD").strip() in head
        assert " ".join(licence) in " ".join(head.replace("*", " ").split())


def test_an_archive_without_git_names_its_commit(tmp_path: Path) -> None:
    commit = run("git", "-C", ROOT, "rev-parse", "HEAD").strip()
    run("git", "-C", ROOT, "archive", "-o", tmp_path / "tree.tar", "HEAD")
    with tarfile.open(tmp_path / "tree.tar") as archive:
        archive.extractall(tmp_path / "tree", filter="data")
    run(tmp_path / "tree/tools/amalgamate.sh", cwd=tmp_path)
    text = (tmp_path / "tree/build/amalgamation/dahl.h").read_text()
    assert re.findall(r" \*   commit +(.*)", text) == [commit]


def test_a_copy_in_the_repository_of_another_project_names_no_commit(tmp_path: Path) -> None:
    copy = tmp_path / "vendor"
    for name in ("lib", "tools"):
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "LICENSE", copy)
    for words in ("init -q", "add -A", "-c user.name=n -c user.email=e commit -q -m c"):
        run("git", "-C", tmp_path, *words.split())
    run(copy / "tools/amalgamate.sh", "-o", tmp_path)
    text = (tmp_path / "dahl.h").read_text()
    assert re.findall(r" \*   commit +(.*)", text) == ["unknown"]


@pytest.mark.parametrize(("names", "unknown"), [("parts,gear", "'gear'"), ("parts,", "''")])
def test_an_unknown_part_is_named(names: str, unknown: str, tmp_path: Path) -> None:
    said = run(TOOL, "--with", names, "-o", tmp_path, code=2)
    assert said.startswith("error: ") and unknown in said and all(name in said for name in PARTS)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", with_compilers("gcc", "clang", *CORES, AVR, "tcc"))
def test_it_compiles_alone_without_a_warning(command: str, made: dict[str, Path]) -> None:
    """All parts by each standard, and each part alone by C99."""
    compiler, *flags = command.split()
    need(compiler, "the amalgamation compiles alone")
    standards = STANDARDS[:2] if compiler == "avr-gcc" else STANDARDS
    runs = [*product(["all"], standards), *product(set(made) - {"all"}, ["c99"])]
    for name, standard in runs:
        words = [] if compiler == "tcc" else [*STRICT, "-fsyntax-only"]
        run(compiler, f"-std={standard}", *flags, *words, "-c", "dahl.c", cwd=made[name])


@pytest.mark.parametrize("part", ["parts", "compensator"])
def test_headers_of_the_commands_compile_beside_it(
    part: str, made: dict[str, Path], tmp_path: Path
) -> None:
    """`dahl.h` of the amalgamation has all: no other header of the library is in the project."""
    if part == "parts":
        slip = plan_header.text("axis", Slip([100, 40], [0.5, 0.3], 1e-4), [])
        header = plan_header.with_load(slip, "axis", 0.0, 1.0)
    else:
        header = plan_header.text("axis", Plan(100, 0.5, 1e-4), [])
        params = c.new("dahl_compensator_params_t *", {"law": c.DAHL_COMPENSATOR_MEASURED})
        header += plan_header.commission("axis", params[0], [0.1] * 14, 0.35)
    (tmp_path / "dahl_plan_axis.h").write_text(header)
    (tmp_path / "main.c").write_text('#include "dahl_plan_axis.h"\n')
    run("gcc", "-std=c99", f"-I{made[part]}", "-fsyntax-only", tmp_path / "main.c")


def test_macros_of_a_platform_and_its_own_define_do_no_harm(made: dict[str, Path]) -> None:
    """Arduino.h, windows.h and CMSIS, included before, as if a project compiles it as one unit."""
    words = [*STRICT, "-std=c99", "-fsyntax-only", "-DDAHL_WITHOUT_ASSEMBLY"]
    words += [f"-D{macro}" for macro in MACROS]
    for name in ("friction", "all"):
        run("gcc", *words, "dahl.c", cwd=made[name])


@pytest.mark.parametrize("command", with_compilers("gcc -O2", "clang -O2", "tcc"))
def test_it_has_the_golden_bits_of_the_library(
    command: str, made: dict[str, Path], tmp_path: Path
) -> None:
    compiler, *flags = command.split()
    words = [need(compiler, "the amalgamation has equal bits"), "-std=c99", *flags]
    for header in ("dahl_parts.h", "dahl_compensator.h"):  # what the program of the bits includes
        (tmp_path / header).write_text('#include "dahl.h"\n')
    words += [f"-I{tmp_path}", f"-I{made['all']}", "-o", tmp_path / "bits"]
    run(*words, ROOT / "tests/lib/bits.c", made["all"] / "dahl.c")
    assert run(tmp_path / "bits") == GOLDEN.read_text()


@pytest.mark.parametrize("compiler", with_compilers("g++", "clang++"))
def test_a_program_in_cpp_links_only_what_it_calls(
    compiler: str, made: dict[str, Path], tmp_path: Path
) -> None:
    need(compiler, "dahl.h of the amalgamation is for C++ too")
    (tmp_path / "main.cpp").write_text(CPP)
    sections = ["-ffunction-sections", "-fdata-sections"]
    run("gcc", *sections, "-c", made["all"] / "dahl.c", "-o", tmp_path / "dahl.o")
    words = [*STRICT, "-std=c++11", f"-I{made['all']}", tmp_path / "main.cpp", tmp_path / "dahl.o"]
    run(compiler, *words, "-Wl,--gc-sections", "-o", tmp_path / "main")
    run(tmp_path / "main")
    linked = run("nm", tmp_path / "main")
    assert "dahl_prepare" in linked and not re.search(
        "dahl_(slip|residual|node|commission)", linked
    )


@pytest.mark.checks
def test_each_selection_links_alone_and_no_tick_is_weak(made: dict[str, Path], tmp_path: Path):
    """It calls only itself and functions of the compiler."""
    need("arm-none-eabi-gcc", "the amalgamation for a core")
    for name, folder in made.items():
        run(*CORES[0].split(), "-c", folder / "dahl.c", "-o", tmp_path / f"{name}.o")
        symbols = run("arm-none-eabi-nm", tmp_path / f"{name}.o")
        assert " W dahl_" not in symbols
        missing = set(re.findall(r"^ +U (\S+)", symbols, re.M))
        assert [one for one in missing if not one.startswith(("__aeabi_", "__gnu", "mem"))] == []
