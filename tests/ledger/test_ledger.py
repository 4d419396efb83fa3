# SPDX-License-Identifier: MIT
"""Every claim has a command, and the command was green; every sentence belongs to a claim.

Runs last, so that it sees what this run's tests said. With --full all of them have run: then the
ledger is written.
"""

from __future__ import annotations

import dataclasses

import ledger
import outcomes
import pytest
import sentences
import versions
from conftest import ROOT

LEAST_PLANTED = 30


@pytest.fixture(scope="module")
def book() -> ledger.Book:
    return ledger.Book.read()


@pytest.fixture(scope="module")
def known() -> dict[str, str]:
    return ledger.all_tests()


@pytest.fixture(scope="module")
def ran() -> dict[str, outcomes.Result]:
    return outcomes.last_run(ROOT / "build")


@pytest.fixture(scope="module")
def rows(book, known, ran) -> list[ledger.Row]:
    return [ledger.row_of(claim, known, ran) for claim in book.claims]


def unaccounted(book: ledger.Book, said: list[str]) -> list[str]:
    return [s for s in said if s not in set(book.sentences())]


def without_test(book: ledger.Book, known: dict[str, str]) -> list[str]:
    return [
        f"{claim.id}: {check}"
        for claim in book.claims
        for check in claim.checks
        if not any(ledger.matches(check, name) for name in known)
    ]


def not_green(states: dict[str, str]) -> dict[str, str]:
    return {claim: state for claim, state in states.items() if state != outcomes.GREEN}


def test_every_sentence_is_accounted_for(book):
    said = list(sentences.all_sentences())
    assert len(said) > 150
    assert unaccounted(book, said) == []


def test_nothing_is_accounted_for_that_nobody_says(book):
    said = book.sentences()
    assert [s for s in said if s not in sentences.all_sentences()] == []
    assert len(said) == len(set(said))


def test_every_check_names_a_test(book, known):
    assert without_test(book, known) == []


def test_the_command_of_a_row_runs_its_tests(rows):
    for row in rows:
        assert row.commands, row.claim.id


def test_nothing_that_ran_now_speaks_against_a_claim(rows):
    assert [row.claim.id for row in rows if row.result == outcomes.RED] == []


@pytest.mark.long
def test_full_run_shows_every_claim(rows, ran):
    """The page is written first, so that it shows what is red, too."""
    ledger.write(rows, ran)
    assert not_green({row.claim.id: row.result for row in rows}) == {}


def test_the_page_says_green_for_every_claim(book):
    """Or says that it is open, where claims.toml says so: --full is red until none is."""
    recorded = ledger.recorded()
    for claim in book.claims:
        said = recorded.get(claim.claim, "no row")
        if claim.open:
            assert said == ledger.OPEN + claim.open
        else:
            assert said in (outcomes.GREEN, ledger.SHORT), claim.id


def test_enough_faults_are_planted(known):
    assert len([name for name in known if ledger.is_planted(name)]) >= LEAST_PLANTED


def test_planted_sentence_that_no_claim_covers(book):
    said = [*sentences.all_sentences(), "It is faster than light."]
    assert unaccounted(book, said) == ["It is faster than light."]


def test_planted_claim_without_a_test(book, known):
    claim = dataclasses.replace(book.claims[0], checks=["test_that_is_not_there"])
    lone = dataclasses.replace(book, claims=[claim])
    assert without_test(lone, known) == [f"{claim.id}: test_that_is_not_there"]


@pytest.mark.parametrize("state", [outcomes.RED, outcomes.UNPROVEN, outcomes.SKIPPED])
def test_planted_result_that_is_not_green(book, known, ran, state):
    claim = dataclasses.replace(book.claims[0], checks=["test_accuracy"])
    names = [name for name in known if ledger.matches("test_accuracy", name)]
    bad = {n: outcomes.Result(n, outcomes.GREEN, 1.0) for n in names}
    assert ledger.row_of(claim, known, bad).result == outcomes.GREEN
    bad = {n: outcomes.Result(n, state, 1.0, f"{state}: why") for n in names}
    assert ledger.row_of(claim, known, bad).result != outcomes.GREEN


def test_planted_test_that_did_not_run(book, known):
    claim = dataclasses.replace(book.claims[0], checks=["test_accuracy"])
    names = [name for name in known if ledger.matches("test_accuracy", name)]
    some = {n: outcomes.Result(n, outcomes.GREEN, 1.0) for n in names[1:]}
    assert ledger.row_of(claim, known, some).result == f"{ledger.NOT_RUN}: {names[0]}"


def test_planted_open_claim_is_not_green(book, known):
    claim = dataclasses.replace(book.claims[0], checks=["test_accuracy"], open="no time")
    names = [name for name in known if ledger.matches("test_accuracy", name)]
    good = {n: outcomes.Result(n, outcomes.GREEN, 1.0) for n in names}
    assert ledger.row_of(claim, known, good).result == ledger.OPEN + "no time"


def test_planted_long_test_that_did_not_run(book, known):
    claim = dataclasses.replace(book.claims[0], checks=["test_cbmc"])
    names = [name for name, mode in known.items() if ledger.matches("test_cbmc", name) and not mode]
    some = {n: outcomes.Result(n, outcomes.GREEN, 1.0) for n in names}
    assert ledger.row_of(claim, known, some).result == ledger.SHORT
    assert not_green({claim.id: ledger.SHORT}) != {}


def test_planted_red_row_of_the_page(tmp_path, rows):
    page = tmp_path / "page.md"
    page.write_text(ledger.PAGE.read_text())
    two = [dataclasses.replace(row, result=outcomes.GREEN) for row in rows[:2]]
    ledger.write(two, {}, page)
    assert not_green(ledger.recorded(page)) == {}
    page.write_text(page.read_text().replace("| passed |", "| unproven: no tool |", 1))
    assert not_green(ledger.recorded(page)) == {two[0].claim.claim: "unproven: no tool"}


def test_versions_are_found_and_absence_is_said():
    assert versions.version("pytest")[0].isdigit()
    assert versions.version("cc")[0].isdigit()
    assert versions.version("no-such-tool") == "absent"


@pytest.mark.parametrize(
    ("inside", "state"),
    [
        ("", outcomes.GREEN),
        ("<failure/>", outcomes.RED),
        ("<error/>", outcomes.RED),
        ('<skipped message="no bus here"/>', outcomes.SKIPPED),
        ('<skipped message="unproven: no tool"/>', outcomes.UNPROVEN),
        ("<system-out>x.c:7:test_a:PASS\nx.c:8:test_b:FAIL: why</system-out><failure/>", None),
    ],
)
def test_planted_result_is_read_as_it_is(tmp_path, inside, state):
    """From JUnit; of a Unity program each test by itself."""
    file = tmp_path / "run.xml"
    file.write_text(f'<s><testcase classname="m" name="x" time="1">{inside}</testcase></s>')
    found = {name: result.state for name, result in outcomes.read([file]).items()}
    of_unity = {"m::test_a": outcomes.GREEN, "m::test_b": outcomes.RED}
    assert found == ({"m::x": state} if state else of_unity)
