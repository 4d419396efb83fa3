# SPDX-License-Identifier: MIT
"""A Cortex-M firmware links the ticks in assembly if its compiler can assemble them, else the C.
Each way to pass the flags of the core is a row. CMake prints the choice.
"""

import re
from pathlib import Path
from typing import NamedTuple

import pytest
from conftest import ROOT, need
from programs import run

pytestmark = pytest.mark.checks

GCC, CLANG = "arm-none-eabi-gcc", "clang"
M0, M3, M4, M23, M33, A9 = (
    f"-mcpu=cortex-{core} -mthumb" for core in ("m0", "m3", "m4", "m23", "m33", "a9")
)
BARE = "--target=arm-none-eabi"
CALLS = (
    "dahl_step_counts_q30",
    "dahl_step_counts",
    "dahl_step",
    "dahl_part_move",
    "dahl_work_step_counts",
)
IN_FLOAT = {"dahl_step_counts", "dahl_step", "dahl_work_step_counts"}
WRITTEN = {core: set(CALLS) for core in (M3, M4, M33)}  # in assembly
WRITTEN |= {core: {"dahl_step_counts_q30", "dahl_step_counts", "dahl_step"} for core in (M0, M23)}
MAIN = "".join(f"extern int {name}(void);\n" for name in CALLS) + (
    "int main(void) { return " + " + ".join(f"{name}()" for name in CALLS) + "; }\n"
)


def ticks_in_assembly(image: Path) -> set[str]:
    """Return the strong ticks of an image; those in C are weak on a Cortex-M."""
    kinds = re.findall(r" ([A-Za-z]) (\w+)$", run("arm-none-eabi-nm", image), re.M)
    return {name for kind, name in kinds if kind == "T" and name in CALLS}


def linked(core: str, folder: Path, *files: Path) -> Path:
    (main := folder / "main.c").write_text(MAIN)
    image = folder / "image"
    words = [*core.split(), "-nostdlib", "-Wl,-e,main", "-Wl,--no-warn-mismatch", "-o", image, main]
    run(GCC, *words, *files, "-lgcc")
    return image


class Project(NamedTuple):
    """A CMake project of a firmware, and how it passes the flags of its core."""

    core: str
    assembly: bool
    flags: str = ""
    compiler: str = GCC
    before: str = ""  # lines before and after add_subdirectory
    after: str = ""
    options: tuple[str, ...] = ()


PROJECTS = {
    "gcc m4": Project(M4, True, M4),
    "gcc m0": Project(M0, True, M0),
    "gcc m33": Project(M33, True, M33),
    "clang m4": Project(M4, True, f"{BARE} -mcpu=cortex-m4", CLANG),
    "make": Project(M4, True, M4, options=("-G", "Unix Makefiles")),
    "add_compile_options": Project(M4, True, before=f"add_compile_options({M4})"),
    "options of C alone": Project(
        M4, True, before=f'add_compile_options("$<$<COMPILE_LANGUAGE:C>:{M4.replace(" ", ";")}>")'
    ),
    "link-time optimization": Project(
        M4, True, M4, before="set(CMAKE_INTERPROCEDURAL_OPTIMIZATION ON)"
    ),
    "strict": Project(M4, True, f"{M4} -Wall -Wextra -Wundef -pedantic -Werror"),
    "options of the target": Project(M4, False, after=f"target_compile_options(dahl PRIVATE {M4})"),
    "flags that no assembler accepts": Project(M4, False, f"{M4} -include stdint.h"),
    "switched off": Project(M4, False, M4, options=("-DDAHL_CORES=OFF",)),
    "another Arm": Project(A9, False, A9),
}


