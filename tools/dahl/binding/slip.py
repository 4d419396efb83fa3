# SPDX-License-Identifier: MIT
"""Elements on one shaft (dahl_parts.h): Slip, and Parallel for a mix of Friction and Slip."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any, Self

from dahl.binding import arrays, checks, parameters
from dahl.binding.copies import content
from dahl.binding.elements import RatioElement
from dahl.binding.friction import Friction, Plan
from dahl.binding.library import c
from dahl.errors import Error, InputError

SLIP_MAX = 8  # DAHL_SLIP_MAX: slip elements in parallel


def floats(name: str, values: Sequence[float], limit: str) -> tuple[float, ...]:
    """Parameters, one for each element, rounded to float."""
    if not arrays.is_list(values):
        raise TypeError(f"{name} = {checks.shown(values)} is not a list of numbers, one an element")
    return tuple(
        parameters.parameter(f"{name}[{k}]", value, limit) for k, value in enumerate(values)
    )


class Slip(RatioElement):
    """Slip elements in parallel (Maxwell slip, Prandtl-Ishlinskii; dahl_slip_plan_t) and their
    state: F is the sum of springs sigma0 that slip at Fc.

    sigma0           N m/rad  one for each of 1 to 8 elements; ranges as in Plan
    Fc               N m      torque at which each slips, as many
    theta_per_count  rad      per encoder count; sigma0/Fc*theta_per_count in the range of Plan for
                              each element

    >>> dahl.Slip(sigma0=[100.0, 50.0], Fc=[0.5, 1.0], theta_per_count=1e-3).step_counts(10)
    1.0
    """

    _kind = "slip_"

    def __init__(
        self,
        sigma0: Sequence[float],
        Fc: Sequence[float],  # noqa: N803 (the field's name)
        theta_per_count: float,
    ) -> None:
        self._sigma0 = floats("sigma0", sigma0, parameters.SIGMA0)
        self._Fc = floats("Fc", Fc, parameters.FC)
        counted = parameters.COUNTED
        self._theta_per_count = parameters.parameter("theta_per_count", theta_per_count, counted)
        self._state = c.new("dahl_slip_state_t *")
        self._prepare()

    def _prepare(self) -> None:
        self._prepared = c.new("dahl_slip_plan_t *")
        count = len(self._sigma0)
        if not 1 <= count <= SLIP_MAX or len(self._Fc) != count:
            raise InputError(
                f"sigma0 has {count} elements and Fc {len(self._Fc)}; as many of each, 1 to"
                f" {SLIP_MAX}, were expected"
            )
        if c.dahl_slip_prepare(self._prepared, self._params()) != 0:
            parameters.need_counted(self._theta_per_count)
            for k in range(count):
                self._check_element(k)
            raise InputError(f"{self!r} is refused by dahl_slip_prepare")

    def _check_element(self, k: int) -> None:
        """Raise the error of element k, if it has one."""
        try:
            Plan(self._sigma0[k], self._Fc[k], self._theta_per_count)
        except Error as error:
            raise InputError(f"element {k}: {error}") from None

    @property
    def sigma0(self) -> tuple[float, ...]:
        """N m/rad, one for each element."""
        return self._sigma0

    @property
    def Fc(self) -> tuple[float, ...]:  # noqa: N802
        """N m, one for each element."""
        return self._Fc

    @property
    def theta_per_count(self) -> float:
        """rad/count"""
        return self._theta_per_count

    def _parameters(self) -> tuple[Any, ...]:
        return self._sigma0, self._Fc, self._theta_per_count

    def _params(self) -> Any:
        values = len(self._sigma0), self._theta_per_count, self._sigma0, self._Fc
        return c.new("dahl_slip_params_t *", values)

    def _arguments(self) -> tuple[Any, ...]:
        return self._prepared, self._state

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Slip):
            return NotImplemented
        is_same = self._parameters() == other._parameters()
        return is_same and content(self._state) == content(other._state)

    __hash__ = None  # type: ignore[assignment]  # it changes with each step

    def __repr__(self) -> str:
        sigma0, Fc = (", ".join(map(parameters.digits, v)) for v in (self._sigma0, self._Fc))
        theta = parameters.digits(self._theta_per_count)
        return f"Slip(sigma0=[{sigma0}], Fc=[{Fc}], theta_per_count={theta})"


class Parallel(RatioElement):
    """Elements on one shaft, whose torques add (dahl_part_t): any mix of Friction and Slip, each
    given once. Moving this moves the parts. The sum in N m is rounded once, within 0.55 ulp of the
    sum of all Fc.

    >>> bearing = dahl.Friction(dahl.Plan(100.0, 0.5, 1e-3))
    >>> dahl.Parallel(bearing, dahl.Slip([20.0], [1.0], 1e-3)).step_counts(10**6)
    1.5
    """

    _kind = "parallel_"

    def __init__(self, *parts: Friction | Slip) -> None:
        for k, part in enumerate(parts):
            if not isinstance(part, (Friction, Slip)):
                raise TypeError(
                    f"parts[{k}] = {checks.shown(part)} is neither a Friction nor a Slip"
                )
            if any(part is other for other in parts[:k]):
                raise InputError(f"parts[{k}] is given twice: it would move twice")
        self._parts = parts

    @property
    def parts(self) -> tuple[Friction | Slip, ...]:
        """The parts as given."""
        return self._parts

    def _arguments(self) -> tuple[Any, ...]:
        return c.new("dahl_part_t[]", [_c_part(part) for part in self._parts]), len(self._parts)

    def step_counts_q30(self, dcounts: int) -> int:
        """Move as step_counts() does and return F over the sum of Fc in Q30, -2^30 .. 2^30: the
        bits of a firmware with dahl_parallel_shares() of the present plans.
        """
        moved = checks.counts(dcounts)
        parts, count = self._arguments()
        shares = c.new("int32_t[]", count)
        c.dahl_parallel_shares(shares, parts, count)
        return int(c.dahl_parallel_step_counts_q30(parts, shares, count, moved))

    def __copy__(self) -> Self:
        other = super().__copy__()
        other._parts = tuple(map(copy.copy, self._parts))
        return other

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Parallel):
            return NotImplemented
        return self._parts == other._parts

    __hash__ = None  # type: ignore[assignment]  # it changes with each step

    def __repr__(self) -> str:
        return f"Parallel({', '.join(map(repr, self._parts))})"


def _c_part(part: Friction | Slip) -> Any:
    """A dahl_part_t. change_plan() may have removed the encoder, so each move checks it."""
    make = c.dahl_batch_slip_part if isinstance(part, Slip) else c.dahl_batch_part
    return make(*part._arguments())
