# SPDX-License-Identifier: MIT
"""Insert small faults into the C sources, one at a time, and run the C tests. All of them run for
hours.

    build/venv/bin/python tests/quality/mutants.py [--function dahl_prepare] [--sample 50]

tree-sitter finds the places. A mutant is compiled into a shared library (lib, codec, line reader,
receiver). The test programs are built once and run with it until one fails. Each survivor is
printed. A reader must judge if it is a hole in the tests or means the same; survivors.toml lists
the judged functions with the reason.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import random
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import Queue

import tree_sitter
import tree_sitter_c

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import sources  # noqa: E402
from sources import ROOT, with_main  # noqa: E402

PARSER = tree_sitter.Parser(tree_sitter.Language(tree_sitter_c.language()))
LIST = Path(__file__).with_name("survivors.toml")
UNITY = ROOT / "build/deps/unity"
UNITS = [*sources.ALL, *sorted(ROOT.glob("lib/node/*.c")), ROOT / "port/slcan/slcan.c"]
HEADERS = [path for path in sources.LIB.rglob("*.h") if path.parent.name != "include"]
FLAGS = ["-std=c99", "-w", "-O1", "-DUNITY_INCLUDE_DOUBLE", "-DTEST_TICKS=20000"]
FLAGS += ["-DTEST_KERNEL_STRIDE=65537u", "-DTEST_FINEST_BITS=20"]
FOLDERS = ("lib", "node")
TESTS = ["port/test_slcan"]
TESTS += [
    f"{part}/{p.stem}" for part in FOLDERS for p in sorted(ROOT.glob(f"tests/{part}/test_*.c"))
]
SECONDS = 60  # of a test program; more is an endless loop

BINARY = {
    "<": "<= >=", "<=": "< >", ">": ">= <=", ">=": "> <", "==": "!=", "!=": "==",
    "+": "-", "-": "+", "*": "+", "/": "*", "%": "/", "&": "|", "|": "&", "^": "&",
    "<<": ">>", ">>": "<<", "&&": "||", "||": "&&",
}  # fmt: skip
CLOSED = {"gnu_asm_expression", "sizeof_expression", "comment", "preproc_include", "preproc_if"}


@dataclass(frozen=True)
class Mutant:
    """Replace bytes start..end of a file by `text`."""

    file: Path
    function: str
    line: int
    start: int
    end: int
    text: str

    def __str__(self) -> str:
        old = self.file.read_bytes()[self.start : self.end].decode()
        place = f"{self.file.relative_to(ROOT)}:{self.line}"
        return f"{place} {self.function}: {' '.join(old.split())} -> {self.text}"


def text_of(node: tree_sitter.Node | None) -> str:
    return (node.text or b"").decode() if node is not None else ""


def numbers(text: str) -> list[str]:
    digits = text.rstrip("uUlL")
    try:
        value = int(digits, 0)
    except ValueError:
        return []
    return [f"{other}{text[len(digits) :]}" for other in (value + 1, value - 1) if other >= 0]


Change = tuple[tree_sitter.Node, str]


def of_operator(node: tree_sitter.Node) -> Iterator[Change]:
    sign = node.child_by_field_name("operator")
    for other in BINARY.get(text_of(sign), "").split():
        yield sign, other


def of_assignment(node: tree_sitter.Node) -> Iterator[Change]:
    sign = node.child_by_field_name("operator")
    if text_of(sign) != "=":
        yield sign, "="


def of_sign(node: tree_sitter.Node) -> Iterator[Change]:
    if text_of(node.child_by_field_name("operator")) in ("-", "~", "!"):
        yield node, text_of(node.child_by_field_name("argument"))


def of_condition(node: tree_sitter.Node) -> Iterator[Change]:
    condition = node.child_by_field_name("condition")
    yield from ((condition, word) for word in ("(1)", "(0)"))


CHANGES: dict[str, Callable[[tree_sitter.Node], Iterable[Change]]] = {
    "binary_expression": of_operator,
    "assignment_expression": of_assignment,
    "unary_expression": of_sign,
    "if_statement": of_condition,
    "conditional_expression": of_condition,
    "expression_statement": lambda node: [(node, ";")],
    "number_literal": lambda node: [(node, other) for other in numbers(text_of(node))],
}


def name_of(node: tree_sitter.Node) -> str:
    while node.type != "identifier":
        inner = node.child_by_field_name("declarator")
        if inner is None:
            return "?"
        node = inner
    return text_of(node)


def walk(node: tree_sitter.Node, file: Path, function: str) -> Iterator[Mutant]:
    if node.type in CLOSED:
        return
    if node.type == "function_definition":
        function = name_of(node)
    for part, text in CHANGES[node.type](node) if node.type in CHANGES else ():
        line = part.start_point[0] + 1
        yield Mutant(file, function or "table", line, part.start_byte, part.end_byte, text)
    for child in node.children:
        yield from walk(child, file, function)


def mutants() -> list[Mutant]:
    """Return the mutants of all units and private headers, except behind a compiler macro."""
    files = [*UNITS, *HEADERS]
    return [m for file in files for m in walk(PARSER.parse(file.read_bytes()).root_node, file, "")]


class Bench:
    """A copy of the sources, the test programs, and the library that they load."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for part in ("lib", "port", "host_sim", "tests"):
            shutil.copytree(ROOT / part, folder / part)
        self.includes = [f"-I{folder / path.relative_to(ROOT)}" for path in sources.FOLDERS]
        self.includes += [f"-I{folder}/tests/{part}" for part in ("", *FOLDERS)] + [f"-I{UNITY}"]
        self.original = self.library()
        assert self.original is not None, "the sources do not compile"
        self.programs = [self.program(name) for name in TESTS]
        assert not self.notices(), "a test fails on the sources as they are"

    def library(self) -> str | None:
        """Compile it. Return its digest, or None if it does not compile."""
        target = self.folder / "libunder_test.so"
        units = [self.folder / unit.relative_to(ROOT) for unit in UNITS]
        command = ["gcc", *FLAGS, "-shared", "-fPIC", *self.includes, *units, "-o", target]
        if subprocess.run(command, capture_output=True, check=False).returncode:
            return None
        return hashlib.sha256(target.read_bytes()).hexdigest()

    def program(self, name: str) -> Path:
        target = self.folder / Path(name).name
        main = [with_main(self.folder / "tests" / f"{name}.c", self.folder), UNITY / "unity.c"]
        command = ["gcc", *FLAGS, *self.includes, *main, f"-L{self.folder}", "-lunder_test"]
        subprocess.run([*command, "-lm", f"-Wl,-rpath,{self.folder}", "-o", target], check=True)
        return target

    def notices(self, source: str = "") -> bool:
        for program in sorted(self.programs, key=lambda each: source not in each.name):
            try:
                done = subprocess.run([program], capture_output=True, timeout=SECONDS, check=False)
            except subprocess.TimeoutExpired:
                return True
            if done.returncode:
                return True
        return False

    def lives(self, mutant: Mutant) -> bool:
        """Return whether a mutant compiles to other code and passes all tests."""
        path = self.folder / mutant.file.relative_to(ROOT)
        before = path.read_bytes()
        path.write_bytes(before[: mutant.start] + mutant.text.encode() + before[mutant.end :])
        try:
            made = self.library()
            return made not in (None, self.original) and not self.notices(mutant.file.stem)
        finally:
            path.write_bytes(before)


