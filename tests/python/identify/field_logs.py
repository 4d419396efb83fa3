# SPDX-License-Identifier: MIT
"""Logs of known truth as users record them: other rigs, recorders and motions than in
hostile_logs.py. The truth is always SIGMA0 (slope at rest) and FC (full slip at speed).
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from dahl.io.log import Log
from hostile_logs import LEAD, LENGTH, ROWS, STEP, Rig
from identify_tools import COUNT, FC, SCALE, SIGMA0, behind_play, dahl_torque, noise_of
from scipy.signal import lfilter


def clock_reset(rig: Rig) -> Log:
    """The recorder starts its clock anew in the middle."""
    log = rig.log(rig.friction() + 0.1 * FC * rig.speed / rig.fastest)
    return replace(log, time=np.where(log.time < 2, log.time, log.time - 1.99))


def clipped_sensor(rig: Rig) -> Log:
    """The amplifier ends at 1.0 to 1.1 of Fc, within the noise."""
    log = rig.log(noise=0.04)
    end = rig.random.uniform(1.0, 1.1) * FC
    return replace(log, torque=np.clip(log.torque, -end, end))


def end_stops(rig: Rig) -> Log:
    """Soft stops beyond 95 % of the stroke, on both sides."""
    far = np.abs(rig.theta).max()
    beyond = np.sign(rig.theta) * np.maximum(np.abs(rig.theta) - 0.95 * far, 0)
    return rig.log(rig.friction() + 1.5 * FC * beyond / (0.05 * far))


def relaxing_rests(rig: Rig) -> Log:
    """Rests at each turn, in which the deflected contacts creep back by a tenth."""
    rig.along(rig.amplitude * LENGTH * np.clip(1.3 * np.sin(rig.phase), -1, 1))
    kept, F, torque = 1.0, 0.0, []  # noqa: N806
    limit, a = SCALE["Fc"] * FC, SCALE["sigma0"] / SCALE["Fc"] / LENGTH
    for move in np.diff(rig.theta, prepend=rig.theta[0]).tolist():
        before, kept = kept, 0.9 + (kept - 0.9) * np.exp(-1 / 30) if abs(move) < 1e-9 else 1.0
        F *= min(kept / before, 1.0)  # noqa: N806
        F += (np.sign(move) * limit - F) * -np.expm1(-a * abs(move))  # noqa: N806
        torque.append(F)
    return rig.log(np.array(torque))


def two_speeds_stribeck(rig: Rig) -> Log:
    """A slow half and a fast half; 25 % more friction at slow speed."""
    pace = np.where(np.sin(rig.phase / 6) > 0, 1.0, 0.35)
    phase = np.cumsum(pace) / pace.sum() * np.ptp(rig.phase) + rig.phase[0]
    rig.along(rig.stroke(phase, rig.seed % 3))
    slow = np.exp(-((rig.speed / (0.1 * rig.fastest)) ** 2))
    return rig.log(dahl_torque(rig.theta, Fc=FC * (1 + 0.25 * slow)))


def belt_resonance(rig: Rig) -> Log:
    """A belt between encoder and bearing that rings at 40 Hz and gives 3 % of a length.

    The truth is what the encoder sees: the bearing is stiffer by what the belt gives.
    """
    torque = dahl_torque(rig.theta, SIGMA0 / 0.97)
    pole = np.exp((-0.1 + 1j) * 2 * np.pi * 40 * STEP)
    a = np.array([1.0, -2 * pole.real, abs(pole) ** 2])
    return rig.log(torque, theta=rig.theta + 0.03 * LENGTH / FC * lfilter([a.sum()], a, torque))


def merged_buses(rig: Rig) -> Log:
    """The torque comes from another bus every four rows and is held; its clock starts elsewhere."""
    log, first = rig.log(), int(rig.random.integers(4))
    rows = np.maximum((np.arange(ROWS) - first) // 4 * 4 + first, 0)
    return replace(log, torque=log.torque[rows])


def swinging_door(rig: Rig) -> Log:
    """Gravity on a leaning axis, six times as large as friction."""
    return rig.log(rig.friction() + 6 * FC * np.sin(rig.theta + 0.4))


def preloaded_play(rig: Rig) -> Log:
    """A play of half a length that a spring closes on one side of the middle.

    The truth is the slope behind the play, as on the side without it.
    """
    behind = behind_play(rig.theta, 0.5 * LENGTH)
    mixed = np.where(rig.theta > 0, rig.theta - 0.25 * LENGTH, behind)
    return rig.log(dahl_torque(mixed) + 0.2 * FC)


def play_and_eccentric_gear(rig: Rig) -> Log:
    """A play of a fifth of a length in a gear whose wheels turn six times in a stroke.

    They move the bearing by up to a count. The truth is the slope behind the play.
    """
    wheel = COUNT * np.sin(12 * np.pi * rig.theta / np.ptp(rig.theta) + rig.seed)
    return rig.log(dahl_torque(behind_play(rig.theta + wheel, 0.2 * LENGTH)) + 0.3 * FC)


def warming_up(rig: Rig) -> Log:
    """Fc falls by 20 %, quickly at first, and the viscous torque with it. The truth is the mean."""
    warm = 1 + 0.25 * np.exp(-np.maximum(rig.rows, 0) / (ROWS / 2))
    return rig.log(rig.friction(warm) + 0.2 * FC * warm * rig.speed / rig.fastest)


def swinging_load(rig: Rig) -> Log:
    """sigma0 and Fc follow a load that swings by 15 %, unrelated to the strokes and not recorded.

    The truth is the mean.
    """
    load = 1 + 0.15 * np.sin(2 * np.pi * rig.random.uniform(1, 5) * rig.rows / ROWS + rig.seed)
    load /= load[LEAD:].mean()
    return rig.log(dahl_torque(rig.theta, load * SIGMA0, load * FC, is_reduced=True))


def sensor_hysteresis(rig: Rig) -> Log:
    """A torque cell with a hysteresis of 1 % of Fc over its range, calibrated at both ends.

    The truth is that of the bearing; the cell changes the slope after a turn by 1 %.
    """
    torque = rig.friction()
    lost = dahl_torque(torque, 0.01, 0.01 * FC) / SCALE["Fc"]
    return rig.log((torque - lost) / 0.9922)


def hand_with_pauses(rig: Rig) -> Log:
    """A hand moves a lever irregularly, waits now and then, and trembles by a count."""
    steps = rig.random.normal(size=len(rig.theta))
    for _ in range(3):
        steps = lfilter([1 / 40], [1, 1 / 40 - 1], steps)
    pace = np.cumsum(np.sin(rig.phase / 2.7) > -0.6)  # rows of motion
    theta = np.interp(pace, rig.rows + LEAD, 8 * LENGTH * steps / np.std(steps))
    return rig.along(theta + COUNT * np.sin(2 * np.pi * 0.009 * rig.rows)).log()


def jittering_rows(rig: Rig) -> Log:
    """Rows are read up to .3 of a row early or late; the stamps are those of the plan."""
    late = rig.random.uniform(-0.3, 0.3, size=len(rig.theta))
    theta, torque = (np.interp(rig.rows + late, rig.rows, x) for x in (rig.theta, rig.friction()))
    return rig.log(torque + 0.1 * FC * rig.speed / rig.fastest, theta=theta)


def averaged_rows(rig: Rig) -> Log:
    """A logger that writes the mean of four rows."""
    log = rig.log()
    theta, torque = (x.reshape(-1, 4).mean(axis=1) for x in (log.theta, log.torque))
    return Log(log.name, theta, torque, log.time[::4])


def clipped_side(rig: Rig) -> Log:
    """The amplifier ends at .85 to 1.05 of Fc, on one side."""
    log = rig.log()
    return replace(log, torque=np.minimum(log.torque, rig.random.uniform(0.85, 1.05) * FC))


def one_way_slow(rig: Rig) -> Log:
    """Strokes that return four times as fast."""
    x = rig.phase / (2 * np.pi) % 1
    ramp = np.where(x < 0.8, x / 0.8, (1 - x) / 0.2)
    smooth = np.convolve(2 * ramp - 1, np.ones(15) / 15, "same")
    return rig.along(rig.amplitude * LENGTH * smooth).log()


def random_strokes(rig: Rig) -> Log:
    """Strokes of 2 to 14 lengths with dwells between them."""
    parts, at = [], 0.0
    for side in np.resize([1.0, -1.0], 60):
        end = side * rig.random.uniform(2, 14) * LENGTH
        share = (1 - np.cos(np.pi * np.linspace(0, 1, int(rig.random.integers(60, 220))))) / 2
        dwell = np.full(int(rig.random.integers(0, 40)), end)
        parts.append(np.append(at + (end - at) * share, dwell))
        at = end
    return rig.along(np.concatenate(parts)[: len(rig.theta)]).log()


def stuck_recorder(rig: Rig) -> Log:
    """All columns stand still for 30 rows, six times, then jump to the present."""
    log = rig.log()
    rows = np.arange(ROWS)
    for start in rig.random.integers(100, ROWS - 100, size=6):
        rows[start : start + 30] = start
    return replace(log, theta=log.theta[rows], torque=log.torque[rows])


def coarse_torque(rig: Rig) -> Log:
    log = rig.log()
    return replace(log, torque=np.round(log.torque / FC * 12) * FC / 12)


def quick_strokes(rig: Rig) -> Log:
    """A sine of 15 to 58 rows a cycle at 200 Hz, of either sign, late by up to two rows."""
    phase = 2 * np.pi * rig.rows / rig.random.uniform(15, 58)
    torque = rig.along(rig.stroke(phase, 0)).friction()
    return rig.log(np.roll(rig.random.choice([1, -1]) * torque, int(rig.random.integers(3))))


def one_speed(rig: Rig) -> Log:
    """A triangle: viscous friction is the same torque but for the turns."""
    return rig.along(rig.amplitude * LENGTH * np.arcsin(np.sin(rig.phase)) * 2 / np.pi).log()


def pause(rig: Rig) -> Log:
    """The recorder pauses, then repeats the last row five times."""
    log = rig.log()
    kept = np.r_[0:1500, 1900:ROWS]
    log = log.part(kept)
    log.theta[1500:1505], log.torque[1500:1505] = log.theta[1499], log.torque[1499]
    return log


MAKERS: dict[str, Callable[[Rig], Log]] = {
    "flipped torque": lambda rig: rig.log(-rig.friction() - 0.1 * FC),
    "clock reset": clock_reset,
    "clipped sensor": clipped_sensor,
    "end stops": end_stops,
    "rests with relaxation": relaxing_rests,
    "two speeds, Stribeck": two_speeds_stribeck,
    "belt resonance": belt_resonance,
    "merged buses": merged_buses,
    "swinging door": swinging_door,
    "preloaded play": preloaded_play,
    "play and eccentric gear": play_and_eccentric_gear,
    "warming up": warming_up,
    "swinging load": swinging_load,
    "sensor hysteresis": sensor_hysteresis,
    "hand with pauses": hand_with_pauses,
    "jittering rows": jittering_rows,
    "averaged rows": averaged_rows,
    "clipped on one side": clipped_side,
    # the mean of two encoders whose errors of two counts beat over the stroke
    "encoders with a beat": lambda rig: rig.log(
        theta=rig.theta + COUNT * sum(np.sin(2 * np.pi * rig.theta / (k * COUNT)) for k in (50, 54))
    ),
    "one way slow": one_way_slow,
    "random strokes": random_strokes,
    "stuck recorder": stuck_recorder,
    "coarse torque": coarse_torque,
    "quick strokes": quick_strokes,
    "one speed": one_speed,
    "pause": pause,
    # an inverter's ripple of 6 % of Fc in alternate rows
    "PWM ripple": lambda rig: rig.log(rig.friction() + 0.06 * FC * (-1.0) ** rig.rows),
    # 24 cogs in each stroke, with 8 % of Fc
    "cogging": lambda rig: rig.log(
        rig.friction() + 0.08 * FC * np.sin(2 * np.pi * rig.theta / (np.ptp(rig.theta) / 24))
    ),
    # the zero of the torque sensor drifts by 30 % of Fc
    "drifting zero": lambda rig: rig.log(rig.friction() + 0.3 * FC * rig.rows / ROWS),
    # noise of the torque that is correlated over 50 rows
    "slow noise": lambda rig: rig.log(
        rig.friction() + 0.06 * FC * noise_of(rig.seed, LEAD + ROWS, 0.98), noise=0.01
    ),
    # a tenth more friction one way than the other
    "asymmetric": lambda rig: rig.log(
        dahl_torque(rig.theta, SIGMA0, FC * (1 + 0.1 * np.sign(rig.speed)))
    ),
    # a coarse encoder: six counts in a presliding length
    "six counts": lambda rig: replace(
        rig.log(),
        theta=np.floor(rig.theta[LEAD:] / (LENGTH / 6)) * LENGTH / 6,
        resolution=LENGTH / 6,
    ),
}
KINDS: dict[str, Callable[[int], Log]] = {
    kind: lambda seed, make=make: make(Rig(seed)) for kind, make in MAKERS.items()
}
