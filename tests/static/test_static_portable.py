# SPDX-License-Identifier: MIT
"""Other machines: golden bits and C tests of library, codec and receiver on a big-endian core
(s390x, with qemu-user) and without extensions of GNU; the batches also in 32 bits and without
128-bit words. (tests/python/library/test_bits.py has the golden bits in 32 bits.)

The accuracy tests do not run there: equal bits have equal errors. The batches run briefly on the
big-endian core, because their own test needs minutes under emulation.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest
import static_tools as static
from conftest import BUILD, ROOT, need
from sources import BATCHES, CORE, EXACT, PARTS, with_main

CLAIM = "the same bits on a big-endian core, in 32 bits, and without GNU extensions"
GOLDEN = ROOT / "tests/lib/golden_bits.txt"
UNITY = BUILD.parent / "deps" / "unity"
UNITS = ["lib/test_laws", "lib/test_params", "node/test_frames", "node/test_node"]
UNITS += ["lib/test_slip"]
WORDS = ["-std=c99", "-O1", "-DUNITY_INCLUDE_DOUBLE", f"-I{UNITY}", *static.INCLUDES]
WORDS += [f"-I{ROOT}/tests/lib", f"-I{ROOT}/tests/node"]


@dataclass(frozen=True)
class Machine:
    """Compiler and runner of the programs for one machine."""

    compiler: str
    words: tuple[str, ...] = ()
    runner: str = ""

    def build(self, folder: Path, main: Path, sources: list[Path]) -> Path:
        made = folder / main.stem
        tool = need(self.compiler, CLAIM)
        command = [tool, *self.words, *WORDS, "-o", made, main, *sources, "-lm"]
        status, text = static.call(*command, cwd=folder)
        assert status == 0, text
        return made

    def run(self, program: Path, *words: str) -> tuple[int, str]:
        runner = [need(self.runner, CLAIM)] if self.runner else []
        return static.call(*runner, program, *words)


S390X = Machine("clang-19", ("--target=s390x-linux-gnu", "-static"), "qemu-s390x-static")
MACHINES = {
    "big-endian": S390X,
    "32 bits": Machine("gcc", ("-m32",)),
    "no GNU C": Machine("clang-19", ("-U__GNUC__",)),
    "no 128-bit words": Machine("gcc", ("-U__SIZEOF_INT128__",)),
}


@pytest.fixture(scope="module", autouse=True)
def s390x_is_here() -> None:
    """Its linker and C library are separate packages."""
    need("s390x-linux-gnu-ld", CLAIM)


@pytest.mark.parametrize("name", ["big-endian", "no GNU C"])
def test_golden_bits(name: str, tmp_path: Path) -> None:
    machine = MACHINES[name]
    program = machine.build(tmp_path, ROOT / "tests/lib/bits.c", CORE + PARTS)
    assert machine.run(program) == (0, GOLDEN.read_text())


def unit(machine: Machine, test: str, folder: Path, sources: list[Path]) -> tuple[int, str]:
    main = with_main(ROOT / f"tests/{test}.c", folder)
    return machine.run(machine.build(folder, main, [*sources, UNITY / "unity.c"]))


@pytest.fixture(scope="module")
def big_endian(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The sources of firmware, compiled once."""
    folder = tmp_path_factory.mktemp("s390x")
    words = [*S390X.words, *WORDS]
    needed = [path for path in static.FIRMWARE if path not in BATCHES]
    static.clean(need(S390X.compiler, CLAIM), *words, "-c", *needed, cwd=folder)
    return sorted(folder.glob("*.o"))


@pytest.mark.parametrize("test", UNITS)
def test_units_on_a_big_endian_core(test: str, tmp_path: Path, big_endian: list[Path]) -> None:
    status, text = unit(S390X, test, tmp_path, big_endian)
    assert status == 0 and " 0 Failures " in text, text


def test_batches_on_a_big_endian_core(tmp_path: Path) -> None:
    program = S390X.build(tmp_path, Path(__file__).parent / "batch_bits.c", EXACT)
    assert S390X.run(program) == (0, "0 differ\n")


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(MACHINES.keys() - {"big-endian"}))
def test_batches_elsewhere(name: str, tmp_path: Path) -> None:
    status, text = unit(MACHINES[name], "lib/test_batch", tmp_path, static.FIRMWARE)
    assert status == 0 and " 0 Failures " in text, text
