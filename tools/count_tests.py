# SPDX-License-Identifier: MIT
"""Count single tests in JUnit files of CTest and pytest: `count_tests.py FILE...`

Prints each failed and each skipped test, then the line `N passed, N failed[, N skipped]`. A CTest
entry that is a Unity program counts with the tests inside it. Exit code 1 when one failed, when
none ran, or when a file is not there: a runner that never wrote its results has not passed.
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

UNITY_TOTAL = re.compile(r"^(\d+) Tests (\d+) Failures (\d+) Ignored", re.MULTILINE)
UNITY_CASE = re.compile(r"^[^:\n]+:\d+:(\w+):(FAIL|IGNORE):? ?(.*)$", re.MULTILINE)


@dataclass
class Count:
    """How many passed; names (with reason) of those that failed or were skipped."""

    passed: int = 0
    failed: list[str] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)

    def line(self) -> str:
        tail = f", {len(self.skipped)} skipped" if self.skipped else ""
        return f"{self.passed} passed, {len(self.failed)} failed{tail}"


def count_unity(count: Count, name: str, output: str, ended_well: bool) -> None:
    """Add the tests inside one Unity program; a program that broke off counts as one more
    failure.
    """
    cases = UNITY_CASE.findall(output)
    failed = [f"{name}.{case}: {why}" for case, kind, why in cases if kind == "FAIL"]
    skipped = [f"{name}.{case}: {why}" for case, kind, why in cases if kind == "IGNORE"]
    total = sum(int(tests) for tests, _, _ in UNITY_TOTAL.findall(output))
    if not ended_well and not failed:
        failed = [f"{name}: ended badly"]
    count.passed += max(0, total - len(failed) - len(skipped))
    count.failed += failed
    count.skipped += skipped


def why_skipped(skipped: ElementTree.Element, output: str) -> str:
    """pytest says it in the message; a CTest program in its last line of output."""
    message = skipped.get("message", "")
    lines = output.strip().splitlines()
    return lines[-1] if lines and "SKIP" in message else message


def count_case(count: Count, case: ElementTree.Element) -> None:
    """Add one <testcase>."""
    name = f"{case.get('classname', '')}.{case.get('name')}".lstrip(".")
    output = case.findtext("system-out") or ""
    bad = case.find("failure") is not None or case.find("error") is not None
    skipped = case.find("skipped")
    if skipped is not None:
        count.skipped.append(f"{name}: {why_skipped(skipped, output)}")
    elif UNITY_TOTAL.search(output):
        count_unity(count, case.get("name", ""), output, not bad)
    elif bad:
        count.failed.append(name)
    else:
        count.passed += 1


def count_file(count: Count, path: Path) -> None:
    """Add all of one JUnit file."""
    try:
        root = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError) as error:
        count.failed.append(f"{path.name}: no results ({error})")
        return
    for case in root.iter("testcase"):
        count_case(count, case)


def main(paths: list[str]) -> int:
    count = Count()
    for path in paths:
        count_file(count, Path(path))
    for name in count.skipped:
        print(f"skipped: {name}")
    for name in count.failed:
        print(f"failed: {name}")
    if not count.passed:
        print("error: no test passed; were there any to run?", file=sys.stderr)
    print(count.line(), flush=True)
    return 0 if count.passed and not count.failed else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
