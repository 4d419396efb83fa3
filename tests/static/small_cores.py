# SPDX-License-Identifier: MIT
"""What the compiler of a small core says of each source as the product is built for it: bytes of
stack of each function, who calls whom, and which symbols an object needs or keeps.
"""

from __future__ import annotations

import json
import re
import shlex
import sys
from collections.abc import Iterable
from dataclasses import dataclass, field
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
import static_tools as static
from conftest import ROOT, need

sys.path.insert(0, str(ROOT / "tools" / "bench"))

import target  # noqa: E402

NODE = re.compile(r'^node: { title: "([^"]+)" label: "([^"]*)"')
EDGE = re.compile(r'^edge: { sourcename: "([^"]+)" targetname: "([^"]+)"')
FRAME = re.compile(r"\\n(\d+) bytes \((.+?)\)")
INDIRECT = "__indirect_call"


@dataclass
class Calls:
    """Functions that were compiled, by name: bytes and kind of their frame, and what they call."""

    frames: dict[str, tuple[int, str]] = field(default_factory=dict)
    callees: dict[str, set[str]] = field(default_factory=dict)

    def read(self, graph: str) -> None:
        for line in graph.splitlines():
            if found := NODE.match(line):
                title, label = found.groups()
                if frame := FRAME.search(label):
                    self.frames[title] = (int(frame[1]), frame[2])
            elif found := EDGE.match(line):
                self.callees.setdefault(found[1], set()).add(found[2])

    def order(self) -> list[str]:
        """Callees before callers; a cycle, which is a recursion, raises graphlib.CycleError."""
        return list(TopologicalSorter(self.callees).static_order())

    def depths(self) -> dict[str, int]:
        """Bytes of stack of each function with the deepest it calls; 0 for what is not here."""
        depth: dict[str, int] = {}
        for name in self.order():
            below = max((depth[callee] for callee in self.callees.get(name, ())), default=0)
            depth[name] = self.frames.get(name, (0, ""))[0] + below
        return depth | {name: size for name, (size, _) in self.frames.items() if name not in depth}

    def outside(self, roots: Iterable[str]) -> set[str]:
        """What is called, at any depth, from these but was not compiled with them."""
        seen: set[str] = set()
        todo = list(roots)
        while todo:
            name = todo.pop()
            if name not in seen:
                seen.add(name)
                todo += self.callees.get(name, set())
        return seen - self.frames.keys()


def core_of(name: str, claim: str) -> target.Core:
    """A core whose build is configured."""
    core = target.CORES[name]
    need(core.tool("gcc"), claim)
    if not (core.build / "compile_commands.json").exists():
        target.run("cmake", "--preset", core.name, cwd=ROOT)
    return core


def words_for(core: target.Core, like: Path) -> list[str]:
    """The command that compiles a source for a core, without its -c, -o and their files."""
    commands = json.loads((core.build / "compile_commands.json").read_text())
    for entry in commands:
        if Path(entry["file"]) == like:
            words = shlex.split(entry["command"])
            at, source = words.index("-o"), words.index("-c")
            drop = {at, at + 1, source, source + 1}
            return [word for i, word in enumerate(words) if i not in drop]
    pytest.fail(f"{like} is not built for {core.name}")


def compile_for(core: target.Core, files: Iterable[Path], folder: Path) -> tuple[Calls, list[Path]]:
    """Objects of these files; those that the core's build does not have go as lib/model/step_counts.c does."""
    built = {
        Path(entry["file"])
        for entry in json.loads((core.build / "compile_commands.json").read_text())
    }
    calls, objects = Calls(), []
    for file in files:
        words = words_for(core, file if file in built else ROOT / "lib/model/step_counts.c")
        made = folder / f"{core.name}_{file.stem}.o"
        more = [*static.INCLUDES, "-fstack-usage", "-fcallgraph-info=su"]
        static.clean(*words, *more, "-c", file, "-o", made, cwd=folder)
        calls.read(made.with_suffix(".ci").read_text())
        objects.append(made)
    return calls, objects


def symbols(core: target.Core, made: Path) -> tuple[set[str], set[str]]:
    """What an object needs from others, and what it keeps that can be written."""
    needed, kept = set(), set()
    for line in target.run(core.tool("nm"), made).splitlines():
        kind, name = line.split()[-2:]
        if kind == "U":
            needed.add(name)
        elif kind in "bBdDcCsS":
            kept.add(name)
    return needed, kept
