# SPDX-License-Identifier: MIT
"""Push 1000 joints with half of their Fc for 2 s, in one batch of MJX, the MuJoCo in JAX. With the
friction of dahl.jax they hold. With `frictionloss` they creep.

Usage: python examples/mjx/hold_many.py, after pip install '.[jax]' mujoco-mjx; 1 minute on a CPU
Written for mujoco-mjx 3.17; any since 3.8 should do.
"""

from __future__ import annotations

from typing import Any

import dahl.jax
import jax
import jax.numpy as jnp
import mujoco
from mujoco import mjx

JOINTS, STEPS = 1000, 1000
HINGE = """<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody><body>
  <joint axis="0 0 1" damping="0.5" frictionloss="{Fc}"/>
  <inertial pos="0 0 0" mass="1" diaginertia="0.00667 0.00667 0.00667"/>
</body></worldbody></mujoco>"""

Fc = jnp.linspace(0.5, 3.0, JOINTS)  # N m
friction = dahl.jax.Dahl(sigma0=67 * Fc, Fc=Fc)  # 67/rad: 0.015 rad from rest to Fc (1 - 1/e)


def model(frictionloss: float) -> mjx.Model:
    return mjx.put_model(mujoco.MjModel.from_xml_string(HINGE.format(Fc=frictionloss)))


def hold(hinge: mjx.Model, one: dahl.jax.Dahl) -> Any:
    """Return the angle [rad] after each step of a joint with the friction of dahl.jax."""

    def step(carry: Any, _: None) -> Any:
        data, state, torque = carry
        after = mjx.step(hinge, data.replace(qfrc_applied=jnp.array([one.Fc / 2 - torque])))
        state, torque = one.step(state, after.qpos[0] - data.qpos[0])
        return (after, state, torque), after.qpos[0]

    start = mjx.make_data(hinge), one.relaxed(), jnp.zeros(())
    return jax.lax.scan(step, start, length=STEPS)[1]


def creep(hinge: mjx.Model, one: dahl.jax.Dahl) -> Any:
    """Return the same of a joint with the frictionloss of MJX."""
    hinge = hinge.replace(dof_frictionloss=jnp.array([one.Fc]))

    def step(data: Any, _: None) -> Any:
        data = mjx.step(hinge, data)
        return data, data.qpos[0]

    start = mjx.make_data(hinge).replace(qfrc_applied=jnp.array([one.Fc / 2]))
    return jax.lax.scan(step, start, length=STEPS)[1]


for name, move, hinge in (("dahl.jax", hold, model(0)), ("frictionloss", creep, model(1))):
    angles = jax.jit(jax.vmap(move, (None, 0)))(hinge, friction)
    drift = abs(angles[:, -1] - angles[:, STEPS // 2])  # in the second half
    print(f"{name}: {(drift < 1e-6).sum()} of {JOINTS} joints hold, drift {drift.max():.2g} rad")
