# SPDX-License-Identifier: MIT
"""Friction that follows a measured load (`dahl identify --load`): found with an interval that is
true, left alone where it is not there, and carried into plan, scene and check.
"""

from __future__ import annotations

import json
import re
import subprocess
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import built
from dahl.identify import pipeline
from dahl.identify.log import Log
from identify_tools import COUNT, FC, SIGMA0, noise_of, sine
from log_reading import drawing, read, run

pytestmark = pytest.mark.usefixtures("library")

ROWS, CYCLES = 2400, 8
REST = np.linspace(0, 1, ROWS)
COURSES = {  # of a load from 3 to 13 N over the log
    "rises": REST,
    "swings": (1 + np.sin(2 * np.pi * 5.3 * REST)) / 2,
    "swings within each stroke": (1 + np.sin(2 * np.pi * 60 * REST)) / 2,
}
MORE = 0.08  # of sigma0 and Fc at 8 N, for each N


def torque_under(theta: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Row by row in long double: a load that falls takes its part of F, one that grows leaves F;
    then the closed form of one move, in which both sigma0 and Fc are `share` times as large.
    """
    torque, F, before = [], np.longdouble(0), share[0]  # noqa: N806
    for move, now in zip(np.diff(theta, prepend=theta[0]), share, strict=True):
        F *= min(now / before, 1.0)  # noqa: N806
        F += (np.sign(move) * now * FC - F) * -np.expm1(-np.longdouble(SIGMA0 / FC) * abs(move))  # noqa: N806
        torque.append(float(F))
        before = now
    return np.array(torque)


def loaded(course: str, seed: int, more: float = MORE, noise: float = 0.05) -> Log:
    """A log of 8 cycles of 10 presliding lengths; the load is told in N."""
    theta = np.round(sine(seed, ROWS, CYCLES) / COUNT) * COUNT
    load = 3 + 10 * COURSES[course]
    torque = torque_under(theta, 1 + more * (load - 8)) + noise * FC * noise_of(seed, ROWS)
    return Log(course, theta, torque, np.arange(ROWS) * 1e-3, resolution=COUNT, load=load)


def truth(reference: float, more: float = MORE) -> dict[str, float]:
    """sigma0, Fc and the slope at the load at which they are told."""
    share = 1 + more * (reference - 8)
    return {"sigma0": SIGMA0 * share, "Fc": FC * share, "slope": more / share}


@pytest.mark.parametrize("course", COURSES)
def test_a_load_is_followed(course):
    """95 % intervals: of 6 at most 2 may miss; without its column the load is seen as a drift."""
    missed = []
    for seed in range(2):
        log = loaded(course, seed)
        result = pipeline.identify([log])
        follows, best = result.follows, result.estimate
        true = truth(follows.reference)
        assert result.verdict.identifiable == {"sigma0": True, "Fc": True}
        for name in ("sigma0", "Fc"):
            ends = best.ci95[name]
            missed += [name] * (not ends.low <= true[name] <= ends.high)
            assert ends.high < 1.2 * ends.low
        missed += ["slope"] * (abs(follows.slope - true["slope"]) > 3 * follows.error)
        assert (best.sigma0, best.Fc) == pytest.approx((true["sigma0"], true["Fc"]), rel=0.02)
        assert follows.slope == pytest.approx(true["slope"], rel=0.02)
        assert 3e-4 < follows.error / follows.slope < 0.02
        assert result.plan.r2 > 0.99 > follows.r2_without + 0.02
    assert len(missed) <= 2, missed
    log.load = None
    result = pipeline.identify([log])
    assert result.follows is None and not result.plan.r2 > 0.99
    if course == "rises":
        assert not any(result.verdict.identifiable.values()) and "Fc drifts" in result.verdict.text


def test_a_load_that_goes_to_nothing():
    """As a normal force that presses with all between nothing and twice its mean."""
    more = 0.1999  # at 3 N there is hardly any friction
    result = pipeline.identify([loaded("swings", 1, more)])
    true = truth(result.follows.reference, more)
    assert result.follows.slope == pytest.approx(true["slope"], rel=0.005)
    assert result.estimate.Fc == pytest.approx(true["Fc"], rel=0.005)
    assert result.estimate.sigma0 == pytest.approx(true["sigma0"], rel=0.02)
    assert result.follows.shares[0] < 0.01 and result.plan.r2 > 0.99


def test_friction_may_fall_with_the_load():
    """As under a load that eases the bearing."""
    result = pipeline.identify([loaded("swings", 1, -MORE)])
    true = truth(result.follows.reference, -MORE)
    assert result.follows.slope == pytest.approx(true["slope"], rel=0.02)
    assert result.estimate.Fc == pytest.approx(true["Fc"], rel=0.02)
    assert result.verdict.identifiable == {"sigma0": True, "Fc": True}


def test_each_of_several_logs_has_a_load_of_its_own():
    """Half a log with low loads, another half with high ones: told are the ends of both; and where
    one has none it is not used.
    """
    half = ROWS // 2
    low, high = (loaded("rises", seed) for seed in (1, 2))
    for log, rows in ((low, slice(half)), (high, slice(half, None))):
        for name in ("theta", "torque", "time", "load"):
            setattr(log, name, getattr(log, name)[rows])
    for logs in ((low, high), (high, low)):
        result = pipeline.identify(logs)
        true = truth(result.follows.reference)
        assert result.follows.ends == pytest.approx((3, 13))
        assert result.follows.slope == pytest.approx(true["slope"], rel=0.02)
        assert result.estimate.Fc == pytest.approx(true["Fc"], rel=0.02)
        assert result.plan.r2 > 0.99
    assert pipeline.identify([low, replace(high, load=None)]).follows is None


def test_a_load_that_friction_does_not_follow_changes_nothing():
    for course in COURSES:
        log = loaded(course, 1, more=0.0)
        result = pipeline.identify([log])
        log.load = None
        without = pipeline.identify([log])
        assert result.follows is None and any("load: not used" in note for note in result.notes)
        assert result.estimate.sigma0 == without.estimate.sigma0
        assert result.estimate.ci95 == without.estimate.ci95


def test_the_sign_the_delay_and_a_gap_are_those_of_the_log():
    """A torque of the other sign that comes 3 rows late, cut by a gap of the clock; what is left is
    the noise.
    """
    log = loaded("swings", 2, noise=0.01)
    log.torque = -np.concatenate((log.torque[:1].repeat(3), log.torque[:-3]))
    log.time = log.time + 0.5 * (np.arange(ROWS) > ROWS // 2)
    result = pipeline.identify([log])
    true = truth(result.follows.reference)
    assert result.sign == -1 and result.delay == pytest.approx(3, abs=0.2)
    assert len(result.logs) == 2
    assert result.follows.slope == pytest.approx(true["slope"], rel=0.03)
    assert result.estimate.Fc == pytest.approx(true["Fc"], rel=0.02)
    assert result.estimate.sigma0 == pytest.approx(true["sigma0"], rel=0.02)
    assert result.rmse == pytest.approx(0.01 * FC, rel=0.1)


def test_another_log_is_predicted_with_its_own_load():
    result = pipeline.identify([loaded("rises", 0)])
    other = loaded("swings", 3)
    assert pipeline.check(result, other) > 0.99
    other.load = other.load[::-1].copy()
    assert pipeline.check(result, other) < 0.97


# --- what is left ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def left(tmp_path_factory):
    """What a run over a log with a column of the load leaves."""
    folder, log = tmp_path_factory.mktemp("left"), loaded("swings", 0, noise=0.01)
    table = np.column_stack((log.time, np.degrees(log.theta), log.torque, log.load))
    names = "t_s,angle_deg,torque_Nm,clamp_N"
    np.savetxt(folder / "log.csv", table, "%.12g", ",", header=names, comments="")
    words = ("--load", "clamp_N", "--counts-per-turn", 2**14, "-o", folder, "--name", "brake")
    with drawing(rendered=False) as figures:
        done = run("identify", folder / "log.csv", *words)
    assert done.returncode == 0, done.stderr
    kept = json.loads((folder / "brake.json").read_text())
    return SimpleNamespace(folder=folder, log=log, kept=kept, figure=figures[0], shown=done.stdout)


def test_numbers_for_machines_and_people(left):
    told, load = left.kept["load"], left.log.load
    true = truth(told["reference"])
    assert told["slope"] == pytest.approx(true["slope"], rel=0.01)
    assert (left.kept["sigma0"], left.kept["Fc"]) == pytest.approx(
        (true["sigma0"], true["Fc"]), rel=0.01
    )
    assert (told["least"], told["most"]) == pytest.approx((load.min(), load.max()))
    shares = 1 + told["slope"] * (np.array([told["least"], told["most"]]) - told["reference"])
    assert told["shares"] == pytest.approx(shares.tolist())
    assert 0 < told["slope_standard_error"] < 0.05 * told["slope"]
    assert told["r2"] > 0.99 > told["r2_without"] > 0.5
    header = (left.folder / "dahl_plan_brake.h").read_text()
    (words,) = re.findall(r"load +│ (sigma0.*?) *│", left.shown)
    assert " ".join(words.split()[:6]) in " ".join(header.replace("*", " ").split())
    for number in (*told["shares"], told["r2"], told["r2_without"]):
        assert f"{number:.3g}" in words or f"{number:.4f}" in words


PROGRAM = """#include <stdio.h>
#include "dahl_plan_brake.h"
int main(void)
{
    dahl_loaded_state_t state = {{0}, 0};
    float load;
    int counts;
    while (scanf("%d %f", &counts, &load) == 2) {
        printf("%.9g %lu\\n", dahl_loaded_step_counts(&dahl_plan_brake, &state, counts,
                                                 dahl_plan_brake_load_q30(load)),
               (unsigned long)dahl_plan_brake_load_q30(load));
    }
    return 0;
}
"""


@pytest.fixture(scope="module")
def firmware(left):
    """Call a firmware with this header: counts and loads -> torques, and loads as parts of one."""
    from conftest import ROOT

    (left.folder / "main.c").write_text(PROGRAM)
    include = [f"-I{left.folder}", f"-I{ROOT}/lib/include"]
    strict = ["-Wall", "-Wextra", "-Werror", "-pedantic", *include]
    program, main = left.folder / "brake", left.folder / "main.c"
    build = ["gcc", "-std=c99", *strict, main, built("lib", "libdahl.a"), "-lm", "-o", program]
    subprocess.run(build, check=True, timeout=60)
    checked = ["g++", "-std=c++11", *strict, "-fsyntax-only", "-x", "c++", main]
    subprocess.run(checked, check=True, timeout=60)

    def call(counts, loads):
        told = "".join(f"{n} {load:.9g}\n" for n, load in zip(counts, loads, strict=True))
        done = subprocess.run([program], input=told, check=True, capture_output=True, text=True)
        torque, load = np.array(done.stdout.split(), dtype=float).reshape(-1, 2).T
        return torque, load / 2**30

    return call


def test_the_header_takes_the_load_as_it_is_measured(left, firmware):
    """A firmware with this header follows the log; beyond its loads up to twice the one that the
    plan is for, and from there on that; none below 0, and none of a load that is no number.
    """
    read_by = np.round(left.log.theta / COUNT).astype(int)
    torque, _ = firmware(np.diff(read_by, prepend=read_by[0]), left.log.load)
    assert np.sqrt(np.mean((torque - left.log.torque) ** 2)) < 0.02 * FC
    assert firmware([99999999, 1], [-1e9, np.nan])[0].tolist() == [0, 0]  # no load, no friction
    told, shares = left.kept["load"], np.linspace(-0.5, 2.5, 31)
    loads = told["reference"] + (shares * max(told["shares"]) - 1) / told["slope"]
    _, taken = firmware(np.zeros(31, dtype=int), loads)
    assert taken == pytest.approx(shares.clip(0, 2), abs=1e-5) and max(taken) < 2


def test_the_picture_draws_the_fit_through_the_measured_loop(left):
    """What the load adds included; both curves over the same angle."""
    lines = {line.get_label(): line for axes in left.figure.axes for line in axes.lines}
    (angle, measured), (at, fitted) = (lines[n].get_data() for n in ("as measured", "fitted"))
    assert at == pytest.approx(angle, abs=COUNT)
    assert measured == pytest.approx(left.log.torque, abs=1e-6)
    assert np.sqrt(np.mean((fitted - measured) ** 2)) < 0.02 * FC


def test_the_scene_replays_the_load(left, dahl_loop):
    folder = left.folder
    words = [dahl_loop, "--scene", folder / "brake.ini", "--virtual", "--seconds", "4"]
    subprocess.run([*words, "--log", folder / "run.log"], check=True, capture_output=True)
    with drawing(rendered=False) as figures:
        assert run("plot", folder / "run.log", "--scene", folder / "brake.ini").returncode == 0
    caption = figures[0].axes[0].get_title(loc="left")
    assert float(re.search(r"R² = (\S+)", caption)[1]) > 0.998


def test_the_band_brake_whose_load_moves(measured_file, tmp_path):
    """Two electric actuators move the band during the test (dataset-4): the first half fitted, the
    second predicted, with the sum of their positions for a load and without.
    """
    path = measured_file("friction_damper", "dataset-4_harmonic0.015forward.json")
    whole = np.array(json.loads(path.read_text())["data"])
    half, r2 = len(whole) // 2, {}
    names = "time_s,x_in,force_kip,first,second"
    for name, rows in (("first", whole[:half]), ("second", whole[half:])):
        table = rows[:, [0, 1, 2, 4, 5]]
        np.savetxt(tmp_path / f"{name}.csv", table, "%.12g", ",", header=names, comments="")
    for load in ((), ("--load", "first", "--load", "second")):
        words = ("--angle", "x_in", "--torque", "force_kip", *load)
        fitted, other = (read(tmp_path / f"{n}.csv", *words) for n in ("first", "second"))
        result = pipeline.identify([fitted], pipeline.Options(model="dahl"))
        r2[bool(load)] = pipeline.check(result, other)
    assert r2[True] > 0.96 > r2[False] + 0.01, r2
