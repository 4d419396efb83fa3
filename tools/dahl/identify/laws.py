# SPDX-License-Identifier: MIT
"""Friction laws as objects: a new law is one class, and one entry in LAWS.

A law has nonlinear parameters p: ln a of each element, then its shape. sigma0 is the slope at
rest of all elements together and Fc their torque at full slip. Methods get a [1/rad (1/m)] of each
element and the shape as numbers within their limits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Protocol

import numpy as np

from dahl.identify import models
from dahl.identify.models import DAHL_ELEMENT, SLIP_ELEMENT, Element, Pieces
from dahl.identify.runnable import Asymmetric, Runnable
from dahl.identify.runnable import Stribeck as StribeckElement
from dahl.identify.samples import Samples

MAX_LN_A = 50.0  # beyond it exp() has no meaning
MAX_STROKES = 250  # above it, laws that are evaluated stroke by stroke would cost seconds
MIN_PEAK = -0.02  # of Fc: its increase if slow or after a rest, which noise may bring below 0
MIN_LOG_SPEED = 0.01  # of fast motion; at a reversal a logarithm would have no bound
MIN_LIMIT = 0.05  # of Fc: friction must not vanish or push at any speed
MIN_SHARE = 0.02  # of sigma0 and Fc, under the least load of a log
MIN_BOUC_WEN = 0.8  # its slope at .05 Fc is 9 % below that at rest; of smaller shapes still more
MIN_STRIBECK_COUNTS = 4.001  # of a row at the Stribeck speed; dahl_stribeck_prepare() needs 4
# Instructions of a Q30 tick on Cortex-M3 (docs/microcontroller.md): of Dahl's law, of the
# asymmetric one and of Stribeck's, of a sum and of each of its elements.
DAHL_TICKS, ASYMMETRIC_TICKS, STRIBECK_TICKS = 20, 33, 202
TICKS = {"slip": (20, 18), "dahl": (21, 21), "mixed": (49, 21)}

Values = Sequence[float]
Ratios = list[np.ndarray]  # F/Fc of each element: (n,)
Parts = list[dict[str, float | str]]


class Fitted(Protocol):
    """The numbers of a fit (fit.py) that a law reads. It calls no method of it."""

    p: np.ndarray
    limits: np.ndarray  # N m (N), Fc of each element
    slopes: np.ndarray  # N m/rad (N/m), sigma0 of each element


class Law:
    """One friction law. The defaults are those of one element that no firmware can run."""

    name: str
    label: str  # in reports
    kind = ""  # of its element in JSON; "": its label
    option = ""  # of --model; "" if it has none
    stiffness: tuple[float, ...] = (0.0,)  # start of ln(a / a of Dahl's law) for each element
    shape: tuple[tuple[float, float, float], ...] = ()  # (start, low, high) of each parameter
    shape_names: tuple[str, ...] = ("shape_1", "shape_2")  # in JSON
    least = -np.inf  # of the first shape parameter, if it is friction
    special_cases: tuple[Law, ...] = ()  # laws that this one contains
    in_library = False  # whether a firmware can run it
    instructions: int | None = None  # of a Q30 tick on Cortex-M3
    is_one_element = False  # without a shape of its own
    is_by_speed = False  # Dahl's law with an Fc that depends on speed
    turns_as_dahl = False  # whether it is Dahl's law at a reversal, although Fc changes
    peaks_after_rest = False
    follows_load = False
    has_slip = False  # elements that lose no energy in presliding
    suits_few_cycles = False

    def __repr__(self) -> str:
        return self.name

    def __reduce__(self) -> tuple[Callable[[str], Law], tuple[str]]:
        return law_of, (self.name,)  # a copy and another process have the same object

    @property
    def elements(self) -> int:
        return len(self.stiffness)

    @property
    def parameters(self) -> int:
        """Nonlinear ones: a stiffness for each element, and the shape."""
        return self.elements + len(self.shape)

    @property
    def size(self) -> int:
        """Parameters beyond those of one Dahl element."""
        return 2 * (self.elements - 1) + len(self.shape)

    # --- fit ---

    def start(self, a: float) -> np.ndarray:
        """Return the start values of p from the a of Dahl's law."""
        shapes = [first for first, _, _ in self.shape]
        return np.array([*(np.log(a) + x for x in self.stiffness), *shapes], dtype=float)

    def starts_from_dahl(self, samples: Samples, moves: np.ndarray) -> bool:
        """Whether the log may show this law, and start() is near enough to it."""
        return True

    def ratios(self, samples: Samples, moves: np.ndarray, p: np.ndarray) -> Ratios:
        """F/Fc of each element after each move, from rest at the start of each piece."""
        return self.evaluate(samples, moves, *self._values(p))

    def evaluate(self, samples: Samples, moves: np.ndarray, a: Values, shape: Values) -> Ratios:
        """ratios() by numbers within their limits."""
        raise NotImplementedError

    def _values(self, p: np.ndarray) -> tuple[list[float], list[float]]:
        """a of each element and the shape, within their limits."""
        a = np.exp(np.clip(p[: self.elements], -MAX_LN_A, MAX_LN_A)).tolist()
        ends = zip(p[self.elements :], self.shape, strict=False)
        return a, [float(np.clip(x, low, high)) for x, (_, low, high) in ends]

    def _shape_of(self, p: np.ndarray) -> list[float]:
        shape: list[float] = p[self.elements : self.parameters].tolist()
        return shape

    # --- meaning ---

    def limit_range(self, samples: Samples, p: np.ndarray) -> tuple[float, float]:
        """Least and largest Fc in parts of the mean or fast Fc that the law states.

        The range covers both directions, and the speeds and rests of the log.
        """
        return 1.0, 1.0

    def rise_lengths(self, fit: Fitted) -> float:
        """Return the length of Dahl's law that rises as slowly from rest, up to 95 % of Fc, in
        parts of Fc/sigma0; at least 1.
        """
        return 1.0

    def mean_torque(self, fit: Fitted) -> float | None:
        """Return the mean of both directions, N m (N), which a fit puts into the offset."""
        return None

    def is_steepest_at_rest(self, p: np.ndarray) -> bool:
        """Whether the slope falls within the first parts of Fc, so that no log resolves it."""
        return False

    # --- export ---

    def parts(self, fit: Fitted) -> Parts:
        """Return the elements, each with its kind and parameters, by JSON keys."""
        own = {"sigma0": float(fit.slopes[0]), "Fc": float(fit.limits[0])}
        shapes = dict(zip(self.shape_names, self._shape_of(fit.p), strict=False))
        return [{"kind": self.kind or self.label, **own, **shapes}]

    def can_run(self, fit: Fitted, samples: Samples) -> bool:
        """Whether a firmware can run this fit by counts alone."""
        return self.in_library

    def runnable(self, fit: Fitted, samples: Samples) -> Runnable:
        """Return the friction as a firmware runs it, of a law that is in the library."""
        raise NotImplementedError


