# SPDX-License-Identifier: MIT
"""A module of the package imports from its layer and those below, and imports form no circle."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import dahl

PACKAGE = Path(dahl.__file__).parent
LAYERS = (  # docs/architecture.md; each layer may import from itself and the earlier ones
    {"errors", "facts", "version"},
    {"dependencies", "interrupt", "paths"},
    {"binding"},
    {"can", "io"},
    {"sim", "simulators", "target"},
    {"report"},
    {"identify"},
    {"commands"},
    {"cli"},
    {"__main__", "bus", "codec", "jax", "mujoco", "node", "pytest_plugin"},  # names for users
)
FILES = {
    ".".join(("dahl", *path.relative_to(PACKAGE).with_suffix("").parts)): path
    for path in PACKAGE.rglob("*.py")
    if path.name != "__init__.py"
}
WALK = "models samples lags laws fit start select diagnose simulate result estimate export report"


def imported(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {one.name for one in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {f"{node.module}.{one.name}" for one in node.names} | {str(node.module)}
    return names


GRAPH = {name: imported(path) & FILES.keys() for name, path in FILES.items()}


def layer(module: str) -> int:
    return next(n for n, rooms in enumerate(LAYERS) if module.split(".")[1] in rooms)


def test_no_module_imports_from_a_layer_above_or_in_a_circle():
    assert sum(map(len, GRAPH.values())) > 50
    TopologicalSorter(GRAPH).prepare()  # raises CycleError with the circle
    pairs = [(user, used) for user, uses in GRAPH.items() for used in uses]
    assert [pair for pair in pairs if layer(pair[0]) < layer(pair[1])] == []


def test_the_walk_of_an_identification_goes_one_way():
    order = [f"dahl.identify.{name}" for name in WALK.split()]
    later = {(user, used) for k, user in enumerate(order) for used in GRAPH[user] & {*order[k:]}}
    assert later == set()
