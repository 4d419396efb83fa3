# SPDX-License-Identifier: MIT
"""cppcheck over all of the product's C, and its MISRA C:2012 addon over what firmware links.

deviations.toml lists every finding that is meant, with its reason; one that is not listed fails,
and so does one that is listed and no longer there. MISRA's texts are not ours: rules go by number.
"""

from __future__ import annotations

import re
import tempfile
import tomllib
from pathlib import Path

import planting
import pytest
import static_tools as static
from conftest import ROOT, need
from static_tools import Finding

CLAIM = "every deviation from MISRA C:2012 that cppcheck sees is listed with its reason"
VERSION = "2.10"  # what the list was made with; another one sees other things
LINE = re.compile(r"(\S+?):(\d+):(\d+): (?:\w+: )?([\w.-]+)$", re.MULTILINE)
# The rules that MISRA C:2012 calls mandatory: no deviation is permitted.
MANDATORY = set(
    "9.1 12.5 13.6 17.3 17.4 17.6 19.1 21.13 21.17 21.18 21.19 21.20 22.2 22.4 22.5 22.6".split()
)
OPTIONS = ["--enable=all", "--inconclusive", "--quiet", "--std=c99", "--platform=unix64"]
OPTIONS += ["--suppress=missingIncludeSystem", "--template={file}:{line}:{column}: {id}"]
USERS = ["tests/lib", "tests/port", "tests/target", "tools/bench"]


def cppcheck() -> str:
    tool = need("cppcheck", CLAIM)
    _, text = static.call(tool, "--version")
    if text.split() != ["Cppcheck", VERSION]:
        pytest.skip(f"unproven: {CLAIM}: cppcheck is {text.split()[-1]}, the list is for {VERSION}")
    return tool


def findings(files: list[Path], *more: str, root: Path = ROOT) -> set[Finding]:
    """What cppcheck says of these files and the headers they include."""
    includes = [f"-I{root / part}" for part in ("lib/include", "port", "host_sim")]
    _, text = static.call(cppcheck(), *OPTIONS, *more, *includes, *files)
    assert "syntaxError" not in text and "internalError" not in text, text
    return {
        Finding(
            rule.removeprefix("misra-c2012-"), static.name_of(file, root), int(line), int(column)
        )
        for file, line, column, rule in LINE.findall(text)
    }


def misra(files: list[Path], root: Path = ROOT) -> set[Finding]:
    with tempfile.TemporaryDirectory() as folder:  # else what the addon reads is written beside lib
        aside = f"--cppcheck-build-dir={folder}"
        found = findings(files, "--addon=misra", aside, root=root)
    return {place for place in found if re.fullmatch(r"\d+\.\d+", place.rule)}


def test_misra_deviations_are_the_listed_ones() -> None:
    files = [*static.FIRMWARE, *static.HEADERS]
    said = static.differences(misra(static.FIRMWARE), static.deviations("misra"), files)
    assert said == []


def test_cppcheck_finds_nothing_else() -> None:
    """All of lib, port and host_sim. Who calls a function is told by the tests and benches too."""
    product = [*static.FIRMWARE, *static.START_UP, *static.DESK]
    users = [*(path for folder in USERS for path in ROOT.glob(f"{folder}/**/*.c"))]
    names = {static.name_of(str(path)) for path in product}
    alone = {place for place in findings(product) if place.rule != "unusedFunction"}
    used = {place for place in findings([*product, *users]) if place.file in names}
    found = alone | {place for place in used if place.rule == "unusedFunction"}
    files = [*product, *static.HEADERS]
    assert static.differences(found, static.deviations("cppcheck"), files) == []


def test_each_deviation_has_its_reason() -> None:
    text = (Path(__file__).parent / "deviations.toml").read_text()
    tools = tomllib.loads(text)
    assert set(tools) == {"misra", "cppcheck", "tidy"}
    for tool, rules in tools.items():
        for rule, entry in rules.items():
            assert set(entry) == {"why", "in"} and len(entry["why"]) >= 20, f"{tool} {rule}"
            assert all((ROOT / file).exists() and n > 0 for file, n in entry["in"].items()), rule
    assert not MANDATORY & set(tools["misra"])


# --- each fault is seen --------------------------------------------------------------------------


# In functions with a prototype: without one the addon says so (8.4) and looks no further.
PLANTED = {
    "goto": ("15.1", "if (x > 0) { goto end; }\nend:"),
    "octal": ("7.1", "x = 017;"),
    "recursion": ("17.2", "x = dahl_x(x - 1);"),
    "no default": ("16.4", "switch (x) { case 1: x = 2; break; case 2: x = 3; break; }"),
    "missing prototype": ("8.4", "return x; }\nint32_t dahl_y(int32_t x) { x++;"),
}


@pytest.mark.parametrize("fault", PLANTED)
def test_planted_misra_finding_is_not_listed(fault: str, tmp_path: Path) -> None:
    rule, body = PLANTED[fault]
    head = "int32_t dahl_x(int32_t x)"
    source = f"{head};\n{head} {{ {body} return x; }}"
    root = planting.copy(tmp_path, ("lib", "port"))
    torque = root / "lib/torque.c"
    torque.write_text(f"{torque.read_text()}{source}\n")
    found = misra([torque], root)
    said = static.differences(found, static.deviations("misra"), [Path("lib/torque.c")])
    assert any(f"lib/torque.c: rule {rule}: 0 listed" in line for line in said)


def test_planted_stale_deviation_is_seen() -> None:
    """A finding that was mended must leave the list."""
    listed = static.deviations("misra")
    found = {
        Finding(rule, file, line, 1) for (rule, file), n in listed.items() for line in range(n)
    }
    files = [ROOT / file for _, file in listed]
    assert static.differences(found, listed, files) == []
    mended = next(iter(found))
    said = static.differences(found - {mended}, listed, files)
    assert len(said) == 1 and said[0].startswith(f"{mended.file}: rule {mended.rule}:")


CPPCHECK_PLANTED = {
    "uninitvar": "uint32_t dahl_x(uint32_t x) { uint32_t y; if (x > 3u) { y = x; } return y; }",
    "arrayIndexOutOfBounds": "uint32_t dahl_x(void) { uint32_t y[3] = {0}; return y[3]; }",
    "unusedFunction": "uint32_t dahl_x(uint32_t x) { return x; }",
}


@pytest.mark.parametrize("fault", CPPCHECK_PLANTED)
def test_planted_fault_is_seen_by_cppcheck(fault: str, tmp_path: Path) -> None:
    torque = planting.copy(tmp_path, ("lib", "port")) / "lib/torque.c"
    torque.write_text(f"{torque.read_text()}{CPPCHECK_PLANTED[fault]}\n")
    assert fault in {place.rule for place in findings([torque], root=tmp_path)}
