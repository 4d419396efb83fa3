# SPDX-License-Identifier: MIT
"""The rules by which one choice, delay or model is taken before another, each on scores made by
hand: what is better, by how much it has to be, and what is then said and claimed.
"""

from __future__ import annotations

import io
from dataclasses import replace
from itertools import combinations, pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from dahl.identify import (
    carried,
    choices,
    compare,
    cycles,
    delay,
    elements,
    explore,
    follow,
    model_table,
    models_output,
    output,
    path,
    pipeline,
)
from dahl.identify.choices import Choice, Trial
from dahl.identify.compare import Candidate
from dahl.identify.explore import Explored
from dahl.identify.fit import Interval
from dahl.identify.model_table import Compared
from dahl.identify.terms import speed_of
from identify_tools import FC, SIGMA0, dahl_torque, sine, synthetic
from rich.console import Console
from scipy.optimize import nnls

pytestmark = pytest.mark.usefixtures("library")

BOTH = ("sigma0", "Fc")
PLAIN = Choice()
WOBBLE = np.resize([0.5, -0.5, 1, -1], 8)  # of cycles, that adds up to nothing


def trial(
    choice: Choice = PLAIN,
    cost: float = 1.0,
    shake: float = 0.01,
    sigma0: float = 100.0,
    **terms: float,
) -> Trial:
    """Eight cycles; `shake` is how much they disagree about the cost, in parts of it."""
    value = {"sigma0": sigma0, "Fc": FC}
    without = {name: np.full(8, one) for name, one in value.items()}
    costs = cost / 8 * (1 + shake * WOBBLE)
    return Trial(choice, sigma0 / FC, value, without, costs, terms=terms)


def error_of(shake: float, cost: float = 1.0) -> float:
    """The standard error of a cost that eight cycles disagree about, the others being steady."""
    return float(np.std(cost / 8 * shake * WOBBLE, ddof=1) * np.sqrt(8))


# --- which choice ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("better", "added", "clearly"),
    [(0.031, 1, True), (0.029, 1, False), (0.061, 2, True), (0.059, 2, False), (0.001, 0, True)],
)
def test_each_thing_more_has_to_pay_three_percent(better, added, clearly):
    one, other = trial(cost=1.0, shake=0), trial(cost=1 + better, shake=0)
    assert choices.clearly_better(one, other, added) is clearly


@pytest.mark.parametrize(("errors", "clearly"), [(1.9, False), (2.1, True)])
def test_better_is_two_standard_errors(errors, clearly):
    other = trial(cost=1.0, shake=0.5)
    one = trial(cost=1 - errors * error_of(0.5), shake=0)
    assert choices.clearly_better(one, other, 0) is clearly


@pytest.mark.parametrize(("errors", "plausible"), [(0.9, True), (1.1, False)])
def test_plausible_is_one_standard_error(errors, plausible):
    best = trial(cost=1.0, shake=0)
    other = trial(Choice(("offset",)), cost=1 + errors * error_of(0.5), shake=0)
    other.cost += WOBBLE * 0.5 / 8
    assert choices.simplest([other, best]) is best
    assert (best.plausible, other.plausible) == (True, plausible)


def test_of_equals_the_better_one_and_of_all_the_simpler_one():
    small = trial(Choice(("offset",)), cost=1.01)
    smaller = trial(Choice(("spring",)), cost=1.005)
    large = trial(Choice(("offset",), delay=2.0), cost=1.0)
    assert choices.simplest([small, large, smaller]) is smaller
    assert [one.choice.size for one in (small, large)] == [1, 2]


@pytest.mark.parametrize(("cost", "driven"), [(0.70, True), (0.73, False)])
def test_a_part_that_drives_the_motion_explains_much_more(cost, driven):
    """By 1.4 times; otherwise it is not even plausible."""
    damped = trial(Choice(("viscous",)), cost=1.0, viscous=0.1)
    active = trial(Choice(("viscous", "spring")), cost=cost, viscous=0.1, spring=-2.0)
    active.plausible = True
    assert (active.active, damped.active) == (True, False)
    assert trial(viscous=-1.0).active and not trial(inertia=-1.0, offset=-1.0).active
    assert list(choices.passive([damped, active])) == [damped, *([active] if driven else [])]
    assert active.plausible is driven


def test_what_was_chosen_by_its_name():
    assert Choice().plain and Choice(("offset",)).plain
    assert not any(one.plain for one in (Choice(("spring",)), Choice(delay=-0.5)))
    assert Choice(("spring", "viscous"), delay=-2.0).size == 3


