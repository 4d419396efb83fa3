# SPDX-License-Identifier: MIT
"""What is claimed is true: on logs of known truth, one kind for each thing that can spoil an
identification, at least nine of ten claimed intervals hold the truth, or nothing is claimed; and
where nothing is wrong with a log, a claim is made.

The thresholds of tools/dahl/identify were set on seeds 0 to 99; --full tries a hundred others.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
import pytest
from dahl import Error
from dahl.identify import pipeline
from identify_tools import FC, SIGMA0, dahl_torque
from identify_truth import KINDS, MUST_CLAIM, dahl, general
from scipy.integrate import solve_ivp

pytestmark = pytest.mark.usefixtures("library")

TRUTH = {"sigma0": SIGMA0, "Fc": FC}
FIRST, SEEDS = 1000, 100
FEW = 2  # seeds of the short form
LEAST = 0.9
WITHIN = {"sigma0": 0.01, "Fc": 0.003}  # median error where a claim has to be made
QUICK = ("AR .95, 5 %", "outliers 10 %", "load that swings by half")  # see *_claims.py, *_models.py


@dataclass
class Outcome:
    """Of one log, by parameter."""

    error: dict[str, float]
    claimed: dict[str, bool]
    held: dict[str, bool]


def outcome(kind: str, seed: int) -> Outcome | None:
    """Nothing where the log is refused, which claims nothing."""
    try:
        result = pipeline.identify([KINDS[kind](seed)])
    except Error:
        return None
    best, at = result.estimate, result.follows.reference if result.follows else 1.0
    truth = [(name, value * at) for name, value in TRUTH.items()]
    ends = best.ci95
    return Outcome(
        {name: getattr(best, name) / value - 1 for name, value in truth},
        result.verdict.identifiable,
        {name: bool(ends[name].low <= value <= ends[name].high) for name, value in truth},
    )


def line_of(kind: str, found: list[Outcome], seeds: int) -> dict[str, dict[str, float]]:
    """Part of the seeds that is claimed, part of the claims that is true, median error."""
    numbers = {}
    for name in TRUTH:
        claims = [one.held[name] for one in found if one.claimed[name]]
        errors = [abs(one.error[name]) for one in found] or [np.inf]
        numbers[name] = {
            "claimed": len(claims) / seeds,
            "true": float(np.mean(claims)) if claims else 1.0,
            "error": float(np.median(errors)),
        }
    return numbers


def wrong(kind: str, numbers: dict[str, dict[str, float]], least: float) -> list[str]:
    """What is not as it should be, in words."""
    said = [
        f"{kind}: {100 * one['true']:.0f} % of the claims of {name} hold the truth"
        for name, one in numbers.items()
        if one["true"] < least
    ]
    if kind in MUST_CLAIM:
        said += [
            f"{kind}: {name} is claimed in {100 * one['claimed']:.0f} %, error {one['error']:.4f}"
            for name, one in numbers.items()
            if one["claimed"] < LEAST or one["error"] > WITHIN[name]
        ]
    return said


def shown(kind: str, numbers: dict[str, dict[str, float]]) -> str:
    """One row of the table of docs/identify.md."""
    cells = [
        f"{100 * one['claimed']:.0f} % | {100 * one['true']:.0f} %" if one["claimed"] else "0 % | -"
        for one in numbers.values()
    ]
    errors = [f"{100 * one['error']:.2g} %" for one in numbers.values()]
    return f"| {kind} | {' | '.join([*cells, *errors])} |"


def test_the_general_truth_solves_its_equation():
    """dw/du = |1 - s w|^i against an ODE solver, to and fro, for an exponent on either side of 1;
    with exponent 1 it is the exact step, and the closed form between reversals.
    """
    theta = 0.02 * np.sin(np.linspace(0, 9, 400))
    for same in (dahl(theta), dahl_torque(theta)):
        assert np.abs(general(theta, 1.0) - same).max() < 1e-6 * FC
    for exponent in (0.3, 1.6):
        w, truth = 0.0, []
        for move in np.diff(theta, prepend=theta[0]):
            side = np.sign(move)

            def slope(_: float, w: np.ndarray, side: float = side, i: float = exponent):
                return side * np.maximum(1 - side * w, 0.0) ** i

            length = SIGMA0 / FC * abs(move)
            w = solve_ivp(slope, (0, length), [w], rtol=1e-10, atol=1e-12).y[0, -1]
            truth.append(FC * w)
        assert np.abs(general(theta, exponent) - truth).max() < 2e-3 * FC


def test_a_wrong_claim_would_be_told():
    """The judgement itself: two claims of ten without the truth are too many."""
    held = [
        Outcome({"sigma0": 0.0, "Fc": 0.0}, dict.fromkeys(TRUTH, True), dict.fromkeys(TRUTH, k))
        for k in [True] * 8 + [False] * 2
    ]
    said = wrong("wrap", line_of("wrap", held, 10), LEAST)
    assert said == [f"wrap: 80 % of the claims of {name} hold the truth" for name in TRUTH]
    nothing = line_of("white 5 %", [], 10)
    assert wrong("wrap", nothing, LEAST) == []
    assert len(wrong("white 5 %", nothing, LEAST)) == 2


@pytest.mark.parametrize("kind", QUICK)
def test_a_few_logs_of_each_kind(kind):
    found = [outcome(kind, FIRST + seed) for seed in range(FEW)]
    numbers = line_of(kind, [one for one in found if one is not None], FEW)
    said = wrong(kind, numbers, least=0.5)  # of two, chance may take one
    assert [words for words in said if "claims" in words] == []
    if kind in MUST_CLAIM:
        assert min(one["claimed"] for one in numbers.values()) == 1


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_coverage_identify_of_100_seeds(capsys):
    """Prints the table of docs/identify.md; on stderr, which reaches the screen from a worker."""
    jobs = [(kind, FIRST + seed) for kind in KINDS for seed in range(SEEDS)]
    spread: Callable[..., list] = lambda pool: list(pool.map(_job, jobs, chunksize=5))  # noqa: E731
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        found = dict(zip(jobs, spread(pool), strict=True))
    said = []
    with capsys.disabled():
        head = "| kind | sigma0 claimed | true | Fc claimed | true | error sigma0 | error Fc |"
        print(f"\n{head}", file=sys.stderr)
        for kind in KINDS:
            own = [found[kind, FIRST + seed] for seed in range(SEEDS)]
            numbers = line_of(kind, [one for one in own if one is not None], SEEDS)
            print(shown(kind, numbers), file=sys.stderr)
            said += wrong(kind, numbers, LEAST)
    assert said == []


def _job(job: tuple[str, int]) -> Outcome | None:
    return outcome(*job)
