# SPDX-License-Identifier: MIT
"""The scripts: a second set-up is quick and says what it found; the count of tests is right."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest

UNITY = """<testsuite><testcase name="laws"><system-out>
tests/lib/laws.c:10:test_semigroup:PASS
tests/lib/laws.c:20:test_wide:IGNORE: needs 32 bits
tests/lib/laws.c:30:test_odd:FAIL: Expected 1 Was 2
-----------------------
3 Tests 1 Failures 1 Ignored
FAIL
</system-out>{failure}</testcase></testsuite>"""
PYTEST = """<testsuites><testsuite><testcase classname="test_a" name="one"/>
<testcase classname="test_a" name="two"><skipped message="no data"/>
</testcase></testsuite></testsuites>"""


def run(*command, **kwargs) -> subprocess.CompletedProcess:
    return subprocess.run(
        list(map(str, command)),
        capture_output=True,
        text=True,
        timeout=250,
        check=False,
        stdin=subprocess.DEVNULL,
        **kwargs,
    )


def needs_setup(root):
    """Setting up anew would take away the environment that this test runs in."""
    stamp = root / "build" / "venv" / ".complete"
    pins = (root / "tools" / name for name in ("requirements.txt", "constraints.txt"))
    if not stamp.exists() or any(pin.stat().st_mtime > stamp.stat().st_mtime for pin in pins):
        pytest.fail("build/venv is not whole or not up to date; run tools/setup.sh")


def test_second_setup_is_quick_and_says_what_it_found(root):
    needs_setup(root)
    start = time.monotonic()
    done = run(root / "tools" / "setup.sh")
    took = time.monotonic() - start
    assert done.returncode == 0, done.stderr
    assert took < 2
    lines = done.stdout.splitlines()
    assert all(line.startswith("setup: ") for line in lines)
    assert "setup: Python environment: in place (build/venv)" in lines
    assert lines[-1].startswith("setup: done in ")


@pytest.mark.parametrize("script", ["setup", "test", "demo"])
def test_help_is_given_without_doing_anything(root, script):
    shown = run(root / "tools" / f"{script}.sh", "--help")
    assert shown.returncode == 0
    assert shown.stdout.startswith(f"Usage: tools/{script}.sh")


def test_setup_refuses_what_it_does_not_know(root):
    done = run(root / "tools" / "setup.sh", "--fast")
    assert done.returncode == 1
    assert done.stderr == "error: setup.sh takes no argument '--fast' (see --help)\n"


def count(root, tmp_path, *texts) -> subprocess.CompletedProcess:
    files = []
    for number, text in enumerate(texts):
        files.append(tmp_path / f"{number}.xml")
        if text is not None:
            files[-1].write_text(text)
    return run(sys.executable, root / "tools" / "count_tests.py", *files)


def test_count_looks_inside_unity_programs(root, tmp_path):
    counted = count(root, tmp_path, UNITY.format(failure="<failure message=''/>"), PYTEST)
    assert counted.returncode == 1
    assert counted.stdout.splitlines() == [
        "skipped: laws.test_wide: needs 32 bits",
        "skipped: test_a.two: no data",
        "failed: laws.test_odd: Expected 1 Was 2",
        "2 passed, 1 failed, 2 skipped",
    ]


def test_count_of_all_well(root, tmp_path):
    counted = count(
        root, tmp_path, '<testsuite><testcase name="a"/><testcase name="b"/></testsuite>'
    )
    assert (counted.returncode, counted.stdout) == (0, "2 passed, 0 failed\n")


@pytest.mark.parametrize("text", [None, "", "<testsuite></testsuite>"])
def test_no_results_are_no_success(root, tmp_path, text):
    counted = count(root, tmp_path, text)
    assert counted.returncode == 1
    assert counted.stdout.splitlines()[-1].startswith("0 passed, ")


def test_a_crashed_unity_program_has_failed(root, tmp_path):
    text = (
        UNITY.replace(":FAIL: Expected 1 Was 2", ":PASS")
        .replace("1 Failures", "0 Failures")
        .format(failure="<failure message='SEGFAULT'/>")
    )
    counted = count(root, tmp_path, text)
    assert counted.returncode == 1
    assert "failed: laws: ended badly" in counted.stdout
