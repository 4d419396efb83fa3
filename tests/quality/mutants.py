# SPDX-License-Identifier: MIT
"""Insert small faults into the C sources, one at a time, and run the C tests until one fails. All
of them run for days.

    build/venv/bin/python tests/quality/mutants.py [--function dahl_prepare] [--sample 50]

tree-sitter finds the places. Each survivor is printed. A reader must judge if it is a hole in the
tests or means the same.
"""

from __future__ import annotations

import argparse
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import tree_sitter
import tree_sitter_c

ROOT = Path(__file__).resolve().parents[2]
PARSER = tree_sitter.Parser(tree_sitter.Language(tree_sitter_c.language()))
FILES = sorted(path for path in ROOT.glob("lib/*/*.[ch]") if path.parent.name != "include")
FILES.append(ROOT / "port/slcan/slcan.c")
OPTIONS = [f"-DDAHL_BUILD_{part}=ON" for part in ("FLOAT", "BATCH", "NODE", "PORT", "TESTS")]
OPTIONS.append("-DCMAKE_C_FLAGS=-w -O1 -DTEST_TICKS=20000 -DTEST_KERNEL_STRIDE=65537u")
CORE = ("arith", "model", "parts", "compensator")  # folders of libdahl.a
TESTS = ["--label-exclude", "^(checks|long|soak)$", "--stop-on-failure", "--timeout", "60"]

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
    """Return the mutants of all sources and private headers, except behind a compiler macro."""
    return [m for file in FILES for m in walk(PARSER.parse(file.read_bytes()).root_node, file, "")]


def passes(*command: object) -> bool:
    return not subprocess.run([*map(str, command)], capture_output=True, check=False).returncode


def survivors(chosen: Iterable[Mutant]) -> list[Mutant]:
    """Return the mutants that compile to another library and pass all tests."""
    with tempfile.TemporaryDirectory(prefix="dahl-mutants-") as name:
        copy, build = Path(name) / "dahl", Path(name) / "build"
        shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".git", "build"))
        (copy / "build").mkdir()
        (copy / "build/deps").symlink_to(ROOT / "build/deps")
        assert passes("cmake", "-G", "Ninja", "-S", copy, "-B", build, *OPTIONS)

        def builds_and_passes() -> bool:
            return passes("ninja", "-C", build) and passes("ctest", "--test-dir", build, *TESTS)

        assert builds_and_passes(), "a test fails on the sources as they are"
        original = (build / "lib/libdahl.a").read_bytes()

        def lives(mutant: Mutant) -> bool:
            path = copy / mutant.file.relative_to(ROOT)
            before = path.read_bytes()
            path.write_bytes(before[: mutant.start] + mutant.text.encode() + before[mutant.end :])
            try:
                is_same = (
                    path.parent.name in CORE
                    and passes("ninja", "-C", build)
                    and (build / "lib/libdahl.a").read_bytes() == original
                )
                return not is_same and builds_and_passes()
            finally:
                path.write_bytes(before)

        return [mutant for mutant in chosen if lives(mutant)]


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
