# SPDX-License-Identifier: MIT
"""Which model a log asks for: the simplest of those that the library has, from which the best is
not clearly away by its score on cycles left out; and what the others say of sigma0 and Fc.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from dahl.identify import choices, compare, elements
from dahl.identify.choices import Choice, Trial
from dahl.identify.compare import Candidate, Dictionary
from dahl.identify.cycles import Cut, excess
from dahl.identify.finding import Finding
from dahl.identify.terms import TIMED, place_of

PROMISING = 1.2  # of the cost of Dahl's model
SLIPS, MIXES = 4, 4  # elements side by side
DAHL_TICK, ASYMMETRIC_TICK = 20, 33  # instructions
SLIP_TICK = (20, 18)  # of a tick, and for each element
DAHLS_TICK, MIXED_TICK = (21, 21), (49, 21)  # a mix has one slip element or more
LEAST_STEP = 0.15  # of the exponent
PLAINLY = 0.1  # of the error, that it has to remove to do without a delay and the like
NOTHING = 1e-6  # of the torque's variance: what rounding leaves, and no model explains
MORE = 0.05  # of the error, that a better model has to remove to be spoken of
SURE, SURELY = 2.0, 3.0  # standard errors
SLOWER, SHAPE, PAIRED = "falling with speed", "general exponent", "Dahl K=2"
SLIP = "slip K=1"
OF_DAHL = (SHAPE, PAIRED, "asymmetric")


def names() -> dict[str, str]:
    """The models that the library has, by how an option calls them."""
    several = {"slip": range(1, SLIPS + 1), "dahl": (2,), "mixed": range(2, MIXES + 1)}
    counted = {
        f"{kind}-{count}": f"{kind.replace('dahl', 'Dahl')} K={count}"
        for kind, counts in several.items()
        for count in counts
    }
    return {"coulomb": "Coulomb", "dahl": "Dahl", "asymmetric": "asymmetric", **counted}


def instructions(name: str) -> int | None:
    """Of one tick in Q30 on a Cortex-M3, at most, as counted in QEMU (docs/microcontroller.md);
    nothing where the library has no such model.
    """
    kind, _, count = name.partition(" K=")
    if count:
        tick, each = {"slip": SLIP_TICK, "Dahl": DAHLS_TICK, "mixed": MIXED_TICK}[kind]
        return tick + each * int(count)
    return {"Dahl": DAHL_TICK, "asymmetric": ASYMMETRIC_TICK}.get(name)


@dataclass
class Compared:
    """All models with their scores."""

    candidates: list[Candidate] = field(default_factory=list)  # simple ones first
    plain: list[Candidate] = field(default_factory=list)  # without a delay, an offset at most
    chosen: str = ""
    forced: str = ""
    spread: float = 1.0  # squares of the torque around its mean

    def of(self, name: str) -> Candidate | None:
        return next((one for one in self.candidates if one.name == name), None)

    def plainly(self) -> Compared:
        """The same without what the models took of a delay, a spring and so on."""
        candidates = sorted(self.plain, key=lambda one: one.size)
        return replace(self, candidates=candidates).decided(self.forced)

    def decided(self, forced: str = "") -> Compared:
        """With the model that is asked for, or the simplest that the library has, chosen."""
        own = [one for one in self.candidates if one.product]
        return replace(self, chosen=forced or _simplest(own).name, forced=forced)

    @property
    def why(self) -> str:
        """Return "asked for" for a forced model, "chosen" for one chosen by its score."""
        return "asked for" if self.forced else "chosen"

    def r2(self, candidate: Candidate) -> float:
        return 1 - float(candidate.trial.cost.sum()) / self.spread


def compared(cut: Cut, base: Trial, a: float, forced: str = "") -> Compared:
    """Fit and score every model: with the terms and the delay of `base`, and with neither."""
    plainly = (tuple(term for term in base.choice.terms if term == "offset"), 0.0)
    plain = _all_of(Dictionary(cut, a, *plainly))
    found = {one.name: one for one in plain}
    if plainly != (base.choice.terms, base.choice.delay):
        for one in _all_of(Dictionary(cut, a, base.choice.terms, base.choice.delay)):
            kept = found.get(one.name)
            if kept is None or one.trial.cost.sum() < kept.trial.cost.sum():
                found[one.name] = one
    candidates = sorted(found.values(), key=lambda one: one.size)
    return Compared(candidates, plain, spread=cut.spread).decided(forced)


def _all_of(book: Dictionary) -> list[Candidate]:
    """Every model with the terms and the delay of one dictionary."""
    dahl = choices.fitted(book.cut, book.a, Choice(book.terms, book.delay))
    found: list[Candidate | None] = [compare.coulomb(book)]
    if dahl is not None:
        own: compare.Part = {"kind": "dahl", **dahl.value}
        found.append(Candidate("Dahl", dahl, [own], 2 + dahl.choice.size))
    promising = PROMISING * float(dahl.cost.sum()) if dahl is not None else np.inf
    found.append(compare.one(book, "slip", "slip"))
    found.append(compare.pair(book, "slip", "slip", promising))
    found += compare.side_by_side(book, ["slip"], "slip", SLIPS)[2:]
    found.append(compare.pair(book, "dahl", "Dahl", promising))
    mixes = compare.side_by_side(book, ["dahl", "slip"], "mixed", MIXES)[1:]
    found += [one for one in mixes if any(part["kind"] == "dahl" for part in one.parts)]
    found += [_best(_asymmetric(book)), _best(_exponents(book)), _best(_slower(book))]
    return [one for one in found if one is not None]


def _asymmetric(book: Dictionary) -> list[Candidate | None]:
    """A few parts by which both limits differ, then those between the best and its neighbours, and
    the lowest point of a parabola through the last three.
    """
    terms = book.terms if "offset" in book.terms else ("offset", *book.terms)
    book = Dictionary(book.cut, book.a, terms, book.delay)
    known: dict[float, Candidate] = {}
    fresh = [side * part for part in compare.PARTS for side in (1.0, -1.0)]
    for _ in range(compare.HALVED):
        known |= {part: one for part in fresh if (one := _of_part(book, part)) is not None}
        near = _around_the_best(known)
        if len(near) < 3:
            return list(known.values())
        fresh = [(near[0] + near[1]) / 2, (near[1] + near[2]) / 2]
    costs = [float(known[part].trial.cost.sum()) for part in near]
    bent, slope, _ = np.polyfit(np.array(near) - near[1], costs, 2)
    last = float(np.clip(near[1] - slope / (2 * bent), near[0], near[2])) if bent > 0 else near[1]
    return [*known.values(), _of_part(book, last)]


def _around_the_best(known: dict[float, Candidate]) -> list[float]:
    """The part with the least cost between its neighbours; fewer at an end."""
    parts = sorted(known)
    best = min(parts, key=lambda part: float(known[part].trial.cost.sum()), default=0.0)
    place = parts.index(best) if parts else 0
    return parts[max(place - 1, 0) : place + 2]


def _of_part(book: Dictionary, part: float) -> Candidate | None:
    """Another limit each way, by so much of their mean."""
    one = compare.shaped(book, partial(elements.asymmetric, part=part), "asymmetric")
    if one is not None:
        one.product = True
        force, sigma0 = one.trial.value["Fc"], one.trial.value["sigma0"]
        limits = {"Fc_forward": force * (1 + part), "Fc_backward": force * (1 - part)}
        one.parts = [{"kind": "asymmetric", "sigma0": sigma0, **limits}]
        offset = one.trial.terms["offset"] - force * part  # half the limits' difference was in it
        one.trial = replace(one.trial, terms={**one.trial.terms, "offset": offset})
    return one


def _exponents(book: Dictionary) -> list[Candidate | None]:
    """A few exponents, then those between the best and its neighbours."""
    known: dict[float, Candidate | None] = {}
    fresh = list(compare.EXPONENTS)
    for _ in range(3):
        for exponent in fresh:
            shape = elements.of_exponent(exponent)
            one = known[exponent] = compare.shaped(book, shape, SHAPE)
            if one is not None:
                one.parts[0]["exponent"] = exponent
        real = {i: one for i, one in known.items() if one is not None}
        if not real:
            return []
        best = min(real, key=lambda i: float(real[i].trial.cost.sum()))
        near = sorted(known)
        place = near.index(best)
        beside = near[max(place - 1, 0) : place] + near[place + 1 : place + 2]
        fresh = [(best + other) / 2 for other in beside if abs(best - other) > LEAST_STEP]
    return list(known.values())


def _slower(book: Dictionary) -> list[Candidate | None]:
    """With a part that fades at speed, where the log has a time."""
    speed = np.abs(book.cut.terms[:, place_of("viscous")])
    if not speed.any():
        return []
    fast = float(np.percentile(speed, 98))
    return [
        compare.shaped(book, elements.of_exponent(1.0), SLOWER, [factor])
        for part in compare.SLOW
        for factor in (np.exp(-((speed / (part * fast)) ** 2)),)
    ]


def _best(found: Sequence[Candidate | None]) -> Candidate | None:
    real = [one for one in found if one is not None]
    return min(real, key=lambda one: float(one.trial.cost.sum()), default=None)


def _simplest(candidates: Sequence[Candidate]) -> Candidate:
    """The simplest from which the best is not clearly away."""
    best = min(candidates, key=lambda one: float(one.trial.cost.sum()))
    near = [
        one
        for one in candidates
        if not choices.clearly_better(best.trial, one.trial, max(best.size - one.size, 0))
    ]
    return min(near, key=lambda one: (one.size, float(one.trial.cost.sum())))


def plausible(table: Compared) -> list[Trial]:
    """The trials of the models that explain more than Dahl's, by one standard error, for the
    intervals; none where no model is clearly better: more elements then draw noise. Of those with
    more elements only the ones that are no larger than what the log asks for.
    """
    dahl = table.of("Dahl")
    if dahl is None or better(table) is None:
        return []
    largest = _simplest([one for one in table.candidates if one.product]).size
    ahead = [
        one.trial
        for one in table.candidates
        if one.name != SLOWER
        and (one.name in OF_DAHL or one.size <= largest)
        and _ahead(one, dahl, 1.0)
    ]
    for trial in ahead:
        trial.plausible = True
    return ahead


def _ahead(one: Candidate, other: Candidate, errors: float) -> bool:
    """Whether one explains more than the other, by so many standard errors: of the cost, or where
    single cycles make most of it, of its logarithm, in which all count alike.
    """
    costs = other.trial.cost, one.trial.cost
    logs = [np.log(np.maximum(cost, 1e-300)) for cost in costs]
    gains = (excess(*costs), excess(*logs))
    return costs[0].sum() > costs[1].sum() and any(more > errors * e for more, e in gains)


def better(table: Compared) -> Candidate | None:
    """The simplest model that explains clearly more than Dahl's, if any."""
    dahl = table.of("Dahl")
    if dahl is None or 1 - table.r2(dahl) < NOTHING:
        return None
    clearly = [one for one in table.candidates if one.name != SLOWER and _clearly(one, dahl)]
    return _simplest(clearly) if clearly else None


