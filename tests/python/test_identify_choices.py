# SPDX-License-Identifier: MIT
"""Choices beside the parameters: scores by cycles left out, intervals over what is plausible, what
a number hangs on, and the model that a log asks for.
"""

from __future__ import annotations

import json
import subprocess
from dataclasses import replace
from unittest.mock import ANY

import numpy as np
import pytest
from conftest import ROOT
from dahl import Friction, Plan, scene
from dahl.identify import (
    carried,
    choices,
    clean,
    compare,
    cycles,
    delay,
    draw,
    elements,
    model_table,
    output,
    pipeline,
)
from dahl.identify.choices import Choice, Trial
from dahl.identify.fit import Interval
from dahl.identify.log import Log
from dahl.identify.pipeline import Options
from identify_tools import (
    COUNT,
    FC,
    SIGMA0,
    caller,
    dahl_torque,
    noise_of,
    sine,
    springs,
    synthetic,
    write_csv,
)
from identify_truth import KINDS, general
from scipy.optimize import lsq_linear

pytestmark = pytest.mark.usefixtures("library")

RNG = np.random.default_rng(5)


def log_of(torque: np.ndarray, theta: np.ndarray, noise: float = 0.02) -> Log:
    noisy = torque + noise * FC * noise_of(3, len(theta))
    return Log("log", theta, noisy, np.arange(len(theta)) * 1e-3)


MOTION = sine(2, rows=4000, cycles=9)


# --- scores ---------------------------------------------------------------------------------------


def test_a_cycle_that_is_left_out_is_predicted_by_the_others():
    """Costs and coefficients against a fit of all other rows by numpy, cycle by cycle."""
    x, y = RNG.normal(size=(60, 3)), RNG.normal(size=60)
    parts = np.split(np.column_stack((x, y)), 6)
    result = cycles.left_out(np.array([part.T @ part for part in parts]), None)
    for k, part in enumerate(parts):
        rest = np.concatenate([other for i, other in enumerate(parts) if i != k])
        best = np.linalg.lstsq(rest[:, :-1], rest[:, -1], rcond=None)[0]
        assert result.found[k] == pytest.approx(best, rel=1e-6)
        assert result.cost[k] == pytest.approx(np.sum((part[:, -1] - part[:, :-1] @ best) ** 2))


def test_a_log_that_is_left_out_tells_nothing_of_itself():
    """With several logs none of the cycles of a log is fitted when one of them is predicted."""
    x, y = RNG.normal(size=(60, 2)), RNG.normal(size=60)
    parts = np.split(np.column_stack((x, y)), 6)
    fold = np.array([0, 0, 0, 4, 4, 4])
    result = cycles.left_out(np.array([part.T @ part for part in parts]), fold)
    for k, part in enumerate(parts):
        rest = np.concatenate([other for i, other in enumerate(parts) if fold[i] != fold[k]])
        best = np.linalg.lstsq(rest[:, :-1], rest[:, -1], rcond=None)[0]
        assert result.cost[k] == pytest.approx(np.sum((part[:, -1] - part[:, :-1] @ best) ** 2))


def test_a_cycle_goes_from_one_upper_turn_to_the_next():
    unit = cycles.units_of(log_of(0 * MOTION, MOTION), 0.01)
    starts = np.flatnonzero(np.diff(unit)) + 1
    assert len(starts) >= 7
    assert np.ptp(MOTION[starts]) < 1e-3  # all at one end of the stroke
    assert np.diff(starts) == pytest.approx(4000 / 9, abs=2)


def test_torques_that_are_averaged_keep_their_cycles():
    """A cut of a long log has few bins, and its products are those of the means."""
    theta = sine(1, rows=20_000, cycles=9)
    log = log_of(dahl_torque(theta), theta)
    cut = cycles.Cut([log], SIGMA0 / FC, 0.01, 60)
    assert cut.rows == 4
    assert cut.torque == pytest.approx(log.torque.reshape(-1, 4).mean(axis=1))
    w = cut.drawn(lambda moves, _: np.cumsum(moves), 1.0)
    assert w == pytest.approx((theta - theta[0]).reshape(-1, 4).mean(axis=1), abs=1e-12)
    later = cut.moved(w[:, None], 4.0)
    assert later[1:, 0] == pytest.approx(w[:-1])


def test_the_rule_of_one_standard_error():
    best = np.array([1.0, 1.0, 1.0, 1.0])
    for shift, near in ((0.9, True), (1.1, False)):
        apart = np.array([-1.0, 1.0, -1.0, 1.0])
        apart = shift * apart.std(ddof=1) / 2 + apart
        more, error = cycles.excess(best + apart, best)
        assert (more <= error) is near


