# SPDX-License-Identifier: MIT
"""clang-tidy 19: bugprone, cert, clang-analyzer, misc, performance, portability, and the house rule
that a function has at most 40 lines and complexity 8. Its configuration is clang-tidy.yaml;
findings that are meant stand in deviations.toml.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import static_tools as static
from conftest import ROOT, need
from static_tools import Finding

CONFIG = Path(__file__).parent / "clang-tidy.yaml"
LINE = re.compile(r"^(/\S+?):(\d+):(\d+): (?:warning|error): .* \[([\w.,-]+)\]$", re.MULTILINE)


def tidy(files: list[Path], root: Path = ROOT) -> set[Finding]:
    tool = need("clang-tidy-19", "clang-tidy finds nothing that is not listed with its reason")
    _, text = static.call(tool, "--quiet", f"--config-file={CONFIG}", *files, "--", *static.PLAIN)
    found = set()
    for file, line, column, rules in LINE.findall(text):
        place = static.name_of(str(Path(file).resolve()), root)
        found.add(Finding(rules.split(",")[0], place, int(line), int(column)))
    assert not any(place.rule == "clang-diagnostic-error" for place in found), text
    return found


def differences(files: list[Path], headers: list[Path]) -> list[str]:
    return static.differences(tidy(files), static.deviations("tidy"), [*files, *headers])


def test_firmware_sources_are_tidy() -> None:
    headers = [path for path in static.HEADERS if path.parent.name == "lib"]
    assert differences(static.FIRMWARE, headers) == []


@pytest.mark.long
def test_desk_sources_are_tidy() -> None:
    assert differences(static.DESK, []) == []


LONG = "uint32_t dahl_x(uint32_t x)\n{{\n{}    return x;\n}}".format("    x += x * x;\n" * 40)
DEEP = """uint32_t dahl_x(uint32_t x, uint32_t y)
{
    for (uint32_t i = 0; i < y; i++) {
        if (x > i) {
            for (uint32_t j = i; j < y; j++) {
                if (x > j && y > j) {
                    x += j;
                }
            }
        }
    }
    return x;
}"""
PLANTED = {
    "readability-function-size": LONG,
    "readability-function-cognitive-complexity": DEEP,
    "misc-no-recursion": "uint32_t dahl_x(uint32_t n) { return n > 0 ? 1u + dahl_x(n - 1u) : 0u; }",
    "clang-analyzer-core.UndefinedBinaryOperatorResult": (
        "uint32_t dahl_x(uint32_t n) { uint32_t y; if (n > 3) { y = n; } return y + 1u; }"
    ),
    "bugprone-sizeof-expression": "size_t dahl_x(char *p) { return sizeof(p) / sizeof(p[0]); }",
}


@pytest.mark.parametrize("rule", PLANTED)
def test_planted_fault_is_untidy(rule: str, tmp_path: Path) -> None:
    file = tmp_path / "planted.c"
    file.write_text(f"#include <stddef.h>\n#include <stdint.h>\n{PLANTED[rule]}\n")
    assert rule in {place.rule for place in tidy([file], tmp_path)}
