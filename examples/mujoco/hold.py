# SPDX-License-Identifier: MIT
"""Push two hinges with half of Fc for 10 s and draw their angles. MuJoCo's LuGre friction lets the
hinge creep by 3.5 rad. dahl.friction follows the exact solution, which creeps by 0.12 rad.

Usage: python examples/mujoco/hold.py [PICTURE], after pip install '.[mujoco,plot]'
"""

from __future__ import annotations

import sys
from pathlib import Path

import dahl.mujoco  # noqa: F401  (registers dahl.friction)
import matplotlib.pyplot as plt
import mujoco
import numpy as np

SECONDS = 10.0
TORQUE = 0.9  # [N m] half of Fc
EXACT = 0.12354  # [rad] at the end, by SciPy's DOP853 (python -m dahl.mujoco)

model = mujoco.MjModel.from_xml_path(str(Path(__file__).with_name("hinge.xml")))
data = mujoco.MjData(model)
data.ctrl[:2] = TORQUE
angles = []
for _ in range(round(SECONDS / model.opt.timestep)):
    mujoco.mj_step(model, data)
    angles.append(data.qpos.copy())
time = np.arange(1, len(angles) + 1) * model.opt.timestep
native, own = np.transpose(angles)
print(f"after {SECONDS:g} s: MuJoCo LuGre {native[-1]:.3f} rad, dahl.friction {own[-1]:.3f} rad")

figure, (both, close) = plt.subplots(1, 2, figsize=(7, 3), layout="constrained")
figure.suptitle("A hinge under half of Fc, time step 2 ms", fontsize=12, weight="bold")
both.plot(time, native, color="#7c8b9c", label="MuJoCo LuGre, set\nto Dahl's model")
both.plot(time, own, color="#d1495b", label="dahl.friction")
close.plot(time, own, color="#d1495b", linewidth=0.8, label="dahl.friction")
close.plot(SECONDS, EXACT, "ko", fillstyle="none", label="exact solution at 10 s")
for axes in (both, close):
    axes.set(xlabel="time [s]", ylabel="angle [rad]")
    axes.legend(frameon=False)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "hold.png", dpi=200)