class PathLaw(Law):
    """A law whose torque depends on the path alone: on no time, load or direction."""

    def along(self, moves: np.ndarray, pieces: Pieces, a: Values, shape: Values) -> Ratios:
        """F/Fc of each element after each move."""
        raise NotImplementedError

    def evaluate(self, samples: Samples, moves: np.ndarray, a: Values, shape: Values) -> Ratios:
        return self.along(moves, samples.pieces, a, shape)

    def rise_lengths(self, fit: Fitted) -> float:
        share, a = fit.limits / fit.limits.sum(), np.exp(fit.p[: self.elements])
        u = np.geomspace(1e-3, 1e3, 2000)  # travel from rest in parts of Fc/sigma0
        moves, whole = np.diff(u, prepend=0.0) / float(share @ a), [slice(0, len(u))]
        each = self.along(moves, whole, a.tolist(), self._shape_of(fit.p))
        w = np.tensordot(share, each, axes=1)
        rising = (0 < w) & (w < 0.95)
        lengths = u[rising] / -np.log1p(-w[rising])
        return max(1.0, float(lengths.max(initial=1.0)))


class Sum(PathLaw):
    """Elements in parallel, of Dahl's law or springs that slip."""

    in_library = suits_few_cycles = True

    def __init__(
        self,
        name: str,
        kinds: Sequence[Element],
        stiffness: Sequence[float] = (0.0,),
        special_cases: tuple[Law, ...] = (),
    ) -> None:
        self.name, self.kinds, self.special_cases = name, tuple(kinds), special_cases
        self.stiffness, count, slips = tuple(stiffness), len(kinds), kinds.count(SLIP_ELEMENT)
        self.is_one_element, self.has_slip = count == 1, slips > 0
        kind = "slip" if slips == count else "mixed" if slips else "dahl"
        base, each = TICKS[kind]
        self.label = f"{'Dahl' if slips == 0 else kind} K={count}"
        self.option, self.instructions = f"{kind}-{count}", base + each * count
        if self.kinds == (DAHL_ELEMENT,):
            self.label, self.option, self.instructions = "Dahl", "dahl", DAHL_TICKS

    def starts_from_dahl(self, samples: Samples, moves: np.ndarray) -> bool:
        return self.is_one_element  # start.py finds the start of several

    def along(self, moves: np.ndarray, pieces: Pieces, a: Values, shape: Values) -> Ratios:
        return [kind.run(moves, pieces, x) for kind, x in zip(self.kinds, a, strict=True)]

    def parts(self, fit: Fitted) -> Parts:
        every = zip(self.kinds, fit.slopes.tolist(), fit.limits.tolist(), strict=True)
        return [{"kind": kind.name, "sigma0": slope, "Fc": Fc} for kind, slope, Fc in every]

    def runnable(self, fit: Fitted, samples: Samples) -> Runnable:
        is_mixed = DAHL_ELEMENT in self.kinds and self.elements > 1
        model = "parallel" if is_mixed else self.kinds[0].name
        sigma0, Fc = (tuple(x.tolist()) for x in (fit.slopes, fit.limits))  # noqa: N806
        return Runnable(model, self.kinds, sigma0, Fc)


