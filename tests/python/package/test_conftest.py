# SPDX-License-Identifier: MIT
"""tests/conftest.py: plain pytest runs the tests that need only tools/setup.sh test and names the
other folders. It records the number of collected tests for tools/count_tests.py.
"""

from __future__ import annotations

import shutil
import subprocess
import sys

import pytest

CHECK = "import a_package_that_only_checks_need\ndef test_check(): pass\n"
LEFT_OUT = "left out: proof, fuzz, static, quality, mujoco; "


@pytest.mark.parametrize(
    ("words", "code", "lines"),
    [
        ((".", "-n", "2", "--junitxml", "result.xml"), 0, ["1 passed", LEFT_OUT]),
        (("python",), 0, ["1 passed"]),
        ((".", "--checks"), 2, ["1 error", "a_package_that_only_checks_need"]),
    ],
)
def test_checks_are_imported_only_on_request(root, tmp_path, words, code, lines):
    """In a folder with our conftest.py, a test, and a check whose package is missing."""
    for name in ("conftest.py", "pytest.ini"):
        shutil.copy(root / "tests" / name, tmp_path)
    for place, text in (("python", "def test_plain(): pass\n"), ("quality", CHECK)):
        (tmp_path / place).mkdir()
        (tmp_path / place / f"test_{place}.py").write_text(text)
    command = [sys.executable, "-m", "pytest", "-c", "pytest.ini", *words]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == code, done.stdout + done.stderr
    assert [line for line in lines if line not in done.stdout] == [], done.stdout
    assert ("left out: " in done.stdout) == (LEFT_OUT in lines)
    if "--junitxml" in words:
        result = (tmp_path / "result.xml").read_text()
        assert '<property name="collected" value="1"' in result