@pytest.mark.parametrize("name", PROJECTS)
def test_a_project_links_the_tick_of_its_core(name: str, tmp_path: Path) -> None:
    project = PROJECTS[name]
    need(project.compiler, "a firmware links the tick of its core")
    need(GCC, "a firmware links the tick of its core")
    lines = ["cmake_minimum_required(VERSION 3.16)", "project(firmware C)", project.before]
    lines += [f'add_subdirectory("{ROOT}" dahl)', project.after]
    (tmp_path / "CMakeLists.txt").write_text("\n".join(lines) + "\n")
    words = [f"-DCMAKE_C_COMPILER={project.compiler}", "-DCMAKE_SYSTEM_NAME=Generic"]
    words += [f"-DCMAKE_C_FLAGS={project.flags}", "-DCMAKE_TRY_COMPILE_TARGET_TYPE=STATIC_LIBRARY"]
    build = tmp_path / "b"
    output = run("cmake", "-S", tmp_path, "-B", build, "-G", "Ninja", *words, *project.options)
    run("cmake", "--build", build, "--target", "dahl", "-j2")
    image = linked(project.core, tmp_path, build / "dahl/lib/libdahl.a")
    if project.core in WRITTEN:
        assert ticks_in_assembly(image) == (WRITTEN[project.core] if project.assembly else set())
    code = run("arm-none-eabi-objdump", "-d", "--disassemble=dahl_step_counts_q30", image)
    assert ("umaal" in code) == (project.assembly and project.core in (M4, M33))  # not by gcc
    (choice,) = re.findall(r"^-- dahl: ticks in (\w+)", output, re.M)
    assert choice == ("assembly" if project.assembly else "C")


SOURCES = [
    path
    for folder in ("arith", "cores", "model", "parts")
    for path in sorted((ROOT / "lib" / folder).glob("*.[cS]"))
]


HARD = "-mfloat-abi=hard -mfpu=fpv4-sp-d16"
IN_Q30 = {name for name in CALLS if name not in IN_FLOAT}
MIXTURES = {  # flags of C, flags of the assembler, ticks in assembly
    "m0": (M0, M0, WRITTEN[M0]),
    "m4": (M4, M4, IN_Q30),  # its ABI may differ
    "m4f": (f"{M4} {HARD}", f"{M4} {HARD}", WRITTEN[M4]),
    "m4f, link-time optimization": (f"{M4} {HARD} -flto", f"{M4} {HARD}", WRITTEN[M4]),
    "m4f, no ABI for the assembler": (f"{M4} {HARD}", M4, IN_Q30),
    "m4f, nothing for the assembler": (f"{M4} {HARD}", "", set()),
    "m0, nothing for the assembler": (M0, "", set()),
}


@pytest.mark.parametrize("name", MIXTURES)
def test_sources_linked_as_objects_give_the_tick_of_the_core(name: str, tmp_path: Path) -> None:
    """Arduino, PlatformIO and a Makefile compile all files. Some Arduino cores pass no CPU to the
    assembler; its files are then empty.
    """
    need(GCC, "a firmware links the tick of its core")
    of_c, of_assembly, written = MIXTURES[name]
    for kind, flags in ((".c", of_c), (".S", of_assembly)):
        files = [path for path in SOURCES if path.suffix == kind]
        run(GCC, *flags.split(), "-O2", f"-I{ROOT}/lib/include", "-c", *files, cwd=tmp_path)
    image = linked(of_c, tmp_path, *sorted(tmp_path.glob("*.o")))
    assert ticks_in_assembly(image) == written


OTHERS = ("gcc", "clang", "avr-gcc", "riscv64-unknown-elf-gcc", GCC)


@pytest.mark.parametrize("compiler", [*OTHERS, f"{GCC} {M4}", f"clang {BARE} -mcpu=cortex-m4"])
def test_assembly_is_empty_for_another_core_and_has_the_note_of_the_c(
    compiler: str, tmp_path: Path
) -> None:
    """On the stack: linkers warn if the notes differ."""
    need(compiler.split(maxsplit=1)[0], "files in assembly are safe on every core")

    def compiled(source: Path) -> tuple[bool, list[str]]:
        run(*compiler.split(), "-c", source, "-o", made := tmp_path / "x.o")
        symbols = re.findall(r" [A-Z] (\w+)$", run("nm", made), re.M)
        return ".note.GNU-stack" in run("readelf", "-SW", made), symbols

    (plain := tmp_path / "plain.c").write_text("int x;\n")
    for source in sorted((ROOT / "lib/cores").glob("*.S")):
        has_note, symbols = compiled(source)
        assert has_note == compiled(plain)[0]
        assert symbols == [] or "m4" in compiler
