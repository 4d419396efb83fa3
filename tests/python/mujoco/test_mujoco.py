# SPDX-License-Identifier: MIT
"""dahl.friction in MuJoCo: the bits of the library for each model and integrator, on joints and
tendons; states that can be copied, reset and rolled back; the hinge under half of Fc.
"""

import copy
import ctypes
import gc
import math
import os
import re
import shutil
import sys
from contextlib import nullcontext
from importlib import import_module
from pathlib import Path
from typing import Any

import dahl
import model_examples
import numpy as np
import pytest
from conftest import ROOT
from dahl.binding import models
from dahl.simulators import mujoco_plugin
from programs import run
from scipy.integrate import solve_ivp

MISSING = "unproven: dahl.friction in MuJoCo: the package mujoco is not installed"
pytest.importorskip("mujoco.rollout", reason=MISSING)  # `mujoco` alone would find this folder
import_module("dahl.mujoco")  # registers the plugin
mujoco: Any = import_module("mujoco")

INTEGRATORS = ["Euler", "implicitfast", "RK4"]
MECHANISM = """<worldbody>
    <body><joint name="a"/><geom size=".1"/><site name="a" pos=".3 0 0"/></body>
    <body pos="0 1 0"><joint name="b" type="slide"/><geom size=".1"/><site name="b"/></body>
    <body pos="0 3 0"><freejoint name="free"/><geom size=".1"/></body></worldbody>
    <tendon><spatial name="s"><site site="a"/><site site="b"/></spatial>
    <fixed name="t"><joint joint="a" coef="1"/><joint joint="b" coef="-.5"/></fixed></tendon>
    <actuator><motor joint="a"/><motor joint="b"/></actuator>
    <keyframe><key name="away" time="7" qpos=".5 -.3 0 3 0 1 0 0 0"/></keyframe>"""
PARAMETERS = {"a": (60, 0.3), "b": (20, 0.2), "s": (30, 0.2), "t": (50, 0.1)}  # sigma0, Fc
SEVERAL = {
    f"of {name}": {"joint" if name in "ab" else "tendon": name, "sigma0": sigma0, "Fc": Fc}
    for name, (sigma0, Fc) in PARAMETERS.items()
}
REST, FULL = 0.25, 0.25  # of the load [1], [N m]; large torques exceed a load of 1


