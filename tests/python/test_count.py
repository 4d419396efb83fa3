# SPDX-License-Identifier: MIT
"""The count of tests: what is inside, and that a run which did not come to its end has failed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

UNITY = """<testsuite tests="1"><testcase name="laws"><system-out>
tests/lib/laws.c:10:test_semigroup:PASS
tests/lib/laws.c:20:test_wide:IGNORE: needs 32 bits
tests/lib/laws.c:30:test_odd:FAIL: Expected 1 Was 2
-----------------------
3 Tests 1 Failures 1 Ignored
FAIL
</system-out>{failure}</testcase></testsuite>"""
BROKEN_OFF = UNITY.replace(":FAIL: Expected 1 Was 2", ":PASS").replace("1 Failures", "0 Failures")
PYTEST = """<testsuites><testsuite tests="2">
<properties><property name="collected" value="{collected}"/></properties>
<testcase classname="test_a" name="one"/>
<testcase classname="test_a" name="two"><skipped message="no data"/></testcase>
</testsuite></testsuites>"""
TWO_WELL = '<testsuite tests="2"><testcase name="a"/><testcase name="b"/></testsuite>'


@pytest.fixture
def count(root: Path, tmp_path: Path):
    """Count these files, each (text, exit code of its run); None: no file was written."""

    def call(*runs: tuple[str | None, int], note: str = "") -> subprocess.CompletedProcess:
        words = []
        for number, (text, code) in enumerate(runs):
            path = tmp_path / f"{number}.xml"
            if text is not None:
                path.write_text(text)
            words.append(f"{path}={code}")
        command = [sys.executable, root / "tools/count_tests.py", *words, "--note", note]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    return call


def test_it_looks_inside_unity_programs(count):
    counted = count(
        (UNITY.format(failure="<failure message=''/>"), 8), (PYTEST.format(collected=2), 0)
    )
    assert counted.returncode == 1
    assert counted.stdout.splitlines() == [
        "skipped: laws.test_wide: needs 32 bits",
        "skipped: test_a.two: no data",
        "failed: laws.test_odd: Expected 1 Was 2",
        "2 passed, 1 failed, 2 skipped",
    ]


def test_all_well(count):
    counted = count((TWO_WELL, 0))
    assert (counted.returncode, counted.stdout) == (0, "2 passed, 0 failed\n")


def test_a_result_may_lie_in_a_folder_of_any_name(root, tmp_path):
    """As a checkout may: the exit code is what stands behind the last sign."""
    path = tmp_path / "a=1" / "x=y.xml"
    path.parent.mkdir()
    path.write_text(TWO_WELL)
    for code in (0, 137):
        words = [sys.executable, root / "tools/count_tests.py", f"{path}={code}"]
        counted = subprocess.run(words, capture_output=True, text=True, check=False)
        assert counted.stdout.startswith("failed: x=y.xml: " if code else "2 passed, 0 failed\n")


def test_the_note_comes_before_the_last_line(count):
    assert count((TWO_WELL, 0), note="more to run").stdout == "more to run\n2 passed, 0 failed\n"


def test_a_run_without_a_test_to_run_is_no_failure_beside_others(count):
    nothing = '<testsuites><testsuite tests="0"/></testsuites>'
    assert count((TWO_WELL, 0), (nothing, 5)).returncode == 0


@pytest.mark.parametrize("text", [None, "", "<testsuite", "no XML at all"])
def test_a_missing_empty_or_unreadable_result_is_a_failure(count, text):
    counted = count((TWO_WELL, 0), (text, 0))
    assert counted.returncode == 1
    assert counted.stdout.splitlines()[-1] == "2 passed, 1 failed"
    assert "failed: 1.xml: no results" in counted.stdout


def test_no_test_at_all_is_no_success(count):
    counted = count(("<testsuite></testsuite>", 0))
    assert counted.returncode == 1
    assert counted.stdout == "0 passed, 0 failed\n"


@pytest.mark.parametrize(
    "text", [PYTEST.format(collected=3), TWO_WELL.replace('tests="2"', 'tests="3"')]
)
def test_fewer_results_than_tests_are_a_failure(count, text):
    counted = count((text, 0))
    assert counted.returncode == 1
    assert "failed: 0.xml: only 2 of 3 tests have a result" in counted.stdout


@pytest.mark.parametrize("code", [2, 3, 4, 130, 137, 139])
def test_a_run_that_broke_off_is_a_failure_whatever_it_wrote(count, code):
    counted = count((TWO_WELL, code))
    assert counted.returncode == 1
    assert f"failed: 0.xml: the run broke off with exit code {code}" in counted.stdout


@pytest.mark.parametrize("code", [1, 8])
def test_a_run_that_says_failed_has_failed(count, code):
    counted = count((TWO_WELL, code))
    assert counted.returncode == 1
    assert counted.stdout.splitlines()[-1] == "2 passed, 1 failed"


@pytest.mark.parametrize("bad", ["<failure/>", "<error/>"])
def test_one_that_failed_is_named(count, bad):
    counted = count((TWO_WELL.replace('name="b"/>', f'name="b">{bad}</testcase>'), 1))
    assert counted.returncode == 1
    assert counted.stdout.splitlines() == ["failed: b", "1 passed, 1 failed"]


def test_a_crashed_unity_program_has_failed(count):
    counted = count((BROKEN_OFF.format(failure="<failure message='SEGFAULT'/>"), 8))
    assert counted.returncode == 1
    assert "failed: laws: ended badly" in counted.stdout


def test_pytest_here_says_how_many_tests_it_collected(root, tmp_path):
    """Otherwise a run that lost half its tests would count as whole."""
    result = tmp_path / "python.xml"
    command = [sys.executable, "-m", "pytest", "-c", root / "tests/pytest.ini", "-q"]
    command += [f"{__file__}::test_all_well", "--junitxml", result]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    assert '<property name="collected" value="1"' in result.read_text()
