# SPDX-License-Identifier: MIT
"""Lags between friction and the measured torque as objects: a new lag is one class.

A lag has nonlinear parameters, the last ones of a hypothesis, or columns of its own, or both.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.signal import filtfilt, lfilter

from dahl.identify import models
from dahl.identify.samples import Samples, delayed

MIN_LOW_PASS = 0.3  # samples; a shorter time constant has no effect
FADING_SPEED = 0.25  # of fast motion: LuGre's damping fades as its state comes to rest in sliding
PLAY_LENGTHS = 0.2  # presliding lengths, of the play that a fit starts with
MAX_LOGS_WITH_DELAYS = 4  # logs that may each have a delay of their own


class Lag:
    """No lag. The parameters of a late or slow sensor are numbers of samples."""

    name = "none"
    parameters = 0  # nonlinear ones
    columns = 0  # linear ones, of derivatives()
    special_cases: tuple[Lag, ...] = ()  # lags that this one contains
    least = -np.inf  # of its parameter
    is_late = False  # whether the sensor shows torques other than friction late too
    is_delay = False  # whether the parameter is a delay
    is_common = True  # to all logs
    smooths_counts = False

    def __repr__(self) -> str:
        return self.name

    def __reduce__(self) -> tuple[Callable[[str], Lag], tuple[str]]:
        return lag_of, (self.name,)  # a copy and another process have the same object

    @property
    def size(self) -> int:
        """Parameters in all."""
        return self.parameters + self.columns

    def count(self, samples: Samples) -> int:
        """Number of nonlinear parameters for these samples."""
        return self.parameters

    def guess(self, a: float, delay: float) -> float:
        """Start value, from rough values of a [1/rad (1/m)] and delay [samples]."""
        return delay

    def moves(self, samples: Samples, moves: np.ndarray, angle: str, p: np.ndarray) -> np.ndarray:
        """The moves of the bearing if those of the encoder are `moves`."""
        return moves

    def apply(self, samples: Samples, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """x as a late or slow torque sensor shows it."""
        return x

    def derivatives(self, samples: Samples, friction: np.ndarray) -> list[np.ndarray]:
        """Derivatives by time that the lag adds as columns."""
        return []

    def delay(self, p: np.ndarray) -> float:
        """Samples by which the torque of all logs is late."""
        return 0.0

    def play(self, p: np.ndarray) -> float:
        """Width of the play between encoder and bearing, rad (m)."""
        return 0.0


def _damping(samples: Samples, friction: np.ndarray) -> np.ndarray:
    damping: np.ndarray = samples.rate(friction) / samples.reference.fast
    return damping


class Damping(Lag):
    name = "damping"
    columns = 1

    def derivatives(self, samples: Samples, friction: np.ndarray) -> list[np.ndarray]:
        return [_damping(samples, friction)]


DAMPING = Damping()


class Play(Lag):
    """A play between encoder and bearing; the parameter is the logarithm of its width."""

    name = "play"
    parameters = 1

    def guess(self, a: float, delay: float) -> float:
        return float(np.log(PLAY_LENGTHS / a))

    def moves(self, samples: Samples, moves: np.ndarray, angle: str, p: np.ndarray) -> np.ndarray:
        behind = models.behind_play(samples.angles[angle], samples.pieces, self.play(p))
        return samples.moves(behind)

    def play(self, p: np.ndarray) -> float:
        return float(np.exp(p[-1]))


class Delay(Lag):
    """A torque that is late by the same samples in all logs."""

    name = "delay"
    parameters = 1
    is_late = is_delay = True

    def guess(self, a: float, delay: float) -> float:
        return delay or 1.0

    def apply(self, samples: Samples, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        return samples.delayed(x, p[-1])

    def delay(self, p: np.ndarray) -> float:
        return float(p[-1])


DELAY = Delay()


class DelayAndFilter(Delay):
    """A delay with the columns of any short filter: a mean over rows, a torque cell that rings."""

    name = "delay+filter"
    special_cases = (DELAY,)
    columns = 2
    smooths_counts = True

    def guess(self, a: float, delay: float) -> float:
        return delay

    def derivatives(self, samples: Samples, friction: np.ndarray) -> list[np.ndarray]:
        fading = np.exp(-((samples.speed / (FADING_SPEED * samples.reference.fast)) ** 2))
        bend = samples.by_piece(lambda x: np.gradient(np.gradient(x)), friction)
        return [bend, _damping(samples, friction) * fading]


class Delays(Lag):
    """A delay of each log."""

    name = "delays"
    parameters = 2
    is_late = is_delay = True
    is_common = False

    def count(self, samples: Samples) -> int:
        return samples.logs

    def apply(self, samples: Samples, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        each = p[len(p) - samples.logs :]
        parts = zip(samples.pieces, samples.log_of, strict=True)
        return np.concatenate([delayed(x[rows], each[k]) for rows, k in parts])


class LowPass(Lag):
    """A filter of the first order; its parameter is the time constant."""

    name = "low pass"
    parameters = 1
    least = MIN_LOW_PASS
    is_late = smooths_counts = True
    run: Callable[..., np.ndarray] = staticmethod(lfilter)

    def guess(self, a: float, delay: float) -> float:
        return max(delay, 3.0)

    def apply(self, samples: Samples, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        kept = np.exp(-1 / max(p[-1], 1e-2))
        return samples.by_piece(lambda y: self.run([1 - kept], [1, -kept], y), x)


LOW_PASS = LowPass()


class ZeroPhaseFilter(LowPass):
    """A filter that runs to and fro."""

    name = "zero-phase filter"
    run = staticmethod(filtfilt)

    def guess(self, a: float, delay: float) -> float:
        return 3.0


class DampedLowPass(LowPass):
    name = "damped low pass"
    special_cases = (DAMPING, LOW_PASS)
    columns = 2

    def guess(self, a: float, delay: float) -> float:
        return max(delay, 2.0)

    def derivatives(self, samples: Samples, friction: np.ndarray) -> list[np.ndarray]:
        return [_damping(samples, friction), samples.rate(samples.acceleration)]


NONE, PLAY, DELAYS = Lag(), Play(), Delays()  # the delays of several logs are not in LAGS
LAGS = {
    lag.name: lag
    for lag in (
        NONE,
        DAMPING,
        PLAY,
        DELAY,
        LOW_PASS,
        ZeroPhaseFilter(),
        DampedLowPass(),
        DelayAndFilter(),
    )
}


def lag_of(name: str) -> Lag:
    return (LAGS | {DELAYS.name: DELAYS})[name]