def test_another_model_moves_an_interval_by_half_more():
    """Down and up, in log; a choice of the same model by its number alone."""
    base = trial()
    ends = {"sigma0": Interval(98.0, 102.0), "Fc": Interval(0.49, 0.51), "a": Interval(1, 2)}
    for sigma0 in (80.0, 125.0):
        part = np.log(sigma0 / 100)
        for model, more in (("Dahl", 0.0), ("other", abs(part) / 2)):
            other = trial(Choice(model=model), sigma0=sigma0)
            other.plausible = True
            wide = choices.over([base, other], base, {"sigma0": 100.0, "Fc": FC}, ends)["sigma0"]
            below, above = np.hypot(np.log(100 / 98), more), np.hypot(np.log(1.02), more)
            assert wide.low == pytest.approx(min(98, 100 * np.exp(part - below)))
            assert wide.high == pytest.approx(max(102, 100 * np.exp(part + above)))


def test_how_surely_a_choice_moves_an_interval_comes_from_the_cycles():
    """Student's t for eight cycles times the jackknife of the ratio."""
    base, other = trial(), trial(Choice(delay=3.0), sigma0=120.0)
    other.plausible = True
    other.without["sigma0"] = 120.0 * np.exp(0.01 * WOBBLE)
    ends = {"sigma0": Interval(98.0, 102.0)}
    wide = choices.over([base, other], base, {"sigma0": 100.0}, ends)["sigma0"]
    apart = 2.3646 * np.sqrt(7 / 8 * np.sum((0.01 * WOBBLE) ** 2))
    assert wide.high == pytest.approx(120 * np.exp(np.hypot(np.log(1.02), apart)), rel=1e-4)
    assert wide.low == 98.0


def test_what_a_number_hangs_on():
    """By what moves it most, the term or the delay; and only where that is more than `least`."""
    base = trial()
    late, springy = trial(Choice(delay=3.0), sigma0=104), trial(Choice(("spring",)), sigma0=108)
    far = trial(Choice(model="other"), sigma0=300)
    for one in (late, springy):
        one.plausible = True
    trials = [base, late, springy, far]
    assert choices.hangs_on(trials, base, "sigma0") == ("the terms", 100.0, 108)
    seen = Explored(trials, base)
    assert explore.hangs(seen, "sigma0", 0.039) == "the terms: 100 to 108"
    assert explore.hangs(seen, "sigma0", 0.041) == ""
    assert explore.hangs(seen, "Fc", 0.0) == ""
    assert explore.hangs(Explored(), "sigma0", 0.0) == ""
    far.plausible = True
    assert explore.hangs(seen, "sigma0", 0.1) == "the model: 100 to 300"


# --- delays ---------------------------------------------------------------------------------------


@pytest.fixture
def valley(monkeypatch):
    """Delays whose cost is a parabola around one of them, and those that were tried."""
    tried = []

    def make(lowest: float, shake: float = 0.0):
        def fitted(cut, a, choice):
            tried.append(choice.delay)
            return trial(choice, 1 + (choice.delay - lowest) ** 2 / 100, shake)

        monkeypatch.setattr(delay, "fitted", fitted)
        return trial(Choice(("offset",)), 1 + lowest**2 / 100, shake)

    make.tried = tried
    return make


@pytest.mark.parametrize("lowest", [-60.0, -7.3, -0.4, 0.4, 1.7, 33.0, 74.0])
def test_the_best_delay_is_found_either_way(valley, lowest):
    found = delay.tried(None, [valley(lowest)])
    best = min(found, key=lambda one: one.cost.sum())
    assert best.choice.delay == pytest.approx(lowest, abs=0.01 * max(abs(lowest), 1))
    assert best.choice.terms == ("offset",)
    assert not delay.at_the_end(found)


def test_a_search_ends_where_it_gets_worse_twice(valley):
    delay.tried(None, [valley(3.0)])
    whole = [one for one in valley.tried if one == int(one)]
    assert [one for one in whole if one > 3][:2] == [5, 8] and 12 not in whole
    assert [one for one in whole if one < 0] == [-1, -2]


@pytest.mark.parametrize("lowest", [-3.0, 3.0])
def test_a_search_keeps_what_it_found_where_there_is_no_friction_beyond(
    valley, lowest, monkeypatch
):
    """As where the torque would come a quarter of a cycle late."""
    base, near = valley(lowest), delay.fitted
    monkeypatch.setattr(
        delay,
        "fitted",
        lambda cut, a, choice: near(cut, a, choice) if abs(choice.delay) < 5 else None,
    )
    best = min(delay.tried(None, [base]), key=lambda one: one.cost.sum())
    assert best.choice.delay == pytest.approx(lowest, abs=0.03)


