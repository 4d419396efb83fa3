# SPDX-License-Identifier: MIT
"""A torque that depends on the angle beyond a spring, as by magnets, teeth or a shaft that is not
straight. It acts the same both ways, so that it is no friction; but a fit that does not know of it
answers with a viscous part, another exponent or another Fc.

Beside Dahl's torque any curve over the angle is fitted, straight between knots. Where that explains
cycles left out clearly better than all models did, or as well as a viscous part or a mass that the
fit had to take, parameters that become others are not claimed.
"""

from __future__ import annotations

import numpy as np

from dahl.identify import choices, compare, delay, path
from dahl.identify.choices import Choice, Trial
from dahl.identify.compare import Dictionary
from dahl.identify.cycles import Cut, excess, jackknife
from dahl.identify.explore import LEAST_CYCLES
from dahl.identify.finding import Finding
from dahl.identify.result import Result
from dahl.identify.terms import TIMED, place_of
from dahl.identify.trial import NAMES

KNOTS, LEAST_KNOTS = 40, 14  # over the range of the angle
APIECE = 6  # rows of a stroke for each: with fewer the rounding of an encoder is a curve too
SURELY, MORE = 3.0, 0.05  # standard errors; of the error, that the curve has to remove
QUANTILE = 1.96
MATTERS = 0.02  # of a parameter


def finding(result: Result, least_turn: float) -> list[Finding]:
    """Whether a curve over the angle explains more, and which parameters then are others."""
    estimate = result.estimate
    cut = Cut(result.logs, estimate.a, least_turn, int(delay.LONGEST))
    plain = choices.fitted(cut, estimate.a, Choice(tuple(estimate.terms)))
    if len(cut.spans) < LEAST_CYCLES or plain is None:
        return []
    knots = min(KNOTS, sum(log.rows for log in result.logs) // max(result.reversals, 1) // APIECE)
    if knots < LEAST_KNOTS:
        return []
    timed = [name for name in estimate.terms if name in TIMED]
    found = beside_a_curve(cut, estimate.a, timed, knots)
    if found is not None and _is_clear(result, plain, found):
        return _told(result, found)
    found = beside_a_curve(cut, estimate.a, [], knots) if timed else None
    return _told(result, found) if found is not None and _is_as_good(plain, found) else []


def _is_clear(result: Result, plain: Trial, found: Trial) -> bool:
    """Whether the curve explains clearly more than the fit, and than every model."""
    costs = [plain.cost, *(one.trial.cost for one in result.explored.models.candidates)]
    known = min(float(cost.sum()) for cost in costs)
    gain, error = excess(plain.cost, found.cost)
    return gain > SURELY * error and float(found.cost.sum()) < (1 - MORE) * known


def _is_as_good(plain: Trial, found: Trial) -> bool:
    """Whether the fit is not better than the curve by a standard error."""
    more, error = excess(found.cost, plain.cost)
    return more <= error


def _told(result: Result, found: Trial) -> list[Finding]:
    """What the curve makes of the parameters, where that is outside of their intervals: these are
    drawn out to it, and where it is much, nothing is claimed.
    """
    log, value, reach = result.logs[0], found.value, {}
    for name in NAMES:
        ends, apart = result.estimate.ci95[name], QUANTILE * jackknife(found.without[name])
        if not ends.low <= value[name] <= ends.high:
            reach[name] = (value[name] - apart, value[name] + apart)
    if not reach:
        return []
    words = (
        "the torque depends on the angle beyond a spring:"
        f" sigma0 is then {value['sigma0']:.4g} {log.slope_unit}, Fc {value['Fc']:.4g} {log.unit}"
    )
    fitted = {name: getattr(result.estimate, name) for name in reach}
    others = [name for name in reach if abs(value[name] / fitted[name] - 1) > MATTERS]
    return [Finding(words, tuple(others), reach)]


def beside_a_curve(cut: Cut, a: float, terms: list[str], count: int) -> Trial | None:
    """Dahl's torque and some terms beside a curve over the angle of so many knots; nothing where
    there is no friction in it.
    """
    theta = cut.terms[:, place_of("spring")]
    knots = np.linspace(theta.min(), theta.max(), count)
    curve = [np.interp(theta, knots, one) for one in np.eye(count)]
    found = compare.shaped(Dictionary(cut, a, terms, 0.0, curve), path.dahl, "curve over the angle")
    return found.trial if found is not None else None