# --- elements -------------------------------------------------------------------------------------


@pytest.mark.parametrize("exponent", [0.3, 0.7, 1.6])
def test_a_general_exponent_is_the_solution_of_its_equation(exponent):
    moves = np.diff(MOTION, prepend=MOTION[0])
    ours = FC * elements.general(moves, SIGMA0 / FC, exponent)
    assert np.abs(ours - general(MOTION, exponent)).max() < 2e-3 * FC


def test_an_asymmetric_element_is_the_solution_of_its_equation():
    """Two limits, one stiffness: the exact step of each row, by hand."""
    forward, backward, F, drawn = 1.2 * FC, 0.8 * FC, 0.2 * FC, []  # noqa: N806
    moves = np.diff(MOTION, prepend=MOTION[0])
    for move in moves:
        limit = forward if move > 0 else -backward
        F += (limit - F) * -np.expm1(-SIGMA0 * move / limit) if move else 0.0  # noqa: N806
        drawn.append(F)
    w = elements.asymmetric(moves, SIGMA0 / FC, 0.2)
    assert np.abs(0.2 * FC + FC * w - drawn).max() < 1e-5 * FC


def test_no_element_pushes():
    """Least squares with some coefficients not below 0, against scipy on all rows."""
    for seed in range(5):
        draw = np.random.default_rng(seed)
        x, y = draw.normal(size=(40, 5)), draw.normal(size=40)
        whole = np.column_stack((x, y))
        lower = [0, 0, 0, -np.inf, -np.inf]
        truth = lsq_linear(x, y, (lower, np.inf), tol=1e-12).x
        assert compare.constrained(whole.T @ whole, 3) == pytest.approx(truth, abs=1e-4)


# --- intervals over choices -----------------------------------------------------------------------


def trial(choice: Choice, sigma0: float, cost: float = 1.0) -> Trial:
    steady = np.full(8, sigma0)
    values = {"sigma0": sigma0, "Fc": FC}
    without = {"sigma0": steady, "Fc": np.full(8, FC)}
    wobble = np.linspace(-0.01, 0.01, 8)
    return Trial(choice, sigma0 / FC, values, without, cost + wobble * cost)


def test_the_interval_goes_over_what_is_plausible_and_no_further():
    plain = trial(Choice(), 100.0)
    near, far = (trial(Choice(delay=3.0), 120.0), trial(Choice(delay=9.0), 300.0, cost=2.0))
    assert choices.simplest([far, near, plain]) is plain
    assert [one.plausible for one in (plain, near, far)] == [True, True, False]
    ends = {"sigma0": Interval(98.0, 102.0), "Fc": Interval(0.4, 0.6), "a": Interval(1, 2)}
    wide = choices.over([plain, near, far], plain, {"sigma0": 100.0, "Fc": FC}, ends)
    assert wide["sigma0"].low == pytest.approx(98.0)
    assert wide["sigma0"].high == pytest.approx(120 * 1.02, rel=0.01)
    assert (wide["Fc"].low, wide["Fc"].high) == pytest.approx((0.4, 0.6))
    assert choices.hangs_on([plain, near, far], plain, "sigma0") == ("the delay", 100.0, 120.0)


def test_what_is_not_needed_is_not_put_in():
    plain = trial(Choice(), 100.0, cost=1.0)
    late = trial(Choice(delay=3.0), 120.0, cost=0.99)
    assert choices.simplest([plain, late]) is plain
    assert choices.simplest([plain, replace(late, cost=0.5 * late.cost)]).choice.delay == 3.0


def test_a_spring_of_the_other_sign_is_taken_where_it_explains_much():
    """At many speeds, since in one sine a mass does the same."""
    x, slope = np.linspace(0, 1, 6000), -3.0  # N m/rad
    theta = 0.1 * np.sin(2 * np.pi * (5 * x + 6 * x**2))
    result = pipeline.identify([log_of(dahl_torque(theta) + slope * theta, theta)])
    assert result.estimate.terms == {"offset": pytest.approx(0, abs=0.01), "spring": ANY}
    assert result.estimate.terms["spring"] == pytest.approx(slope, rel=0.1)
    assert result.delay == 0
    assert result.estimate.sigma0 == pytest.approx(SIGMA0, rel=0.02)


def test_a_delay_at_the_end_of_the_search_is_refused(monkeypatch):
    monkeypatch.setattr(delay, "FAR", (1, 2, 3, 5, 8))
    monkeypatch.setattr(delay, "LONGEST", 8.0)
    log = log_of(dahl_torque(MOTION), MOTION)
    log.torque = clean.shifted(log.torque, -12)
    result = pipeline.identify([log])
    assert result.verdict.identifiable == {"sigma0": False, "Fc": False}
    assert "the best delay is at the end of the search (8 rows)" in result.verdict.text


