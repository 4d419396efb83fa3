# SPDX-License-Identifier: MIT
"""numpy arrays for the C library: used in place if type and stride allow, else copied or refused,
with the name of the argument.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dahl.binding.checks import INT32_MAX, INT32_MIN, ONE_Q30
from dahl.binding.library import c
from dahl.errors import InputError

INT32, UINT32, FLOAT32 = np.dtype(np.int32), np.dtype(np.uint32), np.dtype(np.float32)
C_NAMES = {INT32: "int32_t[]", UINT32: "uint32_t[]", FLOAT32: "float[]"}


class _ArrayTypes(dict[np.dtype, Any]):
    """The types of C_NAMES in cffi, which parses a name once: when it is first used."""

    def __missing__(self, dtype: np.dtype) -> Any:
        self[dtype] = c.typeof(C_NAMES[dtype])
        return self[dtype]


_types = _ArrayTypes()


def pointer(array: np.ndarray) -> Any:
    """Return the address of an array for C. It keeps the array alive."""
    return c.from_buffer(_types[array.dtype], array)


def run(
    batch: Callable[..., object],
    arguments: tuple[Any, ...],
    moves: np.ndarray,
    out: np.ndarray | None,
    *more: np.ndarray,
) -> np.ndarray:
    """Call batch(*arguments, moves, *more, torques, n), and return the torques."""
    torques = output(out, moves)
    if more:
        arguments = (*arguments, pointer(moves), *map(pointer, more))
        batch(*arguments, pointer(torques), len(moves))
    else:  # quick: without calls of pointer()
        address = c.from_buffer
        from_moves, to_torques = _types[moves.dtype], _types[FLOAT32]
        batch(*arguments, address(from_moves, moves), address(to_torques, torques), len(moves))
    return torques


def is_list(values: object) -> bool:
    """Return whether this is a sequence, but no text and no array without dimensions."""
    if isinstance(values, np.ndarray):
        return values.ndim > 0
    return isinstance(values, Sequence) and not isinstance(values, (str, bytes))


def is_iterable(values: object) -> bool:
    """Return whether this is an iterable, but no array without dimensions."""
    return isinstance(values, Iterable) and getattr(values, "ndim", 1) > 0


def moves(values: ArrayLike, dtype: np.dtype, channels: int | None = None) -> np.ndarray:
    """Return moves for C, shape (n,) or (n, channels): the same array if C can read it. Raises
    TypeError for no numbers, and dahl.InputError with the first bad value.
    """
    if type(values) is np.ndarray and channels is None and _is_ready(values, dtype):
        return values
    array = _array("moves", values)
    if array.size and array.dtype.kind not in "fiu":
        raise TypeError(f"moves has type {array.dtype}, not {dtype}")
    wanted = "(n,)" if channels is None else f"(n, {channels})"
    if array.ndim != (1 if channels is None else 2) or array.shape[1:] not in ((), (channels,)):
        raise InputError(f"moves has shape {array.shape}, not {wanted}")
    if array.dtype == dtype or array.size == 0:
        return _for_c(array, dtype)
    if dtype is INT32:
        return _whole(array)
    with np.errstate(over="ignore"):  # beyond a float is infinite, which saturates
        return _for_c(array, dtype)


def moves_of_path(theta: ArrayLike) -> np.ndarray:
    """Return the moves in rad between angles, the first one 0, rounded to float32. Raises
    dahl.Error for the first angle that is not finite.
    """
    array = _array("theta", theta)
    if array.size and array.dtype.kind not in "fiu":
        raise TypeError(f"theta has type {array.dtype}, not float64")
    if array.ndim != 1:
        raise InputError(f"theta has shape {array.shape}, not (n,)")
    wrong = ~np.isfinite(array)
    if wrong.any():
        place = int(np.argmax(wrong))
        raise InputError(f"theta[{place}] = {array[place].item()!r} is not a finite angle in rad")
    wide = array.astype(np.float64)
    with np.errstate(over="ignore"):  # beyond a float is infinite, which saturates
        return np.diff(wide, prepend=wide[:1]).astype(np.float32)


def _is_ready(array: np.ndarray, dtype: np.dtype) -> bool:
    """Return whether C can use it as it is, shape (n,). It costs less than the checks below."""
    return array.dtype is dtype and array.ndim == 1 and array.flags.carray


def _for_c(array: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Return a contiguous array with aligned values."""
    if array.dtype == dtype and array.flags.carray:  # quick: np.require() costs as much as the call
        return array
    return np.require(array, dtype, ("C_CONTIGUOUS", "ALIGNED"))