def test_a_search_goes_on_where_nothing_is_clearly_worse(valley):
    delay.tried(None, [valley(0.0)])
    assert 27 not in valley.tried
    steep = valley(0.0)
    steep.cost = steep.cost + 50 * WOBBLE  # beyond all that a delay changes
    delay.tried(None, [steep])
    assert {90, -90} <= set(valley.tried)


@pytest.mark.parametrize(("least", "kept"), [(0.3, False), (0.2, True)])
def test_a_small_skew_is_no_delay(valley, least, kept):
    found = delay.tried(None, [valley(0.25)], least)
    assert any(abs(one.choice.delay - 0.25) < 0.04 for one in found) is kept
    assert min(abs(one.choice.delay) for one in found) >= least


def test_a_delay_is_sought_without_what_resembles_one(valley):
    base = valley(5.0)
    viscous = replace(base, choice=Choice(("offset", "viscous")), cost=base.cost / 2)
    driven = replace(base, choice=Choice(("spring",)), cost=base.cost / 2, terms={"spring": -1.0})
    found = delay.tried(None, [viscous, driven, base])
    assert {one.choice.terms for one in found} == {("offset",)}
    assert delay.tried(None, [viscous, driven]) == []


@pytest.mark.parametrize(("rows", "end"), [(89.0, False), (90.0, True), (-90.0, True)])
def test_the_end_of_the_search(rows, end):
    assert delay.at_the_end([trial(cost=1.1), trial(Choice(delay=rows))]) is end


def test_terms_are_tried_again_with_the_best_delay(monkeypatch):
    """Where the best has one, and where there is a choice of terms."""
    seen, sets = [], (("offset",), ("offset", "viscous"))
    monkeypatch.setattr(choices, "of_terms", lambda *words: seen.append(words) or ["tried"])
    late, later = trial(Choice(delay=3.0), 0.5, sigma0=120.0), trial(Choice(delay=9.0), 2.0)
    asked = explore.Asked(sets, True)
    assert explore._terms_when_late("cut", [trial(), late, later], asked) == ["tried"]
    assert seen == [("cut", 120.0 / FC, sets, 3.0)]
    assert explore._terms_when_late("cut", [trial(), later], asked) == []
    assert explore._terms_when_late("cut", [late], explore.Asked(sets[:1], True)) == []


# --- which model ----------------------------------------------------------------------------------


def model(name: str, cost: float, size: int = 2, shake: float = 0.0, **changed) -> Candidate:
    one = trial(Choice(model=name), cost, shake, **changed)
    return Candidate(name, one, [{"kind": name, "sigma0": 1.0, "Fc": 1.0}], size)


def table(*candidates: Candidate, spread: float = 10.0) -> Compared:
    return Compared(list(candidates), list(candidates), spread=spread)


def test_the_simplest_model_is_chosen_that_none_is_clearly_better_than():
    coulomb, dahl = model("Coulomb", 3.0, 1), model("Dahl", 1.0)
    near, far = model("slip K=2", 0.95, 4), model("slip K=3", 0.8, 6)
    assert table(coulomb, dahl, near).decided().chosen == "Dahl"
    assert table(coulomb, dahl, near, far).decided().chosen == "slip K=3"
    assert table(coulomb, dahl, near, replace(far, product=False)).decided().chosen == "Dahl"
    forced = table(coulomb, dahl, near).decided("Coulomb")
    assert (forced.chosen, forced.forced) == ("Coulomb", "Coulomb")
    assert table(dahl).r2(dahl) == pytest.approx(0.9)
    assert table(dahl).of("Coulomb") is None


def test_without_a_delay_the_plain_models_are_the_candidates():
    late, plain = model("Dahl", 0.5), [model("slip K=2", 0.8, 4), model("Dahl", 0.9)]
    again = replace(table(late), plain=plain).plainly()
    assert [one.name for one in again.candidates] == ["Dahl", "slip K=2"]
    assert again.of("Dahl").trial.cost.sum() == pytest.approx(0.9)


