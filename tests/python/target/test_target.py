# SPDX-License-Identifier: MIT
"""Small cores: the C tests in QEMU, and the symbols of an image. (Costs: test_bench.py.)"""

import fcntl
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
from conftest import ROOT, need
from programs import run
from sources import CORE, PARTS

pytestmark = pytest.mark.checks

ARM = ("m0", "m3", "m4f", "m7", "m33")
CORES = dict.fromkeys(ARM, "arm-none-eabi-") | {"rv32": "riscv64-unknown-elf-"}
EVERYWHERE = {
    "bits",
    "test_element_properties",
    "commission_axis",
}  # CTest must run these on every core
PORT = ROOT / "port/cortex_m"
START_UP = "startup semihosting exit_semihosting no_tick fpu_none newlib".split()


def tool(core: str, name: str) -> str:
    return need(CORES[core] + name, f"the library on {core}")


def build(core: str, target: str) -> Path:
    """Build a target of a core under a lock, because several tests share the folder."""
    tool(core, "gcc")
    need("qemu-system-arm" if core in ARM else "qemu-system-riscv32", f"the library on {core}")
    folder = ROOT / "build" / core
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        run("cmake", "--preset", core, cwd=ROOT)
        run("cmake", "--build", folder, "--target", target)
    return folder


def flags(folder: Path) -> list[str]:
    cache = (folder / "CMakeCache.txt").read_text()
    return re.search(r"^CMAKE_C_FLAGS:\w+=(.*)$", cache, re.M)[1].split()


# --- the C tests on each core --------------------------------------------------------------------


@pytest.mark.parametrize("core", CORES)
def test_the_c_tests_pass_on_each_core(core: str, tmp_path: Path) -> None:
    """The Unity tests and the golden bits. On an Arm core also the ticks in assembly against the C,
    and, if it has a SysTick, parameters that change in its interrupt.
    """
    folder, junit = build(core, "all"), tmp_path / "ctest.xml"
    words = ["--test-dir", folder, "-L", "target", "-j2", "--output-on-failure"]
    run("ctest", *words, "--output-junit", junit)
    cases = ElementTree.parse(junit).iter("testcase")
    status = {case.get("name"): case.get("status") for case in cases}
    on_arm = {"test_cores"} if core == "m0" else {"test_cores", "change_parameters"}
    assert status.keys() >= EVERYWHERE | (on_arm if core in ARM else set())
    assert set(status.values()) == {"run"}


@pytest.mark.long
@pytest.mark.parametrize("core", ARM)
def test_ticks_in_assembly_have_the_bits_of_the_c_for_1e7_inputs(core: str) -> None:
    folder = build(core, "test_cores_10000000")
    run("ctest", "--test-dir", folder, "-R", "test_cores_10000000", "--no-tests=error")


def test_avr_gives_the_golden_bits() -> None:
    """int has 16 bits. The output decides, not the exit code of the emulator."""
    for program in ("avr-gcc", "qemu-system-avr"):
        need(program, "equal bits with an int of 16 bits")
    run("cmake", "--preset", "avr", cwd=ROOT)
    run("cmake", "--build", ROOT / "build/avr")
    run("ctest", "--test-dir", ROOT / "build/avr", "--no-tests=error")


def test_an_esp32_c3_executes_the_code_of_the_column_rv32imac(tmp_path: Path) -> None:
    """RV32IMC lacks the atomic instructions of RV32IMAC, which the library does not use."""
    texts = []
    for march in ("rv32imac", "rv32imc"):
        (folder := tmp_path / march).mkdir()
        words = [f"-march={march}", "-mabi=ilp32", "--specs=picolibc.specs", "-O2", "-std=c99"]
        units = [path for path in (*CORE, *PARTS) if path.suffix == ".c"]
        run(tool("rv32", "gcc"), *words, f"-I{ROOT}/lib/include", "-c", *units, cwd=folder)
        objects = [path.name for path in sorted(folder.glob("*.o"))]
        texts.append(run(tool("rv32", "objdump"), "-d", *objects, cwd=folder))
    assert texts[0] == texts[1] and "<dahl_step_counts_q30>:" in texts[0]


def test_no_double_load_overwrites_its_address_first() -> None:
    """Erratum 602117: an interrupt in such a load breaks an early Cortex-M3."""
    code = run(tool("m3", "objdump"), "-d", build("m3", "dahl") / "lib/libdahl.a")
    loads = re.findall(r"\tldrd\t(\w+), (\w+), \[(\w+)", code)
    assert len(loads) > 10
    assert [load for load in loads if load[0] == load[2]] == []


def emulate(image: Path, code: int) -> str:
    words = ["-nographic", "-monitor", "none", "-serial", "none"]
    words += ["-semihosting-config", "enable=on,target=native", "-kernel", image]
    command = ["sh", "-c", '"$@" 1>&2', "sh", "qemu-system-arm", "-M", "mps2-an385", *words]
    return run(*command, code=code, timeout=60)


