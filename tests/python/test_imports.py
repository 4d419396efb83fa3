# SPDX-License-Identifier: MIT
"""Modules of the package use each other in one direction: what a module needs can be read and
changed without it.
"""

from __future__ import annotations

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import dahl

PACKAGE = Path(dahl.__file__).parent


def imported(path: Path) -> set[str]:
    """Full names of all that a module imports, also for types alone or inside a function."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {one.name for one in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {f"{node.module}.{one.name}" for one in node.names} | {str(node.module)}
    return names


def test_no_circle_among_the_modules():
    files = {
        ".".join(("dahl", *path.relative_to(PACKAGE).with_suffix("").parts)): path
        for path in PACKAGE.rglob("*.py")
        if path.name != "__init__.py"
    }
    graph = {name: imported(path) & files.keys() for name, path in files.items()}
    assert sum(map(len, graph.values())) > 50
    TopologicalSorter(graph).prepare()  # raises CycleError with the circle
