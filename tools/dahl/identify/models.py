# SPDX-License-Identifier: MIT
"""Friction laws on a path of angles, and what each law means by sigma0 and Fc.

A law returns F/Fc after each move, from rest at the first row of each piece. Moves have shape (n,)
in rad (m); `a` = sigma0/Fc in 1/rad (1/m). For every law, sigma0 is the slope dF/dtheta at rest and
Fc is the torque at full slip. Time appears in two laws only: Fc of "stribeck" and "log speed"
depends on speed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg.lapack import dtbtrs

from dahl.binding.throughput import Throughput

Pieces = Sequence[slice]  # rows of each uninterrupted recording
MAX_STROKES = 250  # above it, laws that are evaluated stroke by stroke would cost seconds

LABELS = {
    "dahl": "Dahl",
    "2 dahl": "Dahl K=2",
    "bouc-wen": "Bouc-Wen",
    "exponent": "general exponent",
    "log speed": "logarithm of speed",
    "stribeck": "Stribeck",
}


@dataclass(frozen=True)
class Law:
    """One friction law with the start values of its nonlinear parameters.

    `stiffness` has the start of ln(a / a_dahl) for each element. `shape` has (start, low, high) of
    each further parameter.
    """

    name: str
    kinds: tuple[str, ...]  # dahl or slip for each element
    stiffness: tuple[float, ...] = (0.0,)
    shape: tuple[tuple[float, float, float], ...] = ()
    special_cases: tuple[str, ...] = ()  # laws that this one contains
    in_library: bool = False  # whether a firmware can run it

    @property
    def elements(self) -> int:
        return len(self.kinds)

    @property
    def label(self) -> str:
        """Name in reports."""
        if self.kinds[0] == "slip":
            return f"slip K={self.elements}"
        if self.name.startswith("mixed"):
            return f"mixed K={self.elements}"
        return LABELS.get(self.name, self.name)

    @property
    def parameters(self) -> int:
        """Nonlinear ones: a stiffness for each element, and the shape."""
        return self.elements + len(self.shape)

    @property
    def size(self) -> int:
        """Parameters beyond those of one Dahl element."""
        return 2 * (self.elements - 1) + len(self.shape)


def slip_law(elements: int) -> Law:
    """Maxwell slip: `elements` springs in parallel that slip."""
    name = "slip" if elements == 1 else f"{elements} slip"
    stiffness = (0.0,) if elements == 1 else tuple(np.linspace(0.5, -0.5, elements).tolist())
    special = ("slip",) if elements > 1 else ()
    return Law(name, ("slip",) * elements, stiffness, special_cases=special, in_library=True)


def mixed_law(elements: int) -> Law:
    """A Dahl element and slip elements. With more than two it is fitted if a user asks for it."""
    stiffness = (0.0, *np.linspace(0.5, -0.5, elements - 1).tolist())
    kinds = ("dahl", *("slip",) * (elements - 1))
    return Law(f"mixed {elements}", kinds, stiffness, special_cases=("mixed",), in_library=True)


ONE_ELEMENT = {"dahl", "slip", "loaded"}  # laws without a shape of their own
BY_SPEED = {"stribeck", "log speed"}  # Dahl's law with an Fc that depends on speed

OPTIONS = {  # law by the name of --model
    "dahl": "dahl",
    "slip-1": "slip",
    **{f"slip-{elements}": f"{elements} slip" for elements in (2, 3, 4)},
    "dahl-2": "2 dahl",
    "mixed-2": "mixed",
    **{f"mixed-{elements}": f"mixed {elements}" for elements in (3, 4)},
    "asymmetric": "asymmetric",
    "coulomb": "coulomb",
}

LAWS = {
    law.name: law
    for law in (
        Law("dahl", ("dahl",), in_library=True),
        *(slip_law(elements) for elements in (1, 2, 3, 4)),
        Law("2 dahl", ("dahl", "dahl"), (0.7, -0.5), special_cases=("dahl",), in_library=True),
        Law("mixed", ("dahl", "slip"), (0.0, 0.0), special_cases=("dahl", "slip"), in_library=True),
        *(mixed_law(elements) for elements in (3, 4)),
        Law(
            "asymmetric",
            ("asymmetric",),
            shape=((0.05, -0.9, 0.9),),
            special_cases=("dahl",),
            in_library=True,
        ),
        Law(
            "loaded",
            ("loaded",),
            shape=((0.5, -20.0, 20.0),),
            special_cases=("dahl",),
            in_library=True,
        ),
        Law("exponent", ("table",), shape=((1.0, 0.05, 6.0),), special_cases=("dahl", "slip")),
        Law("bouc-wen", ("table",), shape=((1.3, 0.05, 6.0),), special_cases=("dahl",)),
        Law("soft shaft", ("table",), shape=((0.05, -0.5, 0.6),), special_cases=("dahl",)),
        Law(
            "stribeck",
            ("limits",),
            shape=((0.2, -0.9, 10.0), (float(np.log(0.15)), -6.0, 3.0)),
            special_cases=("dahl",),
        ),
        # dry contacts: Fc changes by a few per cent for each factor e of speed (rate and state)
        Law("log speed", ("limits",), shape=((0.03, -0.3, 0.3),), special_cases=("dahl",)),
        Law(  # contacts that age at rest: more Fc, until a few presliding lengths have renewed them
            "breakaway",
            ("limits",),
            shape=((0.1, -0.5, 5.0), (float(np.log(2.0)), -1.0, 2.0)),
            special_cases=("dahl",),
        ),
    )
}


def dahl(moves: np.ndarray, pieces: Pieces, a: float) -> np.ndarray:
    """Dahl's law by the exact step of the C library."""
    step = Throughput(a, 1.0, 0.0)
    return np.concatenate([step.run(moves[rows], 0.0) for rows in pieces]).astype(float)