def _array(name: str, values: ArrayLike) -> np.ndarray:
    """Return the values as an array. Raises dahl.Error for masked values and unequal rows."""
    if type(values) is np.ndarray:
        return values
    many = values if isinstance(values, (list, tuple)) else [values]
    if any(isinstance(each, np.ma.MaskedArray) and np.ma.is_masked(each) for each in many):
        raise InputError(
            f"{name} has masked values, which C would read as numbers;"
            " .compressed() drops them, .filled(0) makes each of them 0"
        )
    try:
        return np.asarray(values)
    except (ValueError, OverflowError) as error:
        raise InputError(f"{name} is not an array of numbers ({error})") from None


def _whole(array: np.ndarray) -> np.ndarray:
    """Return whole numbers as int32. Raises dahl.Error for any other value, with its place."""
    wide = array.astype(np.float64) if array.dtype in (np.float16, np.float32) else array
    with np.errstate(invalid="ignore"):  # a narrow float would round the limits to its own
        wrong = ~((wide >= INT32_MIN) & (wide <= INT32_MAX) & (wide == np.trunc(wide)))
    if wrong.any():
        place = tuple(int(i) for i in np.argwhere(wrong)[0])
        value = array[place].item()
        raise InputError(
            f"moves[{', '.join(map(str, place))}] = {value!r}"
            f" is not a whole number from {INT32_MIN} to {INT32_MAX}"
        )
    return _for_c(array, INT32)


def loads(values: ArrayLike, moves: np.ndarray) -> np.ndarray:
    """Return a load for each move in Q30. Raises dahl.Error for the first outside 0 <= load < 2."""
    array = _array("loads", values)
    if array.dtype.kind not in "fiu":
        raise TypeError(f"loads has type {array.dtype}, not float64")
    if array.shape != moves.shape:
        raise InputError(f"loads has shape {array.shape}, not {moves.shape} as moves has")
    wrong = ~((array >= 0) & (array < 2))
    if wrong.any():
        place = int(np.argmax(wrong))
        raise InputError(f"loads[{place}] = {array[place].item()!r} is outside 0 <= load < 2")
    loads_q30 = np.rint(array.astype(np.float64) * ONE_Q30)
    return np.minimum(loads_q30, 2 * ONE_Q30 - 1).astype(np.uint32)


def flags(name: str, values: ArrayLike) -> np.ndarray:
    """Return one bool a tick. Raises TypeError for other types: a text, and NaN, would be True."""
    array = _array(name, values)
    if array.dtype.kind not in "biu":
        raise TypeError(f"{name} has type {array.dtype}, not bool")
    return array.astype(bool)


def output(given: np.ndarray | None, wanted: np.ndarray) -> np.ndarray:
    """Return an array for the torques, or the given one if C can fill it."""
    if given is None:
        return np.empty(wanted.shape, np.float32)
    if not _is_free(given, wanted):
        _check_output(given, wanted)
    return given


def _is_free(given: np.ndarray, wanted: np.ndarray) -> bool:
    """Return whether it surely is a good output: it owns its memory, and the moves have another
    owner.
    """
    if type(given) is not np.ndarray or given.dtype is not FLOAT32 or given.ndim != 1:
        return False
    flags, owner = given.flags, wanted if wanted.base is None else wanted.base
    if not (flags.owndata and flags.carray and type(owner) is np.ndarray and owner.flags.owndata):
        return False
    return owner is not given and given.shape == wanted.shape


def _check_output(given: np.ndarray, wanted: np.ndarray) -> None:
    """Raise TypeError or dahl.InputError if C cannot fill the array."""
    if isinstance(given, np.ma.MaskedArray) or not isinstance(given, np.ndarray):
        raise TypeError(f"out is a {type(given).__name__}, not a float32 array")
    if given.dtype != np.float32:
        raise TypeError(f"out is {given.dtype}, not float32")
    if given.shape != wanted.shape:
        raise InputError(f"out has shape {given.shape}, not {wanted.shape}")
    if not given.flags.carray:
        raise InputError("out is not C-contiguous, aligned and writable")
    if np.may_share_memory(given, wanted):
        raise InputError("out and moves share memory")
