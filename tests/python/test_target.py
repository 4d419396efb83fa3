# SPDX-License-Identifier: MIT
"""Small cores: the Unity tests in QEMU, what may be linked. What a call costs: test_bench.py."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools" / "bench"))

import target  # noqa: E402

pytestmark = pytest.mark.checks

ARM = [name for name, core in target.CORES.items() if core.tools is target.ARM]
EVERYWHERE = {"bits", "test_accuracy", "test_slip"}  # of what CTest has to run on every core


def need(core: target.Core) -> None:
    for program in (core.tool("gcc"), core.tools[1]):
        if not shutil.which(program):
            pytest.skip(
                f"{program} is not installed (tools/setup.sh installs it where Debian has it)"
            )


# --- the Unity tests on each core ----------------------------------------------------------------


@pytest.fixture(scope="module")
def ran_on(tmp_path_factory):
    """Build one core and run its CTest entries once; the outcome of each by name."""
    known: dict[str, dict[str, ElementTree.Element]] = {}

    def run(name: str) -> dict[str, ElementTree.Element]:
        if name not in known:
            core = target.CORES[name]
            need(core)
            target.build(core, "all")
            junit = tmp_path_factory.mktemp(name) / "ctest.xml"
            command = ["ctest", "--test-dir", core.build, "-L", "target", "-j2"]
            command += ["--output-junit", junit]
            subprocess.run(command, check=False, capture_output=True, timeout=280)
            known[name] = {
                case.get("name"): case for case in ElementTree.parse(junit).iter("testcase")
            }
        return known[name]

    return run


@pytest.mark.parametrize("name", target.CORES)
def test_on_core(name: str, ran_on) -> None:
    """Whatever CTest has for it: the Unity tests, the golden bits; on an Arm core the ticks written
    for it against the C, and, where there is a SysTick, parameters that change under its interrupt.
    """
    outcomes = ran_on(name)
    on_arm = {"test_cores"} if name == "m0" else {"test_cores", "change_parameters"}
    assert outcomes.keys() >= EVERYWHERE | (on_arm if name in ARM else set())
    for case, outcome in outcomes.items():
        said = (outcome.findtext("system-out") or "")[-2000:]
        assert outcome.get("status") == "run" and outcome.find("failure") is None, (case, said)


def test_no_double_load_begins_with_its_address() -> None:
    """Erratum 602117: an early Cortex-M3 that is interrupted in such a load goes on from another
    address. gcc avoids it; what is written by hand has to.
    """
    core = target.CORES["m3"]
    need(core)
    target.build(core, "dahl")
    code = target.run(core.tool("objdump"), "-d", core.build / "lib/libdahl.a")
    loads = re.findall(r"\tldrd\t(\w+), (\w+), \[(\w+)", code)
    assert len(loads) > 10
    assert [load for load in loads if load[0] == load[2]] == []


def test_bits_on_avr() -> None:
    """16-bit int: the same hashes (some minutes; lines count, not the emulator's exit)."""
    for program in ("avr-gcc", "qemu-system-avr"):
        if not shutil.which(program):
            pytest.skip(f"{program} is not installed (tools/setup.sh installs it)")
    target.run("cmake", "--preset", "avr", cwd=ROOT)
    target.run("cmake", "--build", ROOT / "build/avr", cwd=ROOT)
    target.run("ctest", "--test-dir", ROOT / "build/avr", timeout=1200)


def test_a_failing_image_fails(ran_on) -> None:
    """An exit code and a fault on the core reach CTest: an image with neither main's 0 nor a main
    at all.
    """
    core = target.CORES["m3"]
    ran_on("m3")
    for body in ("return 3;", "return *(volatile int *)0xF0000001;"):
        status = subprocess.run(
            emulator(core, plant(core, f"int main(void) {{ {body} }}")), timeout=60, check=False
        )
        assert status.returncode == (3 if "3" in body[:9] else 70)


PORT = ROOT / "port/cortex_m"
PARTS = ("startup", "semihosting", "exit_semihosting", "no_tick", "fpu_none")


def link_command(core: target.Core, board: str, image: Path, main: Path) -> list[object]:
    """gcc's words that make an image for a board out of one file."""
    flags = target.cache_value(core, "CMAKE_C_FLAGS").split()
    command = [core.tool("gcc"), *flags, "-O1", f"-I{PORT}", f"-I{ROOT}/port", "-nostartfiles"]
    command += [f"-L{PORT}", f"-T{PORT}/{board}.ld", "-o", image, main]
    return command + [PORT / f"{part}.c" for part in PARTS]


def plant(core: target.Core, source: str) -> Path:
    """A small image for a core's board, linked as the tests are."""
    folder = core.build / "planted"
    folder.mkdir(exist_ok=True)
    (folder / "main.c").write_text(source + "\n")
    target.run(*link_command(core, core.machine, folder / "image", folder / "main.c"))
    return folder / "image"


def emulator(core: target.Core, image: Path) -> list[str]:
    return [core.tools[1], "-M", core.machine, "-nographic", "-monitor", "none", "-serial", "none",
            "-semihosting-config", "enable=on,target=native", "-kernel", str(image)]  # fmt: skip


@pytest.mark.parametrize(
    "built, board", [("m3", "microbit"), ("m3", "mps2-an386"), ("m0", "mps2-an505")]
)
def test_wrong_board_does_not_link(built: str, board: str, tmp_path) -> None:
    core = target.CORES[built]
    need(core)
    target.build(core, "dahl")
    main = tmp_path / "main.c"
    main.write_text("int main(void) { return 0; }\n")
    command = link_command(core, board, tmp_path / "image", main)
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert f"the core of {board}: configure with -DDAHL_CORE=" in done.stderr


def test_unknown_core_is_refused(tmp_path) -> None:
    toolchain = ROOT / "port/cortex_m/toolchain.cmake"
    command = ["cmake", "-S", ROOT, "-B", tmp_path, "--toolchain", toolchain, "-DDAHL_CORE=m9"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert f"'m9'; known are {', '.join(ARM)}" in done.stderr


# --- what may be linked --------------------------------------------------------------------------


@pytest.mark.parametrize("path", target.PATHS)
@pytest.mark.parametrize("name", target.CORES)
def test_links_nothing_but_integers(name: str, path: str) -> None:
    core = target.CORES[name]
    need(core)
    target.build(core, "dahl")
    image = target.link_path(core, path)
    assert target.forbidden(core, image) == []
    assert target.sizes(core, image)["static"] == 0


# At -O0 gcc copies a structure on Cortex-M0 by memcpy, also in dahl_prepare.
LEVELS = [
    (name, level)
    for name in target.CORES
    for level in ("-O0", "-Os", "-O2", "-O3")
    if (name, level) != ("m0", "-O0")
]


@pytest.mark.parametrize("name, level", LEVELS)
def test_a_bare_link_of_all_parts_needs_no_libc(name: str, level: str) -> None:
    """Nothing but libgcc stands beside the objects: a memcpy that gcc makes is not found."""
    core = target.CORES[name]
    need(core)
    target.build(core, "dahl")
    objects = target.objects_at(core, level)
    assert {"slip.o", "inverse.o"} <= {path.name for path in objects}
    assert target.forbidden(core, target.link_bare(core, *objects)) == []
