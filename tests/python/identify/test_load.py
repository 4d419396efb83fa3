# SPDX-License-Identifier: MIT
"""Friction that follows a measured load (`dahl identify --load`): found with a true interval, not
claimed if it is not there, and exported to plan, scene and check.
"""

import json
import subprocess
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import built
from dahl.identify import Log, check, identify
from identify_tools import (
    COUNT,
    FC,
    SIGMA0,
    dahl_torque,
    noise_of,
    replayed_r2,
    seen,
    sine,
    write_table,
)
from log_reading import drawing, run

ROWS, CYCLES = 2400, 8
REST = np.linspace(0, 1, ROWS)
COURSES = {  # of a load from 3 to 13 N over the log
    "rises": REST,
    "swings": (1 + np.sin(2 * np.pi * 5.3 * REST)) / 2,
    "swings within each stroke": (1 + np.sin(2 * np.pi * 60 * REST)) / 2,
}
MORE = 0.08  # of sigma0 and Fc at 8 N, for each N


def loaded(course: str, seed: int, more: float = MORE, noise: float = 0.05) -> Log:
    """Return a log of 8 cycles of 10 presliding lengths; the load is in N."""
    theta, load = sine(seed, ROWS, CYCLES), 3 + 10 * COURSES[course]
    share = 1 + more * (load - 8)
    torque = dahl_torque(theta, share * SIGMA0, share * FC, is_reduced=True)
    torque += noise * FC * noise_of(seed, ROWS)
    read, time = np.round(theta / COUNT) * COUNT, np.arange(ROWS) * 1e-3
    return Log(course, read, torque, time, resolution=COUNT, load=load)


def truth(reference: float, more: float = MORE) -> dict[str, float]:
    """Return sigma0, Fc and the slope at the reference load."""
    share = 1 + more * (reference - 8)
    return {"sigma0": SIGMA0 * share, "Fc": FC * share, "slope": more / share}


@pytest.mark.parametrize(
    ("course", "more"),
    [*((name, MORE) for name in COURSES), ("swings", 0.1999), ("swings", -MORE)],
)
def test_a_load_is_followed(course, more):
    found = seen(loaded(course, 1, more))
    follows, true = found["load"], truth(found["load"]["reference"], more)
    assert found["Fc"] == pytest.approx(true["Fc"], rel=0.02)
    assert found["sigma0"] == pytest.approx(true["sigma0"], rel=0.04)
    assert follows["slope"] == pytest.approx(true["slope"], rel=0.03)
    assert (min(follows["shares"]) < 0.02) == (more > MORE)
    if more == MORE:
        assert found["identifiable"] == {"sigma0": True, "Fc": True}
        assert found["Fc_low"] is None and found["length_long"] is None
        assert found["r2_plan"] > 0.98 and follows["r2"] > follows["r2_without"] + 0.02
        for name in ("sigma0", "Fc"):
            low, high = found["ci95"][name]
            assert low <= true[name] <= high < 1.3 * low
        assert abs(follows["slope"] - true["slope"]) < 4 * follows["slope_standard_error"]


def test_each_of_several_logs_has_a_load_of_its_own():
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


def test_another_log_is_predicted_with_its_own_load():
    result, other = identify([loaded("rises", 0)]), loaded("swings", 3)
    assert check(result, other) > 0.98
    assert check(result, replace(other, load=other.load[::-1].copy())) < 0.97


# --- output ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def left(tmp_path_factory):
    folder, log = tmp_path_factory.mktemp("left"), loaded("swings", 0, noise=0.01)
    columns = {"t_s": log.time, "angle_deg": np.degrees(log.theta), "torque_Nm": log.torque}
    write_table(folder / "log.csv", {**columns, "clamp_N": log.load})
    words = ("--load", "clamp_N", "--counts-per-turn", 2**14, "-o", folder, "--name", "brake")
    with drawing(rendered=False):
        done = run("identify", folder / "log.csv", *words)
    assert done.returncode == 0, done.stderr
    kept = json.loads((folder / "brake.json").read_text())
    return SimpleNamespace(folder=folder, log=log, kept=kept, shown=done.stdout)


def test_json_and_screen_have_the_numbers_of_the_load(left):
    kept, least, most = left.kept["load"], left.log.load.min(), left.log.load.max()
    r2 = {one["name"]: one["r2"] for one in left.kept["models"]}
    assert kept == {
        "reference": pytest.approx(np.median(left.log.load)),
        "slope": pytest.approx(truth(kept["reference"])["slope"], rel=0.01),
        "slope_standard_error": pytest.approx(2e-4, abs=1.9e-4),
        "least": pytest.approx(least),
        "most": pytest.approx(most),
        "shares": [
            pytest.approx(1 + kept["slope"] * (end - kept["reference"])) for end in (least, most)
        ],
        "r2": r2["loaded"],
        "r2_without": r2["Dahl"],
        "linearised_change": pytest.approx(0, abs=0.01),
    }
    numbers = [f"{number:.3g}" for number in kept["shares"]]
    numbers += [f"{kept[name]:.4f}" for name in ("r2", "r2_without")]
    assert all(number in left.shown for number in numbers)


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
def firmware(left, root):
    """Compile a firmware with this header: counts and loads -> torques, and loads as fractions."""
    program, main = left.folder / "brake", left.folder / "main.c"
    main.write_text(PROGRAM)
    strict = ["-Wall", "-Wextra", "-Werror", "-pedantic", f"-I{left.folder}"]
    strict.append(f"-I{root}/lib/include")
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


def test_a_firmware_with_the_header_follows_the_log(left, firmware):
    """A load is limited to 0 and twice the load of the plan; NaN counts as 0."""
    read_by = np.round(left.log.theta / COUNT).astype(int)
    torque, _ = firmware(np.diff(read_by, prepend=read_by[0]), left.log.load)
    assert np.sqrt(np.mean((torque - left.log.torque) ** 2)) < 0.03 * FC
    assert firmware([99999999, 1], [-1e9, np.nan])[0].tolist() == [0, 0]  # no load, no friction
    found, shares = left.kept["load"], np.linspace(-0.5, 2.5, 31)
    loads = found["reference"] + (shares * max(found["shares"]) - 1) / found["slope"]
    _, limited = firmware(np.zeros(31, dtype=int), loads)
    assert limited == pytest.approx(shares.clip(0, 2), abs=1e-5) and max(limited) < 2


def test_the_scene_replays_the_load(left, dahl_loop, tmp_path):
    assert replayed_r2(left.folder / "brake.ini", tmp_path) > 0.998
