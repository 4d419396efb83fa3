# SPDX-License-Identifier: MIT
"""Each mutant of library, codec, line readers and receiver is noticed by a test or means the same.

By default a sample, and the list of equivalents as a text; with --long all of them, and each entry
of the list is proven again. `build/mutants.json` then holds every fate.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
import tomllib
from dataclasses import replace
from typing import Any

import equivalence
import pytest
import run_mutants
import z3
from mutate import Mutant
from workshop import PROGRAMS, ROOT, TARGETS, Fate, takes_every_road

SAMPLE = 20
SAMPLED = (
    "lib/wide.c",
    "lib/set_torque.c",
    "lib/angle.c",
    "lib/gap.h",
    "port/frames.c",
)
LEAST_DISTINCT = 500


Entry = dict[str, Any]  # of equivalent.toml


def equivalents() -> list[Entry]:
    return tomllib.loads(run_mutants.LIST.read_text()).get("mutant", [])


def complaints(entries: list[Entry], mutants: list[Mutant]) -> list[str]:
    """What is wrong with the list as it stands."""
    known, ids = (
        {mutant.id for mutant in mutants},
        [entry.get("id", "") for entry in entries],
    )
    found = [f"no such mutant: {name}" for name in ids if name not in known]
    found += [f"listed twice: {name}" for name in ids if ids.count(name) > 1]
    for entry in entries:
        if entry.get("proof") not in equivalence.PROOFS or not entry.get("reason", "").strip():
            found.append(f"no proof or no reason: {entry.get('id')}")
    return found


def unexplained(fates: list[Fate], entries: list[Entry]) -> list[str]:
    """Mutants alive that the list does not have, and listed ones that a test does notice."""
    listed = {entry["id"] for entry in entries}
    found = [f"alive: {f.id}" for f in fates if f.kind == "alive" and f.id not in listed]
    for fate in fates:
        if fate.id in listed and fate.kind == "killed":
            found.append(f"listed as equivalent, but {fate.killer} notices it: {fate.id}")
    return found


@pytest.fixture(scope="module")
def mutants() -> list[Mutant]:
    return run_mutants.all_mutants()


def named(mutants: list[Mutant], name: str) -> Mutant:
    return next(mutant for mutant in mutants if mutant.id == name)


def test_list_names_mutants_and_reasons(mutants: list[Mutant]) -> None:
    assert complaints(equivalents(), mutants) == []


def test_sample_of_mutants_is_noticed(mutants: list[Mutant]) -> None:
    """The same few of the small files each time."""
    chosen = [mutant for mutant in mutants if mutant.file in SAMPLED]
    chosen.sort(key=lambda mutant: hashlib.sha256(mutant.id.encode()).hexdigest())
    fates = run_mutants.run(chosen[:SAMPLE])
    assert unexplained(fates, equivalents()) == []
    assert sum(fate.kind == "killed" for fate in fates) > SAMPLE // 2


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_every_mutant_is_noticed_or_equivalent(mutants: list[Mutant]) -> None:
    start = time.monotonic()
    jobs = int(os.environ.get("DAHL_MUTANT_JOBS", "0")) or os.cpu_count() or 1
    listed = {entry["id"] for entry in equivalents()}
    fates = run_mutants.run(mutants, jobs, listed=listed)
    result = run_mutants.report(mutants, fates, time.monotonic() - start)
    run_mutants.RESULT.write_text(json.dumps(result, indent=1))
    print(json.dumps({key: value for key, value in result.items() if key != "fates"}, indent=1))
    open_ = unexplained(fates, equivalents())
    if not takes_every_road():
        open_ = [complaint for complaint in open_ if f"alive: {TARGETS} " not in complaint]
    assert open_ == []
    assert result["distinct"] >= LEAST_DISTINCT
    if not takes_every_road():
        pytest.skip(f"unproven: mutants of {TARGETS} are noticed: this processor lacks AVX-512")


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_equivalents_are_proven(mutants: list[Mutant]) -> None:
    """Each entry again, so that the list cannot hide a mutant that differs."""
    open_ = []
    for entry in equivalents():
        at = {int(place): value for place, value in entry.get("at", {}).items()}
        mutant = named(mutants, entry["id"])
        answer = equivalence.prove_equivalent(mutant, at=at, proof=entry["proof"])
        if not answer.proven:
            open_.append((entry["id"], answer.said))
    assert open_ == []


def test_lemmas_are_proven() -> None:
    """What the proofs take for granted of the two wide functions."""
    verdicts = equivalence.prove_lemmas()
    assert {name: str(v) for name, v in verdicts.items() if not v.proven} == {}


def test_assembly_is_read_as_it_multiplies() -> None:
    """The model that the proof `assembly` takes, on some numbers."""
    for a, b in ((0xFEDCBA98, 0x89ABCDEF), (2**32 - 1, 2**32 - 1), (0x10000, 0xFFFF), (0, 5)):
        words = [z3.BitVecVal(x, 32) for x in (a, b)]
        assert z3.simplify(equivalence.product_of_m0(*words)).as_long() == a * b
        for (add, carry), sign in ((("adds", "adcs"), 1), (("subs", "sbcs"), -1)):
            start = [(z3.BitVec(n, 32), z3.BitVecVal(7, 32)) for n in ("low", "high", "part")]
            term = z3.substitute(equivalence.sum_of_m0(*words, add, carry), *start)
            expected = (7 << 32) + 7 + sign * (7 + a * b)
            assert z3.simplify(term).as_long() == expected % 2**64


# ---------------------------------------------------------------- the check itself

SURVIVES_THE_PAPER = "lib/encoder.c dahl_counts_between statement: now %= counts_per_turn; -> ;"
DIFFERS = "lib/counts_q30.c dahl_step_counts_q30 relational: dcounts > DAHL_DENSE"
DIFFERS += " -> dcounts <= DAHL_DENSE"


def test_planted_weak_tests_leave_a_survivor(mutants: list[Mutant]) -> None:
    """Where only the paper's figures are tested, a wrong encoder is alive."""
    weak = [program for program in PROGRAMS if program.name == "lib/test_paper"]
    fates = run_mutants.run([named(mutants, SURVIVES_THE_PAPER)], programs=weak)
    assert unexplained(fates, equivalents()) == [f"alive: {SURVIVES_THE_PAPER}"]