@pytest.mark.parametrize(
    ("name", "cost", "shake", "said"),
    [
        ("slip K=2", 0.94, 0.0, True),
        ("slip K=2", 0.96, 0.0, False),
        ("slip K=2", 0.78, 0.6, False),
        ("slip K=2", 0.70, 0.6, True),
        ("falling with speed", 0.5, 0.0, False),
    ],
)
def test_a_model_that_explains_more_is_named(name, cost, shake, said):
    """By five percent of the error and two standard errors."""
    dahl, other = model("Dahl", 1.0), model(name, cost, 4, shake)
    found = [one for one in model_table.findings(table(dahl, other)) if "more" in one.text]
    assert [one.doubts for one in found] == [()] * said
    r2 = 1 - cost / 10
    assert all(one.text == f"{name} explains more: R2 {r2:.4f} against 0.9000" for one in found)
    assert (model_table.better(table(dahl, other)) is other) is said


def test_where_only_rounding_is_left_nothing_explains_more():
    for spread, named in ((0.9e6, True), (1.1e6, False)):
        models = table(model("Dahl", 1.0), model("slip K=2", 0.5, 4), spread=spread)
        assert (model_table.better(models) is not None) is named
        falling = table(model("Dahl", 1.0), model("falling with speed", 0.5, 4), spread=spread)
        assert bool(model_table.findings(falling)) is named


@pytest.mark.parametrize(
    ("cost", "shake", "other", "said"),
    [
        (0.5, 0.0, 0.6, True),
        (0.5, 0.0, 0.4, False),
        (0.5, 0.9, 0.9, False),
        (0.1, 0.9, 0.9, True),
        (1.1, 0.0, 1.2, False),
    ],
)
def test_friction_that_falls_with_the_speed_claims_nothing(cost, shake, other, said):
    """Three standard errors before Dahl's, and no other model before it."""
    falling = model("falling with speed", cost, 4)
    dahl, rival = model("Dahl", 1.0), model("slip K=2", other, 4)
    falling.trial.cost += shake * WOBBLE / 8
    found = model_table.findings(table(dahl, rival, falling))
    assert [one.doubts for one in found if "speed" in one.text] == [BOTH] * said


@pytest.mark.parametrize(
    ("name", "cost", "counts"),
    [
        ("asymmetric", 0.8, True),
        ("Dahl K=2", 0.8, True),
        ("general exponent", 0.8, True),
        ("slip K=2", 0.8, True),
        ("general exponent", 0.96, False),
    ],
)
def test_models_that_explain_more_widen_the_interval(name, cost, counts):
    models = table(model("Dahl", 1.0), model(name, cost, 4))
    found = model_table.plausible(models)
    assert [one.choice.model for one in found] == [name] * counts
    assert all(one.plausible for one in found)
    assert model_table.plausible(table(model(name, cost, 4))) == []


def test_models_with_more_elements_than_the_log_asks_for_do_not():
    asked, larger = model("slip K=2", 0.8, 4), model("slip K=3", 0.79, 6)
    found = model_table.plausible(table(model("Dahl", 1.0), asked, larger))
    assert [one.choice.model for one in found] == ["slip K=2"]


@pytest.mark.parametrize(
    ("choice", "name", "cost", "plainly"),
    [
        (Choice(("offset", "viscous")), "slip K=1", 0.89, True),
        (Choice(("offset", "viscous")), "slip K=1", 0.91, False),
        (Choice(delay=2.0), "general exponent", 0.89, True),
        (Choice(delay=2.0), "slip K=3", 0.5, False),
        (Choice(("offset", "spring")), "slip K=1", 0.5, False),
    ],
)
def test_another_model_may_do_without_a_delay(choice, name, cost, plainly):
    """Where it removes a tenth of the error of Dahl's with it."""
    base = trial(choice, 1.0, 0.0)
    assert model_table.better_plainly(table(model(name, cost)), base) is plainly


def test_a_model_by_the_name_of_its_option():
    names = model_table.names()
    assert list(names) == (
        "coulomb dahl asymmetric slip-1 slip-2 slip-3 slip-4 dahl-2 mixed-2 mixed-3 mixed-4".split()
    )
    assert [names[key] for key in ("coulomb", "slip-3", "dahl-2", "mixed-4")] == [
        "Coulomb",
        "slip K=3",
        "Dahl K=2",
        "mixed K=4",
    ]


# --- fits of models, on a log ---------------------------------------------------------------------

THETA = sine(1, rows=3000, cycles=9)


def book_of(torque: np.ndarray, terms: tuple[str, ...] = ()) -> compare.Dictionary:
    log = replace(synthetic(1, rows=3000, cycles=9), theta=THETA, torque=torque, resolution=0.0)
    return compare.Dictionary(cycles.Cut([log], SIGMA0 / FC, 0.003, 90), SIGMA0 / FC, terms, 0.0)