def link(core: str, board: str, main: Path, code: int = 0) -> str:
    words = [*flags(build(core, "dahl")), "-O1", f"-I{PORT}", f"-I{ROOT}/port", "-nostartfiles"]
    words += [f"-L{PORT}", f"-T{PORT}/{board}.ld", "-o", main.with_name("image"), main]
    words += [PORT / f"{part}.c" for part in START_UP]
    return run(tool(core, "gcc"), *words, code=code)


HEAP = """
#include <stddef.h>
extern char heap_start[], heap_end[];
char *_sbrk(ptrdiff_t more);
int main(void)
{
    const ptrdiff_t size = heap_end - heap_start;
    return _sbrk(16) != heap_start || _sbrk(size - 16) != heap_start + 16 ||
           _sbrk(1) != (char *)-1 || _sbrk(-size) != heap_end || _sbrk(0) != heap_start;
}
"""
PRINT = """#include <stdio.h>
int main(void)
{
    int length = printf("%s, %d", "words", 7);
    return fflush(stdout) == 0 ? length : -1;
}
"""
FAULT = "error: fault on the target\n"
IMAGES = {  # main, the exit code of the emulator, its output
    "a code": ("int main(void) { return 3; }\n", 3, ""),
    "a fault": ("int main(void) { return *(volatile int *)0xF0000001; }\n", 70, FAULT),
    "memory after a reset": ((ROOT / "tests/target/start_up.c").read_text(), 0, ""),
    "the whole heap": (HEAP, 0, ""),
    "printed words": (PRINT, 8, "words, 7"),
}


@pytest.mark.parametrize("name", IMAGES)
def test_an_image_ends_the_emulator_with_its_code(name: str, tmp_path: Path) -> None:
    text, code, printed = IMAGES[name]
    (main := tmp_path / "main.c").write_text(text)
    link("m3", "mps2-an385", main)
    assert emulate(tmp_path / "image", code) == printed


@pytest.mark.parametrize(
    ("core", "board"), [("m3", "microbit"), ("m3", "mps2-an386"), ("m0", "mps2-an505")]
)
def test_a_wrong_board_does_not_link(core: str, board: str, tmp_path: Path) -> None:
    (main := tmp_path / "main.c").write_text("int main(void) { return 0; }\n")
    said = link(core, board, main, code=1)
    assert board in said and "-DDAHL_CORE=" in said


def test_an_unknown_core_is_refused(tmp_path: Path) -> None:
    words = ["--toolchain", PORT / "toolchain.cmake", "-DDAHL_CORE=m9"]
    output = run("cmake", "-S", ROOT, "-B", tmp_path, *words, code=1)
    assert "'m9'" in output and all(core in output for core in ARM)


# --- what may be linked --------------------------------------------------------------------------

# Helpers of gcc for integers: division, products, shifts and leading zeros.
INTEGER = re.compile(
    r"(__aeabi_(u?idiv\w*|[ui]?ldiv\w*|l\w+|u?lcmp)|__\w*(div|mod|mul|sh|clz|cmp)\w*[sd]i\d?"
    r"|__clz_tab|__(gnu_)?u?ldivmod\w*|__restore_\w+|__save_\w+|__riscv_\w+)$"
)


def foreign(core: str, image: Path, *ours: Path) -> set[str]:
    """Return the names in an image that are neither in our objects nor of the linker."""

    def names(*files: Path) -> set[str]:
        lines = (line.split() for line in run(tool(core, "nm"), *files).splitlines())
        return {words[2] for words in lines if len(words) == 3 and words[1] not in "aA"}

    linkers = re.compile(r"[$.]|_*(bss|s?data|edata|text_end|end|stack|global_pointer)", re.I)
    return {name for name in names(image) - names(*ours) if not linkers.match(name)}


def bare_link(core: str, image: Path, *words: object) -> None:
    """Link with the helpers of gcc only, so that a memcpy of gcc is not found."""
    common = [*flags(ROOT / "build" / core), "-nostdlib", "-Wl,--gc-sections", "-o", image]
    run(tool(core, "gcc"), *common, *words, "-lgcc")


# At -O0 gcc for Cortex-M0 copies structures with memcpy, also in dahl_prepare.
@pytest.mark.parametrize("level", ("-O0", "-Os", "-O2", "-O3"))
@pytest.mark.parametrize("core", CORES)
def test_a_bare_link_of_all_parts_needs_no_libc(core: str, level: str, tmp_path: Path) -> None:
    if (core, level) == ("m0", "-O0"):
        return
    words = [*flags(build(core, "dahl")), level, "-std=c99", f"-I{ROOT}/lib/include"]
    units = [path for path in (*CORE, *PARTS) if path.parent.name != "cores"]
    run(tool(core, "gcc"), *words, "-c", *units, cwd=tmp_path)
    objects = sorted(tmp_path.glob("*.o"))
    image = tmp_path / "image"
    room = "-Wl,--defsym=__flash_size=0x100000"  # picolibc assumes 64 KiB; -O0 needs more
    bare_link(core, image, room, "-Wl,-e,0", "-Wl,--no-gc-sections", *objects)
    assert {name for name in foreign(core, image, *objects) if not INTEGER.match(name)} == set()
