# SPDX-License-Identifier: MIT
"""Read `llvm-cov export` and list the holes: code that no test has called, executed or decided.

If a function of a header has instances in several files or programs, they count as one: counts are
added and independence pairs are united. A macro is counted separately for each place that uses it.
Functions that a macro defines are counted separately for each name.
"""

from __future__ import annotations

import json
import subprocess
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

Span = tuple[int, ...]  # first line and column, last line and column
EXPANSION = 1  # kind of a region


@dataclass(frozen=True, order=True)
class Place:
    """A place in a file; if the name there is a macro, also a place within the macro."""

    spans: tuple[Span, ...]
    maker: str = ""  # the function, if a macro defines several with the same text

    @property
    def line(self) -> int:
        """Return the start of the region in the file."""
        return self.spans[0][0]

    def is_within(self, around: Place) -> bool:
        """Return whether this is within the other region, directly or by a macro that it uses."""
        depth = len(around.spans) - 1
        if len(self.spans) <= depth or self.spans[:depth] != around.spans[:depth]:
            return False
        inner, outer = self.spans[depth], around.spans[depth]
        return self.maker == around.maker and outer[:2] <= inner[:2] and inner[2:] <= outer[2:]

    def hole(self, what: str) -> tuple[int, int, str]:
        """Return line, column and the kind of the hole."""
        macro = "".join(f", in the macro at {span[0]}:{span[1]}" for span in self.spans[1:])
        maker = f", in {self.maker}" if self.maker else ""
        return self.spans[0][0], self.spans[0][1], what + macro + maker


@dataclass
class FileCoverage:
    """Counts of one source file."""

    functions: dict[tuple[Place, str], int] = field(default_factory=dict)
    lines: dict[int, int] = field(default_factory=dict)
    branches: dict[Place, list[int]] = field(default_factory=dict)  # times true, times false
    decisions: dict[Place, list[bool]] = field(
        default_factory=dict
    )  # conditions with an independence pair

    def add_branch(self, place: Place, true: int, false: int) -> None:
        """Add the counts of one instance of a branch."""
        counts = self.branches.setdefault(place, [0, 0])
        counts[0] += true
        counts[1] += false

    def add_decision(self, place: Place, shown: Sequence[bool]) -> None:
        """Unite the conditions of one instance of a decision."""
        before = self.decisions.setdefault(place, [False] * len(shown))
        self.decisions[place] = [a or b for a, b in zip(before, shown, strict=True)]

    def conditions_of(self, decision: Place) -> list[Place]:
        """Return the branches within a decision, in the order of the source."""
        return sorted(place for place in self.branches if place.is_within(decision))

    def totals(self) -> dict[str, tuple[int, int]]:
        """Return reached and total numbers of functions, lines, sides of branches, conditions."""
        reached = {
            "functions": [n > 0 for n in self.functions.values()],
            "lines": [n > 0 for n in self.lines.values()],
            "branches": [n > 0 for counts in self.branches.values() for n in counts],
            "MC/DC": [shown for decision in self.decisions.values() for shown in decision],
        }
        return {kind: (sum(each), len(each)) for kind, each in reached.items()}

    def without_uncalled(self) -> FileCoverage:
        """Return the file without the functions that a run cannot call."""
        called = {key: n for key, n in self.functions.items() if n > 0}
        bodies = [place.spans[0] for place, _ in self.functions.keys() - called.keys()]

        def is_open(line: int) -> bool:
            return not any(first <= line <= last for first, _, last, _ in bodies)

        return FileCoverage(
            called,
            {line: n for line, n in self.lines.items() if is_open(line)},
            {place: counts for place, counts in self.branches.items() if is_open(place.line)},
            {place: shown for place, shown in self.decisions.items() if is_open(place.line)},
        )

    def holes(self) -> list[tuple[int, int, str]]:
        """Return line, column and kind of each hole."""
        found = [
            place.hole(f"function {name} never called")
            for (place, name), n in self.functions.items()
            if n == 0
        ]
        found += [(line, 1, "line not executed") for line, n in self.lines.items() if n == 0]
        for place, counts in self.branches.items():
            sides = zip(("true", "false"), counts, strict=True)
            found += [place.hole(f"branch never {side}") for side, n in sides if n == 0]
        for decision, shown in self.decisions.items():
            places = zip(self.conditions_of(decision), shown, strict=True)
            found += [
                place.hole(f"condition {i} of {len(shown)} never shown to decide (MC/DC)")
                for i, (place, is_shown) in enumerate(places, 1)
                if not is_shown
            ]
        return sorted(found)


