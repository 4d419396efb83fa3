# SPDX-License-Identifier: MIT
"""How well the plan itself does: friction alone, on the motion as it was measured, at the counts
that the target will read. A fit has helpers that a firmware has not: a filter of the angle, a
delay, the travel of backlash taken out, terms beside friction.
"""

from __future__ import annotations

import math

import numpy as np

from dahl.identify import carried
from dahl.identify.carried import Friction
from dahl.identify.log import Log
from dahl.identify.result import PlanQuality, Result

LEAST_R2 = 0.9  # below it there is no plan


def of(result: Result, target_counts: float = 0.0, doubted: bool = False) -> PlanQuality:
    """The plan's quality at `target_counts` a turn (millimetre); 0: at the log's own counts, which
    may be `doubted`.
    """
    log = result.logs[0]
    turn = 1e-3 if log.linear else 2 * math.pi
    count = turn / target_counts if target_counts else log.resolution
    friction = carried.of(result)
    r2 = r2_on_raw(result, count, friction)
    against = _against(result, r2)
    if not count and friction.model != "dahl":
        against.append("the log shows no encoder, and this model goes by counts alone")
    if doubted and not target_counts:
        against.append("the counts a turn are in doubt")
    return PlanQuality(count, bool(target_counts), r2, against)


def r2_on_raw(result: Result, count: float, friction: Friction) -> float:
    """R2 of the plan's torque, by raw counts of `count` rad (m); 0: by the raw angle. Offset and
    spring are taken off what was measured, each log has its own torque at its first row.
    """
    lost = spread = 0.0
    for log in result.raw:
        theta = log.theta - log.theta[0]
        theta = np.round(theta / count) * count if count else theta
        measured = result.sign * log.torque - load_of(result, log, friction.terms)
        moves = np.diff(theta, prepend=theta[:1])
        left = measured - drawn(friction, moves, measured, log.load)
        lost += float(left @ left)
        spread += float(np.sum((measured - measured.mean()) ** 2))
    return 1 - lost / spread if spread else 0.0


def load_of(result: Result, log: Log, terms: dict[str, float]) -> np.ndarray:
    """Offset and spring: (rows,) N m (N)."""
    spring = terms.get("spring", 0.0) * (log.theta - result.logs[0].zero)
    return spring + terms.get("offset", 0.0)


def drawn(
    friction: Friction, moves: np.ndarray, measured: np.ndarray, load: np.ndarray | None = None
) -> np.ndarray:
    """The plan's torque, with the best one at the first row: (rows,) N m (N)."""
    torque = friction.torque(moves, load)
    start = np.exp(-np.minimum(friction.a * np.cumsum(np.abs(moves)), 700.0))
    torque = torque + start * float(start @ (measured - torque) / (start @ start))
    return torque


def _against(result: Result, r2: float) -> list[str]:
    """Why there should be no plan."""
    models = result.explored.models
    found = {
        "the library has no plan for Coulomb's model": models.chosen == "Coulomb",
        "sigma0 and Fc of Dahl's model are not both identifiable": not all(
            result.verdict.identifiable.values()
        ),
        f"it explains {100 * r2:.0f} % of the friction on the raw motion,"
        f" {100 * LEAST_R2:.0f} % is the least": r2 < LEAST_R2,
        "it does not know of the backlash": result.backlash > 0,
    }
    return [words for words, holds in found.items() if holds]