@pytest.fixture(scope="module")
def plain_book(library):
    return book_of(dahl_torque(THETA) + 0.2, ("offset",))


@pytest.mark.parametrize("off", [0.2, 0.03, -0.137, 0.55])
def test_another_limit_each_way_is_found(off):
    """And the offset is what stands beside both limits."""
    moves = np.diff(THETA, prepend=THETA[0])
    torque = FC * (off + elements.asymmetric(moves, SIGMA0 / FC, off)) + 0.2 * FC
    found = model_table._best(model_table._asymmetric(book_of(torque)))
    (part,) = found.parts
    assert part["kind"] == "asymmetric" and found.product
    assert part["sigma0"] == pytest.approx(SIGMA0, rel=0.01)
    assert part["Fc_forward"] == pytest.approx((1 + off) * FC, rel=0.005)
    assert part["Fc_backward"] == pytest.approx((1 - off) * FC, rel=0.005)
    assert found.trial.terms["offset"] == pytest.approx(0.2 * FC, rel=0.02)


@pytest.mark.parametrize("exponent", [0.45, 1.7])
def test_the_exponent_is_found(exponent):
    moves = np.diff(THETA, prepend=THETA[0])
    book = book_of(FC * elements.general(moves, SIGMA0 / FC, exponent))
    found = model_table._best(model_table._exponents(book))
    assert found.parts[0]["exponent"] == pytest.approx(exponent, abs=0.15)
    assert not found.product


@pytest.mark.parametrize("times", [0.94, 1.3])
def test_one_slipping_spring_is_found(times):
    moves = np.diff(THETA, prepend=THETA[0])
    book = book_of(FC * path.bilinear(moves, times * SIGMA0 / FC))
    (part,) = compare.one(book, "slip", "slip").parts
    assert part == {
        "kind": "slip",
        "sigma0": pytest.approx(times * SIGMA0, rel=0.02),
        "Fc": pytest.approx(FC, rel=0.01),
    }


def test_all_columns_of_a_late_torque_are_late(plain_book):
    """Those of the elements and those of the terms."""
    late = compare.Dictionary(plain_book.cut, plain_book.a, ("spring",), 4.0)
    there = compare.Dictionary(plain_book.cut, plain_book.a, ("spring",), 0.0)
    key = compare.Key("slip", 150.0)
    for moved, still in ((late.column(key), there.column(key)), (late.beside, there.beside)):
        assert moved[4:] == pytest.approx(still[:-4])
        assert np.abs(moved - still).max() > 0


def test_the_best_pair_of_all_rows_is_taken():
    """Against non-negative least squares over each pair, in a log whose first cycles are odd."""
    moves = np.diff(THETA, prepend=THETA[0])
    a = SIGMA0 / FC * compare.NODES
    drawn = {one: path.bilinear(moves, one) for one in a}
    torque = 0.3 * drawn[a[4]] + 0.2 * drawn[a[10]]
    torque[:900] = 0.5 * drawn[a[7]][:900]
    book = book_of(torque)
    used = book.cut.root > 0
    costs = {
        (one, two): nnls(np.column_stack((drawn[one], drawn[two]))[used], torque[used])[1]
        for one, two in combinations(a, 2)
    }
    found = compare.pair(book, "slip", "slip", 0.0)
    chosen = tuple(sorted(part["sigma0"] / part["Fc"] for part in found.parts))
    assert chosen == pytest.approx(min(costs, key=costs.get), rel=1e-6)


def test_the_size_of_a_model_is_its_parameters(plain_book):
    """With the offset of this log."""
    sizes = {one.name: one.size for one in model_table._all_of(plain_book)}
    assert (sizes["Coulomb"], sizes["Dahl"], sizes["slip K=1"], sizes["slip K=2"]) == (2, 3, 3, 5)
    assert (sizes["asymmetric"], sizes["general exponent"]) == (4, 4)
    assert sizes["falling with speed"] == 5


def test_dahls_log_is_fitted_by_dahls_model(plain_book):
    """Its numbers, and a Coulomb that knows no stiffness."""
    by_name = {one.name: one for one in model_table._all_of(plain_book)}
    dahl = by_name["Dahl"]
    assert dahl.trial.value == {
        "sigma0": pytest.approx(SIGMA0, rel=1e-3),
        "Fc": pytest.approx(FC, rel=1e-3),
    }
    assert dahl.trial.terms == {"offset": pytest.approx(0.2, abs=1e-3)}
    assert dahl.parts == [{"kind": "dahl", **dahl.trial.value}]
    assert by_name["Coulomb"].parts[0]["Fc"] == pytest.approx(0.8 * FC, rel=0.2)


