#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Run an image on QEMU's board mega2560: copy its output and exit with the result of main.

An image cannot end QEMU on this board, so serial.c sends byte 4 and a digit after main.
"""

import subprocess
import sys

END = b"\x04"
QEMU = ["qemu-system-avr", "-M", "mega2560", "-display", "none", "-monitor", "none"]
QEMU += ["-serial", "stdio", "-bios"]


def main() -> int:
    with subprocess.Popen(
        [*QEMU, sys.argv[1]], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE
    ) as emulator:
        assert emulator.stdout is not None
        try:
            while (byte := emulator.stdout.read(1)) not in (END, b""):
                sys.stdout.buffer.write(byte)
            sys.stdout.buffer.flush()
            digit = emulator.stdout.read(1) if byte == END else b""
            return int(digit) if digit.isdigit() else 70
        finally:
            emulator.kill()


if __name__ == "__main__":
    sys.exit(main())
