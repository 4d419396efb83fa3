# SPDX-License-Identifier: MIT
"""Other machines: golden bits and C tests of library, codec and receiver on a big-endian core
(s390x, with qemu-user) and without extensions of GNU; the batches also in 32 bits and without
128-bit words. (tests/python/library/test_bits.py has the golden bits in 32 bits.)

The accuracy tests do not run there: equal bits have equal errors.
"""

from dataclasses import dataclass
from pathlib import Path

import pytest
import static_tools as static
from conftest import BUILD, ROOT, need
from sources import CORE, PARTS, with_main

CLAIM = "the same bits on a big-endian core, in 32 bits, and without GNU extensions"
UNITY = BUILD.parent / "deps" / "unity"
UNITS = ["lib/test_element_properties", "lib/test_prepare_properties", "lib/test_batch"]
UNITS += ["node/test_frames", "node/test_node"]
WORDS = ["-std=c99", "-O1", "-DUNITY_INCLUDE_DOUBLE", "-DTEST_TICKS=20000", f"-I{UNITY}"]
WORDS += [*static.INCLUDES, f"-I{ROOT}/tests/lib", f"-I{ROOT}/tests/node"]


@dataclass(frozen=True)
class Machine:
    """Compiler and runner of the programs for one machine."""

    compiler: str
    words: tuple[str, ...] = ()
    runner: str = ""

    def compile(self, folder: Path, *words: object) -> None:
        static.clean(need(self.compiler, CLAIM), *self.words, *WORDS, *words, cwd=folder)

    def run(self, folder: Path, main: Path, *files: object) -> tuple[int, str]:
        program = folder / main.stem
        self.compile(folder, "-o", program, main, *files, "-lm")
        runner = [need(self.runner, CLAIM)] if self.runner else []
        return static.call(*runner, program)


S390X = Machine("clang-19", ("--target=s390x-linux-gnu", "-static"), "qemu-s390x-static")
NO_GNU = Machine("clang-19", ("-U__GNUC__",))
OTHERS = [Machine("gcc", ("-m32",)), NO_GNU, Machine("gcc", ("-U__SIZEOF_INT128__",))]


@pytest.mark.parametrize("machine", [S390X, NO_GNU], ids=["big-endian", "no GNU C"])
def test_golden_bits(machine: Machine, tmp_path: Path) -> None:
    need("s390x-linux-gnu-ld", CLAIM)  # a separate package
    golden = (ROOT / "tests/lib/golden_bits.txt").read_text()
    assert machine.run(tmp_path, ROOT / "tests/lib/bits.c", *CORE, *PARTS) == (0, golden)


@pytest.fixture(scope="module")
def big_endian(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The sources of firmware, compiled once. Two folders may have files of one name."""
    need("s390x-linux-gnu-ld", CLAIM)
    folder = tmp_path_factory.mktemp("s390x")
    for place in sorted({path.parent for path in static.FIRMWARE}):
        (folder / place.name).mkdir()
        files = [path for path in static.FIRMWARE if path.parent == place]
        S390X.compile(folder / place.name, "-c", *files)
    return sorted(folder.rglob("*.o"))


def unit(machine: Machine, test: str, folder: Path, *files: Path) -> None:
    main = with_main(ROOT / f"tests/{test}.c", folder)
    status, text = machine.run(folder, main, *files, UNITY / "unity.c")
    assert status == 0 and " 0 Failures " in text, text


@pytest.mark.parametrize("test", UNITS)
def test_units_on_a_big_endian_core(test: str, tmp_path: Path, big_endian: list[Path]) -> None:
    unit(S390X, test, tmp_path, *big_endian)


@pytest.mark.long
@pytest.mark.parametrize("machine", OTHERS, ids=["32 bits", "no GNU C", "no 128-bit words"])
def test_batches_elsewhere(machine: Machine, tmp_path: Path) -> None:
    unit(machine, "lib/test_batch", tmp_path, *static.FIRMWARE)