def test_a_wide_union_says_what_it_hangs_on():
    """Where the plausible delays differ by far, and nothing else does."""
    result = pipeline.identify([synthetic(1, rows=3000, cycles=8)])
    base = result.explored.taken
    other = replace(base, choice=Choice(delay=7.0), value={"sigma0": 2 * SIGMA0, "Fc": FC})
    other.plausible = True
    result.explored = replace(result.explored, trials=[base, other])
    ends = {**result.estimate.ci95, "sigma0": Interval(90.0, 210.0)}
    result.estimate = replace(result.estimate, ci95=ends)
    said = pipeline.verdict.judge(result)
    assert not said.sigma0 and said.Fc
    assert f"sigma0 hangs on the delay: {base.value['sigma0']:.4g} to 200 N m/rad" in said.text


def test_terms_and_delay_have_standard_errors():
    """The truth lies within four of them; of the delay beside what the rows of a count hide."""
    log = KINDS["spring and viscous"](1)
    kept = output.numbers(pipeline.identify([log]))
    truth = 0.2 * FC / np.abs(log.theta).max()  # of the log's own maker
    error = kept["extra_standard_errors"]["spring"]
    assert 0 < error < 0.05 * truth
    assert abs(kept["extra"]["spring"] - truth) < 4 * error + 0.01 * truth
    kept = output.numbers(pipeline.identify([KINDS["delay of 10 rows"](1)]))
    assert 0 < kept["delay_rows_standard_error"] < 1
    assert kept["delay_rows"] == pytest.approx(10, abs=4 * kept["delay_rows_standard_error"])


# --- models ---------------------------------------------------------------------------------------

TWO_SLIPS = ((150.0, 0.3), (40.0, 0.5))


@pytest.fixture(scope="module")
def slipping(library):
    """With a load beside the friction."""
    return pipeline.identify([log_of(springs(MOTION, *TWO_SLIPS) + 0.15, MOTION, 0.01)])


def test_the_model_that_a_log_asks_for(slipping):
    """Two springs that slip: two are chosen, they are those, and Dahl's is not claimed silently."""
    models = slipping.explored.models
    assert models.chosen == "slip K=2"
    parts = sorted((part["sigma0"], part["Fc"]) for part in models.of("slip K=2").parts)
    for found, truth in zip(parts, sorted(TWO_SLIPS), strict=True):
        assert found == pytest.approx(truth, rel=0.2)
    assert "slip K=2 explains more: R2" in slipping.verdict.text
    assert models.r2(models.of("slip K=2")) > models.r2(models.of("Dahl")) + 0.003


def test_dahls_model_where_it_is_true():
    models = pipeline.identify([synthetic(1, rows=3000, cycles=8)]).explored.models
    assert models.chosen == "Dahl"
    assert models.r2(models.of("Coulomb")) < 0.9 < models.r2(models.of("Dahl"))


def test_the_numbers_of_the_models_are_in_the_json(slipping):
    kept = json.loads(output.as_json(slipping))
    assert kept["model"] == "slip K=2"
    (one,) = [model for model in kept["models"] if model["chosen"]]
    assert one["name"] == "slip K=2" and one["in_library"]
    assert len(one["elements"]) == 2
    assert {model["name"] for model in kept["models"]} >= {"Coulomb", "Dahl", "asymmetric"}
    (taken,) = [choice for choice in kept["choices"] if choice["taken"]]
    assert taken["terms"] == list(kept["extra"]) and taken["model"] == "Dahl"


def test_a_scene_replays_the_slip_elements_that_were_chosen(slipping, tmp_path):
    text = output.write_scene(slipping, "x", tmp_path).read_text()
    values = dict(line.split(" ; ")[0].split(" = ") for line in text.splitlines() if " = " in line)
    assert values["model"] == "slip"
    parts = slipping.explored.models.of("slip K=2").parts
    assert [float(one) for one in values["Fc"].split()] == [part["Fc"] for part in parts]
    assert [float(one) for one in values["sigma0"].split()] == [part["sigma0"] for part in parts]


@pytest.fixture(scope="module")
def two_elements(library):
    return pipeline.identify([KINDS["two elements"](3)])


CARRIED = {"dahl": "dahl", "slip-2": "slip", "dahl-2": "parallel", "mixed-3": "parallel"}
CARRIED["asymmetric"] = "asymmetric"