def made(
    instances: dict[str, dict[str, Any]], integrator: str = "Euler", mechanism: str = MECHANISM
) -> Any:
    """Return a model with these instances, and its data."""
    words = ""
    for name, keys in instances.items():
        configs = "".join(f'<config key="{key}" value="{keys[key]}"/>' for key in keys)
        words += f'<instance name="{name}">{configs}</instance>'
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep=".001" gravity="0 0 0" integrator="{integrator}"/><extension>
        <plugin plugin="dahl.friction">{words}</plugin></extension>{mechanism}</mujoco>"""
    )
    return model, mujoco.MjData(model)


def torques(columns: int) -> np.ndarray:
    """Return random torques for 400 steps that change every 20 steps."""
    return np.repeat(np.random.default_rng(2).uniform(-2, 2, (20, columns)), 20, axis=0)


def push(model: Any, data: Any) -> bytes:
    """Step with random torques and return the bits of the state."""
    for data.ctrl[:] in torques(model.nu):
        mujoco.mj_step(model, data)
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, state, kind)
    return state.tobytes()


class Reference:
    """A model of the package, moved by angles."""

    def __init__(self, name: str) -> None:
        self.model = models.table()["dahl" if name == "by angle" else name]
        made = model_examples.made(self.model)
        self.friction = dahl.Friction(made) if isinstance(made, dahl.Plan) else made
        self.theta = 0.0 if name == "by angle" else float(np.float32(model_examples.THETA))
        Fc = np.float32(model_examples.numbers(self.model)[1]).astype(float)
        self.whole = Fc.max() if self.model.has_two_limits else Fc.sum()

    def config(self) -> dict[str, Any]:
        keys = dict(line.split(" = ") for line in model_examples.keys(self.model).splitlines())
        keys |= {"theta_per_count": model_examples.THETA} if self.theta else {}
        keys |= {"full": FULL, "rest": REST} if self.model.name == "loaded" else {}
        return keys | {"joint": "a"}

    def move(self, before: float, after: float, load: float) -> float:
        if not self.theta:
            return self.friction.step(np.float32(after - before))
        counts = round(after / self.theta) - round(before / self.theta)
        if self.model.name == "dahl":
            return self.friction.step_counts(counts)
        loads = (load,) if self.model.name == "loaded" else ()
        return self.friction.step_counts_q30(counts, *loads) / 2**30 * self.whole


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("name", [*models.table(), "by angle"])
def test_the_force_has_the_bits_of_the_library(name, integrator) -> None:
    """It starts where the user puts the joint. The C adds the elements of a mix in another order,
    as in a node.
    """
    reference = Reference(name)
    model, data = made({"of a": reference.config()}, integrator)
    mujoco.mj_forward(model, data)
    data.qpos[0], data.qvel[0], load, seen = 0.3, 2, REST, []
    for torque in torques(1) * reference.whole:
        before, data.ctrl[0] = data.qpos[0], torque[0]
        mujoco.mj_step(model, data)
        reference.move(before, data.qpos[0], load)
        load = min(1.0, REST + abs(torque[0]) / FULL)
        mujoco.mj_forward(model, data)
        seen.append((-data.qfrc_passive[0], copy.deepcopy(reference).move(0, 0, load)))
    got, expected = np.transpose(seen)
    slack = 4 * 2.0**-30 * reference.whole if name == "parallel" else 0.0
    assert abs(got - expected).max() <= slack and np.ptp(got) > 0.5 * reference.whole


def test_a_count_without_theta_per_count_is_2e_20_of_the_least_presliding_length() -> None:
    keys = {"joint": "a", "model": "slip", "sigma0": "16 64", "Fc": ".5 .25"}
    more: list[dict[str, Any]] = [{}, {"theta_per_count": 2.0**-28}]
    states = {push(*made({"of a": keys | each})) for each in more}
    assert len(states) == 1


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_each_joint_and_tendon_has_its_own_friction(integrator) -> None:
    """The force of a tendon reaches the joints by its Jacobian."""
    model, data = made(SEVERAL, integrator)
    bearings = [dahl.Friction(dahl.Plan(*pair)) for pair in PARAMETERS.values()]
    mujoco.mj_forward(model, data)
    before, jacobian = np.array([*data.qpos[:2], *data.ten_length]), np.eye(4, model.nv)
    for data.ctrl[:] in torques(2):
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        after = np.array([*data.qpos[:2], *data.ten_length])
        moves = np.float32(after - before)
        forces = [bearing.step(move) for bearing, move in zip(bearings, moves, strict=True)]
        places = model.ten_J_rownnz, model.ten_J_rowadr, model.ten_J_colind
        mujoco.mju_sparse2dense(jacobian[2:], data.ten_J, *places)
        assert data.qfrc_passive == pytest.approx(-(forces @ jacobian), abs=1e-12)
        before = after
    assert np.abs(forces).min() > 0.01


def test_a_trial_position_and_any_numbers_in_the_state_are_safe() -> None:
    model, data = made(SEVERAL | {"mix": Reference("parallel").config()})
    push(model, data)
    state, place, forces = data.plugin_state.copy(), data.qpos[0], []
    for angle in (place, place - 0.01, place):
        data.qpos[0] = angle
        mujoco.mj_forward(model, data)
        forces.append(data.qfrc_passive.copy())
    assert (forces[0] == forces[2]).all() and forces[1][0] > forces[0][0]
    assert (data.plugin_state == state).all()
    for data.plugin_state[:] in (-1.0, np.nan, np.inf, 1e300, 0.5):
        mujoco.mj_forward(model, data)
        assert (np.abs(data.qfrc_passive) < 3).all()


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_copy_a_rollback_and_a_reset_go_on_with_the_same_bits(integrator) -> None:
    more = {name: Reference(name).config() for name in ("loaded", "parallel")}
    more["damped"] = SEVERAL["of s"] | {"dampratio": 0.3}
    model, data = made(SEVERAL | more, integrator)
    middle = push(model, data)
    other = copy.copy(data)
    end = push(model, data)
    assert push(model, other) == end != middle
    for used in (mujoco.MjData(model), other):
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        mujoco.mj_setState(model, used, np.frombuffer(middle), kind)
        assert push(model, used) == end
    mujoco.mj_resetData(model, data)
    assert not data.plugin_state.any() and push(model, data) == middle


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_it_starts_relaxed_where_the_first_step_finds_the_joint(integrator) -> None:
    """Also if the time is set after a call of mj_forward(), and after a reset to a keyframe."""
    model, data = made(SEVERAL, integrator)
    mujoco.mj_forward(model, data)
    data.time = 5
    for _ in range(2):
        for data.qpos[:2] in (0.5, 0.7, 0.9):
            mujoco.mj_forward(model, data)
            assert not data.qfrc_passive.any()
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        assert not data.qfrc_passive.any()
        push(model, data)
        mujoco.mj_resetDataKeyframe(model, data, 0)


def test_the_force_on_a_tree_that_sleeps_stays() -> None:
    model, data = made(SEVERAL)
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    model.opt.sleep_tolerance = 1e-2
    model.tree_sleep_policy[:] = mujoco.mjtSleepPolicy.mjSLEEP_ALLOWED
    model.dof_damping[:2] = 0.5
    data.qfrc_applied[:2] = 0.1, 0.05
    mujoco.mj_step(model, data, 500)
    data.qfrc_applied[:] = 0
    while data.tree_awake.any() and data.time < 20:
        mujoco.mj_step(model, data)
    asleep = data.qfrc_passive.copy()
    mujoco.mj_step(model, data, 100)
    assert not data.tree_awake.any() and (data.qfrc_passive == asleep).all()
    assert asleep[:2].all()


HINGE = """<option timestep="{}" integrator="{}"/><worldbody><body><joint name="a" axis="0 0 1"/>
    <geom type="box" size=".1 .1 .01" mass="1"/></body></worldbody>
    <actuator><motor joint="a"/></actuator>"""
RATIO = 0.3  # of the damping


def exact_damped_angle(seconds: float, sigma0: float, Fc: float, inertia: float) -> float:
    """Return the angle of a hinge under half of Fc, with LuGre's sigma1 and no other damping."""
    sigma1 = 2 * RATIO * math.sqrt(inertia * sigma0)

    def slope(_: float, state: Any) -> list[float]:
        _, speed, force = state
        bristle = speed * (1 - force / Fc * np.sign(speed))
        return [speed, (Fc / 2 - force - sigma1 * bristle) / inertia, sigma0 * bristle]

    solved = solve_ivp(slope, (0, seconds), [0, 0, 0], rtol=1e-10, atol=1e-12)
    return float(solved.y[0, -1])


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_with_dampratio_the_time_step_hardly_changes_the_angle(integrator) -> None:
    """In proportion to the step: by 1.5 % at 2 ms, and by 3 % with RK4."""
    exact, instance = exact_damped_angle(1, 120, 1.8, 1 / 150), {"joint": "a", "sigma0": 120}
    for step in (1e-5, 1e-4, 5e-4, 2e-3):
        hinge = HINGE.format(step, integrator)
        model, data = made({"of a": instance | {"Fc": 1.8, "dampratio": RATIO}}, mechanism=hinge)
        data.ctrl[0] = 0.9
        mujoco.mj_step(model, data, round(1 / step))
        bound = (0.03 if integrator == "RK4" else 0.015) * step / 2e-3
        assert data.qpos[0] == pytest.approx(exact, rel=max(bound, 1e-4))


