#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Run an image on QEMU's board mega2560: what it prints, and main's result as exit code.

QEMU has no way out of this board, so serial.c says when main has returned (byte 4, then a digit).
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
