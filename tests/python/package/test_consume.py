# SPDX-License-Identifier: MIT
"""Projects of users: each way to get the library gives its public headers only, needs no other
package, and installs the library only on request. The snippets that users copy compile.
"""

import math
import os
import re
import shutil
from pathlib import Path

import dahl
import pytest
from conftest import ROOT, built, from_pypi, need, with_compilers
from programs import run

CONSUMER = ROOT / "tests/consume"
PRIVATE = {
    path.name for path in (ROOT / "lib").rglob("*.h") if path.parent.name not in ("include", "node")
}
# Names of headers in real projects.
USUAL = {"bits.h", "fixed.h", "kernel.h", "torque.h", "multiply.h", "compiler.h"}
HEADERS = {"dahl.h", "dahl_compensator.h", "dahl_encoder.h", "dahl_parts.h"}
COMPONENTS = {
    "NODE": {"dahl_node.h", "dahl_frames.h", "dahl_can_bus.h"},
    "FLOAT": {"dahl_float.h"},
}
ASKED = [f"-DDAHL_BUILD_{name}=ON" for name in COMPONENTS]
WANTED = dahl.__version__.rpartition(".")[0]  # of find_package: 0.3 accepts any 0.3.x and no other
# Eq. 7: F = Fc (1 - exp(-sigma0/Fc theta)), sigma0 = 100, Fc = 0.5, theta = 100 counts of 14 bits.
EXPECTED = 0.5 * (1 - math.exp(-100 / 0.5 * 100 * 2 * math.pi / 16384))


def project(folder: Path, way: str, own_headers: Path, *options: object, code: int = 0) -> str:
    words = [f"-DWAY={way}", f"-DOWN_HEADERS={own_headers}", f"-DDAHL_ROOT={ROOT}", *options]
    return run("cmake", "-S", CONSUMER, "-B", folder, "-G", "Ninja", *words, code=code)


def install(tmp: Path, *options: object, **more: object) -> Path:
    build, prefix = tmp / "build", tmp / "prefix"
    place = f"-DCMAKE_INSTALL_PREFIX={prefix}"
    run("cmake", "-S", ROOT, "-B", build, "-G", "Ninja", place, *options, **more)
    run("cmake", "--build", build, **more)
    run("cmake", "--install", build, **more)
    return prefix


@pytest.fixture(scope="module")
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Path:
    where = run("gcc", "-print-multiarch").strip()  # Debian's folder is one level deeper
    options = [*ASKED, f"-DCMAKE_INSTALL_LIBDIR=lib/{where}"]
    return install(tmp_path_factory.mktemp("installed"), *options)


