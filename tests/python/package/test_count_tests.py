# SPDX-License-Identifier: MIT
"""tools/count_tests.py: its totals and names, and that an incomplete run has failed."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import pytest
from conftest import ROOT

UNITY = """<testsuite tests="1"><testcase name="laws"><system-out>
tests/lib/laws.c:10:test_semigroup:PASS
tests/lib/laws.c:20:test_wide:IGNORE: needs 32 bits
tests/lib/laws.c:30:test_odd:FAIL: Expected 1 Was 2
-----------------------
3 Tests 1 Failures 1 Ignored
FAIL
</system-out>{failure}</testcase></testsuite>"""
PYTEST = """<testsuites><testsuite tests="2">
<properties><property name="collected" value="{collected}"/></properties>
<testcase classname="test_a" name="one"/>
<testcase classname="test_a" name="two"><skipped message="no data"/></testcase>
</testsuite></testsuites>"""
CRASHED = UNITY.replace(":FAIL: Expected 1 Was 2", ":PASS").replace("1 Failures", "0 Failures")
CTEST = """<testsuite tests="1"><testcase name="sockets"><skipped message="SKIP_RETURN_CODE=77"/>
<system-out>begins\nSKIP: no CAN here\n</system-out></testcase></testsuite>"""
TWO_WELL = '<testsuite tests="2"><testcase name="a"/><testcase name="b"/></testsuite>'


@pytest.fixture
def count(tmp_path: Path, monkeypatch, capsys):
    """Count files, each (text or None for no file, exit code of its run); return exit code and
    output.
    """

    def call(*runs: tuple[str | None, int], note: str = "") -> tuple[int, str]:
        (tmp_path / "a=1").mkdir(exist_ok=True)  # the exit code follows the last =
        words = []
        for number, (text, code) in enumerate(runs):
            path = tmp_path / "a=1" / f"{number}.xml"
            path.unlink(missing_ok=True)
            if text is not None:
                path.write_text(text)
            words.append(f"{path}={code}")
        monkeypatch.setattr(sys, "argv", ["count_tests.py", *words, "--note", note])
        with pytest.raises(SystemExit) as end:
            runpy.run_path(str(ROOT / "tools/count_tests.py"), run_name="__main__")
        return end.value.code, capsys.readouterr().out

    return call


SUITE = PYTEST.format(collected=2).removeprefix("<testsuites>").removesuffix("</testsuites>")
TWO_SUITES = f"<testsuites>{SUITE}{SUITE}</testsuites>"
NAMED = TWO_WELL.replace('name="b"/>', 'name="b">{bad}</testcase>')
CASES = {  # files with the codes of their runs, the exit code, and the output
    "each kind": (
        [(UNITY.format(failure="<failure message=''/>"), 8), (PYTEST.format(collected=2), 0)]
        + [(CTEST, 0)],
        1,
        "skipped: laws.test_wide: needs 32 bits\nskipped: test_a.two: no data\n"
        "skipped: sockets: SKIP: no CAN here\nfailed: laws.test_odd: Expected 1 Was 2\n"
        "2 passed, 1 failed, 3 skipped\n",
    ),
    "all well": ([(TWO_WELL, 0)], 0, "2 passed, 0 failed\n"),
    "a run that broke off after one with a failure": (
        [(NAMED.format(bad="<failure/>"), 1), (TWO_WELL, 8)],
        1,
        "failed: b\nfailed: 1.xml: exit code 8, and yet no test in it failed\n3 passed, 2 failed\n",
    ),
    "two suites with the number of collected tests": (
        [(TWO_SUITES, 0)],
        0,
        2 * "skipped: test_a.two: no data\n" + "2 passed, 0 failed, 2 skipped\n",
    ),
    "an error": ([(NAMED.format(bad="<error/>"), 1)], 1, "failed: b\n1 passed, 1 failed\n"),
    "a crash at the end of a Unity program": (
        [(CRASHED.format(failure="<failure message='SEGFAULT'/>"), 8)],
        1,
        "skipped: laws.test_wide: needs 32 bits\nfailed: laws: ended badly\n"
        "2 passed, 1 failed, 1 skipped\n",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_totals_and_names_of_tests(count, case):
    runs, code, said = CASES[case]
    assert count(*runs) == (code, said)
    *before, total = said.splitlines(keepends=True)
    assert count(*runs, note="more to run")[1] == "".join([*before, "more to run\n", total])


PYTEST_OF_3, CTEST_OF_3 = PYTEST.format(collected=3), TWO_WELL.replace('tests="2"', 'tests="3"')
BROKEN = [
    *((text, 0, "no results") for text in (None, "", "<testsuite", "no XML at all")),
    *((text, 0, "only 2 of 3 tests have a result") for text in (PYTEST_OF_3, CTEST_OF_3)),
    (TWO_SUITES.replace('value="2"', 'value="3"', 1), 0, "only 4 of 5 tests have"),
    *((TWO_WELL, code, f"the run broke off with exit code {code}") for code in (2, 4, 130, 139)),
    *((TWO_WELL, code, f"exit code {code}, and yet no test in it failed") for code in (1, 8)),
]


@pytest.mark.parametrize("place", [0, 1])
@pytest.mark.parametrize(("text", "code", "why"), BROKEN)
def test_an_incomplete_run_has_failed(count, text, code, why, place):
    runs = [(TWO_WELL, 0)]
    runs.insert(place, (text, code))
    exit_code, output = count(*runs)
    assert exit_code == 1
    assert f"failed: {place}.xml: {why}" in output and " 1 failed" in output
