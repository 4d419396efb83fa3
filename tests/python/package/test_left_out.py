# SPDX-License-Identifier: MIT
"""Plain pytest runs the tests that need only tools/setup.sh test, and names the other folders."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

CHECK = "import a_package_that_only_checks_need\ndef test_check(): pass\n"


@pytest.fixture
def folder(root: Path, tmp_path: Path) -> Path:
    """Return a folder with our conftest.py, a test, and a check whose package is missing."""
    for name in ("conftest.py", "pytest.ini"):
        shutil.copy(root / "tests" / name, tmp_path)
    for place, text in (("python", "def test_plain(): pass\n"), ("quality", CHECK)):
        (tmp_path / place).mkdir()
        (tmp_path / place / f"test_{place}.py").write_text(text)
    return tmp_path


@pytest.mark.parametrize(
    ("words", "code", "lines"),
    [
        ((".",), 0, ["1 passed", "left out: proof, fuzz, static, quality; "]),
        ((".", "-n", "2"), 0, ["1 passed", "left out: proof, fuzz, static, quality; "]),
        (("python",), 0, ["1 passed"]),
        (("quality",), 5, ["no tests ran", "left out: quality; "]),
        ((".", "--checks"), 2, ["1 error", "a_package_that_only_checks_need"]),
        (("quality/test_quality.py",), 2, ["1 error", "a_package_that_only_checks_need"]),
    ],
)
def test_checks_are_imported_only_on_request(folder, words, code, lines):
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-c", "pytest.ini", *words],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code, done.stdout + done.stderr
    assert [line for line in lines if line not in done.stdout] == [], done.stdout
    assert ("left out: " in done.stdout) == any("left out" in line for line in lines)
