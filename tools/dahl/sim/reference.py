# SPDX-License-Identifier: MIT
"""An exact answer that shares no code and no formula with the library.

The library goes from tick to tick by a recursion in integers. Here Eq. 1 is solved in closed form
from one reversal to the next (the paper's Eqs. 7, 18, 27, for any number of reversals): with w1 =
F/Fc at the last reversal and x the travel since then, in direction s,

    w = s - (s - w1)*exp(-a*x)

in 100 bits, so that its own error is beyond what a float can show. Parameters are exact fractions
of the floats given.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, TypeAlias

import mpmath
import numpy as np

if TYPE_CHECKING:
    from dahl.sim.scene import Scene

    Moves: TypeAlias = Collection[int] | np.ndarray  # counts

PRECISION = 100  # bits


def travel_per_count(sigma0: float, Fc: float, theta_per_count: float) -> Fraction:  # noqa: N803
    """a*theta_per_count, exactly, for parameters that are rounded to float first as in C."""
    stiffness, most, theta = (
        Fraction(float(np.float32(value))) for value in (sigma0, Fc, theta_per_count)
    )
    return stiffness * theta / most


def exact_ratios(moves: Iterable[int], travel: Fraction) -> list[mpmath.mpf]:
    """F/Fc after each move in counts, from rest, as mpmath numbers; `travel` is the travel of one
    count.
    """
    with mpmath.workprec(PRECISION):
        a = mpmath.mpf(travel.numerator) / travel.denominator

        def after(anchor: mpmath.mpf, run: int, s: int) -> mpmath.mpf:
            return s - (s - anchor) * mpmath.exp(-a * run)

        return list(_from_reversals(moves, after))


def exact_slip_ratios(
    moves: Iterable[int],
    elements: Sequence[tuple[float, float]],
    theta_per_count: float,
) -> list[mpmath.mpf]:
    """F over the sum of Fc after each move in counts, from rest: springs (sigma0, Fc) that slip, in
    exact fractions of the floats given.
    """
    theta = Fraction(float(np.float32(theta_per_count)))
    springs = [
        (Fraction(float(np.float32(sigma0))) * theta, Fraction(float(np.float32(torque))))
        for sigma0, torque in elements
    ]
    force = [Fraction(0)] * len(springs)
    total = sum((most for _, most in springs), Fraction(0))
    ratios = []
    with mpmath.workprec(PRECISION):
        for move in map(int, moves):
            force = [
                max(-most, min(most, now + per_count * move))
                for now, (per_count, most) in zip(force, springs, strict=True)
            ]
            ratio = sum(force, Fraction(0)) / total
            ratios.append(mpmath.mpf(ratio.numerator) / ratio.denominator)
    return ratios


def exact_parallel_ratios(
    moves: Collection[int] | np.ndarray,
    elements: Sequence[tuple[float, float]],
    kinds: Sequence[str],
    theta_per_count: float,
) -> list[mpmath.mpf]:
    """F over the sum of Fc after each move in counts, from rest: elements (sigma0, Fc) that are of
    Dahl's kind, or slip.
    """
    total = sum(Fraction(float(np.float32(torque))) for _, torque in elements)
    with mpmath.workprec(PRECISION):
        sums = [mpmath.mpf(0)] * len(moves)
        for (sigma0, torque), kind in zip(elements, kinds, strict=True):
            share = Fraction(float(np.float32(torque))) / total
            if kind == "slip":
                ratios = exact_slip_ratios(moves, [(sigma0, torque)], theta_per_count)
            else:
                ratios = exact_ratios(moves, travel_per_count(sigma0, torque, theta_per_count))
            part = mpmath.mpf(share.numerator) / share.denominator
            sums = [now + part * ratio for now, ratio in zip(sums, ratios, strict=True)]
        return sums


def exact_asymmetric_ratios(
    moves: Iterable[int],
    elements: Sequence[tuple[float, float]],
    theta_per_count: float,
) -> list[mpmath.mpf]:
    """F over the larger Fc after each move in counts, from rest; elements: (sigma0, Fc) forward and
    backward. In direction s it falls off to s Fc of that direction as exp(-sigma0/Fc theta).
    """
    torques = [mpmath.mpf(float(np.float32(torque))) for _, torque in elements]
    with mpmath.workprec(PRECISION):
        travels = [travel_per_count(*element, theta_per_count) for element in elements]
        a = [mpmath.mpf(travel.numerator) / travel.denominator for travel in travels]

        def after(anchor: mpmath.mpf, run: int, s: int) -> mpmath.mpf:
            end, rate = (torques[0], a[0]) if s > 0 else (-torques[1], a[1])
            return end - (end - anchor) * mpmath.exp(-rate * run)

        return [torque / max(torques) for torque in _from_reversals(moves, after)]


def exact_elastoplastic_ratios(
    moves: Iterable[int], travel: Fraction, breakaway: float
) -> list[mpmath.mpf]:
    """F/Fc after each move in counts, from rest: in direction s it grows as a spring's up to s b,
    and what is left of it to s then falls off as exp(-u/(1 - b)).
    """
    with mpmath.workprec(PRECISION):
        b = mpmath.mpf(float(np.float32(breakaway)))
        a = mpmath.mpf(travel.numerator) / travel.denominator

        def after(anchor: mpmath.mpf, run: int, s: int) -> mpmath.mpf:
            x, u = s * anchor, a * run
            elastic = max(mpmath.mpf(0), min(u, b - x))
            x += elastic
            return s * (1 - (1 - x) * mpmath.exp(-(u - elastic) / (1 - b)))

        return list(_from_reversals(moves, after))


def exact_loaded_ratios(
    moves: Iterable[int], loads: Iterable[Fraction], travel: Fraction
) -> list[mpmath.mpf]:
    """F/Fc after each move, of Dahl's model whose Fc and sigma0 are in proportion to a load c, told
    anew with each move: w = F/(c Fc) stays where the load falls, F where it grows.
    """
    ratios, before = [], Fraction(0)
    with mpmath.workprec(PRECISION):
        w, a = mpmath.mpf(0), mpmath.mpf(travel.numerator) / travel.denominator
        for move, load in zip(moves, loads, strict=True):
            if load > before:
                w = w * before.numerator * load.denominator / (before.denominator * load.numerator)
            before, s = load, 1 if move > 0 else -1
            w = s - (s - w) * mpmath.exp(-a * abs(int(move)))
            ratios.append(w * load.numerator / load.denominator)
    return ratios


def _dahl(scene: Scene, moves: Moves, _: Iterable[Fraction]) -> list[mpmath.mpf]:
    return exact_ratios(moves, _travel(scene))


def _slip(scene: Scene, moves: Moves, _: Iterable[Fraction]) -> list[mpmath.mpf]:
    return exact_slip_ratios(moves, scene.elements, scene.theta_per_count)


def _parallel(scene: Scene, moves: Moves, _: Iterable[Fraction]) -> list[mpmath.mpf]:
    return exact_parallel_ratios(moves, scene.elements, scene.kinds, scene.theta_per_count)


def _asymmetric(scene: Scene, moves: Moves, _: Iterable[Fraction]) -> list[mpmath.mpf]:
    return exact_asymmetric_ratios(moves, scene.elements, scene.theta_per_count)


def _elastoplastic(scene: Scene, moves: Moves, _: Iterable[Fraction]) -> list[mpmath.mpf]:
    return exact_elastoplastic_ratios(moves, _travel(scene), scene.breakaway)


def _loaded(scene: Scene, moves: Moves, loads: Iterable[Fraction]) -> list[mpmath.mpf]:
    return exact_loaded_ratios(moves, loads, _travel(scene))


EXACT: dict[str, Callable[[Scene, Moves, Iterable[Fraction]], list[mpmath.mpf]]] = {
    "dahl": _dahl,
    "slip": _slip,
    "parallel": _parallel,
    "asymmetric": _asymmetric,
    "elastoplastic": _elastoplastic,
    "loaded": _loaded,
}  # torque ratio after each move, from rest, by the name of the model; loads as fractions of 1


def _travel(scene: Scene) -> Fraction:
    return travel_per_count(scene.sigma0, scene.Fc, scene.theta_per_count)


def _from_reversals(
    moves: Iterable[int], after: Callable[[mpmath.mpf, int, int], mpmath.mpf]
) -> Iterable[mpmath.mpf]:
    """after(torque at the last reversal, counts since then, direction), move by move, from 0."""
    torque = anchor = mpmath.mpf(0)
    direction, run = 0, 0
    for move in map(int, moves):
        sign = (move > 0) - (move < 0)
        if sign and sign != direction:
            anchor, direction, run = torque, sign, 0
        if sign:
            run += abs(move)
            torque = after(anchor, run, sign)
        yield torque


def error_in_ulp(torque: np.ndarray, exact: list[mpmath.mpf], Fc: float) -> np.ndarray:  # noqa: N803
    """abs(torque - exact*Fc) in ulp of Fc: shape (n,) float32 N m, n numbers F/Fc -> shape (n,)."""
    most = float(np.float32(Fc))
    ulp = float(np.spacing(np.float32(Fc)))
    with mpmath.workprec(PRECISION):
        errors = [
            abs(float(got) - want * most) / ulp for got, want in zip(torque, exact, strict=True)
        ]
        return np.array([float(error) for error in errors])


def received_torque(ratio_q30: np.ndarray, Fc: float) -> np.ndarray:  # noqa: N803
    """What a receiver of FrictionTorque computes: F = ratio*Fc, rounded once to float. Shape (n,)
    int -> float32 N m.

    The product of 31 and 24 bits can need one bit more than a double has: the integer part is
    rounded to odd first.
    """
    mantissa, exponent = np.frexp(np.float64(np.float32(Fc)))
    product = np.asarray(ratio_q30, dtype=np.int64) * np.int64(mantissa * 2**24)
    sticky = (product >> 1) | (product & 1)  # 54 bits -> 53, the bit that falls off is remembered
    return np.ldexp(sticky.astype(np.float64), int(exponent) - 53).astype(np.float32)
