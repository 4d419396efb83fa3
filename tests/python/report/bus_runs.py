# SPDX-License-Identifier: MIT
"""Recorded runs of a friction node, frame by frame, with torques of the library."""

from pathlib import Path

import can
from dahl import Friction, Plan, codec

SIGMA0, FC, THETA = 50.0, 0.5, 1e-4


class Run:
    def __init__(self) -> None:
        self.bearing = Friction(Plan(SIGMA0, FC, THETA))
        self.frames: list[can.Message] = []
        self.count = self.ratio = 0
        self.pause = 0.0  # s, before the next frame
        self.answers: int | None = None  # number of the last answer, or None

    def add(self, frame: codec.Frame) -> None:
        message = codec.pack(frame)
        message.timestamp = len(self.frames) / 2000 + self.pause
        message.channel = "can0"
        self.frames.append(message)

    def send(self, counter: int, count: int, valid: bool = True) -> None:
        self.add(codec.EncoderState(count, counter % 16, valid))

    def answer(self, counter: int, count: int, state: int = 0, used: bool = True) -> None:
        """The node integrates the travel since the last answer, or starts anew at the count."""
        move = (count - self.count + 2**31) % 2**32 - 2**31 if used else 0
        self.ratio = self.bearing.step_counts_q30(move)
        self.count = count
        if self.answers is not None:
            self.answers += 1
        self.add(codec.FrictionTorque(self.ratio, (self.answers or 0) % 16, state, counter % 16))

    def tick(self, counter: int, count: int, state: int = 0, used: bool = True) -> None:
        self.send(counter, count)
        self.answer(counter, count, state, used)

    def write(self, path: Path) -> Path:
        with can.Logger(path) as log:
            for frame in self.frames:
                log.on_message_received(frame)
        return path
