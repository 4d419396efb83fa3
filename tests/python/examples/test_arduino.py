# SPDX-License-Identifier: MIT
"""The Arduino library: its layout, its sketches compiled as the IDE compiles them (avr-gcc,
Debian's arduino-core-avr), and one of them on an emulated Uno.
"""

import math
import re
import subprocess
from concurrent.futures import ThreadPoolExecutor
from itertools import takewhile
from pathlib import Path

import pytest
from conftest import ROOT, need
from firmware_examples import expected_torques
from programs import run

ARDUINO = ROOT / "port/arduino"
CORE = Path("/usr/share/arduino/hardware/arduino/avr")
FLASH, RAM = 32256, 2048  # bytes of an Uno, of flash those that the bootloader leaves
# As platform.txt has it; and Debian's compiler gives C++ no DECIMAL_DIG, which WString.cpp wants.
LAX = ["-fpermissive", "-DDECIMAL_DIG=__DECIMAL_DIG__"]
SKETCHES = sorted(path.stem for path in ARDUINO.glob("examples/*/*.ino"))


@pytest.fixture(scope="module")
def packed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(run(ARDUINO / "pack.sh", tmp_path_factory.mktemp("arduino")).strip())


def test_the_library_has_the_layout_of_arduino(packed: Path) -> None:
    """Revision 1.5 of Arduino's specification with all its fields."""
    fields = dict(
        line.split("=", 1) for line in (packed / "library.properties").read_text().splitlines()
    )
    wanted = "name version author maintainer sentence paragraph category url architectures"
    assert set(wanted.split()) <= set(fields)
    assert (fields["name"], fields["includes"]) == ("dahl", "dahl.hpp")
    assert (packed / "src" / fields["includes"]).exists()
    assert not [one for one in packed.rglob("*") if one.is_symlink()]
    kinds = {one.suffix for one in (packed / "src").rglob("*.*")}
    assert kinds == {".c", ".h", ".hpp", ".S", ".inc"}
    assert (packed / "extras/dahl.dbc").exists()
    public = {path.name for path in (ROOT / "lib/include").glob("*.h")}
    of_hosts = {"dahl_batch.h", "dahl_float.h"}
    assert {path.name for path in packed.glob("src/*.h")} == public - of_hosts
    for folder in ("arith", "commission", "compensator", "model", "node", "parts"):
        sources = {path.name for path in (ROOT / "lib" / folder).glob("*.c")}
        assert {path.name for path in packed.glob(f"src/{folder}/*.c")} == sources
    headers = "".join(path.read_text() for path in packed.glob("src/*.h*"))
    for line in (packed / "keywords.txt").read_text().splitlines():
        word, kind = line.split("\t")
        assert re.search(rf"\b{word}\b", headers) and kind in ("KEYWORD1", "KEYWORD2", "LITERAL1")
    said = run(ARDUINO / "pack.sh", packed.parent, code=2)
    assert said.startswith("error: ") and str(packed) in said


class Sketch:
    """Build a sketch as the IDE does: compile core, library and sketch, link, measure."""

    def __init__(self, packed: Path, folder: Path) -> None:
        self.packed, self.folder = packed, folder
        target = ["-Os", "-flto", "-ffunction-sections", "-fdata-sections", "-mmcu=atmega328p"]
        core = [CORE / "cores/arduino", CORE / "variants/standard"]
        self.flags = [*target, "-DF_CPU=16000000L", "-DARDUINO=10819", "-DARDUINO_ARCH_AVR"]
        self.flags += [f"-I{one}" for one in (*core, packed / "src")]
        self.core = [path for path in sorted(core[0].iterdir()) if path.suffix in (".c", ".cpp")]

    def compiled(self, source: Path, *strict: str) -> Path:
        cxx = source.suffix == ".cpp"
        made = self.folder / f"{source.parent.name}_{source.name}.o"
        own = ["-std=gnu++11", "-fno-exceptions", "-fno-threadsafe-statics"] if cxx else []
        compiler = ["avr-g++" if cxx else "avr-gcc", *(own or ["-std=gnu11"])]
        lax = ["-w", *(LAX if cxx else [])]  # Arduino's own sources
        run(*compiler, *self.flags, *(strict or lax), "-c", source, "-o", made)
        return made

    def linked(self, name: str) -> Path:
        source = self.folder / f"{name}.ino.cpp"
        text = (self.packed / f"examples/{name}/{name}.ino").read_text()
        source.write_text(f"#include <Arduino.h>\n{text}")
        library = sorted(self.packed.glob("src/*/*.[cS]"))
        strict = ["-Wall", "-Wextra", "-Werror"]
        with ThreadPoolExecutor(2) as workers:
            objects = list(workers.map(self.compiled, self.core))
            objects += workers.map(lambda one: self.compiled(one, *strict), [*library, source])
        image = self.folder / f"{name}.elf"
        run("avr-gcc", *self.flags, "-Wl,--gc-sections", *objects, "-lm", "-o", image)
        return image

    def sizes(self, image: Path) -> tuple[int, int]:
        """Bytes of flash, bytes of RAM."""
        text, data, bss = map(int, run("avr-size", image).splitlines()[1].split()[:3])
        return text + data, data + bss