def _spread(elements: int) -> list[float]:
    spread: list[float] = np.linspace(0.5, -0.5, elements).tolist()
    return spread


DAHL = Sum("dahl", [DAHL_ELEMENT])
SLIP = Sum("slip", [SLIP_ELEMENT])
SLIPS = {k: Sum(f"{k} slip", [SLIP_ELEMENT] * k, _spread(k), (SLIP,)) for k in (2, 3, 4)}
MIXED = Sum("mixed", [DAHL_ELEMENT, SLIP_ELEMENT], (0.0, 0.0), (DAHL, SLIP))


def _mixed(elements: int) -> Sum:
    """A Dahl element and several slip elements, fitted if a user asks for it."""
    kinds = [DAHL_ELEMENT, *[SLIP_ELEMENT] * (elements - 1)]
    return Sum(f"mixed {elements}", kinds, [0.0, *_spread(elements - 1)], (MIXED,))


class AsymmetricLaw(Law):
    """Dahl's law with Fc (1 + skew) forward and Fc (1 - skew) backward."""

    name = label = option = "asymmetric"
    special_cases = (DAHL,)
    shape = ((0.05, -0.9, 0.9),)
    in_library = turns_as_dahl = True
    instructions = ASYMMETRIC_TICKS

    def evaluate(self, samples: Samples, moves: np.ndarray, a: Values, shape: Values) -> Ratios:
        return [models.asymmetric(moves, samples.pieces, a[0], shape[0])]

    def limit_range(self, samples: Samples, p: np.ndarray) -> tuple[float, float]:
        _, (skew,) = self._values(p)
        return 1 - abs(skew), 1 + abs(skew)

    def mean_torque(self, fit: Fitted) -> float | None:
        return float(fit.limits[0] * fit.p[1])

    def parts(self, fit: Fitted) -> Parts:
        ways = dict(zip(("Fc_forward", "Fc_backward"), self._limits(fit), strict=True))
        return [{"kind": self.name, "sigma0": float(fit.slopes[0]), **ways}]

    def runnable(self, fit: Fitted, samples: Samples) -> Runnable:
        return Asymmetric(self.name, (), tuple(fit.slopes.tolist()), self._limits(fit))

    def _limits(self, fit: Fitted) -> tuple[float, float]:
        """Fc forward and backward, N m (N)."""
        return float(fit.limits[0] * (1 + fit.p[1])), float(fit.limits[0] * (1 - fit.p[1]))


