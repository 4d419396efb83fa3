# SPDX-License-Identifier: MIT
"""Each header compiles alone, twice in a file, and in two linked files, without a warning: public
headers in each supported language, private ones in C99.
"""

from pathlib import Path

import pytest
import static_tools as static
from conftest import need

CLAIM = "each header compiles alone, in C99 to C17 and in C++11 to C++20"
WARNINGS = "-Wall -Wextra -Wpedantic -Werror -Wundef -Wshadow -Wconversion -Wsign-conversion"
# Public headers have extern "C". The others are private, for C only.
PUBLIC = [path for path in static.HEADERS if 'extern "C"' in path.read_text()]
# For one core and its compiler (test_static_warnings.py compiles them).
OF_A_CORE = {"multiply_v6m.h", "cortex_m.h", "semihosting.h"}
OWN = [path for path in static.HEADERS if path not in PUBLIC and path.name not in OF_A_CORE]
USE = "int use_{0}(void);\nint use_{0}(void) {{ return 3; }}\n"


def compile_all(standard: str, folder: Path, files: dict[str, str], *words: object) -> None:
    """Compile texts by name, with both compilers, without a warning."""
    is_cpp = "++" in standard
    paths = [folder / f"{name}.{'cpp' if is_cpp else 'c'}" for name in files]
    for path, text in zip(paths, files.values(), strict=True):
        path.write_text(text)
    for compiler in ("g++", "clang++-19") if is_cpp else ("gcc", "clang-19"):
        options = [f"-std={standard}", "-D_POSIX_C_SOURCE=200809L", *WARNINGS.split()]
        options += [*static.INCLUDES, *static.MUJOCO_INCLUDES, *words]
        static.clean(need(compiler, CLAIM), *options, *paths, cwd=folder)


@pytest.mark.parametrize(
    ("standard", "headers"),
    [
        *((name, PUBLIC) for name in ("c99", "c11", "c17", "c++11", "c++17", "c++20")),
        pytest.param("c99", OWN, id="private"),
    ],
)
def test_a_header_compiles_alone(standard: str, headers: list[Path], tmp_path: Path) -> None:
    files = {
        f"{number}_{path.stem}": f'#include "{path}"\n' * 2 + USE.format(number)
        for number, path in enumerate(headers)
    }
    compile_all(standard, tmp_path, files, "-fsyntax-only")


@pytest.mark.parametrize("standard", ["c99", "c++11"])
def test_two_linked_files_may_include_all_headers(standard: str, tmp_path: Path) -> None:
    lines = "".join(f'#include "{path}"\n' for path in PUBLIC)
    main = f"{lines}int use_0(void);\nint main(void) {{ return use_0(); }}\n"
    files = {"other": lines + USE.format(0), "main": main}
    compile_all(standard, tmp_path, files, "-o", tmp_path / "program")
    assert static.call(tmp_path / "program") == (3, "")