def test_a_log_without_a_clock_has_no_speed():
    log = replace(synthetic(1, rows=3000, cycles=9), time=None)
    book = compare.Dictionary(cycles.Cut([log], 200.0, 0.003, 90), 200.0, (), 0.0)
    assert model_table._slower(book) == []
    for rows in (slice(0, 7), slice(500, 3000), slice(None)):  # zeros, as many as there are rows
        zeros = [part.tolist() for part in speed_of(log, rows)]
        assert zeros == [[0.0] * len(log.theta[rows])] * 2


# --- cycles ---------------------------------------------------------------------------------------


def test_at_the_ends_and_the_beginning_nothing_counts():
    """The first six presliding lengths, at most a quarter of all travel, and as many rows at either
    end as a torque may be moved by.
    """
    log = replace(synthetic(1, rows=3000, cycles=9), theta=THETA)
    travel = np.cumsum(np.abs(log.moves))
    for a, reach in ((200.0, 90), (200.0, 10), (5.0, 0)):
        counted = np.flatnonzero(cycles.Cut([log], a, 0.003, reach).root)
        lost = min(6 / a, travel[-1] / 4)
        assert counted[0] == max(np.flatnonzero(travel > lost)[0], reach)
        assert counted[-1] == 2999 - reach
        assert len(counted) == counted[-1] - counted[0] + 1
    short = cycles.Cut([log.head(600)], 200.0, 0.003, 90)  # a twentieth of a short log at most
    assert np.flatnonzero(short.root)[-1] == 599 - 30


def test_columns_are_moved_within_their_own_log():
    logs = [replace(synthetic(seed, rows=1000, cycles=5), name=f"{seed}") for seed in (1, 2)]
    cut = cycles.Cut(logs, 200.0, 0.003, 10)
    up = np.arange(2000.0)[:, None]
    for rows in (3.0, -3.0, 2.25, -0.5):
        moved = cut.moved(up, rows)[:, 0]
        for start in (0, 1000):
            inner = slice(start + 5, start + 995)
            assert moved[inner] == pytest.approx(up[inner, 0] - rows)
            assert start <= moved[start] and moved[start + 999] <= start + 999
    assert cut.fold.tolist() == sorted(cut.fold.tolist()) and set(cut.fold) == {0, 1}


def test_many_cycles_are_put_together():
    cut = cycles.Cut([synthetic(1, rows=10_000, cycles=60)], 200.0, 0.003, 10)
    assert 12 < len(cut.spans) <= 24  # of 59
    assert all(one.stop == two.start for one, two in pairwise(cut.spans))
    assert cut.spans[-1].stop == cut.ends[-1] and cut.spans[0].start < 0.1 * cut.ends[-1]


def test_few_cycles_are_strokes():
    """Six reversals are too few for whole cycles; twelve are not."""
    for cycled, units in ((6.5, 12), (8.0, 7)):
        log = replace(synthetic(2, rows=4000), theta=sine(2, rows=4000, cycles=cycled))
        assert cycles.units_of(log, 0.003).max() + 1 == pytest.approx(units, abs=1)


@pytest.mark.parametrize(("count", "scored"), [(3.0, False), (3.4, True)])
def test_choices_take_six_cycles_or_strokes(count, scored):
    log = synthetic(1, rows=2000, cycles=count)
    found = pipeline.identify([log], pipeline.Options(terms=("offset",)))
    assert found.explored.taken is not None
    assert (len(found.explored.taken.cost) > 1) is scored


# --- what is shown --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def found(library):
    return pipeline.identify([synthetic(5, rows=2000, cycles=8)])


def with_models(found, *candidates: Candidate, forced: str = "", chosen: str = "Dahl"):
    models = replace(table(*candidates), chosen=forced or chosen, forced=forced)
    return replace(found, explored=replace(found.explored, models=models))


