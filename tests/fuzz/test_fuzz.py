# SPDX-License-Identifier: MIT
"""Coverage-guided fuzzers of all input: each seed once, then 20 s; 1e9 executions with --soak.

The laws are in tests/fuzz/*.c and readers.py.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor

import pytest
from fuzzers import (
    FUZZERS,
    Run,
    complaint,
    fuzz,
    home,
    program_of,
    replay,
    soak,
)

SECONDS = int(os.environ.get("DAHL_FUZZ_SECONDS", "20"))
SOAK_SECONDS = 120  # lost at most by an interruption


def run_for_a_while(name: str) -> Run:
    """Use a fixed seed, so that a new finding is due to a change; --soak uses random seeds."""
    return fuzz(name, program_of(name), home(name), SECONDS, "-seed=1")


@pytest.fixture(scope="module")
def runs(request: pytest.FixtureRequest) -> Iterator[dict[str, Future[Run]]]:
    """The runs of the selected fuzzers, at least two in parallel."""
    wanted = [
        item.callspec.params["name"]
        for item in request.session.items
        if getattr(item, "originalname", "") == "test_fuzz_for_a_while"
    ]
    for name in wanted:
        program_of(name)
    pool = ThreadPoolExecutor(max(2, (os.cpu_count() or 1) - 1))
    yield {name: pool.submit(run_for_a_while, name) for name in wanted}
    pool.shutdown(wait=False, cancel_futures=True)


@pytest.mark.parametrize("name", FUZZERS)
def test_fuzz_every_seed(name: str) -> None:
    run = replay(name)
    assert run.crash is None, complaint(name, run)


@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", FUZZERS)
def test_fuzz_for_a_while(name: str, runs: dict[str, Future[Run]]) -> None:
    run = runs[name].result()
    print(f"{name}: {run.executions} executions in {SECONDS} s, {run.edges} edges covered")
    assert run.crash is None, complaint(name, run)
    assert run.executions > FUZZERS[name].floor * SECONDS // 60, run.text[-2000:]


@pytest.mark.soak
@pytest.mark.timeout(0)
@pytest.mark.parametrize("name", FUZZERS)
def test_fuzz_soak(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    def report(line: str) -> None:
        with capsys.disabled():
            print(line, flush=True)

    goal = FUZZERS[name].soak
    assert soak(name, home(name), goal, SOAK_SECONDS, report) >= goal
