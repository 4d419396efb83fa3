# SPDX-License-Identifier: MIT
"""The count of tests: whatever did not pass is a failure, by name."""

from __future__ import annotations

import subprocess
import sys

import pytest

WELL = '<testsuite><testcase classname="t" name="a"/></testsuite>'


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (None, "1 passed, 1 failed"),  # a runner that never wrote its results
        ("<testsuite><testcase", "1 passed, 1 failed"),  # one that was killed while it did
        (WELL.replace("/></", "><error/></testcase></"), "1 passed, 1 failed"),
        (WELL.replace("/></", "><failure/></testcase></"), "1 passed, 1 failed"),
        (WELL.replace("/></", '><skipped message="no"/></testcase></'), "1 passed, 0 failed, 1 sk"),
        (WELL, "2 passed, 0 failed"),
    ],
)
def test_one_bad_file_beside_a_good_one(root, tmp_path, text, line):
    (tmp_path / "good.xml").write_text(WELL)
    if text is not None:
        (tmp_path / "other.xml").write_text(text)
    script = root / "tools" / "count_tests.py"
    done = subprocess.run(
        [sys.executable, script, tmp_path / "good.xml", tmp_path / "other.xml"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.splitlines()[-1].startswith(line)
    assert done.returncode == (1 if "1 failed" in line else 0)
