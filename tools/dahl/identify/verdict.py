# SPDX-License-Identifier: MIT
"""Whether the numbers can be trusted, and if not, why: never a number without it.

A parameter is identifiable if at least LEAST_CYCLES cycles were scored, its 95 % interval has two
ends and is at most WIDE of its value to either side, and, for sigma0, if Dahl's model beats
Coulomb's on what was not fitted.
"""

from __future__ import annotations

from dahl.identify import explore
from dahl.identify.explore import LEAST_CYCLES
from dahl.identify.result import Result, Verdict

WIDE = 0.3  # half width of the interval over the value
BETTER = 0.85  # of Coulomb's held-out cost, that Dahl's must be below
BENDS = 0.7  # of Dahl's held-out cost, below which the bilinear element's says so
COARSE = 2.0  # counts in a presliding length 1/a
POOR = 0.5  # R2 below which nothing is claimed


def judge(result: Result) -> Verdict:
    """The verdict on a result."""
    estimate, reasons = result.estimate, _reasons(result)
    sound = result.models.r2["dahl"] >= POOR and result.explored.cycles >= LEAST_CYCLES
    good = {
        name: sound
        and estimate.ci95[name].bounded
        and estimate.ci95[name].relative(getattr(estimate, name)) <= WIDE
        for name in ("sigma0", "Fc")
    }
    if not beats_coulomb(result) or too_coarse(result):
        good["sigma0"] = False
    for name in {name for found in result.findings for name in found.doubts}:
        good[name] = False
    words = {
        (True, True): "sigma0 and Fc identifiable",
        (False, True): "sigma0 not identifiable, Fc is",
        (True, False): "Fc not identifiable, sigma0 is",
        (False, False): "neither sigma0 nor Fc identifiable",
    }[good["sigma0"], good["Fc"]]
    text = "; ".join([words, *reasons])
    return Verdict(good["sigma0"], good["Fc"], text, reasons)


def beats_coulomb(result: Result) -> bool:
    lost = {name: 1 - r2 for name, r2 in result.models.r2.items()}
    return lost["dahl"] < BETTER * lost["coulomb"]


def too_coarse(result: Result) -> bool:
    resolution = max(log.resolution for log in result.logs)
    return result.estimate.a * resolution * COARSE > 1


def _reasons(result: Result) -> list[str]:
    """Everything that a reader should know beside the numbers."""
    estimate, r2, cycles = result.estimate, result.models.r2, result.explored.cycles
    wide = estimate.ci95["sigma0"].relative(estimate.sigma0)
    found = {
        f"the model explains {100 * r2['dahl']:.0f} % of what was not fitted": r2["dahl"] < POOR,
        "Dahl no better than Coulomb here": not beats_coulomb(result),
        "presliding below encoder resolution": too_coarse(result),
        "friction never slips: the motion is shorter than presliding": result.reversals > 0
        and not estimate.ci95["Fc"].bounded,
        f"only {cycles} cycle{'s' * (cycles != 1)} scored, {LEAST_CYCLES} are the least"
        f" ({result.reversals} reversals)": r2["dahl"] >= POOR and cycles < LEAST_CYCLES,
        f"sigma0 known within {100 * wide:.0f} % only": WIDE < wide < float("inf"),
        "loop is bilinear: exponent 1 bends too early": 1 - r2["bilinear"]
        < BENDS * (1 - r2["dahl"])
        and r2["bilinear"] > POOR,
        "backlash: flat zone after each reversal": result.backlash > 0,
    }
    return [
        *(words for words, holds in found.items() if holds),
        *_hanging(result),
        *(finding.text for finding in result.findings),
    ]


def _hanging(result: Result) -> list[str]:
    """What a parameter hangs on whose interval the choices have made wide."""
    log, reasons = result.logs[0], []
    for name, unit in (("sigma0", log.slope_unit), ("Fc", log.unit)):
        wide = result.estimate.ci95[name].relative(getattr(result.estimate, name))
        words = explore.hangs(result.explored, name, WIDE / 3)
        if words and WIDE < wide < float("inf"):
            reasons.append(f"{name} hangs on {words} {unit}")
    return reasons
