# SPDX-License-Identifier: MIT
"""The C tests detect small faults in the C sources: a sample of them, or all with --soak."""

from __future__ import annotations

import random

import mutants
import pytest

SAMPLE = 24


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_nearly_all_of_a_sample_are_noticed() -> None:
    chosen = random.Random(2).sample(mutants.mutants(), SAMPLE)
    alive = mutants.survivors(chosen)
    assert len(alive) <= SAMPLE // 6, [str(mutant) for mutant in alive]


@pytest.mark.soak
@pytest.mark.timeout(0)
def test_every_one_is_noticed_or_reviewed() -> None:
    alive = mutants.survivors(mutants.mutants())
    assert [str(mutant) for mutant in alive] == []