def survivors(chosen: Iterable[Mutant], jobs: int = os.cpu_count() or 1) -> list[Mutant]:
    """Return the chosen mutants that pass all tests and are in no judged function."""
    reviewed = tomllib.loads(LIST.read_text())
    with tempfile.TemporaryDirectory(prefix="dahl-mutants-") as folder:
        benches: Queue[Bench] = Queue()
        for number in range(jobs):
            benches.put(Bench(Path(folder) / str(number)))

        def judge(mutant: Mutant) -> bool:
            bench = benches.get()
            try:
                return bench.lives(mutant)
            finally:
                benches.put(bench)

        wanted = [mutant for mutant in chosen if mutant.function not in reviewed]
        with ThreadPoolExecutor(jobs) as pool:
            fates = zip(wanted, pool.map(judge, wanted), strict=True)
            return [mutant for mutant, lives in fates if lives]


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--function", help="those of one function")
    parser.add_argument("--sample", type=int, help="so many, the same each time")
    options = parser.parse_args()
    chosen = [m for m in mutants() if options.function in (None, m.function)]
    if options.sample:
        chosen = random.Random(1).sample(chosen, min(options.sample, len(chosen)))
    alive = survivors(chosen)
    for mutant in alive:
        print(f"alive: {mutant}")
    print(f"{len(alive)} of {len(chosen)} alive")
    return 1 if alive else 0


if __name__ == "__main__":
    sys.exit(main())
