# SPDX-License-Identifier: MIT
"""Rivals that cannot run here, computed from numbers that their makers publish.

Qfplib is under the GPL, and the CORDIC is a part of a chip that QEMU does not emulate.
"""

from __future__ import annotations

from typing import Any

MARKS = ("<!-- bench:computed -->", "<!-- /bench:computed -->")

# Qfplib-M0-full, README: mean cycles with the call, measured on an LPC11U68 (multiplier of 1 cycle)
QFPLIB = {"fexp": 261, "fmul": 62, "fadd": 76}
# w = s - (s - w) exp(-a n), F = Fc w; converting n to float is not counted
QFPLIB_STEP = {"fexp": 1, "fmul": 3, "fadd": 2}

# CORDIC of STM32, AN5325, table 3: cycles of sinh and cosh together on a Cortex-M4F, in fixed point
# and from and to float; |u| <= 1.118
CORDIC_FIXED, CORDIC_FLOAT = 39, 81
CORDIC_RESIDUAL = 2.0**-19  # of 24 iterations, as STM32CubeG4 states it for its sine


def block(target: dict[str, dict[str, Any]]) -> str:
    """Return the block of docs/speed.md: cycles of rivals beside ours on the same core."""
    qfplib = sum(count * QFPLIB[name] for name, count in QFPLIB_STEP.items())
    parts = " + ".join(f"{n} `{name}` of {QFPLIB[name]}" for name, n in QFPLIB_STEP.items())
    m0, m4f = (target[name]["cycles"]["one_count_float"] for name in ("m0", "m4f"))
    error = f"{CORDIC_RESIDUAL:.0e}"
    rows = [
        ["published, not run", "core", "cycles", "`dahl_step_counts`", "error"],
        ["---", "---", "---:", "---:", "---"],
        [
            f"Qfplib-M0-full, a step: {parts}",
            "Cortex-M0",
            f"{qfplib}",
            f"{m0[0]}",
            "as the `1 - expf` step: exp of a short move is 1 to 24 bits",
        ],
        [
            "CORDIC of STM32, exp alone, as its maker measured it: fixed point (float)",
            "Cortex-M4F",
            f"{CORDIC_FIXED} ({CORDIC_FLOAT})",
            f"{m4f[0]} to {m4f[1]}",
            f"{error} of exp, so {error}/u of a move of travel u; longer than 1.118: reduce first",
        ],
    ]
    return "\n".join([MARKS[0], *("| " + " | ".join(row) + " |" for row in rows), MARKS[1]])
