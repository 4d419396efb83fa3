# SPDX-License-Identifier: MIT
"""Print the cost of Python calls next to a call of the same kind that is not ours, in the same run.

Usage: build/venv/bin/python tools/bench/python_calls.py     (in a checkout that is built)

    Friction.step_counts   next to float("1.5"), a call of C from Python
    Node.receive           next to can.Message(...), of which it makes one for its answer

Each cost is the least of many short runs that take turns, so that a busy machine delays all alike.
"""

from __future__ import annotations

import itertools
import timeit
from collections.abc import Callable

import can
import dahl
from dahl import codec

ROUNDS, CALLS = 200, 500


def least_ns(calls: dict[str, Callable[[], object]]) -> dict[str, float]:
    """ns of one call of each."""
    least = dict.fromkeys(calls, float("inf"))
    for _ in range(ROUNDS):
        for name, call in calls.items():
            least[name] = min(least[name], timeit.timeit(call, number=CALLS) / CALLS * 1e9)
    return least


def main() -> None:
    plan = dahl.Plan(sigma0=100.0, Fc=0.5, theta_per_count=1e-4)
    bearing, node = dahl.Friction(plan), dahl.Node(plan)
    frames = itertools.cycle([codec.pack(codec.EncoderState(5 * k, k)) for k in range(16)])
    clock = itertools.count()
    ns = least_ns(
        {
            "nothing": lambda: None,
            'float("1.5")': lambda: float("1.5"),
            "Friction.step_counts": lambda: bearing.step_counts(3),
            "can.Message": lambda: can.Message(
                arbitration_id=0x100, data=bytes(8), is_extended_id=False
            ),
            "Node.receive": lambda: node.receive(next(frames)),
            "Node.receive with now": lambda: node.receive(next(frames), next(clock) * 1e-6),
        }
    )
    base = ns.pop("nothing")
    for name, reference in (
        ("Friction.step_counts", 'float("1.5")'),
        ("Node.receive", "can.Message"),
        ("Node.receive with now", "can.Message"),
    ):
        ours, theirs = ns[name] - base, ns[reference] - base
        print(f"{name}: {ours:.0f} ns, {ours / theirs:.1f} times {reference} ({theirs:.0f} ns)")


if __name__ == "__main__":
    main()