@pytest.mark.parametrize(("forced", "mark"), [("", "chosen"), ("slip K=2", "asked for")])
def test_the_table_of_the_models(found, forced, mark):
    slip = model("slip K=2", 2.0, 4)
    slip.parts = [
        {"kind": "slip", "sigma0": 12.5, "Fc": 0.25},
        {"kind": "slip", "sigma0": 3.0, "Fc": 0.75},
    ]
    result = with_models(found, model("Dahl", 1.0), slip, forced=forced, chosen="slip K=2")
    text = io.StringIO()
    Console(file=text, width=200).print(models_output.table(result))
    rows = [
        [cell.strip() for cell in line.split("│")[1:-1]] for line in text.getvalue().split("\n")
    ]
    shown = {row[0]: row[1:] for row in rows if len(row) == 4}
    assert shown["Dahl"] == ["Dahl 1, 1", "0.9000", "18"]
    assert shown[f"slip K=2 ({mark})"] == ["slip 12.5, 0.25; slip 3, 0.75", "0.8000", "54"]


def test_the_json_of_the_models(found):
    one = model("asymmetric", 2.0, 4)
    one.trial = replace(one.trial, choice=Choice(("offset",), delay=1.5), terms={"offset": 0.5})
    other = replace(model("general exponent", 1.0, 4), product=False)
    kept = models_output.numbers(with_models(found, one, other, chosen="asymmetric"))
    assert kept["model"] == "asymmetric"
    first, second = kept["models"]
    assert first == {
        "name": "asymmetric",
        "chosen": True,
        "elements": one.parts,
        "terms": {"offset": 0.5},
        "delay_rows": 1.5,
        "r2": pytest.approx(0.8),
        "instructions_m3": 33,
        "in_library": True,
    }
    assert (second["chosen"], second["in_library"], second["instructions_m3"]) == (
        False,
        False,
        None,
    )
    assert second["r2"] == pytest.approx(0.9)


def test_the_json_of_the_choices(found):
    """The best first, at most forty."""
    trials = [
        trial(Choice(("spring",), delay=float(k)), cost=1 + k % 50, sigma0=k) for k in range(60)
    ]
    trials[51].plausible = True
    seen = replace(found.explored, trials=trials, taken=trials[1], spread=100.0)
    listed = models_output.numbers(replace(found, explored=seen))["choices"]
    assert len(listed) == 40
    assert [one["r2"] for one in listed] == sorted((one["r2"] for one in listed), reverse=True)
    assert [one["taken"] for one in listed].count(True) == 1
    by_delay = {one["delay_rows"]: one for one in listed}
    assert by_delay[51.0] == {
        "model": "Dahl",
        "terms": ["spring"],
        "delay_rows": 51.0,
        "backlash_counted": False,
        "r2": pytest.approx(0.98),
        "sigma0": 51.0,
        "Fc": FC,
        "plausible": True,
        "taken": False,
    }
    assert by_delay[1.0]["taken"] and not by_delay[1.0]["plausible"]


def of_kinds(name: str, *kinds: str) -> Candidate:
    one = model(name, 0.5, 4)
    one.parts = [{"kind": kind, "sigma0": 1.0, "Fc": 1.0} for kind in kinds]
    return one


@pytest.mark.parametrize(
    ("one", "carries"),
    [
        (of_kinds("Dahl", "dahl"), "dahl"),
        (of_kinds("slip K=2", "slip", "slip"), "slip"),
        (of_kinds("mixed K=2", "dahl", "slip"), "parallel"),
        (of_kinds("Coulomb", "Coulomb"), "dahl"),
    ],
    ids=lambda one: getattr(one, "name", one),
)
def test_which_model_a_file_carries(found, one, carries):
    """The one that was chosen, as the library has it; Dahl's instead of Coulomb's, and says so."""
    result = with_models(found, one, chosen=one.name)
    assert carried.of(result).model == carries
    words = models_output.about(result)
    assert (one.name in words) is (one.name != "Dahl")
    assert ("this carries Dahl's" in words) is (one.name == "Coulomb")
    forced = models_output.about(with_models(found, one, forced=one.name))
    why = "chosen: it explains cycles that were left out better"
    assert forced == words.replace(why, "asked for")
    assert (why in words) is (one.name != "Dahl")


def test_the_torque_of_a_scene_is_late_as_its_model_says(found, tmp_path):
    """Slip elements with a delay of their own, beside what the log was shifted by."""
    slip = of_kinds("slip K=2", "slip", "slip")
    slip.trial = replace(slip.trial, choice=Choice(delay=4.0), terms={"offset": 0.25})
    taken = replace(found.explored.taken, choice=Choice(delay=1.0))
    result = with_models(found, model("Dahl", 1.0), slip, chosen="slip K=2")
    result = replace(result, explored=replace(result.explored, taken=taken))
    friction = carried.of(result)
    assert (friction.earlier, friction.terms) == (3.0, {"offset": 0.25})
    output.write_scene(result, "x", tmp_path)
    torque = np.loadtxt(tmp_path / "x.csv", delimiter=",", skiprows=1)[:, 1]
    assert torque[:-3] == pytest.approx(result.logs[0].torque[3:], abs=1e-7)
    assert "offset = 0.25\n" in (tmp_path / "x.ini").read_text()


