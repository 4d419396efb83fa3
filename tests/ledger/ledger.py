# SPDX-License-Identifier: MIT
"""The ledger: each claim of README.md and lib/dahl.h, the tests that show it, the last result.

tools/test.sh --full puts it into tests/VERIFICATION.md at its end; after another run, by hand:
    build/venv/bin/python tests/ledger/ledger.py
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path

import names
import versions
from outcomes import GREEN, RED, UNPROVEN, Result, last_run
from sentences import ROOT

PAGE = ROOT / "tests" / "VERIFICATION.md"
CLAIMS = ROOT / "tests" / "ledger" / "claims.toml"
MARK = "<!-- ledger:{} -->"
NOT_RUN = "not run"
SHORT = "passed, short form"  # what tools/test.sh runs by itself did; --full runs the rest
OPEN = "open: "
MODES = ("", "--full", "--soak")  # which call of tools/test.sh runs a test
MODE_OF_MARK = {"soak": "--soak", "long": "--full"}


@dataclass(frozen=True)
class Claim:
    """One claim of claims.toml."""

    id: str
    claim: str
    checks: list[str]
    says: list[str] = field(default_factory=list)
    open: str = ""  # what is not shown yet, and why; the claim is not green then


@dataclass(frozen=True)
class Book:
    """All of claims.toml."""

    claims: list[Claim]
    plain: list[str]
    measured: list[dict]

    @staticmethod
    def read(path: Path = CLAIMS) -> Book:
        book = tomllib.loads(path.read_text())
        return Book([Claim(**c) for c in book["claim"]], book["plain"], book["measured"])

    def sentences(self) -> list[str]:
        """Every sentence that the book accounts for; one that stands twice is there twice."""
        said = [s for claim in self.claims for s in claim.says]
        return said + self.plain + [s for entry in self.measured for s in entry["says"]]


def matches(check: str, test: str) -> bool:
    """Whether a test (module::name) is meant by a check; a module alone means all of it."""
    return fnmatchcase(test, check if "::" in check else f"{check}::*")


def _mode_of(marks: Iterable[str]) -> str:
    return next((mode for mark, mode in MODE_OF_MARK.items() if mark in marks), "")


def _pytest_names() -> list[tuple[str, str]]:
    """Mode and name of each test in Python."""
    command = [sys.executable, "-m", "pytest", "-c", "tests/pytest.ini", "tests", "--collect-only"]
    path = [str(ROOT / "tests" / "ledger"), *filter(None, [os.environ.get("PYTHONPATH")])]
    said = subprocess.run(
        [*command, "-q", "-p", "names"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(path)},
    ).stdout
    lines = (line.split("|", 2) for line in said.splitlines() if line.startswith(names.MARK))
    return [(_mode_of(marks.split(",")), name) for _, marks, name in lines]


def _ctest_names() -> list[tuple[str, str]]:
    """Mode and name of programs, and of Unity's single tests as their source names them."""
    said = subprocess.run(
        ["ctest", "--test-dir", "build/host", "--show-only=json-v1"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    found = []
    for test in json.loads(said)["tests"]:
        labels = {p["name"]: p["value"] for p in test["properties"]}.get("LABELS", [])
        sources = (ROOT / "tests").glob(f"*/{test['name']}.c")
        cases = [c for s in sources for c in versions.unity_cases(s.read_text())]
        found += [(_mode_of(labels), f"{test['name']}::{c}") for c in cases or [test["name"]]]
    return found


def all_tests() -> dict[str, str]:
    """Every test that there is, and the mode of tools/test.sh that it takes: the least of those
    that have one of its name."""
    found: dict[str, str] = {}
    for mode, name in sorted(
        [*_pytest_names(), *_ctest_names()], key=lambda one: MODES.index(one[0])
    ):
        found.setdefault(name, mode)
    return found


@dataclass(frozen=True)
class Row:
    """What is known of one claim."""

    claim: Claim
    commands: list[str]
    tools: list[str]
    tests: int
    seconds: float
    result: str


def _word(module: str) -> str:
    return module.removeprefix("test_")


def _commands(tests: dict[str, str]) -> list[str]:
    """The calls of tools/test.sh that run these tests: one a module, in the mode for all of it."""
    modes: dict[str, str] = {}
    for name, mode in tests.items():
        module = name.partition("::")[0]
        modes[module] = max(modes.get(module, ""), mode if mode != "--soak" else "")
    return [
        f"tools/test.sh {m} -k {_word(module)}".replace("  ", " ") for module, m in modes.items()
    ]


def _verdict(results: list[Result]) -> str:
    states = {result.state for result in results}
    if RED in states:
        return RED
    if UNPROVEN in states:
        return next(result.why for result in results if result.state == UNPROVEN)
    return GREEN if GREEN in states else NOT_RUN


def _result(claim: Claim, tests: dict[str, str], ran: list[Result]) -> str:
    """What the ran tests of a claim say, and whether those that did not run matter."""
    verdict, names = _verdict(ran), {result.name for result in ran}
    missing = [n for n, mode in tests.items() if n not in names and mode == ""]
    missing += [c for c in claim.checks if not any(matches(c, n) for n in tests)]
    if verdict == GREEN and missing:
        return f"{NOT_RUN}: {missing[0]}"
    if verdict == GREEN and claim.open:
        return OPEN + claim.open
    long = any(mode == "--full" and n not in names for n, mode in tests.items())
    return SHORT if verdict == GREEN and long else verdict


def row_of(claim: Claim, known: dict[str, str], results: dict[str, Result]) -> Row:
    """One line of the ledger. Soak runs count where there is a result, and are not waited for."""
    others = {n: m for n, m in known.items() if not n.startswith("test_ledger::")}  # runs last
    tests = {n: m for n, m in others.items() if any(matches(c, n) for c in claim.checks)}
    ran = [results[name] for name in tests if name in results]
    modules = dict.fromkeys(name.partition("::")[0] for name in tests)
    return Row(
        claim,
        _commands(tests),
        versions.of(modules),
        len(ran),
        sum(result.seconds for result in ran),
        _result(claim, tests, ran),
    )


def _table(rows: list[Row]) -> str:
    lines = [
        "| claim | command | tools | tests | seconds | last result |",
        "|---|---|---|---:|---:|---|",
    ]
    for row in rows:
        commands = ", ".join(f"`{command}`" for command in row.commands)
        lines.append(
            f"| {row.claim.claim} | {commands} | {', '.join(row.tools)} | {row.tests} "
            f"| {row.seconds:.1f} | {row.result} |"
        )
    return "\n".join(lines)


def _planted(results: dict[str, Result]) -> str:
    """Each planted fault, and the check that caught it."""
    found = [r for r in results.values() if is_planted(r.name)]
    lines = [f"{len(found)} faults planted.", "", "| planted | in | caught |", "|---|---|---|"]
    for result in sorted(found, key=lambda r: r.name):
        module, _, name = result.name.partition("::")
        what = name.removeprefix("test_planted_").replace("_", " ").replace("|", "or")
        lines.append(
            f"| {what} | {_word(module)} | {'yes' if result.state == GREEN else result.state} |"
        )
    return "\n".join(lines)


def is_planted(name: str) -> bool:
    return "::test_planted_" in name


def _between(page: str, name: str, text: str) -> str:
    start, end = MARK.format(name), MARK.format("/" + name)
    head, _, rest = page.partition(start)
    _, found, tail = rest.partition(end)
    if not found:
        raise ValueError(f"{PAGE.name} lacks the marks of {name}")
    return f"{head}{start}\n{text}\n{end}{tail}"


def write(rows: list[Row], results: dict[str, Result], page: Path = PAGE) -> None:
    """Put rows, planted faults and versions into the page, whole or not at all."""
    text = _between(page.read_text(), "claims", _table(rows))
    text = _between(text, "planted", _planted(results))
    text = _between(text, "tools", versions.table())
    new = page.with_suffix(".new")
    new.write_text(text)
    new.replace(page)


def recorded(page: Path = PAGE) -> dict[str, str]:
    """The last result of each claim that stands in the page."""
    table = (
        page.read_text().partition(MARK.format("claims"))[2].partition(MARK.format("/claims"))[0]
    )
    rows = [line.strip("| ").split(" | ") for line in table.splitlines() if line.startswith("| ")]
    return {row[0]: row[-1] for row in rows[1:]}  # but the head


def main() -> None:
    results, known = last_run(ROOT / "build"), all_tests()
    rows = [row_of(claim, known, results) for claim in Book.read().claims]
    write(rows, results)
    for row in rows:
        if row.result != GREEN:
            print(f"{row.claim.id}: {row.result}")


if __name__ == "__main__":
    main()
