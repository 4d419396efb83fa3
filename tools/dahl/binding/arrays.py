# SPDX-License-Identifier: MIT
"""numpy arrays as the C library takes them: read and written in place where type and stride allow,
copied or refused, by name, where not.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from dahl.errors import Error

INT32_MIN, INT32_MAX = -(1 << 31), (1 << 31) - 1


def data(array: np.ndarray) -> int:
    return array.ctypes.data


def is_list(values: object) -> bool:
    """Has it a length and elements? Neither a text nor an array without dimensions has."""
    if isinstance(values, np.ndarray):
        return values.ndim > 0
    return isinstance(values, Sequence) and not isinstance(values, (str, bytes))


def moves(values: ArrayLike, dtype: type, channels: int | None = None) -> np.ndarray:
    """Moves as C wants them, shape (n,) or (n, channels); the very array where it is one."""
    array = _array("moves", values)
    wanted = "(n,)" if channels is None else f"(n, {channels})"
    if array.ndim != (1 if channels is None else 2) or array.shape[1:] not in ((), (channels,)):
        raise Error(f"moves has shape {array.shape}, not {wanted}")
    if array.dtype == dtype or array.size == 0:
        return _for_c(array, dtype)
    if dtype is np.int32:
        return _whole(array)
    if array.dtype.kind not in "fiu":
        raise Error(f"moves has type {array.dtype}, not float32")
    with np.errstate(over="ignore"):  # beyond a float is infinite, which saturates
        return _for_c(array, dtype)


def _for_c(array: np.ndarray, dtype: type) -> np.ndarray:
    """Each value a whole one in memory, not across the words of the processor."""
    return np.require(array, dtype, ("C_CONTIGUOUS", "ALIGNED"))


def _array(name: str, values: ArrayLike) -> np.ndarray:
    """What numpy makes of the values, if it is an array of numbers and nothing of it is masked."""
    many = values if isinstance(values, (list, tuple)) else [values]
    if any(isinstance(each, np.ma.MaskedArray) and np.ma.is_masked(each) for each in many):
        raise Error(
            f"{name} has masked values, which C would take for numbers;"
            " .compressed() drops them, .filled(0) makes each of them 0"
        )
    try:
        return np.asarray(values)
    except (ValueError, TypeError, OverflowError) as error:
        raise Error(f"{name} is not an array of numbers ({error})") from None


def _whole(array: np.ndarray) -> np.ndarray:
    """Any numbers as int32, if that is what they are."""
    if array.dtype.kind not in "fiu":
        raise Error(f"moves has type {array.dtype}, not int32")
    wide = array.astype(np.float64) if array.dtype in (np.float16, np.float32) else array
    with np.errstate(invalid="ignore"):  # a narrow float would round the limits to its own
        wrong = ~((wide >= INT32_MIN) & (wide <= INT32_MAX) & (wide == np.trunc(wide)))
    if wrong.any():
        place = tuple(int(i) for i in np.argwhere(wrong)[0])
        value = array[place].item()
        raise Error(
            f"moves[{', '.join(map(str, place))}] = {value!r}"
            f" is not a whole number from {INT32_MIN} to {INT32_MAX}"
        )
    return _for_c(array, np.int32)


def loads(values: ArrayLike, moves: np.ndarray) -> np.ndarray:
    """A load for each move, 0 <= load < 2, as C wants it: Q30, rounded."""
    array = _array("loads", values)
    if array.dtype.kind not in "fiu":
        raise Error(f"loads has type {array.dtype}, not float64")
    if array.shape != moves.shape:
        raise Error(f"loads has shape {array.shape}, not {moves.shape} as moves has")
    wrong = ~((array >= 0) & (array < 2))
    if wrong.any():
        place = int(np.argmax(wrong))
        raise Error(f"loads[{place}] = {array[place].item()!r} is outside 0 <= load < 2")
    return np.minimum(np.rint(array.astype(np.float64) * 2.0**30), 2**31 - 1).astype(np.uint32)


def out(given: np.ndarray | None, wanted: np.ndarray) -> np.ndarray:
    """Where the torques go: a new array, or `out` if C can write it."""
    if given is None:
        return np.empty(wanted.shape, np.float32)
    if isinstance(given, np.ma.MaskedArray) or not isinstance(given, np.ndarray):
        raise Error(f"out is a {type(given).__name__}, not a float32 array")
    if given.dtype != np.float32 or given.shape != wanted.shape:
        raise Error(f"out is {given.dtype} {given.shape}, not float32 {wanted.shape}")
    if not given.flags.carray:
        raise Error("out is not C-contiguous, aligned and writable")
    if np.may_share_memory(given, wanted):
        raise Error("out and moves share memory")
    return given
