# SPDX-License-Identifier: MIT
"""Is a frame of a node whole? AUTOSAR E2E profile 2, as lib/include/dahl_frames.h has it."""

from __future__ import annotations

KINDS = {0x100: 0x3, 0x110: 0xC, 0x120: 0x5, 0x130: 0x6, 0x140: 0x9, 0x150: 0xA}  # by base id
POLYNOMIAL = 0x2F


def _byte(crc: int) -> int:
    for _ in range(8):
        crc = crc << 1 ^ (POLYNOMIAL if crc & 0x80 else 0)
    return crc & 0xFF


TABLE = [_byte(byte) for byte in range(256)]


def checksum(identifier: int, data: bytes | bytearray) -> int:
    """CRC-8H2F over bytes 1 to 7 and the data id that message and counter choose."""
    crc = 0xFF
    for byte in (*data[1:8], KINDS[identifier & ~15] << 4 | data[1] & 15):
        crc = TABLE[crc ^ byte]
    return crc ^ 0xFF


def is_whole(identifier: int, data: bytes | bytearray) -> bool:
    """True for 8 bytes of one of the messages, with the CRC that they need."""
    return len(data) == 8 and identifier & ~15 in KINDS and checksum(identifier, data) == data[0]
