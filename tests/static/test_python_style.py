# SPDX-License-Identifier: MIT
"""The Python of the project has one style: rules of ruff (complexity at most 8), format of ruff,
functions of at most 40 lines. The rules are in pyproject.toml.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

from conftest import ROOT

CONFIG = ROOT / "pyproject.toml"
LONGEST = 40  # lines of a function, from its def to its end


def sources() -> list[Path]:
    """Return all Python files of the project."""
    return sorted(
        path for part in ("tools", "tests", "examples") for path in (ROOT / part).rglob("*.py")
    )


def ruff(*words: object) -> subprocess.CompletedProcess[str]:
    command = [
        sys.executable,
        "-m",
        "ruff",
        *map(str, words),
        "--no-cache",
        "--config",
        str(CONFIG),
    ]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)


def too_long(path: Path) -> list[str]:
    """Return the functions with more than LONGEST lines."""
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
    found = (node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, kinds))
    lengths = ((node, (node.end_lineno or 0) - node.lineno + 1) for node in found)
    return [f"{path}:{node.lineno}: {n} lines" for node, n in lengths if n > LONGEST]


def test_rules() -> None:
    done = ruff("check", "--output-format", "concise", *sources())
    assert done.returncode == 0, done.stdout + done.stderr


def test_format() -> None:
    done = ruff("format", "--check", *sources())
    assert done.returncode == 0, done.stdout + done.stderr


def test_no_function_is_long() -> None:
    assert [place for path in sources() for place in too_long(path)] == []


def test_each_file_says_its_licence_and_its_idea() -> None:
    for path in sources():
        text = path.read_text()
        assert "# SPDX-License-Identifier: MIT" in text.splitlines()[:2], path  # 1: may be #!
        assert ast.get_docstring(ast.parse(text)) or path.name == "__init__.py", path
