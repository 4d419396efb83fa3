# SPDX-License-Identifier: MIT
"""Exact torque ratios, without code or formulas of the library.

The library steps from tick to tick by a recursion in integers. This module solves Eq. 1 in closed
form from one reversal to the next (Eqs. 7, 18, 27 of the paper). With w1 = F/Fc at the last
reversal and x the travel since then, in direction s,

    w = s - (s - w1)*exp(-a*x)

in 100 bits, so that its error is far below a float. Parameters are exact fractions of the given
floats. All ratios start at rest.
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

PRECISION_BITS = 100


def travel_per_count(sigma0: float, Fc: float, theta_per_count: float) -> Fraction:  # noqa: N803
    """Return sigma0/Fc*theta_per_count exactly, for parameters rounded to float first, as in C."""
    return _as_in_c(sigma0) * _as_in_c(theta_per_count) / _as_in_c(Fc)


def _as_in_c(value: float) -> Fraction:
    """Return a parameter rounded to float."""
    return Fraction(float(np.float32(value)))


def _mpf(fraction: Fraction) -> mpmath.mpf:
    return mpmath.mpf(fraction.numerator) / fraction.denominator


def exact_ratios(moves: Iterable[int], travel: Fraction) -> list[mpmath.mpf]:
    """Return F/Fc after each move in counts; `travel` is the travel of one count."""
    with mpmath.workprec(PRECISION_BITS):
        a = _mpf(travel)

        def after(anchor: mpmath.mpf, run: int, s: int) -> mpmath.mpf:
            return s - (s - anchor) * mpmath.exp(-a * run)

        return list(_from_reversals(moves, after))


def exact_slip_ratios(
    moves: Iterable[int],
    elements: Sequence[tuple[float, float]],
    theta_per_count: float,
) -> list[mpmath.mpf]:
    """Return F over the sum of Fc after each move in counts, of slip elements (sigma0 [N m/rad],
    Fc [N m]).
    """
    theta = _as_in_c(theta_per_count)
    springs = [(_as_in_c(sigma0) * theta, _as_in_c(torque)) for sigma0, torque in elements]
    force = [Fraction(0)] * len(springs)
    total = sum((most for _, most in springs), Fraction(0))
    ratios = []
    with mpmath.workprec(PRECISION_BITS):
        for move in map(int, moves):
            force = [
                max(-most, min(most, now + per_count * move))
                for now, (per_count, most) in zip(force, springs, strict=True)
            ]
            ratio = sum(force, Fraction(0)) / total
            ratios.append(_mpf(ratio))
    return ratios


def exact_parallel_ratios(
    moves: Collection[int] | np.ndarray,
    elements: Sequence[tuple[float, float]],
    kinds: Sequence[str],
    theta_per_count: float,
) -> list[mpmath.mpf]:
    """Return F over the sum of Fc after each move in counts, of elements (sigma0, Fc) whose kind is
    dahl or slip.
    """
    total = sum(_as_in_c(torque) for _, torque in elements)
    with mpmath.workprec(PRECISION_BITS):
        sums = [mpmath.mpf(0)] * len(moves)
        for (sigma0, torque), kind in zip(elements, kinds, strict=True):
            share = _as_in_c(torque) / total
            if kind == "slip":
                ratios = exact_slip_ratios(moves, [(sigma0, torque)], theta_per_count)
            else:
                ratios = exact_ratios(moves, travel_per_count(sigma0, torque, theta_per_count))
            sums = [now + _mpf(share) * ratio for now, ratio in zip(sums, ratios, strict=True)]
        return sums


def exact_asymmetric_ratios(
    moves: Iterable[int],
    elements: Sequence[tuple[float, float]],
    theta_per_count: float,
) -> list[mpmath.mpf]:
    """Return F over the larger Fc after each move in counts; elements: (sigma0, Fc) forward and
    backward. In direction s, the distance to s Fc of that direction decays as
    exp(-sigma0/Fc theta).
    """
    torques = [mpmath.mpf(float(np.float32(torque))) for _, torque in elements]
    with mpmath.workprec(PRECISION_BITS):
        travels = [travel_per_count(*element, theta_per_count) for element in elements]
        a = [_mpf(travel) for travel in travels]

        def after(anchor: mpmath.mpf, run: int, s: int) -> mpmath.mpf:
            end, rate = (torques[0], a[0]) if s > 0 else (-torques[1], a[1])
            return end - (end - anchor) * mpmath.exp(-rate * run)

        return [torque / max(torques) for torque in _from_reversals(moves, after)]


def exact_elastoplastic_ratios(
    moves: Iterable[int], travel: Fraction, breakaway: float
) -> list[mpmath.mpf]:
    """Return F/Fc after each move in counts: in direction s a spring up to s b; beyond it the
    distance to s decays as exp(-u/(1 - b)).
    """
    with mpmath.workprec(PRECISION_BITS):
        b = mpmath.mpf(float(np.float32(breakaway)))
        a = _mpf(travel)

        def after(anchor: mpmath.mpf, run: int, s: int) -> mpmath.mpf:
            x, u = s * anchor, a * run
            elastic = max(mpmath.mpf(0), min(u, b - x))
            x += elastic
            return s * (1 - (1 - x) * mpmath.exp(-(u - elastic) / (1 - b)))

        return list(_from_reversals(moves, after))


def exact_stribeck_ratios(
    moves: Iterable[int], elements: Sequence[tuple[float, float]], theta: float, stribeck: float
) -> list[mpmath.mpf]:
    """Return F over the larger limit after each move of one tick in counts; elements: (sigma0, Fs)
    and (sigma0, Fc). In a move, the distance to s f decays as exp(-sigma0/f theta), with the limit
    f = Fc + (Fs - Fc) exp(-(|move| theta/stribeck)^2).
    """
    ratios = []
    with mpmath.workprec(PRECISION_BITS):
        sigma0 = _mpf(_as_in_c(elements[0][0]))
        slow, fast = (_mpf(_as_in_c(torque)) for _, torque in elements)
        count, of_speed = _mpf(_as_in_c(theta)), _mpf(_as_in_c(stribeck))
        torque = mpmath.mpf(0)
        for travel in (int(move) * count for move in moves):
            limit = fast + (slow - fast) * mpmath.exp(-((travel / of_speed) ** 2))
            end = mpmath.sign(travel) * limit
            torque = end - (end - torque) * mpmath.exp(-sigma0 / limit * abs(travel))
            ratios.append(torque / max(slow, fast))
    return ratios


def exact_loaded_ratios(
    moves: Iterable[int], loads: Iterable[Fraction], travel: Fraction
) -> list[mpmath.mpf]:
    """Return F/Fc after each move. Fc and sigma0 are proportional to a load c, given for each move.
    If the load falls, w = F/(c Fc) stays; if it grows, F stays.
    """
    ratios, before = [], Fraction(0)
    with mpmath.workprec(PRECISION_BITS):
        w, a = mpmath.mpf(0), _mpf(travel)
        for move, load in zip(moves, loads, strict=True):
            if load > before:
                w *= _mpf(before / load)
            before, s = load, 1 if move > 0 else -1
            w = s - (s - w) * mpmath.exp(-a * abs(int(move)))
            ratios.append(w * _mpf(load))
    return ratios


EXACT: dict[str, Callable[[Scene, Moves, Iterable[Fraction]], list[mpmath.mpf]]] = {
    "dahl": lambda scene, moves, _: exact_ratios(moves, _travel(scene)),
    "slip": lambda scene, moves, _: exact_slip_ratios(moves, scene.elements, scene.theta_per_count),
    "parallel": lambda scene, moves, _: exact_parallel_ratios(
        moves, scene.elements, scene.own, scene.theta_per_count
    ),
    "loaded": lambda scene, moves, loads: exact_loaded_ratios(moves, loads, _travel(scene)),
    "elastoplastic": lambda scene, moves, _: exact_elastoplastic_ratios(
        moves, _travel(scene), scene.own
    ),
    "asymmetric": lambda scene, moves, _: exact_asymmetric_ratios(
        moves, scene.elements, scene.theta_per_count
    ),
    "stribeck": lambda scene, moves, _: exact_stribeck_ratios(
        moves, scene.elements, scene.theta_per_count, scene.own
    ),
}  # torque ratio after each move, from rest, by the name of the model; loads as fractions of 1


def _travel(scene: Scene) -> Fraction:
    return travel_per_count(scene.sigma0, scene.Fc, scene.theta_per_count)


def _from_reversals(
    moves: Iterable[int], after: Callable[[mpmath.mpf, int, int], mpmath.mpf]
) -> Iterable[mpmath.mpf]:
    """Yield after(torque at the last reversal, counts since then, direction) for each move,
    from 0.
    """
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
    """Return abs(torque - exact*Fc) in ulp of Fc, shape (n,), for torques in N m, shape (n,),
    float32.
    """
    most = float(np.float32(Fc))
    ulp = float(np.spacing(np.float32(Fc)))
    with mpmath.workprec(PRECISION_BITS):
        errors = [
            abs(float(got) - want * most) / ulp for got, want in zip(torque, exact, strict=True)
        ]
        return np.array([float(error) for error in errors])


def received_torque(ratio_q30: np.ndarray, Fc: float) -> np.ndarray:  # noqa: N803
    """Return F = ratio*Fc rounded once to float, as a receiver of FrictionTorque computes it:
    N m, float32, shape (n,), for ratios in Q30, int, shape (n,).

    The product can need 54 bits, one more than a double has. It is therefore rounded to odd first.
    """
    mantissa, exponent = np.frexp(np.float64(np.float32(Fc)))
    product = np.asarray(ratio_q30, dtype=np.int64) * np.int64(mantissa * 2**24)
    sticky = (product >> 1) | (product & 1)  # 54 bits to 53, rounded to odd
    return np.ldexp(sticky.astype(np.float64), int(exponent) - 53).astype(np.float32)