# --- a live bus -----------------------------------------------------------------------------------


def test_a_live_bus_is_looked_at_each_time_it_has_grown_by_a_quarter(monkeypatch):
    looks = []
    signals = SimpleNamespace(found={"A": [], "T": []}, log=lambda *_: "all")
    signals.feed = lambda frame: signals.found[frame].append(0)
    monkeypatch.setattr(follow, "signals_of", lambda _: signals)
    monkeypatch.setattr(follow, "_look", lambda *_: (None, "as yet"))
    monkeypatch.setattr(pipeline, "identify", lambda logs, options: (logs, options))
    frames = [None, *"A" * 3000, *"T" * 1100, None]
    end = follow.follow(frames, None, "options", 0.1, lambda *seen: looks.append(seen))
    assert looks == [(rows, None, "as yet") for rows in (500, 625, 781, 976)]
    assert end == (["all"], "options")


@pytest.mark.parametrize(("noise", "told"), [(0.6, True), (3.0, False)])
def test_a_noisy_log_is_asked_for_choices_and_a_hopeless_one_is_not(noise, told):
    """As long as the model explains some three tenths."""
    log = synthetic(1, rows=3000, cycles=12, part=noise)
    log.torque = np.roll(log.torque, 15)
    found = pipeline.identify([log], pipeline.Options(terms=()))
    assert (found.explored.taken is not None) is told
    assert (found.r2 > 0.3) is told
    if told:
        assert found.delay == pytest.approx(15, abs=5)


def test_a_log_that_rests_at_first_is_understood():
    """Two thousand rows of nothing, then a torque of the other sign that flickers."""
    log = synthetic(3, rows=3000, cycles=6)
    still = np.zeros(2000)
    theta = np.concatenate((still + log.theta[0], log.theta))
    torque = np.concatenate((still + 0.01 * FC * np.resize([1, -1, 2], 2000), log.torque))
    late = replace(log, theta=theta, torque=-torque, time=np.arange(5000) * 1e-3)
    found = pipeline.identify([late])
    assert found.sign == -1.0
    assert found.estimate.sigma0 == pytest.approx(SIGMA0, rel=0.03)
    assert found.estimate.Fc == pytest.approx(FC, rel=0.01)


def test_each_simpler_model_has_the_terms_that_suit_it():
    """A stroke of two presliding lengths: to Coulomb's model the stiffness is a spring."""
    theta = sine(1, rows=3000, cycles=6, amplitude=0.01)
    log = synthetic(1, rows=3000, cycles=6)
    torque = dahl_torque(theta) + 0.02 * FC * np.random.default_rng(1).normal(size=3000)
    found = pipeline.identify([replace(log, theta=theta, torque=torque, resolution=0.0)])
    assert "spring" not in found.estimate.terms
    assert "spring" in found.models.terms["coulomb"]
    assert found.models.terms["dahl"] == list(found.estimate.terms)
    assert found.models.r2["none"] < found.models.r2["coulomb"] < found.models.r2["dahl"]


def test_a_trial_is_fitted_with_the_terms_of_the_result(found):
    """And no others, whatever the trial asks for."""
    log = synthetic(1, rows=2000, cycles=8)
    log.torque = log.torque + 0.4
    assert pipeline._refitted(found, [log]).terms == {}
    estimate = replace(found.estimate, terms={"offset": 0.0})
    again = pipeline._refitted(replace(found, estimate=estimate), [log])
    assert again.terms == {"offset": pytest.approx(0.4, abs=0.02)}
    turned = replace(log, torque=-log.torque)
    assert pipeline._refitted(replace(found, estimate=estimate, sign=-1.0), [turned]).Fc < 0


def test_pieces_of_one_log_are_no_logs_of_their_own():
    """Its cycles are left out one by one, as those of a log without a gap."""
    pieces = [synthetic(seed, rows=2000, cycles=6) for seed in (1, 2)]
    assert cycles.Cut(pieces, 200.0, 0.003, 9).fold is not None
    assert cycles.Cut([replace(one, name="x") for one in pieces], 200.0, 0.003, 9).fold is None
