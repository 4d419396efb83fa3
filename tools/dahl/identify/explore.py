# SPDX-License-Identifier: MIT
"""What else may be chosen for logs that were cleaned, as far as they tell: terms, delay and model
are tried, the simplest is taken, and the rest says how far the numbers may be off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from dahl.identify import choices, delay, fit, model_table
from dahl.identify.choices import Choice, Trial
from dahl.identify.cycles import LOOKED_AT, Cut
from dahl.identify.finding import Finding
from dahl.identify.fit import Estimate
from dahl.identify.log import Log
from dahl.identify.model_table import Compared
from dahl.identify.sweep import Sweep

LEAST_CYCLES = 6  # that a claim rests on
LEAST_PARTS = 6  # cycles or strokes that a choice is scored by
MOST_ROWS = 1_000_000  # that are used if the first rows have too few cycles
LOOKS = ((LOOKED_AT, False), (MOST_ROWS, False), (MOST_ROWS, True))  # rows, whether by strokes
LONG = 40.0  # rows: from here on a delay is corrected, but its numbers are not claimed
COARSE = 0.3  # presliding lengths in a row, that a shift by parts of rows is no longer sure of
NAMES = ("sigma0", "Fc")


@dataclass
class Explored:
    """All choices that were tried; `taken` is the one that the numbers are given for."""

    trials: list[Trial] = field(default_factory=list)
    taken: Trial | None = None
    spread: float = 1.0  # squares of the torque around its mean, on the rows that were scored
    models: Compared = field(default_factory=Compared)
    findings: list[Finding] = field(default_factory=list)
    cycles: int = 0  # that the choices were scored by

    @property
    def choice(self) -> Choice:
        """The one that was taken."""
        return self.taken.choice if self.taken else Choice()


@dataclass(frozen=True)
class Asked:
    """What may be tried."""

    terms: tuple[tuple[str, ...], ...]  # sets of terms
    delays: bool
    least_delay: float = delay.SKEW  # rows
    model: str = ""  # asked for by its name, else the simplest


def explored(logs: Sequence[Log], estimate: Estimate, least_turn: float, asked: Asked) -> Explored:
    """Try all choices around an estimate; `least_turn` in rad (m) tells the cycles."""
    cut = _cut(logs, estimate.a, least_turn)
    if len(cut.spans) < LEAST_PARTS:
        return Explored(cycles=cut.cycles)
    trials = choices.of_terms(cut, estimate.a, asked.terms)
    if not trials:
        return Explored()
    taken, findings = choices.simplest(trials), []
    if asked.delays:
        late = delay.tried(cut, trials, asked.least_delay)
        if delay.at_the_end([taken, *late]):
            words = f"the best delay is at the end of the search ({delay.LONGEST:g} rows)"
            findings.append(Finding(words, NAMES))
        trials = trials + late + _terms_when_late(cut, [taken, *late], asked)
        taken = choices.simplest(trials)
    models = model_table.compared(cut, taken, taken.a, asked.model)
    plain = [one for one in trials if one.choice.plain]
    if plain and model_table.better_plainly(models, taken):
        for one in trials:
            one.plausible = False
        taken, models = choices.simplest(plain), models.plainly()
    findings += model_table.findings(models)
    trials = trials + model_table.plausible(models)
    return Explored(trials, taken, cut.spread, models, findings, cut.cycles)


def _cut(logs: Sequence[Log], a: float, least_turn: float) -> Cut:
    """Cut the first rows of the logs; if they have too few cycles, more rows, or by strokes."""
    cuts = []
    for rows, strokes in LOOKS:
        cuts.append(Cut(logs, a, least_turn, int(delay.LONGEST), rows, strokes))
        if cuts[-1].cycles >= LEAST_CYCLES:
            break
    return max(cuts, key=lambda cut: cut.cycles)


def unscored(
    found: Sweep, estimate: Estimate, sets: Sequence[tuple[str, ...]], cycles: int
) -> Explored:
    """If the `cycles` are too few to score a choice, each set of terms is plausible with which the
    logs are drawn as well as with those of the estimate.
    """
    limit = (1 + choices.PAYS) * estimate.sse
    points = {terms: fit.point(found, terms) for terms in sets}
    trials = [
        Trial.unscored(Choice(terms), one, plausible=one.sse <= limit)
        for terms, one in points.items()
        if one.Fc > 0
    ]
    own = [one for one in trials if set(one.choice.terms) == set(estimate.terms)]
    spread = fit.spread_of(found)
    return Explored(trials, own[0], spread, cycles=cycles) if own else Explored(cycles=cycles)


def with_backlash(seen: Explored, counted: Estimate) -> Explored:
    """With what the fit said when the travel of the flat zones still counted: how much of them is
    play, and how much a soft bearing, no log tells.
    """
    choice = replace(seen.choice, backlash=True)
    return replace(seen, trials=[*seen.trials, Trial.unscored(choice, counted, plausible=True)])


def _terms_when_late(cut: Cut, trials: Sequence[Trial], asked: Asked) -> list[Trial]:
    """All subsets of the terms again, with the best delay."""
    best = min(trials, key=lambda trial: float(trial.cost.sum()))
    if len(asked.terms) == 1 or best.choice.delay == 0:
        return []
    return choices.of_terms(cut, best.a, asked.terms, best.choice.delay)


def widened(estimate: Estimate, seen: Explored) -> Estimate:
    """With intervals that go over all plausible choices."""
    if seen.taken is None:
        return estimate
    value = {name: getattr(estimate, name) for name in NAMES}
    return replace(estimate, ci95=choices.over(seen.trials, seen.taken, value, estimate.ci95))


def hangs(seen: Explored, name: str, least: float) -> str:
    """What moves a parameter by more than `least` of it to either side: "the delay: 90 to 140"; ""
    where nothing does.
    """
    if seen.taken is None:
        return ""
    kind, low, high = choices.hangs_on(seen.trials, seen.taken, name)
    much = high - low > 2 * least * seen.taken.value[name]
    return f"{kind}: {low:.4g} to {high:.4g}" if kind and much else ""


def between_rows(rows: float, lengths: float) -> list[Finding]:
    """A torque that was shifted, by parts of rows in which the bristle moves far: `lengths` is the
    usual travel of a row in presliding lengths.
    """
    if not rows or lengths < COARSE:
        return []
    words = f"the torque is late, and a row is {lengths:.1f} presliding lengths long: what is"
    return [Finding(f"{words} between the rows is not known", ("sigma0",))]


def long_delay(rows: float) -> list[Finding]:
    """A torque so late that its clock is to be mended first."""
    if abs(rows) < LONG:
        return []
    return [Finding(f"the torque is {rows:.0f} rows late: mend the clocks first", NAMES)]