@pytest.mark.parametrize("name", models.table())
def test_with_dampratio_a_hinge_under_half_of_Fc_comes_to_rest(name) -> None:
    """It then keeps its angle."""
    keys = Reference(name).config() | {"dampratio": RATIO, "theta_per_count": ""}
    keys |= {"full": 1e12, "rest": 1} if name == "loaded" else {}
    sigma0 = sum(map(float, str(keys["sigma0"]).split()))
    step = 0.25 * math.sqrt(1 / 150 / sigma0)
    model, data = made({"of a": keys}, mechanism=HINGE.format(step, "Euler"))
    data.ctrl[0] = min(map(float, str(keys["Fc"]).split())) / 2
    mujoco.mj_step(model, data, round(9 / step))
    before = data.qpos[0]
    mujoco.mj_step(model, data, round(1 / step))
    assert data.qpos[0] == pytest.approx(before, abs=1e-7)


@pytest.mark.parametrize("name", [*models.table(), "by angle"])
def test_the_damping_only_takes_energy_and_reverses_no_speed_at_any_time_step(name) -> None:
    """It is the difference to an instance without it in the same state."""
    keys, rng = Reference(name).config(), np.random.default_rng(3)
    (model, data), (plain, other) = (made({"of a": keys | {"dampratio": k}}) for k in (1, 0))
    for step in (1e-6, 1e-3, 3e-2, 1.0, 100.0):
        model.opt.timestep = plain.opt.timestep = step
        for turn in rng.normal(0, 0.01, 60):
            data.qvel[:2] = rng.normal(0, 1, 2) * 10 ** rng.uniform(-6, 2)
            other.qpos[:], other.qvel[:], other.time = data.qpos, data.qvel, data.time
            other.plugin_state[:] = data.plugin_state
            mujoco.mj_forward(model, data), mujoco.mj_forward(plain, other)
            change = (data.qacc[0] - other.qacc[0]) * step
            speed = data.qvel[0]
            assert -0.5001 * speed**2 - 1e-12 <= change * speed <= 0
            data.qpos[0] += turn
            mujoco.mj_step(model, data)
            data.qpos[:], data.qvel[:] = np.nan_to_num(data.qpos), 0


