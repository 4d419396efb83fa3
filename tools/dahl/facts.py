# SPDX-License-Identifier: MIT
# Written from the C sources by tools/generators/facts.py.
"""Period of the loop, emulated boards and friction models, as the C sources have them."""

from __future__ import annotations

PERIOD_US = 1000  # from one EncoderState to the next (host_sim/timing.h)

BOARDS = {  # of each emulated core: the machine of QEMU, the address of its page of parameters
    "m0": ("microbit", 0x3FC00),
    "m3": ("mps2-an385", 0x3FF000),
    "m4f": ("mps2-an386", 0x3FF000),
    "m7": ("mps2-an500", 0x3FF000),
    "m33": ("mps2-an505", 0x103FF000),
}

# fmt: off
MODELS = (  # the rows of DAHL_MODELS (dahl_parts.h) without NAME; plan is True or False
    ("dahl", "Dahl", 0, 1, 1, True, "", "", 0, 0),
    ("slip", "Slip", 0, 0, 0, True, "", "", 0, 0),
    ("parallel", "Parallel", 32, 0, 0, False, "kinds", "`dahl` or `slip` for each element", 0, 0),
    (
        "loaded", "Loaded", 18, 1, 1, False, "",
        "a section `[load]`; `sigma0` and `Fc` hold at load 1", 0, 0,
    ),
    (
        "elastoplastic", "ElastoPlastic", 17, 1, 1, True, "breakaway",
        "the fraction of Fc up to which nothing creeps", 1e-45, 0.9999999403953552,
    ),
    ("asymmetric", "Asymmetric", 16, 1, 2, True, "", "", 0, 0),
    (
        "stribeck", "Stribeck", 19, 1, 2, True, "stribeck",
        "rad that a tick travels at the Stribeck speed", 1e-19, 1e+19,
    ),
)
# fmt: on
