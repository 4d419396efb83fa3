# SPDX-License-Identifier: MIT
"""A hinge under half of Fc, with dahl.friction and with MuJoCo's LuGre friction of the same model,
next to the solution of the differential equation.

The hinge swings within the presliding length; without damping it does not come to rest. A drift
away from the solution is the error of an integration by time steps.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from mujoco import rollout

from dahl import dependencies
from dahl.errors import RunError

INERTIA = 1 / 150  # [kg m2] of the box below: 1 kg, 0.2 m x 0.2 m
SIGMA0, FC = 120.0, 1.8  # [N m/rad], [N m]
TORQUE = FC / 2  # [N m]
SECONDS = 10.0
STEPS_S = (5e-5, 5e-4, 1e-3, 2e-3)
DAMPINGS = (0.0, 0.5)  # [N m s/rad]
ROLLOUTS, THREADS = 1000, 4
HINGE = """<body><joint name="{name}" axis="0 0 1" damping="{damping}"/>
    <geom type="box" size=".1 .1 .01" mass="1" contype="0" conaffinity="0"/></body>"""
NATIVE = f"""<dcmotor joint="native" motorconst="1e-9" resistance="1"
    lugre="{SIGMA0} 0 {FC} {FC} 1"/>"""
DAHL = f"""<plugin plugin="dahl.friction"><instance name="hinge"><config key="joint" value="dahl"/>
    <config key="sigma0" value="{SIGMA0}"/><config key="Fc" value="{FC}"/></instance></plugin>"""


def model(step: float, damping: float = 0.0, hinges: tuple[str, ...] = ("native", "dahl")) -> Any:
    bodies = "".join(HINGE.format(name=name, damping=damping) for name in hinges)
    motors = "".join(f'<motor joint="{name}"/>' for name in hinges)
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{step}" integrator="implicitfast"/>
        <extension>{DAHL if "dahl" in hinges else ""}</extension><worldbody>{bodies}</worldbody>
        <actuator>{motors}{NATIVE if "native" in hinges else ""}</actuator></mujoco>"""
    )


def angles(step: float, damping: float) -> tuple[float, float]:
    """Return the last angle [rad] of the native hinge and of that with dahl.friction."""
    both = model(step, damping)
    data = mujoco.MjData(both)
    data.ctrl[:2] = TORQUE
    mujoco.mj_step(both, data, round(SECONDS / step))
    return float(data.qpos[0]), float(data.qpos[1])


def exact_angle(damping: float) -> float:
    """Return the last angle [rad] by SciPy's DOP853."""
    try:
        from scipy.integrate import solve_ivp
    except ImportError:
        hint = dependencies.hint(["scipy"], "mujoco")
        raise RunError(f"the reference needs scipy; {hint}") from None

    def slope(_: float, state: Any) -> list[float]:
        _, speed, force = state
        bristle = SIGMA0 * (speed - force / FC * abs(speed))
        return [speed, (TORQUE - force - damping * speed) / INERTIA, bristle]

    solved = solve_ivp(slope, (0, SECONDS), [0, 0, 0], method="DOP853", rtol=1e-10, atol=1e-12)
    return float(solved.y[0, -1])


def rollouts(count: int, threads: int, steps: int = 200) -> np.ndarray:
    """Return the states of rollouts with different random torques, shape (count, steps, size)."""
    hinge = model(0.002, 0.0, ("dahl",))
    data = [mujoco.MjData(hinge) for _ in range(max(1, threads))]
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    start = np.zeros((count, mujoco.mj_stateSize(hinge, full)))
    torques = np.random.default_rng(1).uniform(-2 * FC, 2 * FC, (count, steps, 1))
    states, _ = rollout.rollout(hinge, data, start, torques)
    return np.asarray(states)


def print_comparison() -> None:
    """Print the table of the hinge, and whether threads change bits."""
    print(f"angle of a hinge after {SECONDS:g} s under half of Fc, and its relative error")
    print(f"sigma0 = {SIGMA0:g} N m/rad, Fc = {FC:g} N m, inertia = {INERTIA:.5f} kg m2\n")
    print("damping  step [ms]  DOP853 [rad]   MuJoCo LuGre [rad]   dahl.friction [rad]")
    for damping in DAMPINGS:
        exact = exact_angle(damping)
        for step in STEPS_S:
            native, own = (f"{each:.5f} {each / exact - 1:+9.2%}" for each in angles(step, damping))
            print(f"{damping:7g} {step * 1e3:10g} {exact:13.5f} {native:>20} {own:>21}")
    is_same = np.array_equal(rollouts(ROLLOUTS, THREADS), rollouts(ROLLOUTS, 1))
    same = "the same bits as" if is_same else "OTHER BITS than"
    print(f"\n{ROLLOUTS} rollouts on {THREADS} threads: {same} on one thread\n")