def _clearly(one: Candidate, dahl: Candidate) -> bool:
    lost = float(dahl.trial.cost.sum())
    return _ahead(one, dahl, SURE) and lost - float(one.trial.cost.sum()) > MORE * lost


def findings(table: Compared) -> list[Finding]:
    """Which model explains more than Dahl's; one with a speed in it takes the claim away."""
    best, dahl, found = better(table), table.of("Dahl"), []
    if best is not None and dahl is not None:
        more, less = table.r2(best), table.r2(dahl)
        digits = max(4, math.ceil(1 - math.log10(more - less)))  # so that they differ
        words = f"{best.name} explains more: R2 {more:.{digits}f} against {less:.{digits}f}"
        found.append(Finding(words))
    slower = table.of(SLOWER)
    if slower is not None and dahl is not None and _is_slower(table, slower, dahl):
        found.append(
            Finding("friction falls with the speed: Fc is not one number", ("sigma0", "Fc"))
        )
    return found


def _is_slower(table: Compared, slower: Candidate, dahl: Candidate) -> bool:
    """Whether the speed explains what is left, and no other model does."""
    if 1 - table.r2(dahl) < NOTHING:
        return False
    others = [one for one in table.candidates if one is not slower]
    return _ahead(slower, dahl, SURELY) and not any(_ahead(one, slower, 1.0) for one in others)


def better_plainly(table: Compared, base: Trial) -> bool:
    """Whether another model explains more with an offset at most than Dahl's does with what
    `base` takes of a delay, viscous friction or inertia.
    """
    if TIMED.isdisjoint(base.choice.terms) and base.choice.delay == 0:
        return False
    own = Candidate("Dahl", base)
    limit = (1 - PLAINLY) * float(base.cost.sum())
    return any(
        _ahead(one, own, 1.0) and float(one.trial.cost.sum()) < limit
        for one in table.plain
        if one.name in (SLIP, *OF_DAHL)
    )
