# SPDX-License-Identifier: MIT
"""Friction that follows a measured load (`dahl identify --load`): found with a true interval, not
claimed if it is not there, and exported to plan, scene and check.
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
from dahl.identify import Log, check, identify
from identify_tools import COUNT, FC, SIGMA0, noise_of, seen, sine
from log_reading import drawing, run

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
    """Return the torque row by row, in long double.

    A falling load reduces F, a growing load does not change it. Then follows the closed form of
    one move with `share` times sigma0 and Fc.
    """
    torque, F, before = [], np.longdouble(0), share[0]  # noqa: N806
    for move, now in zip(np.diff(theta, prepend=theta[0]), share, strict=True):
        F *= min(now / before, 1.0)  # noqa: N806
        F += (np.sign(move) * now * FC - F) * -np.expm1(-np.longdouble(SIGMA0 / FC) * abs(move))  # noqa: N806
        torque.append(float(F))
        before = now
    return np.array(torque)


def loaded(course: str, seed: int, more: float = MORE, noise: float = 0.05) -> Log:
    """Return a log of 8 cycles of 10 presliding lengths; the load is in N."""
    theta, load = sine(seed, ROWS, CYCLES), 3 + 10 * COURSES[course]
    torque = torque_under(theta, 1 + more * (load - 8)) + noise * FC * noise_of(seed, ROWS)
    read, time = np.round(theta / COUNT) * COUNT, np.arange(ROWS) * 1e-3
    return Log(course, read, torque, time, resolution=COUNT, load=load)


def truth(reference: float, more: float = MORE) -> dict[str, float]:
    """Return sigma0, Fc and the slope at the reference load."""
    share = 1 + more * (reference - 8)
    return {"sigma0": SIGMA0 * share, "Fc": FC * share, "slope": more / share}


@pytest.mark.parametrize("course", COURSES)
def test_a_load_is_followed(course):
    """If the column is not used, the friction drifts, and no claim is false."""
    log = loaded(course, 1)
    found = seen(log)
    follows = found["load"]
    assert follows is not None and found["identifiable"] == {"sigma0": True, "Fc": True}
    true = truth(follows["reference"])
    for name in ("sigma0", "Fc"):
        low, high = found["ci95"][name]
        assert low <= true[name] <= high < 1.3 * low
        assert found[name] == pytest.approx(true[name], rel=0.03)
    assert abs(follows["slope"] - true["slope"]) < 4 * follows["slope_standard_error"]
    assert follows["slope"] == pytest.approx(true["slope"], rel=0.03)
    assert found["r2_plan"] > 0.98 and follows["r2"] > follows["r2_without"] + 0.02
    found = seen(replace(log, load=None))
    assert found["load"] is None and found["r2_plan"] < 0.98
    for name, (low, high) in found["ci95"].items():
        if name != "a" and found["identifiable"][name] and course == "rises":
            mean = (SIGMA0 if name == "sigma0" else FC) * 1.0
            assert low <= mean <= high


@pytest.mark.parametrize("more", [0.1999, -MORE])
def test_friction_may_vanish_at_the_least_load_or_fall_with_the_load(more):
    found = seen(loaded("swings", 1, more))
    true = truth(found["load"]["reference"], more)
    assert found["load"]["slope"] == pytest.approx(true["slope"], rel=0.03)
    assert found["Fc"] == pytest.approx(true["Fc"], rel=0.02)
    assert found["sigma0"] == pytest.approx(true["sigma0"], rel=0.04)
    assert (min(found["load"]["shares"]) < 0.02) == (more > MORE)


def test_each_of_several_logs_has_a_load_of_its_own():
    """One log has low loads, the other one high loads. If one log lacks a load, none is used."""
    half = ROWS // 2
    low = replace(loaded("rises", 1).part(slice(half)), name="low")
    high = replace(loaded("rises", 2).part(slice(half, None)), name="high")
    found = seen(low, high)
    follows = found["load"]
    assert (follows["least"], follows["most"]) == pytest.approx((3, 13))
    assert follows["slope"] == pytest.approx(truth(follows["reference"])["slope"], rel=0.05)
    assert found["Fc"] == pytest.approx(truth(follows["reference"])["Fc"], rel=0.03)
    assert identify([low, replace(high, load=None)]).samples.load is None


def test_a_load_that_friction_does_not_follow_changes_nothing():
    log = loaded("swings", 1, more=0.0)
    found, without = seen(log), seen(replace(log, load=None))
    assert found["load"] is None and any("load" in note for note in found["notes"])
    for name in ("sigma0", "Fc"):
        assert found[name] == pytest.approx(without[name], rel=2e-3)


def test_the_sign_and_a_gap_are_those_of_the_log():
    log = loaded("swings", 2, noise=0.01)
    time = log.time + 0.5 * (np.arange(ROWS) > ROWS // 2)
    found = seen(replace(log, torque=-log.torque, time=time))
    true = truth(found["load"]["reference"])
    assert found["torque_sign"] == -1 and len(found["pieces"]) == 2
    assert found["load"]["slope"] == pytest.approx(true["slope"], rel=0.03)
    assert found["Fc"] == pytest.approx(true["Fc"], rel=0.02)


def test_another_log_is_predicted_with_its_own_load():
    result, other = identify([loaded("rises", 0)]), loaded("swings", 3)
    assert check(result, other) > 0.98
    assert check(result, replace(other, load=other.load[::-1].copy())) < 0.97


# --- what is left ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def left(tmp_path_factory):
    """The output of a run over a log with a column of the load."""
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
    found, load = left.kept["load"], left.log.load
    true = truth(found["reference"])
    assert found["slope"] == pytest.approx(true["slope"], rel=0.02)
    for name, (low, high) in left.kept["ci95"].items():
        assert name == "a" or low <= true[name] <= high < 1.3 * low
    assert (found["least"], found["most"]) == pytest.approx((load.min(), load.max()))
    shares = 1 + found["slope"] * (np.array([found["least"], found["most"]]) - found["reference"])
    assert found["shares"] == pytest.approx(shares.tolist())
    assert 0 < found["slope_standard_error"] < 0.05 * found["slope"]
    assert found["r2"] > 0.99 > found["r2_without"] > 0.5
    cells = " ".join(left.shown.split())
    numbers = [f"{number:.3g}" for number in found["shares"]]
    numbers += [f"{found[name]:.4f}" for name in ("r2", "r2_without")]
    assert all(number in cells for number in numbers)
    legend = left.figure.axes[-1].get_legend().get_texts()
    assert legend[1].get_text() == f"fitted: {left.kept['model']}"


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
    """Compile a firmware with this header: counts and loads -> torques, and loads as fractions."""
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
        lines = "".join(f"{n} {load:.9g}\n" for n, load in zip(counts, loads, strict=True))
        done = subprocess.run([program], input=lines, check=True, capture_output=True, text=True)
        torque, load = np.array(done.stdout.split(), dtype=float).reshape(-1, 2).T
        return torque, load / 2**30

    return call


def test_the_header_takes_the_load_as_it_is_measured(left, firmware):
    """A firmware with this header follows the log.

    A load is limited to 0 and twice the load of the plan; NaN counts as 0.
    """
    read_by = np.round(left.log.theta / COUNT).astype(int)
    torque, _ = firmware(np.diff(read_by, prepend=read_by[0]), left.log.load)
    assert np.sqrt(np.mean((torque - left.log.torque) ** 2)) < 0.03 * FC
    assert firmware([99999999, 1], [-1e9, np.nan])[0].tolist() == [0, 0]  # no load, no friction
    found, shares = left.kept["load"], np.linspace(-0.5, 2.5, 31)
    loads = found["reference"] + (shares * max(found["shares"]) - 1) / found["slope"]
    _, limited = firmware(np.zeros(31, dtype=int), loads)
    assert limited == pytest.approx(shares.clip(0, 2), abs=1e-5) and max(limited) < 2


def test_the_scene_replays_the_load(left, dahl_loop):
    folder = left.folder
    words = [dahl_loop, "--scene", folder / "brake.ini", "--virtual", "--seconds", "4"]
    subprocess.run([*words, "--log", folder / "run.log"], check=True, capture_output=True)
    with drawing(rendered=False) as figures:
        assert run("plot", folder / "run.log", "--scene", folder / "brake.ini").returncode == 0
    caption = figures[0].axes[0].get_title(loc="left")
    assert float(re.search(r"R² = (\S+)", caption)[1]) > 0.998
