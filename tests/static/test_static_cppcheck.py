# SPDX-License-Identifier: MIT
"""cppcheck accepts all C of the product, and its MISRA C:2012 addon the C of firmware, except for
the rules in suppressions.txt, which have a reason each.
"""

import re
import tempfile
from pathlib import Path

import pytest
import static_tools as static
from conftest import ROOT, need

CLAIM = "cppcheck finds nothing, and of MISRA C:2012 nothing but the rules of suppressions.txt"
VERSION = "2.10"  # another version has other findings
LIST = Path(__file__).with_name("suppressions.txt")
LINE = re.compile(r"(\S+?):(\d+):(\d+): (?:\w+: )?([\w.-]+)$", re.MULTILINE)
# Mandatory rules of MISRA C:2012: no deviation is permitted.
MANDATORY = set(
    "9.1 12.5 13.6 17.3 17.4 17.6 19.1 21.13 21.17 21.18 21.19 21.20 22.2 22.4 22.5 22.6".split()
)
OPTIONS = ["--enable=all", "--inconclusive", "--quiet", "--std=c99", "--platform=unix64"]
OPTIONS += ["--suppress=missingIncludeSystem", "--suppress=unmatchedSuppression"]
OPTIONS += [f"--suppressions-list={LIST}", "--template={file}:{line}:{column}: {id}"]
# Macros that cppcheck does not know: compiler.h reads those of <limits.h>, <float.h> and
# <stdint.h>; port/cortex_m/startup.c reads the core.
DEFINED = """CHAR_BIT=8 INT_MIN=(-2147483647-1) INT_MAX=2147483647 UINT_MAX=0xffffffffU
    UINT32_MAX=0xffffffffU UINT64_MAX=0xffffffffffffffffULL
    FLT_RADIX=2 FLT_MANT_DIG=24 FLT_MAX_EXP=128 FLT_MIN_EXP=-125 __ARM_ARCH_7M__=1""".split()
OPTIONS += [f"-D{word}" for word in DEFINED] + ["--max-configs=12"]
USERS = ["tests/lib", "tests/node", "tests/port", "tests/sim", "tests/target", "tools/bench"]


def cppcheck() -> str:
    tool = need("cppcheck", CLAIM)
    _, text = static.call(tool, "--version")
    if text.split() != ["Cppcheck", VERSION]:
        pytest.skip(f"{CLAIM}: cppcheck is {text.split()[-1]}, the list is for {VERSION}")
    return tool


def findings(files: list[Path], *more: str) -> set[str]:
    """Return the findings of cppcheck in these files and their headers, one per line."""
    _, text = static.call(cppcheck(), *OPTIONS, *more, *static.INCLUDES, *files)
    unread = ("syntaxError", "internalError", "noValidConfiguration")
    assert not any(word in text for word in unread), text
    return {":".join(place) for place in LINE.findall(text)}


def misra(files: list[Path]) -> set[str]:
    with (
        tempfile.TemporaryDirectory() as folder
    ):  # otherwise the addon writes its files next to the sources
        found = findings(files, "--addon=misra", f"--cppcheck-build-dir={folder}")
    return {place for place in found if ":misra-" in place}


def test_misra_finds_no_other_rule() -> None:
    assert misra(static.FIRMWARE) == set()


def test_cppcheck_finds_nothing() -> None:
    """All of lib, port and host_sim; with tests and benches, because they call functions too."""
    product = [*static.FIRMWARE, *static.START_UP, *static.DESK]
    users = [path for folder in USERS for path in ROOT.glob(f"{folder}/**/*.c")]
    alone = {place for place in findings(product) if not place.endswith(":unusedFunction")}
    used = {place for place in findings([*product, *users]) if place.endswith(":unusedFunction")}
    assert alone | {place for place in used if Path(place.split(":")[0]) in product} == set()


def test_no_mandatory_rule_is_suppressed() -> None:
    assert not MANDATORY & set(re.findall(r"^misra-c2012-([\d.]+)", LIST.read_text(), re.MULTILINE))