@pytest.mark.parametrize("angle", [0, 1e-9, 1e-3])
def test_the_damping_of_a_tendon_that_no_joint_moves_is_finite(angle) -> None:
    """It is outstretched in qpos0. Its energy only falls."""
    stretched = """<worldbody><body><joint name="a" axis="0 0 1"/><site name="p" pos=".5 0 0"/>
        <geom size=".1"/></body><site name="q" pos="1 0 0"/></worldbody>
        <tendon><spatial name="t"><site site="p"/><site site="q"/></spatial></tendon>"""
    model, data = made({"t": SEVERAL["of t"] | {"dampratio": 1}}, mechanism=stretched)
    data.qpos[0], data.qvel[0] = angle, 1
    for _ in range(3000):
        mujoco.mj_step(model, data)
        assert 0 <= abs(data.qvel[0]) <= 1 + 1e-9


LINK = '<body pos=".2 0 0"><joint name="j{0}" axis="0 0 1"/><geom type="capsule" size=".02"'
LINK += ' fromto="0 0 0 .2 0 0" contype="0" conaffinity="0"/>'


@pytest.mark.parametrize("joints", [1, 6], ids=["six on one joint", "six links"])
@pytest.mark.parametrize("ratio", [0, 0.3, 1])
def test_damping_makes_no_coupled_joints_unstable(joints, ratio) -> None:
    """At 3/4 of the time step at which the same springs without damping become unstable."""
    links = "".join(LINK.format(k) for k in range(joints)) + "</body>" * joints
    keys = {"sigma0": 1, "Fc": 0.01, "dampratio": ratio}
    instances = {f"of {k}": keys | {"joint": f"j{k % joints}"} for k in range(6)}
    model, data = made(instances, mechanism=f"<worldbody>{links}</worldbody>")
    mujoco.mj_forward(model, data)
    inverse = np.empty((joints, joints))
    mujoco.mj_solveM(model, data, inverse, np.eye(joints))
    model.opt.timestep = 1.5 / math.sqrt(np.linalg.eigvalsh(inverse).max() * 6 / joints)
    data.qvel[:] = np.random.default_rng(0).normal(0, 1e-4, joints)
    mujoco.mj_step(model, data, 400)
    assert abs(data.qvel).max() < 1e-3


