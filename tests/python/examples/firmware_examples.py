# SPDX-License-Identifier: MIT
"""Torques that the firmware of examples/ and port/arduino/ must print; all have the same motion."""

import math

SIGMA0, FC, THETA_PER_COUNT = 100.0, 0.5, 2 * math.pi / 16384
TICKS, COUNTS = 100, 2  # half of them forward, half back; so many counts a tick


def expected_torques() -> dict[int, float]:
    """N m after each tenth tick, by Eqs. 7 and 18: towards Fc from rest, then towards -Fc."""
    rate = SIGMA0 / FC * THETA_PER_COUNT * COUNTS
    half = TICKS // 2
    turned = 1 - math.exp(-rate * half)  # F/Fc at the reversal
    forward = {tick: 1 - math.exp(-rate * tick) for tick in range(10, half + 1, 10)}
    back = {
        tick: -1 + (turned + 1) * math.exp(-rate * (tick - half))
        for tick in range(half + 10, TICKS + 1, 10)
    }
    return {tick: FC * ratio for tick, ratio in (forward | back).items()}
