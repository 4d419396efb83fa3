# SPDX-License-Identifier: MIT
"""Count the instructions of the AVX-512 loops of the throughput forms, to explain the distance of a
tick to a copy.

Usage: PYTHON tools/bench/batch_loops.py [ARCHIVE]    (build/host/lib/libdahl_batch.a)

Prints, for each loop and 64 ticks: all instructions, those on 512-bit registers, those that
exchange lanes, and the cycles that llvm-mca-19 expects, if it is installed: of Zen 4, whose 512-bit
instructions take two turns, and of Sapphire Rapids. docs/decisions/04-two-batches.md reads them.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ARCHIVE = Path(__file__).resolve().parents[2] / "build/host/lib/libdahl_batch.a"
MCA, PROCESSORS = "llvm-mca-19", ("znver4", "sapphirerapids")
STEPS = 100  # of a loop for llvm-mca


@dataclass(frozen=True)
class Kind:
    """A loop, found by its instructions: the number of each, and the ticks of one pass."""

    form: str
    title: str
    ticks: int
    has: dict[str, int]


EXCHANGE = r"^v(perm|align|pack|shuf[fi]\d|insert|extract|cvtpd2ps|cvtdq2pd|pmov)"
LOOK_UP, SIGN, POWER, ROUND = "vperm[ti]2pd", "vpternlogq", "vrndscalepd", "vcvtpd2ps"
KINDS = (
    Kind("trajectory", "lanes, up to 7 counts", 64, {LOOK_UP: 16, SIGN: 0, ROUND: 0}),
    Kind("trajectory", "lanes, up to 15", 64, {LOOK_UP: 16, SIGN: 8, ROUND: 0}),
    Kind("trajectory", "starts of lanes", 64, {"vmaxpd": 1}),
    Kind("trajectory", "torques, up to 7 counts", 128, {LOOK_UP: 32, SIGN: 0}),
    Kind("trajectory", "torques, up to 15", 128, {LOOK_UP: 32, SIGN: 16}),
    Kind("trajectory", "largest move", 32, {"vpmaxud": 2, "vpabsd": 2}),
    Kind("trajectory", "maps, any move", 64, {POWER: 8, "vfn?m": 40}),
    Kind("trajectory", "lanes, any move", 64, {"vfmadd": 7, "vmulpd": 7, LOOK_UP: 0}),
    Kind("trajectory", "torques, any move", 128, {ROUND: 16, "vfmadd": 16, LOOK_UP: 0}),
    Kind("channels", "16 channels, up to 7 counts", 64, {LOOK_UP: 16, SIGN: 0, "%k": 0}),
    Kind("channels", "16 channels, up to 15", 64, {LOOK_UP: 16, SIGN: 8, "%k": 0}),
    Kind("channels", "16 channels, any move", 64, {POWER: 8, "%k": 0}),
)


def loops(form: str, archive: Path) -> Iterator[list[str]]:
    """Yield the innermost loops of counts_avx512() of a form, without addresses and comments."""
    words = ["objdump", "-d", "--no-show-raw-insn", str(archive)]
    text = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    body = text.partition(f"\n{form}.c.o:")[2].partition("<counts_avx512>:\n")[2]
    lines = re.findall(r"^ *([0-9a-f]+):\t([^#<\n]*)", body.partition("\n\n")[0], re.M)
    places = {address: k for k, (address, _) in enumerate(lines)}
    start = 0
    for end, (_, instruction) in enumerate(lines):
        jump = re.match(r"j\w+ +([0-9a-f]+)", instruction)
        first = places.get(jump.group(1), end) if jump else end
        if start <= first < end:
            yield [instruction.strip() for _, instruction in lines[first : end + 1]]
            start = end


def is_kind(loop: list[str], kind: Kind) -> bool:
    found = {word: sum(bool(re.search(word, line)) for line in loop) for word in kind.has}
    return found == kind.has


def expected_cycles(loop: list[str], processor: str) -> float:
    """Return the cycles of one pass. The jump at the end has no target here."""
    words = [MCA, "-march=x86-64", f"-mcpu={processor}", f"-iterations={STEPS}", "-"]
    source = "\n".join(loop[:-1]).replace("0x0(%rip)", "(%rip)")
    text = subprocess.run(words, input=source, capture_output=True, text=True, check=True).stdout
    [cycles] = re.findall(r"^Total Cycles: +(\d+)", text, re.M)
    return int(cycles) / STEPS


def main(archive: Path) -> int:
    if not archive.exists():
        print(f"error: no {archive}: run tools/bench.sh host first", file=sys.stderr)
        return 1
    columns = ("for 64 ticks", "instructions", "on 512 bits", "exchanges of lanes", *PROCESSORS)
    print("| " + " | ".join(columns) + " |")
    print("|---" + "|---:" * (len(columns) - 1) + "|")
    for kind in KINDS:
        matching = (loop for loop in loops(kind.form, archive) if is_kind(loop, kind))
        loop = next(matching, None)
        if loop is None:
            print(f"error: {archive}: no loop '{kind.title}' of {kind.form}.c", file=sys.stderr)
            return 1
        passes, wide = 64 / kind.ticks, sum("%zmm" in line for line in loop)
        exchanges = sum(bool(re.match(EXCHANGE, line)) for line in loop)
        cells = [kind.title, *(f"{passes * count:.0f}" for count in (len(loop), wide, exchanges))]
        for name in PROCESSORS:
            has_mca = shutil.which(MCA)
            cells.append(f"{passes * expected_cycles(loop, name):.0f}" if has_mca else "-")
        print("| " + " | ".join(cells) + " |")
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if sys.argv[1:] else ARCHIVE))
