# SPDX-License-Identifier: MIT
"""Friction that follows a measured load (`dahl identify --load`): found with an interval that is
true, left alone where it is not there, and carried into plan, scene and check.
"""

from __future__ import annotations

import json
import re
import subprocess

import numpy as np
import pytest
from conftest import built
from dahl import Error, data, logs, plots, report, scene
from dahl.identify import draw, output, pipeline, readers
from dahl.identify import load as following
from dahl.identify.cycles import jackknife, least_squares
from dahl.identify.log import Log
from identify_tools import COUNT, FC, SIGMA0, caller, complaint, noise_of, sine

pytestmark = pytest.mark.usefixtures("library")

ROWS, CYCLES = 4800, 12
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
    """A log of 12 cycles of 10 presliding lengths; the load is told in N."""
    theta = np.round(sine(seed, ROWS, CYCLES) / COUNT) * COUNT
    load = 3 + 10 * COURSES[course]
    share = 1 + more * (load - 8)
    torque = torque_under(theta, share) + noise * FC * noise_of(seed, ROWS)
    return Log(course, theta, torque, np.arange(ROWS) * 1e-3, resolution=COUNT, load=load)


def truth(result: pipeline.Result) -> dict[str, float]:
    """sigma0, Fc and the slope at the load at which the result tells them."""
    share = 1 + MORE * (result.follows.reference - 8)
    return {"sigma0": SIGMA0 * share, "Fc": FC * share, "slope": MORE / share}


@pytest.mark.parametrize("course", COURSES)
def test_a_load_is_followed(course):
    """95 % intervals: of 6 at most 2 may miss."""
    missed = []
    for seed in range(2):
        result = pipeline.identify([loaded(course, seed)])
        true, best = truth(result), result.estimate
        assert result.verdict.identifiable == {"sigma0": True, "Fc": True}
        assert not any("drifts" in words or "steps" in words for words in result.verdict.reasons)
        missed += [n for n in best.ci95 if n != "a" and not inside(true[n], best.ci95[n])]
        missed += ["slope"] * (abs(result.follows.slope - true["slope"]) > 3 * result.follows.error)
        assert (best.sigma0, best.Fc) == pytest.approx((true["sigma0"], true["Fc"]), rel=0.02)
        assert result.follows.slope == pytest.approx(true["slope"], rel=0.02)
        assert result.plan.r2 > 0.99 > result.follows.r2_without + 0.02
    assert len(missed) <= 2, missed


def inside(value: float, interval: pipeline.Interval) -> bool:
    return bool(interval.low <= value <= interval.high)


def found_without(
    loads: following.Loads, cycle: int, at: tuple[float, float], free: bool
) -> tuple[float, float, float]:
    """sigma0, Fc and the slope by a fit of its own to all other cycles, to the end; the slope as
    well (free) or at that of all.
    """
    a, slope = at
    for _ in range(6):
        grams = loads.grams(a, slope)
        keep = [k for k in range(grams.shape[1]) if free or k != 2]
        Fc, *changes = least_squares((grams.sum(axis=0) - grams[cycle])[np.ix_(keep, keep)])  # noqa: N806
        a *= np.exp(changes[0] / Fc)
        slope += changes[1] / Fc / loads.range if free else 0.0
    return a * Fc, Fc, slope


@pytest.mark.parametrize(
    ("course", "seed", "more"),
    [("swings", 0, 0.1999), ("swings", 0, MORE), ("swings within each stroke", 1, MORE)],
)
def test_the_intervals_hold_what_is_not_known_of_the_slope(course, seed, more):
    """They are as much wider as sigma0 and Fc scatter more where each cycle in turn is left out;
    the slope's own error is its scatter there, for each unit of the load.
    """
    log = loaded(course, seed, more)
    of = [log], pipeline.identify([log]).estimate, 5 * COUNT
    follows, loads = following.found(*of), following.Loads(*of)
    at, cycles = (follows.a, follows.slope), range(len(loads.grams(follows.a, follows.slope)))
    free, fixed = (
        [
            jackknife(one)
            for one in np.transpose([found_without(loads, k, at, with_slope) for k in cycles])
        ]
        for with_slope in (True, False)
    )
    for k, name in enumerate(("sigma0", "Fc")):
        assert follows.wider[name] == pytest.approx(max(free[k] / fixed[k], 1), abs=0.005), name
    assert follows.error == pytest.approx(free[2], rel=0.05)