@pytest.fixture
def sketch(packed: Path, tmp_path: Path) -> Sketch:
    claim = "the sketches compile as Arduino's IDE compiles them, and one of them runs"
    for tool in ("avr-gcc", "avr-g++", "qemu-system-avr"):
        need(tool, claim)
    if not CORE.is_dir():
        pytest.skip(f"unproven: {claim}: {CORE} is not here (Debian's arduino-core-avr)")
    return Sketch(packed, tmp_path)


def printed_by(image: Path) -> list[str]:
    """Return what a program prints on the serial line of an emulated Uno, up to `done`."""
    words = ["-M", "uno", "-display", "none", "-monitor", "none", "-serial", "stdio"]
    command = ["qemu-system-avr", *words, "-bios", str(image)]
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE) as emulator:
        lines = (line.decode().strip() for line in iter(emulator.stdout.readline, b""))
        said = [*takewhile(lambda line: line != "done", lines)]
        emulator.kill()
    return said


@pytest.mark.checks
@pytest.mark.parametrize("name", SKETCHES)
def test_a_sketch_fits_an_uno_and_prints_the_torques_of_the_model(sketch: Sketch, name: str):
    """With a quarter of the RAM for the stack, and half of the flash for the product."""
    image = sketch.linked(name)
    flash, ram = sketch.sizes(image)
    assert flash < FLASH / 2 and ram < RAM * 3 / 4
    if name == "Friction":  # the other one needs a shaft
        rows = [line.split() for line in printed_by(image)]
        found = {int(tick): float(torque) for tick, torque in rows}
        assert found == pytest.approx(expected_torques(), abs=2e-7)


def test_the_quadrature_sketch_follows_a_turning_shaft(packed: Path, tmp_path: Path) -> None:
    """On a stand-in for the board: each edge counts, and the torque has the sign of the motion."""
    sketch = packed / "examples/QuadratureEncoder/QuadratureEncoder.ino"
    shaft, program = Path(__file__).with_name("arduino_shaft.cpp"), tmp_path / "shaft"
    library = sorted(packed.glob("src/*/*.[cS]"))
    run("gcc", "-std=c99", "-O1", "-c", f"-I{packed}/src", *library, cwd=tmp_path)
    words = ["-std=c++11", f"-I{packed}/src", f'-DSKETCH="{sketch}"', shaft]
    run("g++", *words, *tmp_path.glob("*.o"), "-o", program)
    rows = [line.split() for line in run(program).splitlines()]
    per_edge = 2.0 / 0.05 * 2 * math.pi / 2000  # sigma0 / Fc, rad
    top = 1 - math.exp(-300 * per_edge)
    assert len(rows) >= 3
    for n, (edges, torque) in enumerate(rows):
        forward = n == 0 or int(edges) > int(rows[n - 1][0])
        back = -1 + (top + 1) * math.exp(-(300 - int(edges)) * per_edge)
        ratio = 1 - math.exp(-int(edges) * per_edge) if forward else back
        assert float(torque) == pytest.approx(0.05 * ratio, abs=2e-6), edges
    assert min(int(edges) for edges, _ in rows) < 0 < max(int(edges) for edges, _ in rows)
