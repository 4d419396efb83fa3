# SPDX-License-Identifier: MIT
"""Measure calls of this library from Python, next to calls of other packages in the same process.

Usage: PYTHON tools/bench/python_calls.py single|logs     (in a checkout that is built; prints JSON)

    single   ns of one call: Friction.step_counts next to float("1.5"), a call of C from Python, and
             Node.receive next to can.Message(...), of which it makes one for its answer
    logs     ns of one call for a log of each length in LENGTHS, with the Python of build/bench/venv
             also of numba and JAX; the first call, which compiles, is not timed

Each cost is the least of many short runs that take turns, so that a busy machine delays all alike.
"""

from __future__ import annotations

import itertools
import json
import sys
import timeit
from collections.abc import Callable
from typing import Any

ROUNDS, ROUND_NS = 100, 100_000  # so that a round fits between two interruptions
LONG_ROUNDS = 10  # of calls that need longer than a round
LENGTHS = (1, 10, 100, 1_000_000)  # ticks of a log
SIGMA0, FC, THETA = 100.0, 0.5, 6.2831853 / 2**14

Call = Callable[[], object]


def least_ns(calls: dict[str, Call]) -> dict[str, float]:
    """Return ns of one call of each."""
    numbers, least = {}, {}
    for name, call in calls.items():
        call()
        least[name] = timeit.timeit(call, number=1) * 1e9
        numbers[name] = max(1, round(ROUND_NS / least[name]))
    for _ in range(ROUNDS if max(numbers.values()) > 1 else LONG_ROUNDS):
        for name, call in calls.items():
            ns = timeit.timeit(call, number=numbers[name]) / numbers[name] * 1e9
            least[name] = min(least[name], ns)
    return least


def single_calls() -> dict[str, float]:
    """Return ns of one call, without the ns of the loop around it."""
    import can
    import dahl
    from dahl import codec

    plan = dahl.Plan(SIGMA0, FC, THETA)
    bearing, node = dahl.Friction(plan), dahl.Node(plan)
    frames = itertools.cycle([codec.pack(codec.EncoderState(5 * k, k)) for k in range(16)])
    clock = itertools.count()
    ns = least_ns(
        {
            "nothing": lambda: None,
            "float": lambda: float("1.5"),
            "step_counts": lambda: bearing.step_counts(3),
            "message": lambda: can.Message(
                arbitration_id=0x100, data=bytes(8), is_extended_id=False
            ),
            "receive": lambda: node.receive(next(frames)),
            "receive_now": lambda: node.receive(next(frames), next(clock) * 1e-6),
        }
    )
    loop = ns.pop("nothing")
    return {name: each - loop for name, each in ns.items()}


def numpy_call(angles: Any, out: Any) -> Call:
    """Use one ufunc: what NumPy needs for a call, and for a copy of a long log."""
    import numpy as np

    return lambda: np.negative(angles, out)


def friction_call(moves: Any, out: Any) -> Call:
    import dahl

    bearing = dahl.Friction(dahl.Plan(SIGMA0, FC, THETA))
    return lambda: bearing.run_counts(moves, out)


def throughput_call(moves: Any, out: Any) -> Call:
    import dahl

    fast = dahl.Throughput(SIGMA0, FC, THETA)
    return lambda: fast.run_counts(moves, out=out)


def numba_call(moves: Any, out: Any) -> Call:
    import log_rivals

    torques = log_rivals.numba_loop()
    return lambda: torques(moves, SIGMA0 / FC * THETA, FC, out)


def jax_call(moves: Any, _: Any) -> Call:
    import log_rivals

    torques = log_rivals.jax_scan("float64")
    return lambda: torques(moves, SIGMA0 / FC * THETA, FC)


LOG_CALLS = {
    "numpy": numpy_call,
    "friction": friction_call,
    "throughput": throughput_call,
    "numba": numba_call,
    "jax_double": jax_call,
}


def log_calls() -> dict[str, Any]:
    """Return {"ticks": LENGTHS, "ns": {call: ns of each length}, "missing": {call: reason}}, and
    as "one_direction" the ns of Friction for the longest log, with all moves forward.
    """
    import numpy as np

    random = np.random.default_rng(1).integers(-8, 9, LENGTHS[-1]).astype(np.int32)
    ns: dict[str, list[float]] = {}
    missing = {}
    for length in LENGTHS:
        moves, out, calls = random[:length], np.empty(length, np.float32), {}
        for name, make in LOG_CALLS.items():
            try:
                calls[name] = make(moves.astype(np.float32) if name == "numpy" else moves, out)
            except ImportError as error:
                missing[name] = str(error)
        for name, each in least_ns(calls).items():
            ns.setdefault(name, []).append(each)
    forward = {"one direction": friction_call(np.abs(random), np.empty(LENGTHS[-1], np.float32))}
    [one_direction] = least_ns(forward).values()
    return {"ticks": LENGTHS, "ns": ns, "one_direction": one_direction, "missing": missing}


if __name__ == "__main__":
    print(json.dumps({"single": single_calls, "logs": log_calls}[sys.argv[1]]()))
