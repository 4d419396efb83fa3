# SPDX-License-Identifier: MIT
"""Friction as a firmware runs it, by the keys of a scene: elements in parallel, or one of them that
is asymmetric, or follows a load or the speed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dahl.identify import models
from dahl.identify.models import DAHL_ELEMENT, SLIP_ELEMENT, Element

if TYPE_CHECKING:
    from dahl.binding.plan_header import AnyPlan

MIN_LOAD_SHARE = 1e-3  # of the load that the plan is for


@dataclass(frozen=True)
class Runnable:
    """Elements in parallel; one Dahl element may follow a load. N m and rad, or N and m."""

    model: str  # key of [friction] in a scene
    elements: tuple[Element, ...]
    sigma0: tuple[float, ...]  # of each element, at the largest load
    Fc: tuple[float, ...]  # of each element; asymmetric: forward and backward; stribeck: Fs and Fc
    load: tuple[float, float] | None = None  # share of the largest load: at 0, per unit
    own: float | None = None  # of the model's own key
    period: float = 0.0  # s, of rows and ticks, of a model that depends on speed; 0: unknown

    @property
    def is_mixed(self) -> bool:
        """Whether the sum is neither one Dahl element nor slip elements alone."""
        return DAHL_ELEMENT in self.elements and len(self.elements) > 1

    @property
    def needs_encoder(self) -> bool:
        """Whether it works by counts alone."""
        return self.elements != (DAHL_ELEMENT,) or self.load is not None

    @property
    def sums(self) -> dict[str, float]:
        """sigma0 and Fc of all elements together; of both directions the mean."""
        return {"sigma0": sum(self.sigma0), "Fc": sum(self.Fc)}

    @property
    def note(self) -> str:
        """What a firmware must know, for its header; "" if nothing."""
        return ""

    @property
    def by_speed(self) -> dict[str, float]:
        """Numbers of a model that depends on speed, by their keys in JSON: rad (m) and s."""
        timed = {"period": self.period} if self.period else {}
        return {} if self.own is None else {self.model: self.own, **timed}

    @property
    def a(self) -> float:
        """sigma0/Fc of all elements together, 1/rad (1/m)."""
        return self.sums["sigma0"] / self.sums["Fc"]

    def shares(self, load: np.ndarray) -> np.ndarray:
        """sigma0 and Fc in parts of those at the largest load."""
        assert self.load is not None
        shares: np.ndarray = self.load[0] + self.load[1] * load
        return shares

    def torque(self, moves: np.ndarray, load: np.ndarray | None = None) -> np.ndarray:
        """Return the torque after each move, from rest: (n,) N m (N)."""
        torque, whole = np.zeros(len(moves)), [slice(0, len(moves))]
        if self.load is not None and load is not None:
            share = np.maximum(self.shares(load), MIN_LOAD_SHARE)
            return self.Fc[0] * models.dahl_under_load(moves, whole, self.a, share)
        for element, sigma0, Fc in zip(self.elements, self.sigma0, self.Fc, strict=True):  # noqa: N806
            torque += Fc * element.run(moves, whole, sigma0 / Fc)
        return torque

    def plans(self, count: float) -> dict[str, AnyPlan]:
        """Return the plans of a firmware, with `count` rad (m) each, by the endings of their names.

        Raises dahl.Error for parameters that the library rejects.
        """
        from dahl.binding.friction import Plan
        from dahl.binding.slip import Slip

        parts = list(zip(self.elements, self.sigma0, self.Fc, strict=True))
        dahls = [Plan(sigma0, Fc, count) for kind, sigma0, Fc in parts if kind is DAHL_ELEMENT]
        slips = [(sigma0, Fc) for kind, sigma0, Fc in parts if kind is SLIP_ELEMENT]
        several = self.is_mixed
        found: dict[str, AnyPlan] = {f"_{k}" if several else "": x for k, x in enumerate(dahls, 1)}
        if slips:
            stiffness, limits = zip(*slips, strict=True)
            found["_slip" if several else ""] = Slip(stiffness, limits, count)
        return found


@dataclass(frozen=True)
class Asymmetric(Runnable):
    """One element of Dahl's law with an Fc of each direction."""

    @property
    def sums(self) -> dict[str, float]:
        return {"sigma0": sum(self.sigma0), "Fc": sum(self.Fc) / 2}

    def torque(self, moves: np.ndarray, load: np.ndarray | None = None) -> np.ndarray:
        half, mean = sum(self.Fc) / 2, (self.Fc[0] - self.Fc[1]) / 2
        return mean + half * models.asymmetric(moves, [slice(0, len(moves))], self.a, mean / half)

    def plans(self, count: float) -> dict[str, AnyPlan]:
        from dahl.binding.state_element import Asymmetric as Plan

        return {"": Plan(self.sigma0[0], self.Fc[0], self.Fc[1], count)}


@dataclass(frozen=True)
class Stribeck(Runnable):
    """One element of Dahl's law whose Fc falls with speed; own: rad (m) of a tick at the Stribeck
    speed.
    """

    @property
    def sums(self) -> dict[str, float]:
        return {"sigma0": self.sigma0[0], "Fc": self.Fc[1]}

    @property
    def note(self) -> str:
        if not self.own or not self.period:
            return "A tick of this plan is as long as a row of the log, which has no times."
        speed = self.own / self.period
        return (
            f"A tick of this plan is {1e3 * self.period:.5g} ms long, as a row of the log."
            " For another period, make it again with speed_travel = period times the Stribeck"
            f" speed {speed:.5g}."
        )

    def torque(self, moves: np.ndarray, load: np.ndarray | None = None) -> np.ndarray:
        slow, fast = self.Fc
        assert self.own is not None
        limits = 1 + (slow / fast - 1) * np.exp(-((moves / self.own) ** 2))
        return fast * models.dahl_with_limits(moves, [slice(0, len(moves))], self.a, limits)

    def plans(self, count: float) -> dict[str, AnyPlan]:
        from dahl.binding.state_element import Stribeck as Plan

        assert self.own is not None
        slow, fast = self.Fc
        return {"": Plan(self.sigma0[0], slow, fast, count, self.own)}