def test_a_load_that_goes_to_nothing():
    """As a normal force that presses with all between nothing and twice its mean."""
    more = 0.1999  # at 3 N there is hardly any friction
    result = pipeline.identify([loaded("swings", 1, more)])
    share = 1 + more * (result.follows.reference - 8)
    assert result.follows.slope == pytest.approx(more / share, rel=0.005)
    assert result.estimate.Fc == pytest.approx(FC * share, rel=0.005)
    assert result.estimate.sigma0 == pytest.approx(SIGMA0 * share, rel=0.02)
    assert result.follows.shares[0] < 0.01 and result.plan.r2 > 0.99


def test_without_its_column_the_load_is_seen_as_a_drift():
    log = loaded("rises", 0)
    log.load = None
    result = pipeline.identify([log])
    assert not any(result.verdict.identifiable.values())
    assert "Fc drifts by +" in result.verdict.text and result.follows is None


@pytest.mark.parametrize("course", COURSES)
def test_a_load_that_friction_does_not_follow_changes_nothing(course):
    log = loaded(course, 1, more=0.0)
    result = pipeline.identify([log])
    log.load = None
    without = pipeline.identify([log])
    assert result.follows is None and json.loads(output.as_json(result))["load"] is None
    assert any("not used" in note for note in result.notes)
    assert (result.estimate.sigma0, result.estimate.ci95) == (
        without.estimate.sigma0,
        without.estimate.ci95,
    )