class LoadedLaw(Law):
    """Dahl's law with sigma0 and Fc times 1 + slope (load / reference - 1)."""

    name = label = "loaded"
    special_cases = (DAHL,)
    shape = ((0.5, -20.0, 20.0),)
    in_library = is_one_element = follows_load = suits_few_cycles = True

    def starts_from_dahl(self, samples: Samples, moves: np.ndarray) -> bool:
        return False  # it is fitted beside Dahl's law

    def evaluate(self, samples: Samples, moves: np.ndarray, a: Values, shape: Values) -> Ratios:
        share = np.maximum(self._shares(samples, shape[0]), MIN_SHARE)
        return [models.dahl_under_load(moves, samples.pieces, a[0], share)]

    def _shares(self, samples: Samples, slope: float) -> np.ndarray:
        """sigma0 and Fc of each sample in parts of those at the reference load: (n,)."""
        assert samples.load is not None  # the law is fitted to logs with a load only
        shares: np.ndarray = 1 + slope * (samples.load / samples.reference.load - 1)
        return shares

    def runnable(self, fit: Fitted, samples: Samples) -> Runnable:
        """The plan is for the largest load."""
        slope = float(fit.p[1])
        most = float(self._shares(samples, slope).max())
        load = (1 - slope) / most, slope / samples.reference.load / most
        sigma0, Fc = (tuple((x * most).tolist()) for x in (fit.slopes, fit.limits))  # noqa: N806
        return Runnable(self.name, (DAHL_ELEMENT,), sigma0, Fc, load)


# --- curves of one shape parameter ----------------------------------------------------------------


class Curve(PathLaw):
    """A law dw/du = slope(s w) of one shape parameter."""

    special_cases: tuple[Law, ...] = (DAHL,)

    def slope(self, gap: np.ndarray, shape: float) -> np.ndarray:
        """dw/du at 1 - s w = gap."""
        raise NotImplementedError

    def starts_from_dahl(self, samples: Samples, moves: np.ndarray) -> bool:
        return len(models.strokes(moves)[0]) < MAX_STROKES

    def along(self, moves: np.ndarray, pieces: Pieces, a: Values, shape: Values) -> Ratios:
        return [models.by_strokes(moves, pieces, a[0], *_travel_table(self, round(shape[0], 6)))]


@lru_cache(maxsize=64)
def _travel_table(law: Curve, shape: float) -> tuple[np.ndarray, np.ndarray]:
    return models.travel_table(lambda gap: law.slope(gap, shape))


class Exponent(Curve):
    """Dahl's model of 1968."""

    name, label = "exponent", "general exponent"
    shape = ((1.0, 0.05, 6.0),)
    shape_names = ("exponent",)
    special_cases = (DAHL, SLIP)

    def slope(self, gap: np.ndarray, shape: float) -> np.ndarray:
        slope: np.ndarray = gap**shape
        return slope


class BoucWen(Curve):
    name, label = "bouc-wen", "Bouc-Wen"
    shape = ((1.3, 0.05, 6.0),)

    def slope(self, gap: np.ndarray, shape: float) -> np.ndarray:
        y = 1 - gap
        slope: np.ndarray = 1 - np.sign(y) * np.abs(y) ** shape
        return slope

    def is_steepest_at_rest(self, p: np.ndarray) -> bool:
        return float(p[1]) < MIN_BOUC_WEN


class SoftShaft(Curve):
    """Dahl's law in series with a spring of `shape` of the compliance."""

    name = label = "soft shaft"
    shape = ((0.05, -0.5, 0.6),)

    def slope(self, gap: np.ndarray, shape: float) -> np.ndarray:
        slope: np.ndarray = gap / (1 - shape + shape * gap)
        return slope


# --- laws whose Fc changes by speed or rest -------------------------------------------------------


class Limits(Law):
    """Dahl's law with an Fc of 1 + strength change(); strength is the first shape parameter."""

    kind = "limits"
    special_cases = (DAHL,)
    turns_as_dahl = True

    def change(self, samples: Samples, a: float, shape: Values) -> np.ndarray:
        """The form of the change over the samples: (n,)."""
        raise NotImplementedError

    def evaluate(self, samples: Samples, moves: np.ndarray, a: Values, shape: Values) -> Ratios:
        limits = self._limits(samples, a[0], shape)
        return [models.dahl_with_limits(moves, samples.pieces, a[0], limits)]

    def _limits(self, samples: Samples, a: float, shape: Values) -> np.ndarray:
        """Fc of each sample, in parts of Fc: (n,)."""
        limits: np.ndarray = np.maximum(1 + shape[0] * self.change(samples, a, shape), MIN_LIMIT)
        return limits

    def limit_range(self, samples: Samples, p: np.ndarray) -> tuple[float, float]:
        (a,), shape = self._values(p)
        limits = self._limits(samples, a, shape)
        return min(float(limits.min()), 1.0), max(float(limits.max()), 1.0)


