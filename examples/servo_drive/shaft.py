# SPDX-License-Identifier: MIT
"""The drive in QEMU, and what surrounds it: shaft, encoder, power, watchdog and the bus.

    with Bench("m4f", image, folder) as bench:   # power on
        bench.send(Command.COMMISSION)
        bench.run(26.0)
        print(bench.drive["State"])

The shaft is that of `dahl commission --simulate`. Drive and shaft advance in turns of a tick, so
each run gives the same numbers.
"""

from __future__ import annotations

import struct
import subprocess
from collections import deque
from collections.abc import Callable
from enum import IntEnum
from pathlib import Path
from typing import IO, Any

import cantools
from dahl import codec
from dahl.facts import BOARDS
from dahl.sim.axis import Shaft

TICKS_PER_S = 1000
FRAMES = 8  # in a tick and direction
FRAME = struct.Struct("<HB8sx")
TO_DRIVE = struct.Struct("<4s6I")  # encoder, cause, is_stalled, address, value, is_written, count
FROM_DRIVE = struct.Struct("<f2I")  # torque, word, count
FROM_BYTES = FROM_DRIVE.size + FRAMES * FRAME.size
WATCHDOG_STATUS = 3  # of QEMU
FLASH_BYTES, SLOT_BYTES = 512, 256
DATABASE: Any = cantools.database.load_file(Path(__file__).with_name("servo_drive.dbc"))


class Command(IntEnum):
    """Values of DriveCommand.Command."""

    STOP, MOVE, COMMISSION, SAVE, CLEAR = range(5)


def crc(polynomial: int, data: bytes, start: int) -> int:
    """Return a CRC-8, most significant bit first."""
    for byte in data:
        start ^= byte
        for _ in range(8):
            start = start << 1 ^ (0x100 | polynomial if start & 0x80 else 0)
    return start ^ 0xFF


def spi_frame(count: int) -> bytes:
    """Return the frame of the encoder."""
    bits = struct.pack(">HB", count % 65536, 3)
    return bits + bytes([crc(0x97, bits, 0)])


class Bench:
    """A drive that runs. The flash is a file in `folder`, so the next Bench starts with it."""

    def __init__(self, core: str, image: Path, folder: Path, *options: str) -> None:
        self.words = ["qemu-system-arm", "-M", BOARDS[core][0], "-display", "none", *options]
        self.words += ["-monitor", "none", "-serial", "none", "-kernel", str(image.resolve())]
        self.words += ["-semihosting-config", "enable=on,target=native"]
        self.folder, self.flash = folder, folder / "flash.bin"
        self.shaft, self.count = Shaft(), 100  # the encoder's count of the first angle
        self.torque, self.ticks, self.cause, self.resets = 0.0, 0, 0, 0
        self.encoder: Callable[[int], bytes] = spi_frame  # replace it to damage the frame
        self.is_stalled = False  # the main program hangs
        self.address, self.value, self.is_written, self.word = 0, 0, False, 0
        self.drive: dict[str, Any] = {}  # the last DriveStatus
        self.frames: list[Any] = []  # all other frames
        self.torques: list[float] = []  # N m, of each tick
        self.queue: deque[tuple[int, bytes]] = deque()
        self._counter = 0
        if not self.flash.exists():
            self.flash.write_bytes(b"\xff" * FLASH_BYTES)

    def __enter__(self) -> Bench:
        self.process = subprocess.Popen(
            self.words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=self.folder
        )
        return self

    def __exit__(self, *_: object) -> None:
        self.stream(self.process.stdin).close()
        self.process.wait(30)
        self.stream(self.process.stdout).close()

    @staticmethod
    def stream(stream: IO[bytes] | None) -> IO[bytes]:
        assert stream is not None
        return stream

    def power_cycle(self, cause: int = 0) -> None:
        """Switch the power off and on: only flash and shaft keep their state."""
        self.__exit__()
        self.cause, self.torque = cause, 0.0
        self.drive = {}
        self.__enter__()

    def send(self, command: Command, target: int = 0) -> None:
        """Send a DriveCommand."""
        values = {"Crc": 0, "Counter": self._counter % 16, "Command": int(command)}
        values |= {"Target": target}
        data = DATABASE.encode_message("DriveCommand", values, strict=False)
        protected = bytes(data[1:]) + bytes([0xF0 | data[1] & 15])
        self._counter += 1
        self.send_raw(0x160, bytes([crc(0x2F, protected, 0xFF)]) + data[1:])

    def send_raw(self, identifier: int, data: bytes) -> None:
        self.queue.append((identifier, data))

    def peek(self, address: int) -> int:
        """Return the word at an address."""
        self.address = address
        self.run(0.002)
        return self.word

    def poke(self, address: int, word: int) -> None:
        """Write a word, as a fault of the memory does."""
        self.address, self.value, self.is_written = address, word, True
        self.run(0.001)

    def write(self, param: codec.Param, raw: int, how: codec.Write = codec.Write.WRITE) -> Any:
        """Write a parameter; return its ParamReply."""
        message = codec.pack(codec.ParamWrite(param, raw, how))
        self.send_raw(message.arbitration_id, bytes(message.data))
        self.run(0.005)
        return self.last(codec.ParamReply)

    def last(self, kind: type) -> Any:
        """Return the last frame of a kind."""
        return next(frame for frame in reversed(self.frames) if isinstance(frame, kind))

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Run; stop early if until() is true, and return that."""
        for _ in range(round(seconds * TICKS_PER_S)):
            self.tick()
            if until():
                return True
        return False

    def hold(self, seconds: float, target: int, until: Callable[[], bool] = lambda: False) -> bool:
        """Run with a DriveCommand MOVE every 50 ms."""
        for _ in range(round(seconds / 0.05)):
            self.send(Command.MOVE, target)
            if self.run(0.05, until):
                return True
        return False

    def tick(self) -> None:
        """Exchange one tick with the drive."""
        incoming = [self.queue.popleft() for _ in range(min(2, len(self.queue)))]
        raw = TO_DRIVE.pack(
            self.encoder(self.count), self.cause, self.is_stalled, self.address, self.value,
            self.is_written, len(incoming),
        )  # fmt: skip
        raw += b"".join(FRAME.pack(identifier, len(data), data) for identifier, data in incoming)
        self.is_written = False
        stdin, stdout = self.stream(self.process.stdin), self.stream(self.process.stdout)
        found = stdout.read(FROM_BYTES)
        if len(found) < FROM_BYTES:
            if self.process.wait(10) != WATCHDOG_STATUS:
                raise RuntimeError(f"QEMU ended with {self.process.returncode}")
            self.resets += 1
            self.power_cycle(cause=1)
            return
        self.torque, self.word, number = FROM_DRIVE.unpack_from(found)
        self._take(found[FROM_DRIVE.size :], number)
        self.torques.append(self.torque)
        self.count += self.shaft.move(self.torque)
        self.ticks += 1
        stdin.write(raw + bytes(TO_DRIVE.size + FRAMES * FRAME.size - len(raw)))
        stdin.flush()

    def _take(self, found: bytes, number: int) -> None:
        for identifier, length, data in list(FRAME.iter_unpack(found))[:number]:
            if identifier == 0x170:
                assert length == 8 and crc(0x2F, data[1:] + bytes([data[1] & 15]), 0xFF) == data[0]
                self.drive = DATABASE.decode_message(identifier, data)
            else:
                self.frames.append(codec.from_bytes(identifier, data))
