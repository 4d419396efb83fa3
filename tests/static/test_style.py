# SPDX-License-Identifier: MIT
"""ruff, mypy --strict and shellcheck accept the Python and the scripts. Their rules, with reasons,
are in pyproject.toml.
"""

import os
import re
import sys
from pathlib import Path

import pytest
import static_tools as static
from conftest import BUILD, ROOT, need

PYTHON = [ROOT / "tools", ROOT / "tests", ROOT / "examples"]
RUFF = [sys.executable, "-m", "ruff"]
MYPY = [sys.executable, "-m", "mypy", "--no-error-summary", "--cache-dir", BUILD.parent / "mypy"]
MYPY += ["--config-file", ROOT / "pyproject.toml"]


@pytest.mark.parametrize("words", [["check"], ["format", "--check"]], ids=["rules", "format"])
def test_ruff_accepts_all_python(words: list[str]) -> None:
    status, text = static.call(*RUFF, *words, "--no-cache", *PYTHON, cwd=ROOT)
    assert status == 0, text


def test_the_types_of_tools_are_strict() -> None:
    assert "\nstrict = true\n" in (ROOT / "pyproject.toml").read_text()
    static.clean(
        *MYPY,
        ROOT / "tools/dahl",
        ROOT / "tools/bench",
        ROOT / "tools/docs",
        ROOT / "tools/release",
        ROOT / "tools/generators/amalgamate.py",
        *ROOT.glob("tools/*.py"),
    )


def test_what_users_copy_is_typed(tmp_path: Path) -> None:
    """The examples and the Python blocks of the pages have types, except of test functions."""
    text = "\n".join(page.read_text() for page in [ROOT / "README.md", *ROOT.glob("docs/*.md")])
    blocks = re.findall(r"```python\n(.*?)```", text, re.S)
    assert len(blocks) >= 3
    files = [tmp_path / f"block_{number}.py" for number in range(len(blocks))]
    for path, block in zip(files, blocks, strict=True):
        path.write_text(block)
    static.clean(*MYPY, "--allow-untyped-defs", *files, *ROOT.glob("examples/**/*.py"))


def test_shellcheck_accepts_each_script() -> None:
    """Files without permission to execute are checked with the scripts that source them."""
    scripts = [path for part in ("tools", "tests", "port") for path in ROOT.glob(f"{part}/**/*.sh")]
    programs = sorted(path for path in scripts if os.access(path, os.X_OK))
    assert len(programs) >= 10
    tool = need("shellcheck", "no common mistake in a script")
    static.clean(tool, "--check-sourced", "--external-sources", *programs, cwd=ROOT)