def test_the_sign_the_delay_and_a_gap_are_those_of_the_log():
    """A torque of the other sign that comes 3 rows late, cut by a gap of the clock; what is left is
    the noise.
    """
    log = loaded("swings", 2, noise=0.01)
    log.torque = -np.concatenate((log.torque[:1].repeat(3), log.torque[:-3]))
    log.time = log.time + 0.5 * (np.arange(ROWS) > ROWS // 2)
    result = pipeline.identify([log])
    true = truth(result)
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


PROGRAM = """#include <stdio.h>
#include "dahl_plan_brake.h"
int main(void)
{
    dahl_loaded_state_t state = {{0}, 0};
    float load;
    int counts;
    while (scanf("%d %f", &counts, &load) == 2) {
        printf("%.9g\\n", dahl_loaded_step_counts(&dahl_plan_brake, &state, counts,
                                                 dahl_plan_brake_load_q30(load)));
    }
    return 0;
}
"""


@pytest.fixture(scope="module")
def left(tmp_path_factory):
    """What a run leaves, and its log."""
    folder, log = tmp_path_factory.mktemp("left"), loaded("swings", 0, noise=0.01)
    result = pipeline.identify([log])
    written = output.write_all(result, "brake", folder)
    assert written[-1].name == "dahl_plan_brake.h"
    return folder, log, result


def test_the_header_takes_the_load_as_it_is_measured(left, root):
    """Compiled as C, a firmware with this header follows the log; also as C++ without a warning."""
    folder, log, _ = left
    (folder / "main.c").write_text(PROGRAM)
    strict = ["-Wall", "-Wextra", "-Werror", "-pedantic", f"-I{folder}", f"-I{root}/lib/include"]
    program, library = folder / "brake", built("lib", "libdahl.a")
    build = ["gcc", "-std=c99", *strict, folder / "main.c", library, "-lm", "-o", program]
    subprocess.run(build, check=True, timeout=60)
    checked = ["g++", "-std=c++11", *strict, "-fsyntax-only", "-x", "c++", folder / "main.c"]
    subprocess.run(checked, check=True, timeout=60)
    moves = np.diff(np.round(log.theta / COUNT).astype(int), prepend=round(log.theta[0] / COUNT))
    told = "".join(f"{n} {load:.9g}\n" for n, load in zip(moves, log.load, strict=True))
    done = subprocess.run([program], input=told, check=True, capture_output=True, text=True)
    torque = np.array(done.stdout.split(), dtype=float)
    assert np.sqrt(np.mean((torque - log.torque) ** 2)) < 0.02 * FC
    ends = subprocess.run(
        [program], input="99999999 -1e9 1 nan", check=True, capture_output=True, text=True
    )
    assert ends.stdout.split() == ["0", "0"]  # no load, no friction


ASKED = """#include <stdio.h>
#include "dahl_plan_brake.h"
int main(void)
{
    float load;
    while (scanf("%f", &load) == 1) {
        printf("%lu\\n", (unsigned long)dahl_plan_brake_load_q30(load));
    }
    return 0;
}
"""


def test_the_header_takes_a_load_beyond_those_of_the_log(left, root, tmp_path):
    """Up to twice the one that the plan is for, and from there on that; none below 0."""
    folder, _, result = left
    (tmp_path / "main.c").write_text(ASKED)
    include = [f"-I{folder}", f"-I{root}/lib/include"]
    build = ["gcc", "-std=c99", *include, tmp_path / "main.c", "-o", tmp_path / "asked"]
    subprocess.run(build, check=True, timeout=60)
    shares = np.linspace(-0.5, 2.5, 31)
    loads = (
        result.follows.reference + (shares * result.follows.shares[1] - 1) / result.follows.slope
    )
    told = " ".join(f"{load:.9g}" for load in loads)
    done = subprocess.run(
        [tmp_path / "asked"], input=told, check=True, capture_output=True, text=True, timeout=60
    )
    taken = [int(word) / 2**30 for word in done.stdout.split()]
    assert taken == pytest.approx(shares.clip(0, 2).tolist(), abs=1e-5)
    assert max(taken) < 2


def test_the_picture_draws_the_fit_through_the_measured_loop(left, monkeypatch, tmp_path):
    """What the load adds included; both curves over the same angle."""
    _, log, result = left
    figures = []
    monkeypatch.setattr(plots, "save", lambda figure, path: figures.append(figure))
    draw.draw(tmp_path / "x.png", result)
    lines = {line.get_label(): line for axes in figures[0].axes for line in axes.lines}
    (angle, measured), (at, fitted) = (lines[n].get_data() for n in ("as measured", "fitted"))
    assert at == pytest.approx(angle, abs=COUNT)
    assert np.ptp(measured) == pytest.approx(np.ptp(log.torque), rel=0.1)
    assert np.sqrt(np.mean((fitted - measured) ** 2)) < 0.02 * FC


def test_the_scene_replays_the_load(left, dahl_loop):
    folder, *_ = left
    played = scene.read(folder / "brake.ini")
    run = [dahl_loop, "--scene", folder / "brake.ini", "--virtual", "--seconds", "4"]
    subprocess.run([*run, "--log", folder / "run.log"], check=True, capture_output=True, timeout=60)
    trace = report.trace_of(logs.read_candump(folder / "run.log"))
    recorded = scene.read_log(played, folder / "brake.csv")
    assert report.fit(played, trace, recorded)["r2_measured"] > 0.998


def test_numbers_for_machines(left):
    folder, log, result = left
    told = json.loads((folder / "brake.json").read_text())["load"]
    assert told["least"], told["most"] == (log.load.min(), log.load.max())
    shares = 1 + told["slope"] * (np.array([told["least"], told["most"]]) - told["reference"])
    assert told["shares"] == pytest.approx(shares.tolist())
    assert 0 < told["slope_standard_error"] < 0.05 * told["slope"]
    assert told["r2"] > 0.99 > told["r2_without"]
    assert "follow the load" in (folder / "dahl_plan_brake.h").read_text()


# --- where a load comes from ---------------------------------------------------------------------


def test_columns_are_added(tmp_path):
    """By name or number; a load's column is not taken for the torque, whose name it resembles."""
    table = "angle_deg,load_N,torque_Nm,clamp_N\n" + "".join(
        f"{k},{k},7,{10 * k}\n" for k in range(9)
    )
    (tmp_path / "x.csv").write_text(table)
    log = readers.read(tmp_path / "x.csv", readers.Source(load=("load_N", "4")))
    assert log.load.tolist() == [11 * k for k in range(9)] and set(log.torque) == {7}
    assert readers.read(tmp_path / "x.csv", readers.Source(torque="torque_Nm")).load is None


BUS = """VERSION ""
BU_: A
BO_ 256 Shaft: 8 A
 SG_ Angle : 0|32@1- (0.1,0) [0|0] "deg" A
 SG_ Torque : 32|32@1- (0.1,0) [0|0] "Nm" A
BO_ 257 Brake: 8 A
 SG_ Clamp : 0|16@1- (1,0) [0|0] "N" A
BO_ 258 Cell: 8 A
 SG_ Moment : 0|16@1- (0.1,0) [0|0] "Nm" A
"""


def test_a_signal_of_a_bus_is_a_load(tmp_path):
    """At the times of the angle, between its own frames."""
    import can

    (tmp_path / "bus.dbc").write_text(BUS)
    with can.Logger(tmp_path / "x.log") as writer:
        for k in range(9):
            frames = [(256, bytes(4) + bytes([k, 0, 0, 0]))]
            frames += [(257, bytes([10 * k, 0] + [0] * 6))] * (k % 2 == 0)
            for number, content in frames:
                writer(can.Message(float(k), number, False, data=content))
    given = {"angle": "Angle", "torque": "Torque", "dbc": tmp_path / "bus.dbc"}
    log = readers.read(tmp_path / "x.log", readers.Source(**given, load=("Clamp",)))
    assert log.load.tolist() == [10 * k for k in range(9)]
    with pytest.raises(Error, match="no signal 'Clam' in the DBC.*Clamp"):
        readers.read(tmp_path / "x.log", readers.Source(**given, load=("Clam",)))


def test_a_load_is_that_of_the_time_at_which_a_torque_is_known(tmp_path):
    """The torque begins after the angle and ends before it, between whose frames it comes."""
    import can

    (tmp_path / "bus.dbc").write_text(BUS)
    frames = [(float(k), 256, k) for k in range(9)]
    frames += [(float(k), 257, 10 * k) for k in range(0, 9, 2)]
    frames += [(k + 0.5, 258, 10 * k) for k in range(2, 7)]
    with can.Logger(tmp_path / "x.log") as writer:
        for time, number, value in sorted(frames):
            content = value.to_bytes(2, "little") + bytes(6)
            writer(can.Message(time, number, False, data=content))
    source = readers.Source("Angle", "Moment", dbc=tmp_path / "bus.dbc", load=("Clamp",))
    log = readers.read(tmp_path / "x.log", source)
    assert log.time.tolist() == [3, 4, 5, 6]
    assert log.load == pytest.approx(10 * log.time)
    assert log.torque == pytest.approx(log.time - 0.5)
    assert np.degrees(log.theta) == pytest.approx(0.1 * log.time)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--load", "clam"], "no column 'clam'.*clamp"),
        (["--load", "torque_Nm", "--torque", "torque_Nm"], "'torque_Nm' cannot be both torque and"),
        (["--load", "clamp", "--load", "clamp"], "'clamp' cannot be both load 1 and load 2"),
        (["--load", "clamp"], "x.csv:4: column 'clamp': no finite number here"),
    ],
)
def test_bad_loads_are_one_line(words, said, tmp_path, capsys):
    (tmp_path / "x.csv").write_text("angle_deg,torque_Nm,clamp\n1,2,3\n2,3,4\n3,4,inf\n4,5,6\n")
    done = caller(capsys)("identify", tmp_path / "x.csv", *words)
    code, line = complaint(done)
    assert code == 2 and re.search(said, line), line


# --- measured ------------------------------------------------------------------------------------


def test_the_band_brake_whose_load_moves(measured_file, tmp_path):
    """Two electric actuators move the band during the test (dataset-4): the first half fitted, the
    second predicted, with the sum of their positions for a load and without.
    """
    whole = np.array(
        json.loads(
            measured_file("friction_damper", "dataset-4_harmonic0.015forward.json").read_text()
        )["data"]
    )
    half, r2 = len(whole) // 2, {}
    for name, rows in (("first", whole[:half]), ("second", whole[half:])):
        table = rows[:, [0, 1, 2, 4, 5]]
        names = "time_s,x_in,force_kip,first,second"
        np.savetxt(tmp_path / f"{name}.csv", table, "%.12g", ",", header=names, comments="")
    for load in ((), ("first", "second")):
        source = readers.Source("x_in", "force_kip", load=load)
        fitted, other = (readers.read(tmp_path / f"{n}.csv", source) for n in ("first", "second"))
        result = pipeline.identify([fitted], pipeline.Options(model="dahl"))
        r2[bool(load)] = pipeline.check(result, other)
    assert r2[True] > 0.96 > r2[False] + 0.01, r2
    assert data.SETS["friction_damper"].files[2].name.startswith("dataset-4")