@pytest.mark.parametrize("name", CARRIED)
def test_header_and_scene_carry_the_model_that_is_asked_for(two_elements, name, tmp_path, root):
    """The plan is drawn as the library draws it, count by count; the header is what a firmware can
    compile, and the scene names the same elements.
    """
    seen = two_elements.explored
    forced = seen.models.decided(model_table.names()[name])
    result = replace(two_elements, explored=replace(seen, models=forced))
    friction = carried.of(result)
    plans = friction.plans(COUNT)
    moves = np.rint(np.diff(result.raw[0].theta[:2000], prepend=0) / COUNT).astype(int)
    drawn = sum(np.asarray(_runner(plan).run_counts(moves), dtype=float) for plan in plans.values())
    assert friction.torque(moves * COUNT) == pytest.approx(drawn, abs=2e-5)
    (tmp_path / "dahl_plan_x.h").write_text(output.header(result, "x"))
    played = scene.read(output.write_scene(result, "x", tmp_path))
    assert played.model == CARRIED[name]
    assert [force for _, force in played.elements] == list(friction.Fc)
    assert played.kinds == friction.kinds
    includes = ["-I", tmp_path, "-I", root / "lib" / "include"]
    source = tmp_path / "main.c"
    tables = "".join(f"    (void)dahl_plan_x{ending};\n" for ending in plans)
    source.write_text(f'#include "dahl_plan_x.h"\nint main(void)\n{{\n{tables}    return 0;\n}}\n')
    command = ["cc", "-std=c99", "-Wall", "-Wextra", "-Werror", *includes, "-fsyntax-only", source]
    subprocess.run(list(map(str, command)), check=True, timeout=60)


def _runner(plan):
    """A plan of Dahl's model has its state beside it, the parts theirs within."""
    return Friction(plan) if isinstance(plan, Plan) else plan


def test_the_picture_has_the_chosen_model_too(slipping, tmp_path, monkeypatch):
    """And it lies nearer to the log than Dahl's."""
    figures = []
    monkeypatch.setattr(draw.plots, "save", lambda figure, _: figures.append(figure))
    draw.draw(tmp_path / "x.png", slipping)
    drawn = {line.get_label(): line.get_ydata() for axes in figures[0].axes for line in axes.lines}
    measured = drawn["as measured"]
    lost = {
        name: np.linalg.norm(drawn[name] - measured) for name in ("slip K=2 (chosen)", "fitted")
    }
    assert lost["slip K=2 (chosen)"] < 0.8 * lost["fitted"]


def test_a_plan_of_the_chosen_model_is_the_better_one(slipping):
    """On the raw motion, by its own elements."""
    forced = pipeline.identify(slipping.raw, Options(model="dahl"))
    assert slipping.plan.r2 > forced.plan.r2 + 0.003


def test_a_model_that_is_asked_for(tmp_path, capsys):
    """It is chosen whatever the log says; Coulomb's has no plan, which is said."""
    theta = sine(2, rows=3000, cycles=8)
    path = write_csv(tmp_path / "x.csv", theta, dahl_torque(theta) + 0.02 * FC * noise_of(1, 3000))
    run = caller(capsys)
    done = run("identify", path, "--model", "coulomb", "-o", tmp_path / "out")
    assert done.returncode == 0
    assert "no plan for Coulomb's model" in " ".join(done.stdout.split())
    assert "Coulomb (asked" in " ".join(done.stdout.split())
    assert not list((tmp_path / "out").glob("*.h"))
    wrong = run("identify", path, "--model", "slop", "--no-files")
    assert wrong.returncode == 2 and "error: --model slop: no such model" in wrong.stderr


def test_the_cost_of_a_model_is_what_was_counted():
    """As many instructions as the counts in QEMU may have at most."""
    budget = json.loads((ROOT / "tests" / "target" / "budgets.json").read_text())
    counted = budget["instructions at most"]["m3"]
    for name, key in (
        ("Dahl", "one_count_q30"),
        ("asymmetric", "asymmetric_q30"),
        ("slip K=2", "slip_2_q30"),
        ("slip K=4", "slip_4_q30"),
        ("Dahl K=2", "parallel_2_q30"),
        ("mixed K=2", "mixed_2_q30"),
        ("mixed K=4", "mixed_4_q30"),
    ):
        assert model_table.instructions(name) == counted[key], name
    assert model_table.instructions("general exponent") is None


def test_terms_that_were_asked_for_are_the_only_choice():
    result = pipeline.identify([synthetic(1, rows=3000, cycles=8)], Options(terms=("viscous",)))
    tried = {one.choice.terms for one in result.explored.trials if one.choice.model == "Dahl"}
    assert tried == {("viscous",)}