@pytest.mark.parametrize("ratio", [0.3, 1.0])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_an_arm_that_folds_keeps_losing_energy_and_comes_to_rest(ratio, integrator) -> None:
    """Five links: the inertia at a joint changes by a factor of 60. The time step is 0.3 of
    sqrt(inertia/sigma0) for the least inertia.
    """
    links = "".join(LINK.format(k) for k in range(5)) + "</body>" * 5
    keys = {"sigma0": 10, "Fc": 0.05, "dampratio": ratio}
    arm = f"<worldbody>{links}</worldbody>"
    model, data = made({f"of {k}": keys | {"joint": f"j{k}"} for k in range(5)}, integrator, arm)
    inverse, least = np.empty((5, 5)), np.inf
    for data.qpos[:] in np.random.default_rng(4).uniform(-3, 3, (200, 5)):
        mujoco.mj_forward(model, data)
        mujoco.mj_solveM(model, data, inverse, np.eye(5))
        least = min(least, 1 / inverse.diagonal().max())
    model.opt.timestep = 0.3 * math.sqrt(least / 10)
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    mujoco.mj_resetData(model, data)
    data.qpos[:], data.qvel[:] = 2, np.random.default_rng(5).normal(0, 5, 5)
    peaks = []
    for _ in range(10):
        energies = []
        for _ in range(round(2 / model.opt.timestep)):
            mujoco.mj_step(model, data)
            energies.append(data.energy[1])
        peaks.append(max(energies))
    assert (np.diff(peaks) < 0).all() and peaks[-1] < 1e-5 * peaks[0]


def test_the_hinge_holds_under_half_of_Fc_and_threads_change_no_bit() -> None:
    printed = run(sys.executable, "-m", "dahl.mujoco")
    rows = re.findall(r"^ *([\d.]+) +([\d.]+) +([\d.]+) +([\d.]+) .* ([\d.]+) ", printed, re.M)
    assert len(rows) == 8 and {float(step) for _, step, *_ in rows} == {0.05, 0.5, 1, 2}
    for damping, _, exact, native, own in (map(float, row) for row in rows):
        error = abs(own / exact - 1)
        assert error < (0.03 if damping else 0.002) and error < abs(native / exact - 1) / 3
    assert "1000 rollouts on 4 threads: the same bits as on one thread" in printed
    rows = re.findall(r"^(\w.*?\S)  +(.+)$", printed.partition("step [us]\n")[2], re.M)
    ways = {name: [float(number) for number in numbers.split()] for name, numbers in rows}
    _, drifts, *arms, costs = np.transpose(list(ways.values()))
    assert len(ways) == 10 and (costs > 0).all()
    is_rest = np.abs([drifts, *arms]).max(axis=0) < 1e-3
    rests = {name for name in ways if "dampratio" in name} | {"LuGre, sigma1 critical"}
    assert {name for name, rest in zip(ways, is_rest, strict=True) if rest} == rests
    exact = 1e3 * exact_damped_angle(10, 120, 1.8, 1 / 150)
    assert ways["dahl.friction, dampratio"][0] == pytest.approx(exact, rel=0.015)


