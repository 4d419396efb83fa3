# SPDX-License-Identifier: MIT
"""Compare ways to give joints friction in MuJoCo, at a time step of 2 ms. Each way holds a hinge
under half of Fc and an arm under gravity; the cost of a step is measured.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import mujoco
import numpy as np

STEP_S = 2e-3
SECONDS = 10.0  # of the hinge
ARM_SECONDS = 20.0
COMPENSATED = 0.93  # of the gravity torques
STEPS, ROUNDS = 300, 150  # of the measured cost: the least of many short times


@dataclass(frozen=True)
class Joint:
    """A link of a chain, and the friction of its joint."""

    length: float  # [m]
    mass: float  # [kg]
    Fc: float  # [N m]
    sigma0: float  # [N m/rad]


HINGE = (Joint(0.2, 0.5, 1.8, 120.0),)  # inertia 1/150 kg m2
ARM = (Joint(0.3, 2.0, 2.0, 100.0), Joint(0.3, 1.5, 1.0, 50.0), Joint(0.3, 1.0, 0.3, 15.0))


@dataclass(frozen=True)
class Way:
    """How a joint gets its friction."""

    name: str
    joint: str = ""  # attributes of the joint
    option: str = ""  # attributes of <option>
    lugre_ratio: float | None = None  # damping ratio of LuGre's sigma1
    plugin: str = ""  # keys of dahl.friction


LOSS = 'frictionloss="{Fc}"'
SOLIMP = 'solimpfriction=".9999 .9999 .001"'
DAHL = """<config key="joint" value="{name}"/><config key="sigma0" value="{sigma0}"/>
    <config key="Fc" value="{Fc}"/>"""
RATIO = '<config key="dampratio" value="0.3"/>'
SOFT = '<config key="model" value="elastoplastic"/><config key="breakaway" value="0.7"/>'
WAYS = (
    Way("frictionloss", LOSS),
    Way("frictionloss, solref 4 ms", f'{LOSS} solreffriction=".004 1"'),
    Way("frictionloss, solimp .9999", f"{LOSS} {SOLIMP}"),
    Way("frictionloss, both", f'{LOSS} {SOLIMP} solreffriction=".004 1"'),
    Way("frictionloss, noslip", LOSS, 'noslip_iterations="100"'),
    Way("LuGre, sigma1 0", lugre_ratio=0.0),
    Way("LuGre, sigma1 critical", lugre_ratio=1.0),
    Way("dahl.friction", plugin=DAHL),
    Way("dahl.friction, dampratio", plugin=DAHL + RATIO),
    Way("elastoplastic, dampratio", plugin=DAHL + SOFT + RATIO),
)


def chain(way: Way, joints: Sequence[Joint]) -> Any:
    """Return a model of a chain whose axes are parallel."""
    inertias = _model(Way(""), joints, [0.0] * len(joints)).dof_M0
    return _model(way, joints, [2 * math.sqrt(each) for each in inertias])


def _model(way: Way, joints: Sequence[Joint], roots: Sequence[float]) -> Any:
    """`roots` are 2 sqrt(inertia) at the joints, for LuGre."""
    bodies, motors, instances, place = "", "", "", 0.0
    for k, joint in enumerate(joints):
        words, half = {"name": f"j{k}", **asdict(joint)}, joint.length / 2
        bodies += f"""<body pos="{place} 0 0"><joint name="j{k}" axis="0 1 0"
            {way.joint.format(**words)}/><geom type="box" size="{half} .001 .001"
            pos="{half} 0 0" mass="{joint.mass}" contype="0" conaffinity="0"/>"""
        place = joint.length
        instances += f'<instance name="j{k}">{way.plugin.format(**words)}</instance>'
        if way.lugre_ratio is not None:
            sigma1 = way.lugre_ratio * roots[k] * math.sqrt(joint.sigma0)
            motors += f"""<dcmotor joint="j{k}" motorconst="1e-9" resistance="1"
                lugre="{joint.sigma0} {sigma1} {joint.Fc} {joint.Fc} 1"/>"""
    plugin = f'<plugin plugin="dahl.friction">{instances}</plugin>' if way.plugin else ""
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{STEP_S}" integrator="implicitfast" {way.option}/>
        <extension>{plugin}</extension><worldbody>{bodies}{"</body>" * len(joints)}</worldbody>
        <actuator>{motors}</actuator></mujoco>"""
    )


def hold(way: Way) -> tuple[float, float]:
    """Push the hinge with half of Fc. Return its last angle [rad], and its mean speed in the last
    half of the time [rad/s].
    """
    model = chain(way, HINGE)
    model.opt.gravity[:] = 0
    data = mujoco.MjData(model)
    data.qfrc_applied[0] = HINGE[0].Fc / 2
    (angle,), (speed,) = _drift(model, data, SECONDS)
    return float(angle), float(speed)


def hang(way: Way) -> Any:
    """Return the drift [rad/s] of each joint of the arm, which starts outstretched."""
    model = chain(way, ARM)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    data.qfrc_applied[:] = COMPENSATED * data.qfrc_bias
    return _drift(model, data, ARM_SECONDS)[1]


def _drift(model: Any, data: Any, seconds: float) -> tuple[Any, Any]:
    half = round(seconds / 2 / STEP_S)
    mujoco.mj_step(model, data, half)
    before = data.qpos.copy()
    mujoco.mj_step(model, data, half)
    return data.qpos.copy(), (data.qpos - before) / (seconds / 2)


def costs() -> Any:
    """Return the least time of a step of the arm [us] for each way, measured in turn."""
    models = [chain(way, ARM) for way in WAYS]
    times = np.full((ROUNDS, len(WAYS)), np.inf)
    for row in times:
        for k, model in enumerate(models):
            data = mujoco.MjData(model)
            start = time.perf_counter()
            mujoco.mj_step(model, data, STEPS)
            row[k] = (time.perf_counter() - start) / STEPS * 1e6
    return times.min(axis=0)


def print_table() -> None:
    """Print what each way does at a time step of 2 ms."""
    print(f"time step {STEP_S * 1e3:g} ms; hinge as above; arm of three joints, gravity")
    print(f"compensated to {COMPENSATED:.0%}; drift in the last half of {ARM_SECONDS:g} s\n")
    print(f"{'':26} hinge [mrad]  drift [mrad/s]  arm, drift of joints 0, 1 [mrad/s]  step [us]")
    for way, cost in zip(WAYS, costs(), strict=True):
        angle, drift = (1e3 * each for each in hold(way))
        first, second, _ = 1e3 * hang(way)
        print(f"{way.name:26}{angle:13.3g}{drift:16.1g}{first:25.1g}{second:11.1g}{cost:11.2f}")