def test_planted_wrong_equivalence_is_reported(mutants: list[Mutant]) -> None:
    """A mutant that differs, listed as equivalent: seen by the tests and by the solver."""
    entry = {"id": DIFFERS, "proof": "solver", "reason": "planted"}
    golden = [program for program in PROGRAMS if program.name == "golden"]
    fates = run_mutants.run([named(mutants, DIFFERS)], programs=golden)
    assert unexplained(fates, [entry]) == [
        f"listed as equivalent, but golden notices it: {DIFFERS}"
    ]


def test_planted_difference_is_refuted_by_the_solver(mutants: list[Mutant]) -> None:
    differs = named(mutants, "lib/far_angle.c dahl_step_far constant: 31 -> 30")
    answer = equivalence.prove_equivalent(differs, seconds=60)
    assert not answer.proven
    assert any("fails for" in said for said in answer.said)


def test_planted_at_of_another_value_is_refused(mutants: list[Mutant]) -> None:
    """`at` has to be where the comparison differs, and all of that."""
    mutant = named(mutants, "lib/digits.c dahl_move_digits constant: 0 -> -1")
    assert equivalence.differs_only_at(mutant, {2: -1})
    assert not equivalence.differs_only_at(mutant, {2: 0})
    assert not equivalence.differs_only_at(mutant, {1: -1})
    negated = named(
        mutants, "lib/digits.c dahl_move_digits relational: dcounts < 0 -> dcounts != 0"
    )
    assert not equivalence.differs_only_at(negated, {2: 0})


def test_planted_wrong_symmetry_is_refuted(mutants: list[Mutant]) -> None:
    swap = "lib/wide.c dahl_mulhi64 arguments: dahl_mulhi(a0, b0) -> dahl_mulhi(b0, a0)"
    assert equivalence.prove_equivalent(named(mutants, swap), proof="symmetry").proven
    wrong = next(m for m in mutants if " arguments: dahl_quotient_q63(F.mantissa" in m.id)
    assert not equivalence.prove_equivalent(wrong, proof="symmetry").proven


