# SPDX-License-Identifier: MIT
"""The result of an identification, and the one rule that decides what is claimed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dahl.identification.log import Log
from dahl.identification.samples import MIN_SCORED_CYCLES, Samples

if TYPE_CHECKING:
    from dahl.identification.diagnose import Lack
    from dahl.identification.fit import Fit, Fitter, Hypothesis
    from dahl.identification.select import Plausible

NAMES = ("sigma0", "Fc")
MAX_HALF_WIDTH = 0.3  # of the value; a wider interval is no basis for a firmware
MIN_R2 = 0.5  # on cycles left out; below it most of the torque is not friction


@dataclass
class Claim:
    """sigma0 and Fc with 95 % intervals: arrays (2,)."""

    value: np.ndarray = field(default_factory=lambda: np.full(2, np.nan))
    low: np.ndarray = field(default_factory=lambda: np.zeros(2))
    high: np.ndarray = field(default_factory=lambda: np.full(2, np.inf))
    widths: dict[str, np.ndarray] = field(default_factory=dict)  # relative, cumulative by source
    claimed: tuple[bool, bool] = (False, False)
    reasons: list[str] = field(default_factory=list)

    @property
    def half_width(self) -> np.ndarray:
        """Relative: (2,)."""
        return (self.high - self.low) / 2 / self.value

    def dominant_uncertainty(self, k: int) -> str:
        """The source that most of an interval comes from: 0 for sigma0, 1 for Fc."""
        names = list(self.widths)
        widths = np.array([float(self.widths[name][k]) for name in names])
        nested = [name for name in names if name != "counts"]
        own = dict(zip(names, widths, strict=True))
        steps = np.diff([0.0, *(own[name] for name in nested)])
        shares = dict(zip(nested, steps.tolist(), strict=True))
        if "counts" in own:
            shares["counts"] = own["counts"]
        return max(shares, key=lambda name: shares[name])


@dataclass
class Result:
    """All that was found. Torque in N m and angle in rad, or N and m for linear motion."""

    logs: list[Log]  # preprocessed pieces
    samples: Samples
    sign: float  # -1 if the torque was used with the other sign
    options: Any
    fitter: Fitter | None = None
    fits: list[Fit] = field(default_factory=list)
    plausible: Plausible | None = None
    lacks: list[Lack] = field(default_factory=list)
    claim: Claim = field(default_factory=Claim)

    def without_fit(self, reason: str) -> Result:
        return replace(self, claim=replace(self.claim, reasons=[reason]))

    @property
    def hypothesis(self) -> Hypothesis | None:
        return None if self.plausible is None else self.plausible.chosen.hypothesis

    @property
    def r2(self) -> float:
        """Of the best hypothesis, on cycles that were left out."""
        if self.plausible is None:
            return 0.0
        return 1 - self.plausible.best.total / spread_of(self.samples)

    @property
    def verdict(self) -> str:
        """One line: what is claimed, how well it is known, and the dominant uncertainty."""
        words = []
        for k, name in enumerate(NAMES):
            half = 100 * self.claim.half_width[k]
            if not self.claim.claimed[k]:
                words.append(f"{name} not claimed (+-{half:.0f} %)")
            else:
                source = self.claim.dominant_uncertainty(k)
                words.append(f"{name} {self.claim.value[k]:.4g} +-{half:.1f} % ({source})")
        return "; ".join([*words, *self.claim.reasons])


def spread_of(samples: Samples) -> float:
    """Sum of squares of the torque around its mean, as the fit weighs it."""
    gram = samples.grams(np.ones((samples.rows, 1))).sum(axis=0)
    return float(gram[1, 1] - gram[0, 1] ** 2 / gram[0, 0])


def claims_of(result: Result) -> Result:
    """Apply the rule: enough cycles, enough explained, a narrow interval, nothing withdrawn."""
    claim, samples = result.claim, result.samples
    withdrawn = np.zeros(2, dtype=bool)
    reasons = []
    for lack in result.lacks:
        withdrawn |= np.array(lack.withdraws)
        moved = np.round(100 * lack.moved, 2)
        reasons.append(f"{lack.name}: {100 * lack.gain:.1f} % of the residual, moves {moved} %")
    known = np.isfinite(claim.low) & np.isfinite(claim.high) & (claim.low > 0)
    claimed = known & (claim.half_width <= MAX_HALF_WIDTH) & ~withdrawn
    if samples.cycles < MIN_SCORED_CYCLES:
        claimed[:] = False
        reasons.append(f"only {samples.cycles} cycles; {MIN_SCORED_CYCLES} are needed")
    if result.r2 < MIN_R2:
        claimed[:] = False
        reasons.append(f"R2 {result.r2:.2f} on cycles left out")
    claim = replace(claim, claimed=(bool(claimed[0]), bool(claimed[1])), reasons=reasons)
    return replace(result, claim=claim)
