# SPDX-License-Identifier: MIT
"""Run Newton's Dahl axis as a kernel. warp resolves the names of a kernel in its module."""

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
    """Run all ticks in one thread: moves in rad, torques in N m."""
    torque = float(0.0)  # noqa: UP018  (warp reads a bare literal as a constant)
    before = float(0.0)  # noqa: UP018
    for i in range(moves.shape[0]):
        torque, before = _advance_dahl_axis(moves[i], before, torque, Fc, tau)
        out[i] = torque