@pytest.fixture(scope="module")
def own_headers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of user headers with the names of the library's private headers.

    A library that reads one of these does not compile, nor does a user who gets another.
    """
    folder = tmp_path_factory.mktemp("own")
    check = []
    for name in sorted(PRIVATE | USUAL):
        word = f"OWN_{name.removesuffix('.h').upper()}"
        alarm = f'#ifndef CONSUMER\n#error "the library reads its user\'s {name}"\n#endif\n'
        (folder / name).write_text(f"{alarm}#define {word}\n")
        check.append(
            f'#include <{name}>\n#ifndef {word}\n#error "{name} is the library\'s"\n#endif\n'
        )
    (folder / "own_headers.h").write_text("".join(check))
    (folder / "all_calls.h").write_text(all_calls(HEADERS, "all_calls"))
    more = set().union(*COMPONENTS.values()) - {"dahl_can_bus.h"}  # a port defines its calls
    (folder / "component_calls.h").write_text(all_calls(more, "component_calls"))
    return folder


def all_calls(headers: set[str], table: str) -> str:
    """Return a table of all functions that these headers declare, so that each must link."""
    text = "".join((ROOT / "lib/include" / name).read_text() for name in sorted(headers))
    code = re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    names = sorted(set(re.findall(r"^\w[^#;{(]*\b(dahl_\w+)\([^;{]*\);", code, re.M)))
    assert len(names) > 15
    lines = "".join(f"    (void (*)(void)){name},\n" for name in names)
    includes = "".join(f"#include <{name}>\n" for name in sorted(headers))
    return f"{includes}static void (*const {table}[])(void) = {{\n{lines}}};\n"


@pytest.mark.parametrize(
    "way",
    [
        *("add_subdirectory", "find_package", "platformio"),
        *(
            pytest.param(way, marks=pytest.mark.checks)
            for way in ("FetchContent", "esp_idf", "zephyr")
        ),
    ],
)
def test_a_project_builds_with_cmake(
    way: str, prefix: Path, own_headers: Path, tmp_path: Path
) -> None:
    options = [f"-DCMAKE_PREFIX_PATH={prefix}", f"-DDAHL_WANTED={WANTED}"]
    options += ["-DDAHL_COMPONENTS=node;float", *ASKED]
    wanted = {"consumer": EXPECTED, "consumer_cxx": EXPECTED, "consumer_node": 2 * EXPECTED}
    if way in ("add_subdirectory", "FetchContent", "find_package"):
        wanted["consumer_components"] = EXPECTED
    project(tmp_path, way, own_headers, *options)
    run("cmake", "--build", tmp_path)
    for program, torque in wanted.items():
        assert float(run(tmp_path / program)) == pytest.approx(torque, rel=1e-6), program
    user = tmp_path / "user"
    run("cmake", "--install", tmp_path, "--prefix", user)
    assert [file.name for file in user.rglob("*") if file.is_file()] == ["consumer"]
    if way == "find_package":  # before 1.0 a minor version may change a header
        words = [*options, "-DDAHL_WANTED=0.1"]
        said = project(tmp_path / "x", way, own_headers, *words, code=1)
        assert f"version: {dahl.__version__}" in said


@pytest.mark.parametrize("asked", ["batch", "dahl;gear"])
def test_a_component_that_is_not_installed_is_not_found(
    asked: str, prefix: Path, own_headers: Path, tmp_path: Path
) -> None:
    """The message names it and the installed ones. (CMake wraps its lines.)"""
    options = [f"-DCMAKE_PREFIX_PATH={prefix}", f"-DDAHL_COMPONENTS={asked}"]
    said = project(tmp_path, "find_package", own_headers, *options, code=1)
    missing, said = asked.rpartition(";")[2], " ".join(said.split())
    assert f"'{missing}'" in said and "dahl;node;float" in said
    assert "-DDAHL_BUILD_NODE=ON" in said


@pytest.mark.long
def test_cmake_of_debian_11_and_ubuntu_20_04_suffices(
    prefix: Path, own_headers: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """3.16, for the library and for a project that uses it, also if a newer CMake installed it."""
    oldest = from_pypi("cmake_3.16", "cmake==3.16.8", "CMake 3.16 suffices")
    monkeypatch.setenv("PATH", f"{oldest}:{os.environ['PATH']}")
    assert run("cmake", "--version").startswith("cmake version 3.16")
    for installed in (install(tmp_path / "by_3.16", *ASKED), prefix):
        options = [f"-DCMAKE_PREFIX_PATH={installed}", "-DDAHL_COMPONENTS=node;float"]
        build = tmp_path / f"user_of_{installed.parent.name}"
        project(build, "find_package", own_headers, *options)
        run("cmake", "--build", build)
        assert float(run(build / "consumer_node")) == pytest.approx(2 * EXPECTED, rel=1e-6)


def test_no_source_reads_a_header_of_its_user(own_headers: Path) -> None:
    flags = ["-std=c99", f"-I{own_headers}", f"-I{ROOT}/lib/include", "-fsyntax-only"]
    run("gcc", *flags, *(ROOT / "lib").rglob("*.c"))


@pytest.mark.parametrize(
    ("packages", "source", "torque"),
    [
        ("dahl", "main.c", EXPECTED),
        ("dahl_node", "node.c", 2 * EXPECTED),
        ("dahl_float dahl_node", "components.c", EXPECTED),
    ],
)
def test_a_project_builds_with_pkg_config(
    packages: str, source: str, torque: float, prefix: Path, own_headers: Path, tmp_path: Path
) -> None:
    """The flags of the packages suffice."""
    (config,) = prefix.rglob("dahl.pc")
    assert {file.stem for file in config.parent.iterdir()} == {"dahl", "dahl_node", "dahl_float"}
    path, names = {**os.environ, "PKG_CONFIG_PATH": str(config.parent)}, packages.split()
    assert run("pkg-config", "--modversion", names[0], env=path).strip() == dahl.__version__
    flags = run("pkg-config", "--cflags", "--libs", *names, env=path).split()
    own = [f"-I{own_headers}", "-DCONSUMER"]
    run("gcc", CONSUMER / source, "-o", tmp_path / "consumer", *flags, *own)
    assert float(run(tmp_path / "consumer")) == pytest.approx(torque, rel=1e-6)


@pytest.mark.parametrize(
    "standard", ["11", "20", *(pytest.param(s, marks=pytest.mark.checks) for s in ("14", "17"))]
)
@pytest.mark.parametrize("compiler", with_compilers("g++", "clang++"))
def test_the_wrapper_for_cpp_has_the_bits_of_c(
    compiler: str, standard: str, prefix: Path, tmp_path: Path
) -> None:
    need(compiler, "dahl.hpp compiles without a warning")
    libraries = [*prefix.rglob("libdahl_node.a"), *prefix.rglob("libdahl.a")]
    flags = ["-Wall", "-Wextra", "-pedantic", "-Werror", "-Wconversion", "-Wshadow", "-O2"]
    flags += ["-fno-exceptions", "-fno-rtti", f"-std=c++{standard}", f"-I{prefix}/include"]
    if compiler == "clang++":
        flags.append("-Wglobal-constructors")
    program = tmp_path / "wrapper"
    run(compiler, *flags, CONSUMER / "wrapper.cpp", *libraries, "-o", program)
    assert run(program) == "same bits\n"
    made = run("nm", program)
    assert "_GLOBAL__sub_I" not in made  # code before main(), by gcc


@pytest.mark.parametrize("compiler", with_compilers("gcc", "clang"))
def test_a_unity_build_has_unique_names(compiler: str, tmp_path: Path) -> None:
    """All components, each as one translation unit (but for files with flags of their own)."""
    need(compiler, "a unity build")
    parts = ("NODE", "FLOAT", "BATCH", "SHARED", "PORT")
    options = [f"-DDAHL_BUILD_{name}=ON" for name in parts]
    options += ["-DCMAKE_UNITY_BUILD=ON", "-DCMAKE_UNITY_BUILD_BATCH_SIZE=0"]
    options += ["-G", "Ninja", f"-DCMAKE_C_COMPILER={compiler}"]
    run("cmake", "-S", ROOT, "-B", tmp_path, *options)
    run("cmake", "--build", tmp_path)
    assert len(list(tmp_path.glob("**/unity_0_c.c.o"))) >= 6


@pytest.mark.checks
def test_a_unity_build_for_a_core_has_its_assembly(tmp_path: Path) -> None:
    """The linker takes the first definition of a tick in the archive."""
    need("arm-none-eabi-gcc", "a unity build for a core")
    core = ["arm-none-eabi-gcc", "-mcpu=cortex-m3", "-mthumb"]
    options = ["-G", "Ninja", "-DCMAKE_UNITY_BUILD=ON", "-DCMAKE_UNITY_BUILD_BATCH_SIZE=0"]
    options += ["-DCMAKE_SYSTEM_NAME=Generic", "-DCMAKE_TRY_COMPILE_TARGET_TYPE=STATIC_LIBRARY"]
    options += [f"-DCMAKE_C_COMPILER={core[0]}", f"-DCMAKE_C_FLAGS={' '.join(core[1:])}"]
    run("cmake", "-S", ROOT, "-B", tmp_path, *options)
    run("cmake", "--build", tmp_path)
    symbols = run("arm-none-eabi-nm", tmp_path / "lib/libdahl.a").partition("unity_0_c")[2]
    first = symbols.partition("\n\n")[0]
    assert " W dahl_" not in first and " T dahl_" in first
    ticks = ("dahl_step_counts", "dahl_step_counts_q30", "dahl_step", "dahl_work_step_counts_q30")
    calls = "".join(f"void {tick}(void); {tick}(); " for tick in ticks)
    (tmp_path / "main.c").write_text(f"int main(void) {{ {calls} return 0; }}\n")
    files = [tmp_path / "main.c", tmp_path / "lib/libdahl.a", "-o", tmp_path / "program"]
    run(*core, "--specs=nosys.specs", "-Wl,--no-warnings", *files)
    names = run("arm-none-eabi-nm", tmp_path / "program")
    kinds = {name: kind for kind, name in re.findall(r" (\w) (dahl_\w+)", names)}
    assert {kinds[tick] for tick in ticks} == {"T"}  # of assembly; the C is weak, W


def headers(prefix: Path) -> set[str]:
    return {path.relative_to(prefix / "include").as_posix() for path in prefix.rglob("*.h")}


def test_installed_files_are_public_and_contain_no_path_of_this_machine(prefix: Path) -> None:
    assert headers(prefix) == HEADERS.union(*COMPONENTS.values())
    for file in prefix.rglob("*"):
        if file.suffix in (".pc", ".cmake", ".h", ".hpp"):
            assert str(ROOT) not in file.read_text() and str(prefix) not in file.read_text(), file


def test_a_plain_build_needs_only_a_compiler_and_cmake(tmp_path: Path) -> None:
    path = tmp_path / "bin"
    path.mkdir()
    for tool in ("cmake", "ninja", "cc", "gcc", "ar", "ranlib", "ld", "as"):
        (path / tool).symlink_to(shutil.which(tool))
    nothing = [
        f"-DCMAKE_FIND_ROOT_PATH={tmp_path}/none",
        "-DFETCHCONTENT_FULLY_DISCONNECTED=ON",
        *(f"-DCMAKE_FIND_ROOT_PATH_MODE_{kind}=ONLY" for kind in ("LIBRARY", "INCLUDE", "PACKAGE")),
    ]
    prefix = install(tmp_path, *nothing, env={"PATH": str(path)})
    assert not (tmp_path / "build/_deps").exists()
    assert {file.name for file in prefix.rglob("*.a")} == {"libdahl.a"}
    assert headers(prefix) == HEADERS and (prefix / "include/dahl.hpp").exists()
    assert {file.name for file in prefix.rglob("*.cmake")} == {
        *("dahl-config.cmake", "dahl-config-version.cmake"),
        *("dahl-targets.cmake", "dahl-targets-relwithdebinfo.cmake"),
    }
    dbc, described = prefix / "share/dahl/dahl.dbc", ROOT / "lib/node/dahl.dbc"
    assert dbc.read_bytes() == described.read_bytes()


def test_the_shared_library_has_the_number_of_its_structures() -> None:
    """Before 1.0 each minor version has other structures."""
    names = {path.name for path in built("lib").glob("libdahl.so*")}
    assert names == {"libdahl.so", f"libdahl.so.{WANTED}", f"libdahl.so.{dahl.__version__}"}
    assert f"[libdahl.so.{WANTED}]" in run("readelf", "-d", built("lib/libdahl.so"))


@pytest.mark.checks
def test_a_parent_project_installs_the_library_on_request(own_headers: Path, tmp_path: Path):
    prefix, build = tmp_path / "prefix", tmp_path / "build"
    options = [f"-DCMAKE_INSTALL_PREFIX={prefix}", "-DDAHL_INSTALL=ON"]
    project(build, "FetchContent", own_headers, *options)
    run("cmake", "--build", build)
    run("cmake", "--install", build)
    files = {file.name for file in prefix.rglob("*") if file.is_file()}
    assert {"consumer", "dahl.h", "libdahl.a", "dahl-config.cmake", "dahl.pc"} <= files


STOP = "extern uint32_t before, now;\nvoid stop(void);\nfloat use(void);\n"
TIMER = (
    STOP + "typedef struct { volatile uint32_t CNT; } timer_t_;\nextern timer_t_ *TIM3;\n"
    "extern dahl_plan_t plan;\nextern dahl_state_t bearing;\n"
)


def example_of(header: str) -> list[str]:
    """Return the first block of C in the comments of a header."""
    block = header.split("@code{.c}\n")[1].split(" * @endcode", maxsplit=1)[0]
    return [line.removeprefix(" * ") for line in block.splitlines()]


def snippet(name: str) -> str:
    """Return the example of a header in a function, with the declarations that it leaves to the
    reader.
    """
    lines = example_of((ROOT / "lib/include" / name).read_text())
    assert any("prepare" in line or "init" in line for line in lines), lines
    assert any("step_counts" in line for line in lines), lines
    before = TIMER if "encoder" in name else STOP
    head = f'#include "dahl.h"\n#include "{name}"\n{before}float use(void)\n{{\n    float F = 0;\n'
    return head + "\n".join(lines) + "\n    return F;\n}\n"


@pytest.mark.parametrize("name", ["dahl.h", "dahl_encoder.h"])
@pytest.mark.parametrize("compiler", with_compilers("gcc", "g++", "clang", "clang++"))
def test_snippets_compile_without_a_warning(compiler: str, name: str, tmp_path: Path) -> None:
    need(compiler, "the snippets compile without a warning")
    cxx = "++" in compiler
    source = tmp_path / ("snippet.cpp" if cxx else "snippet.c")
    source.write_text(snippet(name))
    flags = ["-Wall", "-Wextra", "-pedantic", "-Werror", f"-I{ROOT}/lib/include", "-fsyntax-only"]
    for language in ("c++11", "c++14", "c++17") if cxx else ("c99", "c17"):
        run(compiler, f"-std={language}", *flags, source)