class Stribeck(Limits):
    """More Fc if slow."""

    name = option = "stribeck"
    label = "Stribeck"
    shape = ((0.2, -0.9, 10.0), (float(np.log(0.15)), -6.0, 3.0))
    least = MIN_PEAK
    is_by_speed = in_library = True
    instructions = STRIBECK_TICKS

    def change(self, samples: Samples, a: float, shape: Values) -> np.ndarray:
        slow = samples.reference.fast * np.exp(shape[1])
        change: np.ndarray = np.exp(-((samples.speed / slow) ** 2))
        return change

    def can_run(self, fit: Fitted, samples: Samples) -> bool:
        return self._travel(fit, samples) >= MIN_STRIBECK_COUNTS * samples.count

    def runnable(self, fit: Fitted, samples: Samples) -> StribeckElement:
        _, (strength, _) = self._values(fit.p)
        fast = float(fit.limits[0])
        limits, own = (fast * (1 + strength), fast), self._travel(fit, samples)
        sigma0, period = (float(fit.slopes[0]),), self._period(samples) if samples.timed else 0.0
        return StribeckElement(self.name, (), sigma0, limits, own=own, period=period)

    def _period(self, samples: Samples) -> float:
        """s, from row to row."""
        return float(np.median(np.diff(samples.time[samples.pieces[0]]))) / samples.block

    def _travel(self, fit: Fitted, samples: Samples) -> float:
        """rad (m), of a row at the Stribeck speed."""
        _, (_, ln_slow) = self._values(fit.p)
        return samples.reference.fast * math.exp(ln_slow) * self._period(samples)


class LogSpeed(Limits):
    """Dry contacts: Fc changes by a few per cent for each factor e of speed (rate and state)."""

    name, label = "log speed", "logarithm of speed"
    shape = ((0.03, -0.3, 0.3),)
    is_by_speed = True

    def change(self, samples: Samples, a: float, shape: Values) -> np.ndarray:
        reference = samples.reference
        speed = np.maximum(np.abs(samples.speed), MIN_LOG_SPEED * reference.fast)
        change: np.ndarray = np.log(speed / reference.mean_speed)
        return change


class Breakaway(Limits):
    """Contacts that age at rest: more Fc, until a few presliding lengths have renewed them."""

    name = label = "breakaway"
    shape = ((0.1, -0.5, 5.0), (float(np.log(2.0)), -1.0, 2.0))
    least = MIN_PEAK
    peaks_after_rest = True

    def starts_from_dahl(self, samples: Samples, moves: np.ndarray) -> bool:
        return samples.has_rests

    def change(self, samples: Samples, a: float, shape: Values) -> np.ndarray:
        change: np.ndarray = np.exp(-a * samples.travel_since_rest() / np.exp(shape[1]))
        return change


# --- all laws -------------------------------------------------------------------------------------

LAWS: dict[str, Law] = {
    law.name: law
    for law in (
        DAHL,
        SLIP,
        *SLIPS.values(),
        Sum("2 dahl", [DAHL_ELEMENT, DAHL_ELEMENT], (0.7, -0.5), (DAHL,)),
        MIXED,
        *map(_mixed, (3, 4)),
        AsymmetricLaw(),
        LoadedLaw(),
        Exponent(),
        BoucWen(),
        SoftShaft(),
        Stribeck(),
        LogSpeed(),
        Breakaway(),
    )
}


def law_of(name: str) -> Law:
    return LAWS[name]


# laws by the names of --model; Coulomb's is no law of a fit, so that it exports the nearest one
OPTIONS: dict[str, Law | None] = {law.option: law for law in LAWS.values() if law.option}
OPTIONS["coulomb"] = None
