# SPDX-License-Identifier: MIT
"""What an identification found: the numbers, the models they were compared with, the verdict."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from dahl.identify.explore import Explored
from dahl.identify.finding import Finding
from dahl.identify.fit import Estimate
from dahl.identify.load import Follows
from dahl.identify.log import Log


@dataclass
class Verdict:
    """identifiable: by parameter; text: one line; reasons: what it rests on."""

    sigma0: bool = False
    Fc: bool = False
    text: str = ""
    reasons: list[str] = field(default_factory=list)

    @property
    def identifiable(self) -> dict[str, bool]:
        return {"sigma0": self.sigma0, "Fc": self.Fc}


@dataclass
class Models:
    """Held-out R2 and RMSE of Dahl's model and of simpler ones, each with its own best terms."""

    r2_coulomb: float  # on the rows fitted
    r2: dict[str, float]
    rmse: dict[str, float]
    terms: dict[str, list[str]]
    bilinear_sigma0: float


@dataclass
class Cycles:
    """Each whole cycle of all logs by itself."""

    value: dict[str, np.ndarray] = field(default_factory=dict)  # Fc, sigma0, offset
    error: dict[str, np.ndarray] = field(default_factory=dict)  # standard errors / that of a row
    rows: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))  # over all logs

    def __len__(self) -> int:
        return len(self.rows)


@dataclass(frozen=True)
class PlanQuality:
    """What a plan of the found parameters is worth in a firmware."""

    theta_per_count: float = 0.0  # rad (m)
    of_target: bool = False  # of --target-counts-per-turn, not of the log's encoder
    r2: float = 0.0  # on the raw motion, friction alone
    against: list[str] = field(default_factory=list)  # why there should be none


@dataclass
class Result:
    """All that was found."""

    logs: list[Log]
    estimate: Estimate
    models: Models
    r2: float  # on the rows fitted
    rmse: float
    reversals: int
    informs: float  # part of the rows in which sigma0 shows
    delay: float  # rows
    median: int  # rows of the running median that the angle went through
    backlash: float  # rad (m)
    sign: float = field(default=1.0, kw_only=True)  # -1: the torque was taken with the other one
    inner: bool = field(default=False, kw_only=True)  # the angle was taken between the counts
    predicted: list[np.ndarray]  # N m (N), (rows,) of each log
    verdict: Verdict = field(default_factory=Verdict)
    checks: dict[str, float] = field(default_factory=dict)  # log not fitted -> R2
    raw: list[Log] = field(default_factory=list)  # as measured, before any cleaning of the angle
    eased: list[Log] = field(default_factory=list)  # the same, as at the reference of the load
    findings: list[Finding] = field(default_factory=list)
    follows: Follows | None = None  # how the friction follows the load, where it does
    options: dict[str, Any] = field(default_factory=dict)  # what was asked for
    cycles: Cycles = field(default_factory=Cycles)
    plan: PlanQuality = field(default_factory=PlanQuality)
    explored: Explored = field(default_factory=Explored)

    @property
    def notes(self) -> list[str]:
        return [f"{log.name}: {note}" for log in self.logs for note in log.notes]


def titled(result: Result) -> str:
    """The names of the logs, each once."""
    return ", ".join(dict.fromkeys(Path(one.name).name for one in result.logs))