def merge(profiles: Iterable[Path], to: Path) -> Path:
    """Merge the profiles of many runs."""
    command = ["llvm-profdata-19", "merge", "-o", str(to), *map(str, profiles)]
    subprocess.run(command, check=True, capture_output=True, text=True, timeout=60)
    return to


def export(profile: Path, programs: Sequence[Path], sources: Sequence[Path], form: str) -> str:
    """Return the output of `llvm-cov export`."""
    objects = [word for program in programs for word in ("-object", str(program))]
    command = ["llvm-cov-19", "export", f"-format={form}", f"-instr-profile={profile}", *objects]
    command += ["-sources", *map(str, sources)]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=60)
    return done.stdout


def read_lines(lcov: str, files: dict[str, FileCoverage]) -> None:
    """Return the counts of lines. The lcov form has merged all instances."""
    name = ""
    for record in lcov.splitlines():
        key, _, value = record.partition(":")
        if key == "SF":
            name = value
        elif key == "DA":
            line, count = value.split(",")[:2]
            files[name].lines[int(line)] = int(count)


def bare(function: dict[str, Any]) -> str:
    """Return the name in the source; the name of a static function has its file as prefix."""
    return str(function["name"]).rsplit(":", maxsplit=1)[-1]


def start_of(function: dict[str, Any]) -> tuple[str, Span]:
    """Return file and position of the start of its body."""
    return function["filenames"][0], tuple(function["regions"][0][:4])


def ways_of(function: dict[str, Any]) -> list[tuple[str, tuple[Span, ...]]]:
    """Return for each file id of a function its file, and the macro uses that lead to it."""
    uses = {
        expanded: (parent, tuple(span))
        for *span, _, parent, expanded, kind in function["regions"]
        if kind == EXPANSION
    }
    ways = []
    for file_id in range(len(function["filenames"])):
        way: tuple[Span, ...] = ()
        top = file_id
        while top in uses:
            top, span = uses[top]
            way = (span, *way)
        ways.append((function["filenames"][top], way))
    return ways


def read_function(function: dict[str, Any], maker: str, files: dict[str, FileCoverage]) -> None:
    """Add branches, then decisions. A decision has no file id; its branches give it."""
    ways = ways_of(function)
    name, span = start_of(function)
    key = Place((span,), maker), bare(function)
    files[name].functions[key] = files[name].functions.get(key, 0) + function["count"]
    for *spot, true, false, file_id, _, _ in function["branches"]:
        name, way = ways[file_id]
        files[name].add_branch(Place((*way, tuple(spot)), maker), true, false)
    taken: list[Place] = []
    for *spot, _, _, shown in function["mcdc_records"]:
        places = [(name, Place((*way, tuple(spot)), maker)) for name, way in ways]
        fitting = [
            (name, place)
            for name, place in places
            if place not in taken and len(files[name].conditions_of(place)) == len(shown)
        ]
        if not fitting:
            raise ValueError(f"{function['name']}: {spot}: a decision without its branches")
        name, place = fitting[0]
        files[name].add_decision(place, shown)
        taken.append(place)


def measure(
    profile: Path, programs: Sequence[Path], sources: Sequence[Path]
) -> dict[Path, FileCoverage]:
    """Return the coverage of each source (absolute path). A source without code has no lines."""
    wanted = set(map(str, sources))
    data = json.loads(export(profile, programs, sources, "text"))["data"][0]
    functions = [f for f in data["functions"] if start_of(f)[0] in wanted]
    names: dict[tuple[str, Span], set[str]] = defaultdict(set)
    for function in functions:
        names[start_of(function)].add(bare(function))
    files: dict[str, FileCoverage] = defaultdict(FileCoverage)
    for function in functions:
        is_made = len(names[start_of(function)]) > 1
        read_function(function, function["name"] if is_made else "", files)
    read_lines(export(profile, programs, sources, "lcov"), files)
    return {source: files[str(source)] for source in sources}


def holes_of(files: dict[Path, FileCoverage], base: Path) -> list[str]:
    """Return all holes as file:line:column: kind."""
    return [
        f"{path.relative_to(base)}:{line}:{column}: {what}"
        for path, coverage in sorted(files.items())
        for line, column, what in coverage.holes()
    ]
