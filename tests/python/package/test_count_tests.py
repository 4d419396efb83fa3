# SPDX-License-Identifier: MIT
"""tools/count_tests.py: its totals and names, and that an incomplete run has failed."""

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
</system-out><failure message='SEGFAULT'/></testcase></testsuite>"""
CRASHED = UNITY.replace(":FAIL: Expected 1 Was 2", ":PASS").replace("1 Failures", "0 Failures")
SUITE = """<testsuite tests="2">
<properties><property name="collected" value="2"/></properties>
<testcase classname="test_a" name="one"/>
<testcase classname="test_a" name="two"><skipped message="no data"/></testcase></testsuite>"""
TWO_SUITES = f"<testsuites>{SUITE}{SUITE}</testsuites>"
CTEST = """<testsuite tests="1"><testcase name="sockets"><skipped message="SKIP_RETURN_CODE=77"/>
<system-out>begins\n\nsearches\nSKIP: no CAN here\n</system-out></testcase></testsuite>"""
TWO_WELL = '<testsuite tests="2"><testcase name="a"/><testcase name="b"/></testsuite>'
BAD = TWO_WELL.replace('name="b"/>', 'name="b"><{}/></testcase>')
SKIPPED = "skipped: test_a.two: no data\n"
CASES = [  # files with the codes of their runs, the output
    ([(TWO_WELL, 0)], "2 passed, 0 failed\n"),
    ([(TWO_SUITES, 0)], f"{2 * SKIPPED}2 passed, 0 failed, 2 skipped\n"),
    ([(BAD.format("error"), 1)], "failed: b\n1 passed, 1 failed\n"),
    (
        [(UNITY, 8), (SUITE, 0), (CTEST, 0)],
        f"skipped: laws.test_wide: needs 32 bits\n{SKIPPED}skipped: sockets: SKIP: no CAN here\n"
        "failed: laws.test_odd: Expected 1 Was 2\n2 passed, 1 failed, 3 skipped\n",
    ),
    (
        [(CRASHED, 8)],
        "skipped: laws.test_wide: needs 32 bits\nfailed: laws: ended badly\n"
        "2 passed, 1 failed, 1 skipped\n",
    ),
    (
        [(BAD.format("failure"), 1), (TWO_WELL, 8)],
        "failed: b\nfailed: 1.xml: exit code 8, and yet no test in it failed\n3 passed, 2 failed\n",
    ),
]
BROKEN = [  # a file (None: it is missing), the code of its run, the reason
    *((text, 0, "no results") for text in (None, "", "<testsuite")),
    (TWO_WELL.replace('"2"', '"3"'), 0, "only 2 of 3 tests have a result"),
    (TWO_SUITES.replace('value="2"', 'value="3"', 1), 0, "only 4 of 5 tests have"),
    *((TWO_WELL, code, f"the run broke off with exit code {code}") for code in (2, 139)),
]


@pytest.fixture
def count(tmp_path: Path, monkeypatch, capsys):
    """Count files, each (text, exit code of its run); return exit code and output."""

    def call(*runs: tuple[str | None, int], note: str = "") -> tuple[int, str]:
        words = []
        for number, (text, code) in enumerate(runs):
            path = tmp_path / "a=1" / f"{number}.xml"  # the exit code follows the last =
            path.parent.mkdir(exist_ok=True)
            if text is not None:
                path.write_text(text)
            words.append(f"{path}={code}")
        monkeypatch.setattr(sys, "argv", ["count_tests.py", *words, "--note", note])
        with pytest.raises(SystemExit) as end:
            runpy.run_path(str(ROOT / "tools/count_tests.py"), run_name="__main__")
        return end.value.code, capsys.readouterr().out

    return call


@pytest.mark.parametrize(("runs", "said"), CASES)
def test_totals_and_names_of_tests(count, runs, said):
    *before, total = said.splitlines(keepends=True)
    assert count(*runs, note="more to run") == (
        int(", 0 failed" not in total),
        "".join([*before, "more to run\n", total]),
    )


@pytest.mark.parametrize(("text", "code", "why"), BROKEN)
def test_an_incomplete_run_has_failed(count, text, code, why):
    exit_code, output = count((text, code), (TWO_WELL, 0))
    assert exit_code == 1
    assert f"failed: 0.xml: {why}" in output and " 1 failed" in output
