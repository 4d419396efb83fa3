# SPDX-License-Identifier: MIT
"""Each public header compiles alone in each supported language, twice in a file, and in two linked
files, without a warning.
"""

from __future__ import annotations

from pathlib import Path

import pytest
import static_tools as static
from conftest import need

CLAIM = "each header compiles by itself, in C99 to C17 and in C++11 to C++20"
WARNINGS = (
    "-Wall -Wextra -Wpedantic -Werror -Wundef -Wshadow -Wconversion -Wsign-conversion".split()
)
C = ["c99", "c11", "c17"]
CPP = ["c++11", "c++17", "c++20"]
# Public headers have extern "C". The others are private, for C only.
PUBLIC = [path for path in static.HEADERS if 'extern "C"' in path.read_text()]
# For one core and its compiler (test_static_warnings.py compiles them).
OF_A_CORE = {"multiply_v6m.h", "cortex_m.h", "semihosting.h"}
OWN = [path for path in static.HEADERS if path not in PUBLIC and path.name not in OF_A_CORE]


def compilers(standard: str) -> list[str]:
    names = ["g++", "clang++-19"] if "++" in standard else ["gcc", "clang-19"]
    return [need(name, CLAIM) for name in names]


def alone(headers: list[Path], standard: str, folder: Path) -> str:
    """Return the warnings for files that include one header twice and have no other code."""
    said = ""
    suffix = ".cpp" if "++" in standard else ".c"
    files = []
    for number, header in enumerate(headers):
        files.append(folder / f"alone_{number}_{header.stem}{suffix}")
        used = f"int dahl_use_{number}(void);\nint dahl_use_{number}(void) {{ return 0; }}\n"
        files[-1].write_text(f'#include "{header}"\n#include "{header}"\n{used}')
    for compiler in compilers(standard):
        posix = "-D_POSIX_C_SOURCE=200809L"
        words = [f"-std={standard}", posix, *WARNINGS, *static.INCLUDES, "-fsyntax-only"]
        said += static.call(compiler, *words, *files, cwd=folder)[1]
    return said


@pytest.mark.parametrize("standard", [*C, *CPP])
def test_public_header_alone(standard: str, tmp_path: Path) -> None:
    assert alone(PUBLIC, standard, tmp_path) == ""


def test_private_header_alone(tmp_path: Path) -> None:
    assert alone(OWN, "c99", tmp_path) == ""


@pytest.mark.parametrize("standard", ["c99", "c++11"])
def test_headers_in_two_linked_files(standard: str, tmp_path: Path) -> None:
    """No header has a definition that two linked files cannot both have."""
    suffix = ".cpp" if "++" in standard else ".c"
    lines = "".join(f'#include "{path}"\n' for path in PUBLIC)
    other, main = tmp_path / f"other{suffix}", tmp_path / f"main{suffix}"
    other.write_text(f"{lines}int other(void);\nint other(void) {{ return 3; }}\n")
    main.write_text(f"{lines}int other(void);\nint main(void) {{ return other(); }}\n")
    for compiler in compilers(standard):
        words = [f"-std={standard}", *WARNINGS, *static.INCLUDES]
        static.clean(compiler, *words, other, main, "-o", tmp_path / "program")
        assert static.call(tmp_path / "program") == (3, "")
