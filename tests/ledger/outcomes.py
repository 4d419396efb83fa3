# SPDX-License-Identifier: MIT
"""What the last run said, from the JUnit files of CTest and pytest.

Tests are named `module::test[parameters]`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

UNITY_CASE = re.compile(r":\d+:(test_\w+):(PASS|FAIL|IGNORE)(?::\s*(.*))?")
GREEN, RED, UNPROVEN, SKIPPED = "passed", "failed", "unproven", "skipped"


@dataclass(frozen=True)
class Result:
    """One test of one run."""

    name: str  # module::test[parameters]
    state: str
    seconds: float
    why: str = ""

    @property
    def module(self) -> str:
        return self.name.partition("::")[0]


def _state(case: ElementTree.Element) -> tuple[str, str]:
    skipped = case.find("skipped")
    if case.find("failure") is not None or case.find("error") is not None:
        return RED, ""
    if skipped is None:
        return GREEN, ""
    why = skipped.get("message", "")
    return (UNPROVEN if "unproven" in why else SKIPPED), why


def _of_unity(program: str, output: str, seconds: float) -> list[Result]:
    """A Unity program's single tests; its time is shared out among them."""
    cases = UNITY_CASE.findall(output)
    states = {"PASS": GREEN, "FAIL": RED, "IGNORE": SKIPPED}
    return [
        Result(f"{program}::{case}", states[state], seconds / len(cases), why)
        for case, state, why in cases
    ]


def _of_case(case: ElementTree.Element) -> list[Result]:
    module = case.get("classname", "").rpartition(".")[2]
    seconds = float(case.get("time") or 0)
    state, why = _state(case)
    inside = _of_unity(module, case.findtext("system-out") or "", seconds)
    if inside and (state == GREEN or any(result.state == RED for result in inside)):
        return inside
    return [Result(f"{module}::{case.get('name')}", state, seconds, why)]


def read(paths: list[Path]) -> dict[str, Result]:
    """All results of the files that are there, by name."""
    found = {}
    for path in paths:
        if path.exists():
            for case in ElementTree.parse(path).getroot().iter("testcase"):
                found.update({result.name: result for result in _of_case(case)})
    return found


def last_run(build: Path) -> dict[str, Result]:
    """What tools/test.sh said last: C tests, Python tests, checks."""
    return read([build / f"{name}.xml" for name in ("ctest", "python", "checks")])