@pytest.mark.parametrize(
    ("proof", "name"),
    [
        ("shortcut", "largest relational: job->stride == width -> job->stride >= width"),
        ("shortcut", "largest relational: job->stride == width -> job->stride != width"),
        ("loop", "run relational: t < job->n -> t <= job->n"),
        ("loop", "run relational: t < job->n -> t >= job->n"),
    ],
)
def test_planted_wrong_shortcut_or_loop_is_refuted(
    mutants: list[Mutant], proof: str, name: str
) -> None:
    mutant = named(mutants, f"lib/batch_throughput_channels.c {name}")
    assert not equivalence.prove_equivalent(mutant, proof=proof).proven


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("batch_channels.c", "open_digits constant: 32 -> 33"),
        ("batch_channels.c", "open_digits relational: gap != 0 -> gap == 0"),
        ("batch_channels.c", "open_digits relational: c < count -> c <= count"),
        ("batch_channels.c", "open_digits assignment: open |= {0} -> open = {0}"),
        ("batch_channels.c", "move_row bitwise: rest & (0u - rest) -> rest | (0u - rest)"),
        ("batch.h", "dahl_batch_far constant: 32 -> 33"),
        ("batch.h", "dahl_batch_far logical: {1} && {2} -> {1} || {2}"),
    ],
)
def test_planted_digit_less_is_refuted(mutants: list[Mutant], file: str, name: str) -> None:
    """A digit left out that changes a bit, a channel that is not there, a loop without an end."""
    terms = "gap != 0 ? chunk->eights[t][c] : 0u", "rest != 0", "dahl_batch_gap(w) >> 32 != 0"
    mutant = named(mutants, f"lib/{file} {name.format(*terms)}")
    assert not equivalence.prove_equivalent(mutant, proof="idle").proven


def test_planted_bit_beside_the_sign_is_refuted(mutants: list[Mutant]) -> None:
    right = named(mutants, "lib/batch_channels.c torque_row constant: 63 -> 62")
    wrong = replace(right, id=right.id.replace("62", "28"), text="28")
    proofs = [equivalence.prove_equivalent(m, proof="sign").proven for m in (right, wrong)]
    assert proofs == [True, False]


def test_planted_change_of_a_name_is_seen() -> None:
    """What the proof of a loop asks of its body."""
    assert equivalence.is_left_alone("n", "x = n - 1; y[n] = n == 2;")
    for change in ("n -= 1;", "n = 2;", "n++;", "--n;", "f(&n);", "n <<= 1;"):
        assert not equivalence.is_left_alone("n", change)


def test_planted_rounding_of_a_double_is_refuted(mutants: list[Mutant]) -> None:
    """One bit less cleared, where a double has no room for it."""
    mutant = named(mutants, "lib/batch.h dahl_batch_product condition: size >> 53 != 0 -> 0")
    code = equivalence.original(("batch",)), equivalence.with_mutant(mutant, ("batch",))
    functions = [module["dahl_batch_product"] for module in code]
    verdict = equivalence.same(functions[0], functions[1], 60, {}, set())
    assert verdict.refuted


@pytest.mark.long
@pytest.mark.skipif(not takes_every_road(), reason="unproven: this processor lacks AVX-512")
def test_planted_road_is_noticed_and_a_hint_is_not(mutants: list[Mutant]) -> None:
    """What chooses between sets of instructions: a wrong choice is seen; how a loop is unrolled is
    not, though the code differs.
    """
    wrong = next(m for m in mutants if m.file == TARGETS and " DAHL_HAS_AVX2 logical: " in m.id)
    hint = b'"GCC unroll 8"'
    start = (ROOT / TARGETS).read_bytes().index(hint)
    unrolled = replace(wrong, id="a hint", start=start, end=start + len(hint), text='""')
    fates = run_mutants.run([wrong, unrolled])
    assert [(fate.kind, fate.killer) for fate in fates] == [("killed", "roads"), ("alive", "")]


def test_planted_stale_entry_is_reported(mutants: list[Mutant]) -> None:
    stale = {
        "id": "lib/gap.h gone constant: 1 -> 2",
        "proof": "solver",
        "reason": "was there",
    }
    bare = {"id": DIFFERS, "proof": "solver", "reason": ""}
    assert complaints([stale], mutants) == ["no such mutant: lib/gap.h gone constant: 1 -> 2"]
    assert complaints([bare], mutants) == [f"no proof or no reason: {DIFFERS}"]