def dahl_with_limits(moves: np.ndarray, pieces: Pieces, a: float, limits: np.ndarray) -> np.ndarray:
    """Dahl's law with Fc `limits` times as large at each row (n,) and a constant sigma0."""
    kept = np.exp(-a * np.abs(moves) / limits)
    return _affine_steps(kept, np.sign(moves) * limits * (1 - kept), pieces)


def dahl_under_load(moves: np.ndarray, pieces: Pieces, a: float, share: np.ndarray) -> np.ndarray:
    """Dahl's law with Fc and sigma0 both `share` times as large at each row (n,).

    F falls with a falling load and is kept when the load grows, as in dahl_loaded_step_counts().
    """
    left = np.exp(-a * np.abs(moves))
    before = np.concatenate((share[:1], share[:-1]))
    kept = left * np.minimum(share / before, 1.0)
    return _affine_steps(kept, share * np.sign(moves) * (1 - left), pieces)


def asymmetric(moves: np.ndarray, pieces: Pieces, a: float, skew: float) -> np.ndarray:
    """Dahl's law with Fc (1 + skew) forward and Fc (1 - skew) backward and one sigma0.

    Returns the symmetric part w of F = Fc (skew + w). The constant part belongs to the offset.
    """
    return dahl(np.where(moves > 0, moves / (1 + skew), moves / (1 - skew)), pieces, a)


def _affine_steps(kept: np.ndarray, added: np.ndarray, pieces: Pieces) -> np.ndarray:
    """Solve F_i = kept_i F_(i-1) + added_i from F = 0, as one bidiagonal system."""
    band = np.ones((2, len(kept)))
    band[1, :-1] = -kept[1:]
    for rows in pieces:
        if rows.start:
            band[1, rows.start - 1] = 0.0
    solved: np.ndarray = dtbtrs(band, added[:, None], uplo="L", diag="U")[0][:, 0]
    return solved


