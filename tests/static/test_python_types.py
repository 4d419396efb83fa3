# SPDX-License-Identifier: MIT
"""mypy --strict accepts the Python of tools/, without a blanket ignore. The settings are in
pyproject.toml, with a reason for each package without types.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from conftest import BUILD, ROOT

TOOLS = ROOT / "tools"


def mypy(*files: Path | str) -> subprocess.CompletedProcess[str]:
    """Run mypy; its cache is in the build folder."""
    command = [sys.executable, "-m", "mypy", "--config-file", ROOT / "pyproject.toml"]
    command += ["--cache-dir", BUILD.parent / "mypy", "--no-error-summary", *files]
    return subprocess.run(
        list(map(str, command)), capture_output=True, text=True, check=False, timeout=240
    )


def test_strict() -> None:
    assert "\nstrict = true\n" in (ROOT / "pyproject.toml").read_text()
    done = mypy(TOOLS / "dahl", TOOLS / "bench", *TOOLS.glob("*.py"))
    assert done.returncode == 0, done.stdout + done.stderr


def test_what_users_copy_is_typed(tmp_path: Path) -> None:
    """The examples and the Python blocks of the pages have types, except of test functions."""
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    blocks = [
        block
        for page in pages
        for block in re.findall(r"```python\n(.*?)```", page.read_text(), re.S)
    ]
    assert len(blocks) >= 3
    files = [tmp_path / f"block_{number}.py" for number in range(len(blocks))]
    for path, block in zip(files, blocks, strict=True):
        path.write_text(block)
    done = mypy("--allow-untyped-defs", *files, *(ROOT / "examples").rglob("*.py"))
    assert done.returncode == 0, done.stdout + done.stderr
