# SPDX-License-Identifier: MIT
"""Numbers that are probably in a wrong unit (dahl_params_plausible)."""

from __future__ import annotations

import math

from dahl.binding import parameters
from dahl.binding.library import c

REMARKS = {  # of dahl_plausible_t
    c.DAHL_COUNTS_PER_TURN: "theta_per_count = {theta:.9g} rad is more than a quarter turn; counts"
    " per turn in place of rad per count?",
    c.DAHL_DEGREES_PER_COUNT: "theta_per_count = {theta:.9g} would be {turn:g} counts per turn in"
    " degrees; it must be in rad",
    c.DAHL_SHORT_PRESLIDING: "a count of {theta:g} rad is {travel:.3g} presliding lengths"
    " Fc/sigma0; degrees in place of rad?",
    c.DAHL_LONG_PRESLIDING: "the presliding length Fc/sigma0 = {length:g} rad is {turns:.3g} turns;"
    " sigma0 in N m/deg, or exchanged with Fc?",
}


def implausible(sigma0: float, Fc: float, theta_per_count: float = 0.0) -> str:  # noqa: N803
    """Return the probable mistake with a unit, or "" if the numbers are plausible. Parameters as of
    Plan, which may refuse them; dahl.h says what it cannot find.

    >>> import dahl
    >>> dahl.implausible(100.0, 0.5, 2 * 3.14159265 / 16384)
    ''
    >>> print(dahl.implausible(100.0, 0.5, 360 / 16384))
    theta_per_count = 0.0219726562 would be 16384 counts per turn in degrees; it must be in rad
    """
    given = (sigma0, Fc, theta_per_count)
    names = parameters.LIMITS.items()
    floats = [
        parameters.parameter(name, x, limit) for (name, limit), x in zip(names, given, strict=True)
    ]
    remark = REMARKS.get(c.dahl_params_plausible(c.new("dahl_params_t *", floats)), "")
    if not remark:
        return ""
    sigma0, Fc, theta = floats
    length = Fc / sigma0
    counts = {"theta": theta, "travel": theta / length, "turn": 360 / theta if theta else 0.0}
    return remark.format(length=length, turns=length / math.tau, **counts)