def strokes(moves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first row of each stroke, and its direction (+1 or -1)."""
    moving = np.flatnonzero(moves)
    if len(moving) == 0:
        return np.zeros(1, dtype=int), np.ones(1)
    direction = np.sign(moves[moving])
    turns = np.flatnonzero(np.diff(direction)) + 1
    return np.append(0, moving[turns]), direction[np.append(0, turns)]


def slip(moves: np.ndarray, pieces: Pieces, a: float) -> np.ndarray:
    """A spring that slips at Fc: within one stroke it is a line from -1 to 1."""
    return _by_strokes(moves, pieces, a, np.array([-1.0, 1.0]), np.array([0.0, 2.0]))


def behind_play(theta: np.ndarray, pieces: Pieces, width: float) -> np.ndarray:
    """The angle behind a play of `width` rad (m), which starts in the middle of the play."""
    half = max(width, 1e-12) / 2
    moves = np.diff(theta, prepend=theta[:1])
    moves[[rows.start for rows in pieces]] = 0.0
    followed: np.ndarray = theta - half * slip(moves, pieces, 1 / half)
    return followed


_GAP = np.concatenate((np.linspace(2.0, 0.05, 300)[:-1], np.geomspace(0.05, 1e-8, 400)))


def _slope(kind: str, shape: float, gap: np.ndarray) -> np.ndarray:
    """dw/du at 1 - s w = gap."""
    y = 1 - gap
    slope: np.ndarray = 1 - np.sign(y) * np.abs(y) ** shape  # Bouc-Wen
    if kind == "exponent":
        slope = gap**shape  # Dahl 1968
    if kind == "soft shaft":  # Dahl's law in series with a spring of `shape` of the compliance
        slope = gap / (1 - shape + shape * gap)
    return slope


@lru_cache(maxsize=64)
def _travel_table(kind: str, shape: float) -> tuple[np.ndarray, np.ndarray]:
    """y = s w and the travel u from y = -1, by Simpson's rule for the integral of dy / slope(y)."""
    y = 1 - _GAP
    ends = 1 / np.maximum(_slope(kind, shape, _GAP), 1e-12)
    middle = 1 / np.maximum(_slope(kind, shape, (_GAP[1:] + _GAP[:-1]) / 2), 1e-12)
    steps = np.diff(y) * (ends[1:] + 4 * middle + ends[:-1]) / 6
    return y, np.concatenate(([0.0], np.cumsum(steps)))


def tabulated(moves: np.ndarray, pieces: Pieces, a: float, kind: str, shape: float) -> np.ndarray:
    """A law dw/du = slope(s w) of one `shape` parameter: exponent, bouc-wen or soft shaft."""
    return _by_strokes(moves, pieces, a, *_travel_table(kind, round(shape, 6)))


def _by_strokes(
    moves: np.ndarray, pieces: Pieces, a: float, y: np.ndarray, u: np.ndarray
) -> np.ndarray:
    """A law by its curve y(u) from -1 to 1, with the travel u in presliding lengths."""
    ratio = np.zeros(len(moves))
    for rows in pieces:
        part, w = moves[rows], 0.0
        starts, directions = strokes(part)
        for i, j, s in zip(starts, [*starts[1:], len(part)], directions, strict=True):
            travel = a * np.cumsum(np.abs(part[i:j]))
            reached = np.interp(np.interp(s * w, y, u) + travel, u, y)
            ratio[rows.start + i : rows.start + j] = s * reached
            w = float(s * reached[-1])
    return ratio


def rise_lengths(law: Law, p: np.ndarray, limits: np.ndarray) -> float:
    """Return the length of Dahl's law that rises as slowly from rest, up to 95 % of Fc, in parts of
    Fc/sigma0; at least 1. p holds ln a of each element and the shape, limits the Fc of each.
    """
    share, a = limits / limits.sum(), np.exp(p[: law.elements])
    u = np.geomspace(1e-3, 1e3, 2000)  # travel from rest in parts of Fc/sigma0
    moves, whole = np.diff(u, prepend=0.0) / float(share @ a), [slice(0, len(u))]
    if law.kinds == ("table",):
        w = tabulated(moves, whole, float(a[0]), law.name, float(p[law.elements]))
    elif set(law.kinds) <= {"dahl", "slip"}:
        laws = {"dahl": dahl, "slip": slip}
        each = [
            laws[kind](moves, whole, float(one)) for kind, one in zip(law.kinds, a, strict=True)
        ]
        w = np.tensordot(share, each, axes=1)
    else:
        return 1.0  # Dahl's law with other limits
    rising = (0 < w) & (w < 0.95)
    lengths = u[rising] / -np.log1p(-w[rising])
    return max(1.0, float(lengths.max(initial=1.0)))


def turning_points(theta: np.ndarray, min_turn: float) -> np.ndarray:
    """Rows at which the motion turns back by more than `min_turn` rad (m)."""
    moving = np.append(0, np.flatnonzero(np.diff(theta)) + 1)
    turns = moving[np.flatnonzero(np.diff(np.sign(np.diff(theta[moving])))) + 1]
    kept, direction = [], 0
    low = high = 0  # rows of the lowest and the highest angle since the last turn
    for row in [*turns.tolist(), len(theta) - 1]:
        low = row if theta[row] <= theta[low] else low
        high = row if theta[row] >= theta[high] else high
        extreme = high if direction > 0 else low
        if direction == 0 and theta[high] - theta[low] > min_turn:
            direction = 1 if row == high else -1
            low = high = row
        elif direction and abs(theta[row] - theta[extreme]) > min_turn:
            kept.append(extreme)
            direction, low, high = -direction, row, row
    return np.array(kept, dtype=int)
