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
CTEST = """<testsuite tests="1"><testcase name="sockets"><skipped message="SKIP_RETURN_CODE=77"/>
<system-out>begins\nSKIP: no CAN here\n</system-out></testcase></testsuite>"""
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


NAMED = TWO_WELL.replace('name="b"/>', 'name="b">{bad}</testcase>')
CASES = {  # files with the codes of their runs, the exit code, and what is printed
    "each kind": (
        [(UNITY.format(failure="<failure message=''/>"), 8), (PYTEST.format(collected=2), 0)]
        + [(CTEST, 0)],
        1,
        "skipped: laws.test_wide: needs 32 bits\nskipped: test_a.two: no data\n"
        "skipped: sockets: SKIP: no CAN here\nfailed: laws.test_odd: Expected 1 Was 2\n"
        "2 passed, 1 failed, 3 skipped\n",
    ),
    "all well": ([(TWO_WELL, 0)], 0, "2 passed, 0 failed\n"),
    "nothing to run beside others": (
        [(TWO_WELL, 0), ('<testsuites><testsuite tests="0"/></testsuites>', 5)],
        0,
        "2 passed, 0 failed\n",
    ),
    "no test at all": ([("<testsuite></testsuite>", 0)], 1, "0 passed, 0 failed\n"),
    "a failure": ([(NAMED.format(bad="<failure/>"), 1)], 1, "failed: b\n1 passed, 1 failed\n"),
    "an error": ([(NAMED.format(bad="<error/>"), 1)], 1, "failed: b\n1 passed, 1 failed\n"),
    "a crash at the end of a Unity program": (
        [(BROKEN_OFF.format(failure="<failure message='SEGFAULT'/>"), 8)],
        1,
        "skipped: laws.test_wide: needs 32 bits\nfailed: laws: ended badly\n"
        "2 passed, 1 failed, 1 skipped\n",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_what_is_counted_and_named(count, case):
    runs, code, said = CASES[case]
    counted = count(*runs)
    assert (counted.returncode, counted.stdout) == (code, said)
    *before, total = said.splitlines(keepends=True)
    assert count(*runs, note="more to run").stdout == "".join([*before, "more to run\n", total])


BROKEN = [(text, 0, "no results") for text in (None, "", "<testsuite", "no XML at all")]
BROKEN += [
    (text, 0, "only 2 of 3 tests have a result")
    for text in (PYTEST.format(collected=3), TWO_WELL.replace('tests="2"', 'tests="3"'))
]
BROKEN += [
    (TWO_WELL, code, f"the run broke off with exit code {code}")
    for code in (2, 3, 4, 130, 137, 139)
]
BROKEN += [(TWO_WELL, code, f"exit code {code}, and yet no test in it failed") for code in (1, 8)]


@pytest.mark.parametrize(("text", "code", "why"), BROKEN)
def test_a_run_that_did_not_come_to_its_end_has_failed(count, text, code, why):
    """Whatever it wrote, and beside one that did."""
    counted = count((TWO_WELL, 0), (text, code))
    assert counted.returncode == 1
    assert f"failed: 1.xml: {why}" in counted.stdout and " 1 failed" in counted.stdout


def test_a_result_may_lie_in_a_folder_of_any_name(root, tmp_path):
    """As a checkout may: the exit code is what stands behind the last sign."""
    path = tmp_path / "a=1" / "x=y.xml"
    path.parent.mkdir()
    path.write_text(TWO_WELL)
    for code in (0, 137):
        words = [sys.executable, root / "tools/count_tests.py", f"{path}={code}"]
        counted = subprocess.run(words, capture_output=True, text=True, check=False)
        assert counted.stdout.startswith("failed: x=y.xml: " if code else "2 passed, 0 failed\n")


def test_pytest_here_says_how_many_tests_it_collected(root, tmp_path):
    """Otherwise a run that lost half its tests would count as whole."""
    result = tmp_path / "python.xml"
    command = [sys.executable, "-m", "pytest", "-c", root / "tests/pytest.ini", "-q"]
    command += [f"{__file__}::test_what_is_counted_and_named[all well]", "--junitxml", result]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    assert '<property name="collected" value="1"' in result.read_text()
