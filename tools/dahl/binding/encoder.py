# SPDX-License-Identifier: MIT
"""Encoder readings to counts, and torques in whole units (dahl_encoder.h, dahl.h)."""

from __future__ import annotations

from dahl.binding import checks
from dahl.binding.checks import INT32_MAX, INT32_MIN, ONE_Q30, UINT32_MAX
from dahl.binding.copies import Copied, content
from dahl.binding.library import c
from dahl.errors import InputError


def counts_between(before: int, now: int, modulus: int = 0) -> int:
    """Return the shortest signed move in counts between two readings of a counter that wraps
    (dahl_counts_between): -modulus/2 <= move < modulus/2.

    modulus is the number of different readings: 65536 for a 16-bit timer, 0 for a 32-bit timer, the
    counts of a turn for an absolute encoder. Readings are whole numbers from 0 to modulus-1.
    """
    modulus = checks.whole("modulus", modulus, 0, UINT32_MAX)
    most = modulus - 1 if modulus else UINT32_MAX
    first = checks.whole("before", before, 0, most)
    return int(c.dahl_counts_between(first, checks.whole("now", now, 0, most), modulus))


def to_units(ratio_q30: int, Fc_units: int) -> int:  # noqa: N803
    """Return a torque in whole units (dahl_to_units): ratio_q30 2^-30 Fc_units, rounded to nearest,
    a half up.

    ratio_q30 is F/Fc in Q30 as step_counts_q30() returns it, from -2^31 to 2^31-1. Fc_units is Fc
    in that unit (uN m, counts of a drive's current), a whole number from 0 to 2^30.
    """
    ratio_q30 = checks.whole("ratio_q30", ratio_q30, INT32_MIN, INT32_MAX)
    return int(c.dahl_to_units(ratio_q30, checks.whole("Fc_units", Fc_units, 0, ONE_Q30)))


class Encoder(Copied):
    """Convert the readings of a counter that wraps to the counts of each tick (dahl_encoder_t).

    modulus       as in counts_between(); 0, or 3 .. 2^32-1
    sign          of the mounting: +1, or -1 if it counts down while the shaft turns forward
    largest_step  counts; a longer move is a jump (an index pulse, a wrong reading) and no motion;
                  the next reading then counts as a first one. Below half of the modulus; 0: no
                  limit

    Do not pass a reading that is known to be bad: the next move then covers both ticks.

    >>> timer = dahl.Encoder(modulus=65536)
    >>> timer.move(65535), timer.move(2)
    (0, 3)
    """

    def __init__(self, modulus: int = 0, sign: int = 1, largest_step: int = 0) -> None:
        modulus = checks.whole("modulus", modulus, 0, UINT32_MAX)
        if modulus in (1, 2):
            raise InputError(
                f"modulus = {modulus} shows no direction; 0, or 3 to {UINT32_MAX} does"
            )
        most = ((modulus or 2**32) - 1) // 2
        largest_step = checks.whole("largest_step", largest_step, 0, most)
        if checks.whole("sign", sign, -1, 1) == 0:
            raise InputError("sign = 0 is neither 1 nor -1")
        self._encoder = c.new("dahl_encoder_t *")
        c.dahl_encoder_init(self._encoder, modulus, int(sign), largest_step)

    def move(self, reading: int) -> int:
        """Return the counts since the last reading, as counts_between() does; 0 for the first
        reading, for a jump and for the reading after it.
        """
        return int(c.dahl_encoder_move(self._encoder, self._check_reading(reading)))

    def home(self, reading: int) -> None:
        """The counter was set to `reading` without motion; the next move starts there."""
        c.dahl_encoder_home(self._encoder, self._check_reading(reading))

    @property
    def jumps(self) -> int:
        """Number of moves longer than largest_step."""
        return int(self._encoder.jumps)

    def _check_reading(self, reading: int) -> int:
        modulus = self._encoder.modulus
        return checks.whole("reading", reading, 0, modulus - 1 if modulus else UINT32_MAX)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Encoder):
            return NotImplemented
        return content(self._encoder) == content(other._encoder)

    __hash__ = None  # type: ignore[assignment]  # it changes with each reading

    def __repr__(self) -> str:
        names = ("modulus", "sign", "largest_step")
        return f"Encoder({', '.join(f'{name}={getattr(self._encoder, name)}' for name in names)})"
