# SPDX-License-Identifier: MIT
"""The torques of a whole log, as users of numba and JAX write them.

A tick maps the state w = F/Fc by the exact solution of Eq. 1 at travel u = scale * counts, with
scale = sigma0/Fc * theta_per_count. The state is in double unless the name says float. Torques are
float32, as those of this library.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

Log = Callable[..., Any]


def numba_loop() -> Log:
    """Return torques(moves, scale, Fc, out), which moves tick by tick and fills `out`."""
    import numba

    @numba.njit  # type: ignore[untyped-decorator]  # numba is in build/bench/venv only
    def torques(moves: Any, scale: float, Fc: float, out: Any) -> None:  # noqa: N803
        w = 0.0
        for i in range(moves.size):
            u = scale * moves[i]
            s = math.copysign(1.0, u)
            w = s + (w - s) * math.exp(-abs(u))
            out[i] = Fc * w

    return torques  # type: ignore[no-any-return]


def jax_scan(dtype: str) -> Log:
    """Return torques(moves, scale, Fc): ticks are affine maps of w, which the scan joins."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)  # type: ignore[no-untyped-call]

    def join(first: Any, then: Any) -> Any:
        return first[0] * then[0], first[1] * then[0] + then[1]

    @jax.jit
    def torques(moves: Any, scale: float, Fc: float) -> Any:  # noqa: N803
        u = scale * moves.astype(dtype)
        g = -jnp.expm1(-jnp.abs(u))
        _, w = jax.lax.associative_scan(join, (1 - g, jnp.sign(u) * g))
        return (Fc * w).astype("float32")

    def wait_for_torques(moves: Any, scale: float, Fc: float) -> Any:  # noqa: N803
        return torques(moves, scale, Fc).block_until_ready()

    return wait_for_torques
