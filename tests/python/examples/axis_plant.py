# SPDX-License-Identifier: MIT
"""A simulated axis: LuGre friction and gravity in fine steps, without the library."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field


@dataclass
class Axis:
    """A motor with friction. With `shaft` in N m/rad, it drives a load of its own inertia."""

    Fc: float
    sigma0: float
    inertia: float
    peak: float = 1.0  # breakaway over Fc
    stribeck_speed: float = 0.3  # rad/s
    damping: float = 0.0  # sigma1, N m s/rad
    shaft: float = 0.0  # N m/rad
    load_inertia: float = 0.0  # kg m2
    outside: Callable[[float], float] = field(default=lambda angle: 0.0)  # N m at an angle
    angle: float = 0.0
    speed: float = 0.0
    bristle: float = 0.0
    load_angle: float = 0.0
    load_speed: float = 0.0

    def friction(self, dt: float) -> float:
        peak = 1 + (self.peak - 1) * math.exp(-((self.speed / self.stribeck_speed) ** 2))
        slope = self.sigma0 * abs(self.speed) / (self.Fc * peak)
        rate = self.speed - slope * self.bristle
        self.bristle += rate * dt
        return self.sigma0 * self.bristle + self.damping * rate

    def advance(self, torque: float, seconds: float, steps: int = 10) -> None:
        dt = seconds / steps
        for _ in range(steps):
            resisted = self.friction(dt)
            if self.shaft:
                twist, rate = self.angle - self.load_angle, self.speed - self.load_speed
                damping = 0.04 * math.sqrt(self.shaft * self.load_inertia)
                carried = self.shaft * twist + damping * rate
                drive = carried + self.outside(self.load_angle)
                self.load_speed += dt * drive / self.load_inertia
                self.load_angle += dt * self.load_speed
                resisted += carried
            else:
                resisted -= self.outside(self.angle)
            self.speed += dt * (torque - resisted) / self.inertia
            self.angle += dt * self.speed
