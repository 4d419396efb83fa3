# SPDX-License-Identifier: MIT
"""Dahl friction torque, exact at every encoder tick: the Python side.

Same names, units and bits as the C library, which does all mathematics. Torques have the sign of
the motion; for linear motion read m and N. Objects start relaxed. They can be compared, copied and
pickled; a copy has a separate state. Use an object from one thread at a time. An argument outside
its stated range raises dahl.InputError with name, value and limit, one of a wrong type TypeError,
before any move. Public names:

    Plan(sigma0, Fc, theta_per_count)   parameters, prepared once
    Friction(plan)                      one Dahl element: step it by counts or angles, read F
    State                               state of an element, to store and restore
    Throughput(sigma0, Fc, theta_per_count).run_counts(moves)   long logs, vectorized
    Slip(sigma0, Fc, theta_per_count)   slip elements in parallel; lists of sigma0 and Fc
    Parallel(part, part, ...)           any mix of Friction and Slip on one shaft
    Asymmetric(sigma0, Fc_forward, Fc_backward, theta_per_count)   one Fc for each direction
    ElastoPlastic(sigma0, Fc, theta_per_count, breakaway)   no creep below breakaway
    Stribeck(sigma0, Fs, Fc, theta_per_count, stribeck)   Fc falls with speed: stick-slip
    Loaded(plan), Work(plan)            Dahl element under a load; one that sums its work
    VelocityTable(torque, segment_bits)   friction that depends on speed; add it to another
    Compensator(sigma0, Fc, theta_per_count, ...)   torque that cancels friction, within bounds
    Residual(sigma0, Fc, theta_per_count, ...)     for a Compensator: add what the model lacks
    Damping(sigma0, Fc, sigma1, period)   damps an element that a motor renders
    Commission(period=..., ...).run(drive)   an axis measures its own friction, without a sensor
    Encoder(modulus, sign, largest_step).move(reading)   counts of each tick, for any wrap
    counts_between(before, now, modulus)   shortest way from one encoder reading to the next
    implausible(sigma0, Fc, theta_per_count)   a probable mistake with units, or ""
    to_units(ratio_q30, Fc_units)       convert F/Fc in Q30 to integer units of torque
    Node(plan, number)                  friction node on a bus: python-can messages in and out
    Client(bus, number)                 other end of a node: moves in counts, torque in N m
    node, codec                         modules: nodes on a bus, and their frames
    Error                               base of InputError, RunError, BusError and Timeout

>>> import dahl
>>> bearing = dahl.Friction(dahl.Plan(sigma0=100.0, Fc=0.5, theta_per_count=2 * 3.14159265 / 16384))
>>> round(bearing.step_counts(3), 6)   # N m
0.102772

The command `dahl` (see `dahl --help`) has the tools: demo, identify, plan, monitor, record, ...
"""

from __future__ import annotations

from importlib import import_module

from dahl.errors import BusError, Error, InputError, RunError, Timeout
from dahl.version import __version__ as __version__

TYPE_CHECKING = False  # importing typing would double the time of `dahl --help`
if TYPE_CHECKING:
    from dahl.binding.commission import Commission
    from dahl.binding.compensator import Compensator
    from dahl.binding.damping import Damping
    from dahl.binding.encoder import Encoder, counts_between, to_units
    from dahl.binding.friction import Friction, Plan, State
    from dahl.binding.loaded import Loaded
    from dahl.binding.plausible import implausible
    from dahl.binding.residual import Residual
    from dahl.binding.slip import Parallel, Slip
    from dahl.binding.state_element import Asymmetric, ElastoPlastic, Stribeck
    from dahl.binding.throughput import Throughput
    from dahl.binding.velocity import VelocityTable
    from dahl.binding.work import Work
    from dahl.can import codec, node
    from dahl.can.client import Client
    from dahl.can.node import Node

__all__ = [
    "Asymmetric",
    "BusError",
    "Client",
    "Commission",
    "Compensator",
    "Damping",
    "ElastoPlastic",
    "Encoder",
    "Error",
    "Friction",
    "InputError",
    "Loaded",
    "Node",
    "Parallel",
    "Plan",
    "Residual",
    "RunError",
    "Slip",
    "State",
    "Stribeck",
    "Throughput",
    "Timeout",
    "VelocityTable",
    "Work",
    "codec",
    "counts_between",
    "implausible",
    "node",
    "to_units",
]
SUBMODULES = {"codec": "dahl.can.codec", "node": "dahl.can.node"}
MODULES = {  # of the public classes and functions
    "binding.commission": ("Commission",),
    "binding.state_element": ("Asymmetric", "ElastoPlastic", "Stribeck"),
    "binding.compensator": ("Compensator",),
    "binding.damping": ("Damping",),
    "binding.encoder": ("Encoder", "counts_between", "to_units"),
    "binding.friction": ("Friction", "Plan", "State"),
    "binding.loaded": ("Loaded",),
    "binding.plausible": ("implausible",),
    "binding.residual": ("Residual",),
    "binding.slip": ("Parallel", "Slip"),
    "binding.throughput": ("Throughput",),
    "binding.velocity": ("VelocityTable",),
    "binding.work": ("Work",),
    "can.client": ("Client",),
    "can.node": ("Node",),
}
MODULE = {name: module for module, names in MODULES.items() for name in names}


if not TYPE_CHECKING:  # a type checker would accept any name

    def __getattr__(name: str) -> object:
        """Load the library only when one of its names is used, so that `dahl --help` is quick."""
        if name in SUBMODULES:
            return import_module(SUBMODULES[name])
        if name in MODULE:
            return getattr(import_module(f"dahl.{MODULE[name]}"), name)
        if name == "Adaptation":
            raise AttributeError("dahl.Adaptation is removed: use dahl.Residual")
        raise AttributeError(f"module 'dahl' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted({*__all__, "__doc__", "__version__"})