SLIP, MIX = {"model": "slip"}, {"model": "parallel", "kinds": "slip dahl"}
EIGHT = {"sigma0": "1 " * 8, "Fc": "1 " * 8}
SOFT = models.with_key("breakaway").name
BAD: list[tuple[dict[str, Any], str]] = [  # keys of an instance, words of the error
    ({"Fc": -1}, "Fc = -1 is outside 5.42101e-20 .. 1.84467e+19"),
    ({"sigma0": "1e3x"}, "sigma0 = 1e3x is not a number"),
    ({"Fc": "1,2"}, "Fc = 1,2 is not a number; separate several by blanks"),
    ({"Fc": "nan"}, "Fc = nan is outside"),
    ({"sigma0": ""}, "model = dahl needs sigma0"),
    ({"Fc": " "}, "model = dahl needs Fc"),
    ({"model": "loaded", "full": " "}, "model = loaded needs full"),
    ({"model": SOFT, "breakaway": " "}, f"model = {SOFT} needs breakaway"),
    ({"Fc": "1 1 1 1 1 1 1 1 1"}, "Fc = 1 1 1 1 1 1 1 1 1 has more than 8 values"),
    ({"Fc": "1 2"}, "model = dahl does not fit 1 sigma0 and 2 Fc"),
    ({"model": "asymmetric", "Fc": "1"}, "model = asymmetric does not fit 1 sigma0 and 1 Fc"),
    ({"model": "loaded", "full": 1, "sigma0": "1 2"}, "loaded does not fit 2 sigma0 and 1 Fc"),
    (SLIP | {"sigma0": "1 2", "Fc": "1"}, "model = slip does not fit 2 sigma0 and 1 Fc"),
    (SLIP | {"sigma0": "1", "Fc": "1 2"}, "model = slip does not fit 1 sigma0 and 2 Fc"),
    (MIX | {"sigma0": "1 2 3", "Fc": "1 2"}, "parallel does not fit 3 sigma0 and 2 Fc"),
    (MIX | {"sigma0": "1", "Fc": "1 2"}, "model = parallel does not fit 1 sigma0 and 2 Fc"),
    (MIX | {"sigma0": "1 2", "Fc": "1 2", "kinds": "slip"}, "kinds = slip has 1 words for 2 Fc"),
    ({"model": "parallel"}, "model = parallel needs kinds"),
    ({"model": "loaded", "full": 1, "rest": 1.5}, "rest = 1.5 is outside 0 .. 1"),
    ({"theta_per_count": "1 2"}, "theta_per_count = 1 2 has more than 1 values"),
    ({"theta_per_count": 1e-15}, "theta_per_count = 1e-15 is outside 2^-30 .. 2^20 of Fc/sigma0"),
    ({"model": "lugre"}, "model = lugre is none of dahl slip parallel"),
    ({"model": SOFT, "breakaway": 1}, "breakaway = 1 is outside 1e-45 .. 1"),
    ({"breakaway": 0.5}, f"breakaway = 0.5 is for model = {SOFT}, not for dahl"),
    ({"model": "parallel", "kinds": "dahl dahl"}, "kinds = dahl dahl has 2 words for 1 Fc"),
    ({"model": "parallel", "kinds": "slip " * 9} | EIGHT, "has more than 8 words"),
    ({"model": "parallel", "kinds": "soft"}, "kinds = soft: soft is neither dahl nor slip"),
    ({"joint": "", "tendon": "t", "model": "loaded", "full": 1}, "model = loaded needs a joint"),
    ({"joint": "x"}, "joint = x is not in the model"),
    ({"joint": "free"}, "joint = free is neither a hinge nor a slide"),
    ({"tendon": "t"}, "needs either joint or tendon"),
    ({"dampratio": 1.1}, "dampratio = 1.1 is outside 0 .. 1"),
]


@pytest.mark.parametrize(("keys", "words"), BAD, ids=[words for _, words in BAD])
def test_a_bad_attribute_is_an_error_of_the_model(keys, words) -> None:
    with pytest.raises(ValueError, match=f"dahl.friction 'bad one': .*{re.escape(words)}"):
        made({"of a": SEVERAL["of a"], "bad one": SEVERAL["of a"] | keys})


@pytest.mark.parametrize(
    "keys", [{"full": 1e-9}, {"full": 1e12, "rest": 1}, {"full": 1, "rest": 0}]
)
def test_limits_are_accepted_and_rest_need_not_be_given(keys) -> None:
    made({"of a": SEVERAL["of a"] | {"model": "loaded"} | keys})


