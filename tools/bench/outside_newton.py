# SPDX-License-Identifier: MIT
"""Newton's Dahl axis as a kernel; a module of its own, because warp reads a kernel's names from its
module.
"""

import warp as wp
from newton._src.solvers.vbd.rigid_vbd_kernels import _advance_dahl_axis

wp.config.quiet = True


@wp.kernel  # type: ignore[untyped-decorator]  # warp has no types
def advance(
    moves: wp.array(dtype=float),  # type: ignore[valid-type]  # warp reads its own kind of types
    out: wp.array(dtype=float),  # type: ignore[valid-type]  # as above
    Fc: float,  # noqa: N803
    tau: float,
) -> None:
    """One thread, a tick after the other: moves in rad, torques in N m."""
    torque = float(0.0)  # noqa: UP018  (to warp a bare literal is a constant, not a variable)
    before = float(0.0)  # noqa: UP018
    for i in range(moves.shape[0]):
        torque, before = _advance_dahl_axis(moves[i], before, torque, Fc, tau)
        out[i] = torque
