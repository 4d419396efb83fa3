# SPDX-License-Identifier: MIT
"""The friction that a header and a scene carry: the model that was chosen or asked for, of those
that the library has; Dahl's where Coulomb's was, for which it has none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dahl.identify import elements, path
from dahl.identify.compare import Candidate, Part
from dahl.identify.load import Follows
from dahl.identify.result import Result

if TYPE_CHECKING:
    from dahl.plan_header import AnyPlan


@dataclass(frozen=True)
class Friction:
    """One model by the words of a scene. N m and rad, or N and m."""

    model: str  # dahl, slip, parallel, asymmetric, loaded
    sigma0: tuple[float, ...]
    Fc: tuple[float, ...]  # of each element; forward and backward
    kinds: tuple[str, ...]  # of parallel: dahl or slip for each element
    terms: dict[str, float]  # beside it
    earlier: float = 0.0  # rows that the torque is to come earlier than the log was shifted to
    follows: Follows | None = None  # of loaded; sigma0 and Fc are those of its largest share

    @property
    def a(self) -> float:
        """Of all elements together, 1/rad (1/m)."""
        return sum(self.sigma0) / (sum(self.Fc) / (2 if self.model == "asymmetric" else 1))

    def load(self, measured: np.ndarray) -> np.ndarray:
        """What a loaded plan takes as its load, 0 .. 1 in the log: (rows,)."""
        assert self.follows is not None
        shares: np.ndarray = self.follows.share(measured) / self.follows.shares[1]
        return shares

    def torque(self, moves: np.ndarray, load: np.ndarray | None = None) -> np.ndarray:
        """From rest, after each move, under the load measured: (rows,) N m (N)."""
        if self.follows is not None and load is not None:
            return self.Fc[0] * path.loaded(moves, self.a, self.load(load))
        if self.model == "asymmetric":
            half, mean = sum(self.Fc) / 2, (self.Fc[0] - self.Fc[1]) / 2
            part = mean / half
            w = elements.asymmetric(moves, self.sigma0[0] / half, part, before=-part)
            return mean + half * w
        drawn = np.zeros(len(moves))
        for sigma0, limit, kind in zip(self.sigma0, self.Fc, self._kinds, strict=True):
            element = path.bilinear if kind == "slip" else path.dahl
            drawn += limit * element(moves, sigma0 / limit)
        return drawn

    @property
    def line(self) -> tuple[float, float]:
        """The load of the plan over that measured: at 0, and its change with a unit."""
        assert self.follows is not None
        most = self.follows.shares[1]
        return (1 - self.follows.slope * self.follows.reference) / most, self.follows.slope / most

    @property
    def _kinds(self) -> tuple[str, ...]:
        return self.kinds or (self.model,) * len(self.sigma0)

    def plans(self, theta_per_count: float) -> dict[str, AnyPlan]:
        """What a firmware needs, by the ending of its name. Raises dahl.Error for parameters that
        the library refuses.
        """
        from dahl.core import Plan
        from dahl.parts import Slip
        from dahl.variants import Asymmetric

        if self.model == "asymmetric":
            (sigma0,), (forward, backward) = self.sigma0, self.Fc
            return {"": Asymmetric(sigma0, forward, backward, theta_per_count)}
        pairs = list(zip(self.sigma0, self.Fc, self._kinds, strict=True))
        slips = [pair[:2] for pair in pairs if pair[2] == "slip"]
        dahls = [Plan(*pair[:2], theta_per_count) for pair in pairs if pair[2] != "slip"]
        several = self.model == "parallel"
        found: dict[str, AnyPlan] = {
            f"_{k + 1}" if several else "": one for k, one in enumerate(dahls)
        }
        if slips:
            sigma0, limits = zip(*slips, strict=True)
            found["_slip" if several else ""] = Slip(sigma0, limits, theta_per_count)
        return found


def of(result: Result) -> Friction:
    """The friction of a result."""
    seen, estimate = result.explored, result.estimate
    one = seen.models.of(seen.models.chosen)
    if result.follows is not None and (one is None or one.name == "Dahl"):
        most = result.follows.shares[1]
        scaled = (most * estimate.sigma0,), (most * estimate.Fc,)
        return Friction("loaded", *scaled, (), estimate.terms, follows=result.follows)
    if one is None or one.name in ("Dahl", "Coulomb"):
        return Friction("dahl", (estimate.sigma0,), (estimate.Fc,), (), estimate.terms)
    earlier = one.trial.choice.delay - seen.choice.delay
    if one.name == "asymmetric":
        return _asymmetric(one, earlier)
    kinds = tuple(str(part["kind"]) for part in one.parts)
    model = "slip" if set(kinds) == {"slip"} else "parallel"
    sigma0, limits = (_of_each(one.parts, name) for name in ("sigma0", "Fc"))
    several = kinds if model == "parallel" else ()
    return Friction(model, sigma0, limits, several, one.trial.terms, earlier)


def _of_each(parts: list[Part], name: str) -> tuple[float, ...]:
    return tuple(float(part[name]) for part in parts)


def _asymmetric(one: Candidate, earlier: float) -> Friction:
    (sigma0,) = _of_each(one.parts, "sigma0")
    (forward,), (backward,) = (_of_each(one.parts, f"Fc_{way}") for way in ("forward", "backward"))
    return Friction("asymmetric", (sigma0,), (forward, backward), (), one.trial.terms, earlier)
