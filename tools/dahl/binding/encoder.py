# SPDX-License-Identifier: MIT
"""Encoder readings to counts, and torques in whole units. Same names and bits as in C."""

from __future__ import annotations

from dahl.binding import checks
from dahl.binding.checks import INT32_MAX, INT32_MIN, ONE_Q30, UINT32_MAX
from dahl.binding.copies import Copied, content
from dahl.binding.library import c
from dahl.errors import Error


@checks.names_checked
def counts_between(before: int, now: int, modulus: int = 0) -> int:
    """Shortest signed way from one reading of a counter to the next (dahl_counts_between), in
    counts: -modulus/2 <= way < modulus/2, so that exactly half way round counts as backward.

    modulus is the number of different readings, 0 for a full 32-bit counter: 65536 for a 16-bit
    timer, the counts of a turn for an absolute encoder. Whole numbers: modulus from 0 to 2^32-1,
    both readings from 0 to modulus-1. Raises dahl.Error for any other, also for a reading that does
    not wrap at modulus.
    """
    modulus = checks.whole("modulus", modulus, 0, UINT32_MAX)
    most = modulus - 1 if modulus else UINT32_MAX
    first = checks.whole("before", before, 0, most)
    return int(c.dahl_counts_between(first, checks.whole("now", now, 0, most), modulus))


@checks.names_checked
def to_units(ratio_q30: int, Fc_units: int) -> int:  # noqa: N803
    """A torque in whole units of your own (dahl_to_units), for a firmware without floats:
    ratio_q30 2^-30 Fc_units, rounded to the nearest, a half up.

    ratio_q30 is F/Fc in Q30 as step_counts_q30() returns it, from -2^31 to 2^31-1; Fc_units is Fc
    in that unit (uN m, counts of a drive's current), a whole number from 0 to 2^30. Raises
    dahl.Error for any other.
    """
    ratio_q30 = checks.whole("ratio_q30", ratio_q30, INT32_MIN, INT32_MAX)
    return int(c.dahl_to_units(ratio_q30, checks.whole("Fc_units", Fc_units, 0, ONE_Q30)))


@checks.calls_checked
class Encoder(Copied):
    """dahl_encoder_t: from the readings of a counter to the counts of each tick, wherever it wraps.

    modulus       of the reading: 65536 for a 16-bit timer, 0 for all 32 bits, the counts of a turn
                  for an absolute encoder; 0, or 3 .. 2^32-1
    sign          of the mounting: +1, or -1 if it counts down while the shaft turns forward
    largest_step  counts; a longer move is a jump (an index pulse, a spoiled reading) and no motion;
                  below half of the modulus, 0: no limit

    Comparable, picklable; a copy has a state of its own. Raises dahl.Error with the argument, its
    value and its limit.

    >>> timer = dahl.Encoder(modulus=65536)
    >>> timer.move(65535), timer.move(2)
    (0, 3)
    """

    def __init__(self, modulus: int = 0, sign: int = 1, largest_step: int = 0) -> None:
        modulus = checks.whole("modulus", modulus, 0, UINT32_MAX)
        if modulus in (1, 2):
            raise Error(f"modulus = {modulus} shows no direction; 0, or 3 to {UINT32_MAX} does")
        most = ((modulus or 2**32) - 1) // 2
        largest_step = checks.whole("largest_step", largest_step, 0, most)
        if checks.whole("sign", sign, -1, 1) == 0:
            raise Error("sign = 0 is neither 1 nor -1")
        self._encoder = c.new("dahl_encoder_t *")
        c.dahl_encoder_init(self._encoder, modulus, int(sign), largest_step)

    def move(self, reading: int) -> int:
        """Counts since the last reading, the shortest way (exactly half of the modulus counts as
        backward); 0 for the first one and for a jump. A reading is a whole number from 0 to
        modulus-1; dahl.Error for any other.
        """
        return int(c.dahl_encoder_move(self._encoder, self._check_reading(reading)))

    def home(self, reading: int) -> None:
        """The counter was set to `reading`, in counts as in move(), without motion; the next move
        starts there. The same errors as move().
        """
        c.dahl_encoder_home(self._encoder, self._check_reading(reading))

    @property
    def jumps(self) -> int:
        """Moves refused since the beginning: longer than largest_step."""
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
