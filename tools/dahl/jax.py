# SPDX-License-Identifier: MIT
"""Friction as pure functions of JAX, for batches, gradients and MuJoCo's MJX, on a CPU or GPU.

    friction = dahl.jax.Dahl(sigma0=120.0, Fc=1.8)     # N m/rad, N m
    state = friction.relaxed()
    state, torque = friction.step(state, dtheta)       # a move in rad -> N m, with its sign

    Dahl(sigma0, Fc)                        one Dahl element
    Slip(sigma0, Fc)                        slip elements in parallel, along the last axis
    ElastoPlastic(sigma0, Fc, breakaway)    a spring up to breakaway Fc, then Dahl's model

Each is a pytree of its parameters, and `step` works under jit, vmap, grad and scan:
`jax.lax.scan(friction.step, friction.relaxed(), moves)`. Arrays of parameters, states and moves
broadcast; `jax.vmap(Dahl.step)(friction, state, dtheta)` maps over all three. The state's dtype
decides the precision: float32, or float64 if JAX allows it.

RANGE  sigma0 > 0, Fc > 0, 0 < breakaway < 1; they are not checked. sigma0/Fc*dtheta may be any
number. As in the library, a NaN is no motion and an infinite move saturates.

ERROR  Of the exact torque, for parameters and moves as given: at most

    Dahl                    8 eps Fc, for any motion; a move below eps Fc/sigma0 adds up to eps^2 Fc
    Slip, ElastoPlastic     8 eps Fc (1 + U)

eps is 2^-24 in float32 and 2^-53 in float64. U is the travel within the spring, in units of
Fc/sigma0, since the torque last reached Fc: a spring does not forget. The bits are not those of the
library, which has an error of its own, at most 0.6 ulp of Fc.

GRADIENTS  They are finite for finite moves. At a reversal, at a limit or without motion, where the
slope jumps, they lie between the slopes of both sides.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from dahl.errors import RunError

try:
    import jax.numpy as jnp
    from jax import Array
    from jax.typing import ArrayLike
except ImportError:
    from dahl.dependencies import hint

    raise RunError(f"dahl.jax needs jax; {hint(['jax'], 'jax')}") from None

__all__ = ["Dahl", "ElastoPlastic", "Slip", "State"]
SATURATED = 1000.0  # [Fc/sigma0] a longer move changes nothing, and keeps gradients finite


class State(NamedTuple):
    """The ratio F/Fc, -1 to 1, and the part of it that rounding to `ratio` lost.

    Without the second word, short moves would be lost near Fc.
    """

    ratio: Array
    low: Array

    def add(self, change: Array) -> State:
        """Return the sum; its two words have no error beyond that of adding to `low`."""
        change = change + self.low
        ratio = self.ratio + change
        added = ratio - self.ratio
        return State(ratio, (self.ratio - (ratio - added)) + (change - added))


class Dahl(NamedTuple):
    """A Dahl element (Eq. 1): sigma0 [N m/rad] and Fc [N m], numbers or arrays."""

    sigma0: ArrayLike
    Fc: ArrayLike

    def relaxed(self, shape: tuple[int, ...] | None = None, dtype: Any = None) -> State:
        """Return the state at F = 0; default: the shape and dtype of the parameters."""
        return _relaxed(self, shape, dtype)

    def step(self, state: State, dtheta: ArrayLike) -> tuple[State, Array]:
        """Move by dtheta [rad] and return the state after it and F [N m]."""
        s, u = _direction_and_travel(self.sigma0, self.Fc, state, dtheta)
        gap = (s - state.ratio) - state.low
        state = state.add(gap * -jnp.expm1(-u))
        return state, _torque(self.Fc, state)


class Slip(NamedTuple):
    """Slip elements in parallel: sigma0 [N m/rad] and Fc [N m] of each along the last axis.

    One element may be a number. The torque has one axis less than the state.
    """

    sigma0: ArrayLike
    Fc: ArrayLike

    def relaxed(self, shape: tuple[int, ...] | None = None, dtype: Any = None) -> State:
        """Return the state at F = 0; its last axis holds the elements."""
        return _relaxed(tuple(map(jnp.atleast_1d, self)), shape, dtype)

    def step(self, state: State, dtheta: ArrayLike) -> tuple[State, Array]:
        """Move by dtheta [rad] and return the state after it and F [N m]."""
        each = jnp.expand_dims(jnp.asarray(dtheta), -1)
        s, u = _direction_and_travel(self.sigma0, self.Fc, state, each)
        ratio, low = state.add(s * u)
        state = State(jnp.clip(ratio, -1, 1), jnp.where(jnp.abs(ratio) < 1, low, 0))
        return state, jnp.sum(_torque(self.Fc, state), -1)


class ElastoPlastic(NamedTuple):
    """Dupont's element: sigma0 [N m/rad], Fc [N m], and the breakaway, a fraction of Fc."""

    sigma0: ArrayLike
    Fc: ArrayLike
    breakaway: ArrayLike

    def relaxed(self, shape: tuple[int, ...] | None = None, dtype: Any = None) -> State:
        """Return the state at F = 0; default: the shape and dtype of the parameters."""
        return _relaxed(self, shape, dtype)

    def step(self, state: State, dtheta: ArrayLike) -> tuple[State, Array]:
        """Move by dtheta [rad] and return the state after it and F [N m]."""
        s, u = _direction_and_travel(self.sigma0, self.Fc, state, dtheta)
        b = jnp.asarray(self.breakaway, state.ratio.dtype)
        to_breakaway = (b - s * state.ratio) - s * state.low
        elastic = jnp.clip(to_breakaway, 0, u)
        gap = (1 - s * state.ratio) - s * state.low - elastic
        plastic = gap * -jnp.expm1(-(u - elastic) / (1 - b))
        state = state.add(s * (elastic + plastic))
        return state, _torque(self.Fc, state)


def _relaxed(parameters: tuple[ArrayLike, ...], shape: tuple[int, ...] | None, dtype: Any) -> State:
    arrays = jnp.broadcast_arrays(*map(jnp.asarray, parameters))
    zeros = jnp.zeros(
        arrays[0].shape if shape is None else shape, dtype or jnp.result_type(float, *arrays)
    )
    return State(zeros, zeros)


def _direction_and_travel(
    sigma0: ArrayLike, Fc: ArrayLike, state: State, dtheta: ArrayLike
) -> tuple[Array, Array]:
    """Return the direction, 1 or -1, and the travel in units of Fc/sigma0."""
    dtype = state.ratio.dtype
    move = jnp.nan_to_num(jnp.asarray(dtheta, dtype), nan=0)
    s = jnp.where(move < 0, -1, 1).astype(dtype)
    stiffness = jnp.asarray(sigma0, dtype) / jnp.asarray(Fc, dtype)
    return s, jnp.minimum(stiffness * (s * move), SATURATED)


def _torque(Fc: ArrayLike, state: State) -> Array:
    return jnp.asarray(Fc, state.ratio.dtype) * state.ratio