@pytest.mark.parametrize("name", ["b", "t"])
def test_frictionloss_and_the_plugin_on_one_joint_or_tendon_are_an_error(name) -> None:
    lossy = MECHANISM.replace(f'name="{name}"', f'name="{name}" frictionloss="0.5"', 1)
    kind = "joint" if name == "b" else "tendon"
    with pytest.raises(
        ValueError, match=f"'of {name}': {kind} = {name} also has frictionloss = 0.5"
    ):
        made(SEVERAL, mechanism=lossy)


class Heap(ctypes.Structure):
    """Of mallinfo2() in glibc."""

    _fields_ = tuple((f"field{k}", ctypes.c_size_t) for k in range(10))

    @staticmethod
    def used() -> int:
        """Return the allocated bytes, those of large blocks too."""
        gc.collect()
        mallinfo2 = ctypes.CDLL(None).mallinfo2
        mallinfo2.restype = Heap
        return mallinfo2().field4 + mallinfo2().field7


@pytest.mark.parametrize("keys", [{}, *(keys for keys, _ in BAD[::10])], ids=str)
def test_a_rejected_model_and_an_accepted_one_leave_no_memory_behind(keys) -> None:
    """Neither that of MuJoCo nor that of the instance before."""
    sizes = []
    for _ in range(5):
        for _ in range(60):
            with pytest.raises(ValueError, match="bad one") if keys else nullcontext():
                made({"of a": SEVERAL["of a"], "bad one": SEVERAL["of a"] | keys})
        sizes.append(Heap.used())
    assert np.diff(sizes).min() < 60 * 8  # a leak is in each round, Python's own memory is not


@pytest.mark.parametrize(
    ("stand_in", "words"),
    [
        ("None", "cannot import mujoco"),
        ("types.SimpleNamespace(__version__='3.7.0')", "needs MuJoCo 3.8 or later; this is 3.7.0"),
    ],
)
def test_without_a_recent_mujoco_one_line_names_the_packages(stand_in: str, words: str) -> None:
    code = f"import runpy, sys, types; sys.modules['mujoco'] = {stand_in};"
    code += "runpy.run_module('dahl.mujoco', run_name='__main__')"
    said = run(sys.executable, "-c", code, code=1)
    assert said.startswith("error: dahl.mujoco ") and words in said and said.count("\n") == 1
    assert re.search(r"pip install \S*mujoco>=3.8\S*, or pip install '.\[mujoco\]'", said)


def test_without_a_compiler_one_line_says_so(monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(mujoco_plugin.paths, "ROOT", tmp_path)
    monkeypatch.setenv("CC", "no-such-cc")
    with pytest.raises(dahl.RunError, match="cannot start no-such-cc .*install a C compiler"):
        mujoco_plugin.load()


PAGE = (ROOT / "docs/simulators.md").read_text()
EXAMPLE = ROOT / "examples/mujoco/hinge.xml"
LOAD = """import sys, mujoco
mujoco.mj_loadPluginLibrary(sys.argv[1])
mujoco.MjModel.from_xml_path(sys.argv[2])"""


@pytest.mark.parametrize("version", [0, 1], ids=["this version", "another version"])
def test_the_library_of_a_c_program_is_registered_in_its_version(tmp_path, version) -> None:
    package = Path(mujoco.__file__).parent
    shutil.copytree(package / "include", tmp_path / "include")
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib/libmujoco.so").symlink_to(*package.glob("libmujoco.so*"))
    header = tmp_path / "include/mujoco/mujoco.h"
    macro = "#define mjVERSION_HEADER "
    header.write_text(header.read_text().replace(macro, f"{macro}{version} + "))
    command = re.search(r"```sh\n(cc .*?)```", PAGE, re.S)[1].replace("-o ", f"-o {tmp_path}/")
    run("bash", "-c", command, env={**os.environ, "MUJOCO": str(tmp_path)}, cwd=ROOT)
    words = [sys.executable, "-c", LOAD, tmp_path / "libdahl_friction.so", EXAMPLE]
    said = run("sh", "-c", '"$@" 1>&2', "sh", *words, code=version, cwd=tmp_path)
    assert version == 0 or "compiled for MuJoCo" in said
