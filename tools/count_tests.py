# SPDX-License-Identifier: MIT
"""Count the single tests in JUnit files of CTest and pytest.

Usage: count_tests.py FILE=CODE... [--note T]. CODE is the exit code of the program that wrote FILE.
Prints each failed and each skipped test, the note, then `N passed, N failed[, N skipped]`. If a
CTest entry is a Unity program, its tests are counted. A run counts as one more failure if it did
not end properly: if FILE is missing or damaged, if it has fewer results than tests, or if CODE is
an unexpected one. Exit code 1 if a test failed or no test passed.
"""

from __future__ import annotations

import argparse
import re
import sys
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

ALL_WELL = (0, 5)  # 5: pytest had no test to run
SOME_FAILED = (1, 8)  # codes of pytest and of ctest

UNITY_TOTAL = re.compile(r"^(\d+) Tests (\d+) Failures (\d+) Ignored", re.MULTILINE)
UNITY_CASE = re.compile(r"^[^:\n]+:\d+:(\w+):(FAIL|IGNORE):? ?(.*)$", re.MULTILINE)


@dataclass
class Count:
    """The number of passed tests; names and reasons of failed and skipped ones."""

    passed: int = 0
    failed: list[str] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)

    def line(self) -> str:
        tail = f", {len(self.skipped)} skipped" if self.skipped else ""
        return f"{self.passed} passed, {len(self.failed)} failed{tail}"


def count_unity(count: Count, name: str, output: str, ended_well: bool) -> None:
    """Add the tests of a Unity program. If it ended early, add one failure."""
    cases = UNITY_CASE.findall(output)
    failed = [f"{name}.{case}: {why}" for case, kind, why in cases if kind == "FAIL"]
    skipped = [f"{name}.{case}: {why}" for case, kind, why in cases if kind == "IGNORE"]
    total = sum(int(tests) for tests, _, _ in UNITY_TOTAL.findall(output))
    count.passed += max(0, total - len(failed) - len(skipped))
    if not ended_well and not failed:
        failed = [f"{name}: ended badly"]
    count.failed += failed
    count.skipped += skipped


def why_skipped(skipped: ElementTree.Element, output: str) -> str:
    """Return the reason: in the message of pytest, or in the last line of a CTest program."""
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


def announced(root: ElementTree.Element) -> int:
    """Return the number of tests that the run had to report: the collected ones of pytest
    (tests/conftest.py), or the sum of the suites.
    """
    collected = root.findall(".//property[@name='collected']")
    if collected:
        return sum(int(each.get("value", "")) for each in collected)
    return sum(int(suite.get("tests", "0")) for suite in root.iter("testsuite"))


def count_file(count: Count, path: Path, code: int) -> None:
    """Add a JUnit file. If its run ended early, add one failure."""
    try:
        root = ElementTree.parse(path).getroot()
        cases, expected = list(root.iter("testcase")), announced(root)
    except (OSError, ElementTree.ParseError, ValueError) as error:
        count.failed.append(f"{path.name}: no results ({error})")
        return
    failed_before = len(count.failed)
    for case in cases:
        count_case(count, case)
    if code in SOME_FAILED and len(count.failed) == failed_before:
        count.failed.append(f"{path.name}: exit code {code}, and yet no test in it failed")
    if len(cases) < expected:
        count.failed.append(f"{path.name}: only {len(cases)} of {expected} tests have a result")
    if code not in (*ALL_WELL, *SOME_FAILED):
        count.failed.append(f"{path.name}: the run broke off with exit code {code}")


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("runs", nargs="+", metavar="FILE=CODE")
    parser.add_argument("--note", default="", help="a line to print before the last one")
    options = parser.parse_args(arguments)
    count = Count()
    for run in options.runs:
        path, _, code = run.rpartition("=")
        count_file(count, Path(path), int(code))
    for name in count.skipped:
        print(f"skipped: {name}")
    for name in count.failed:
        print(f"failed: {name}")
    if not count.passed:
        print("error: no test passed; were there any to run?", file=sys.stderr)
    if options.note:
        print(options.note)
    print(count.line(), flush=True)
    return 0 if count.passed and not count.failed else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
