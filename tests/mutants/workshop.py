# SPDX-License-Identifier: MIT
"""Where mutants are compiled and the tests run on them: a copy of the sources, one shared library
of all that is mutated, and test programs linked to it once, so that only the library is exchanged.

A program counts as a test of a mutant if it reaches, by calls, an object that the mutant changed,
or includes the mutated header (then it is rebuilt with it). It has as much processor time as four
runs on the original; more is an endless loop, and that kills as a failed check and a crash do.

What only a Cortex-M0 compiles is judged by an image for one, in QEMU (`judge_small_core`); what
chooses between sets of instructions by the form that is taken for each (`judge_targets`).
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import re
import resource
import shutil
import signal
import subprocess
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

from mutate import Mutant

ROOT = Path(__file__).resolve().parents[2]
COPIED = ("lib", "port", "host_sim", "tests/lib", "tests/port", "tests/mutants", "tests/target")
CORE = ("prepare", "wide", "counts", "counts_q30", "digits", "angle", "far_angle", "torque")
CORE += ("set_torque", "change_plan", "encoder")
VECTORS = ("batch_channels", "batch_throughput", "batch_throughput_channels")
REST = ("float", "batch", *VECTORS, "batch_throughput_check")
PORT = ("port/frames", "port/slcan/slcan", "port/socketcand/text", "host_sim/node")
UNITS = tuple(f"lib/{name}.c" for name in CORE + REST) + tuple(f"{name}.c" for name in PORT)
CORE_UNITS = frozenset(f"lib/{name}.c" for name in CORE)
WHOLE_CORE = "core.c"  # all of CORE in one, for mutants of headers

FLAGS = ("-std=c99", "-fPIC", "-w", "-Ilib", "-Iport", "-Ihost_sim")
FLAGS += ("-ftrivial-auto-var-init=pattern",)  # what is read unset is the same at each run
UNITY_STOPS = ("-include", "stdlib.h", "-DTEST_PROTECT()=1", "-DTEST_ABORT()=exit(1)")
UNITY_STOPS += ("-DUNITY_INCLUDE_DOUBLE",)
TOO_LONG = 4  # times what the original takes, and
GRACE = 0.3  # seconds more


class WorkshopError(Exception):
    """The workshop itself does not work: the original does not compile or fails a test."""


@dataclass(frozen=True)
class Form:
    """One way to compile the sources. `hints` are what compilers are told that changes no value."""

    name: str
    compiler: str
    flags: tuple[str, ...]
    vector_compiler: str
    vector_flags: tuple[str, ...] = ()

    def command(self, unit: str) -> tuple[str, ...]:
        if Path(unit).stem in VECTORS:
            return (self.vector_compiler, *self.flags, *self.vector_flags)
        return (self.compiler, *self.flags)


# Many objects: the vector files in one form only (no variants for each set of instructions).
ONE_FORM = ("-U__x86_64__", "-ffp-contract=fast", "-fno-math-errno", "-fno-signed-zeros")
AS_BUILT = Form("as built", "gcc", ("-O2",), "clang-19", ONE_FORM)
# Without what the compiler can do better than plain C: neither its functions nor its hints.
PLAIN = Form("plain", "gcc", ("-O2", "-include", "no_gnu.h"), "gcc")
# Undefined behaviour stops the program, as in the tests with sanitizers: what a shift too far does
# by chance on this processor does not count.
# What is read unset is another value than in the form as built.
TRAPS = ("-O1", "-fsanitize=undefined,float-cast-overflow", "-ftrivial-auto-var-init=zero")
CLANG_TRAPS = (*TRAPS, "-fsanitize-trap=all")
CHECKED = Form("checked", "clang-19", CLANG_TRAPS, "clang-19", ("-U__x86_64__",))
GCC_TRAPS = (*TRAPS, "-O2", "-fsanitize-undefined-trap-on-error", "-include", "no_gnu.h")
PLAIN_CHECKED = Form("plain, checked", "gcc", GCC_TRAPS, "gcc")
# Where tests notice nothing, another compiler may show that the mutant means the same.
OTHERS = (
    Form("clang", "clang-19", ("-O2",), "gcc", ("-U__x86_64__", "-O2")),
    Form("gcc -O3", "gcc", ("-O3",), "clang-19", ("-U__x86_64__",)),
)


SMALL_CORE = "lib/multiply_v6m.h"  # only compiled for
CORTEX_M0 = (
    "-mthumb",
    "-mcpu=cortex-m0",
    "-O2",
    "-std=c99",
    "-w",
    "-Ilib",
    "-Iport/cortex_m",
    "-Iport",
)
BARE = ("newlib", "semihosting", "exit_semihosting", "no_tick", "startup", "fpu_none")
LAYOUT = ("-nostartfiles", "-Wl,--no-warn-rwx-segments", "-Lport/cortex_m", "-Tmicrobit.ld")
QEMU = ("-M", "microbit", "-nographic", "-monitor", "none", "-serial", "none")
QEMU += ("-semihosting-config", "enable=on,target=native", "-kernel")
IMAGE_SECONDS = {1000: 2, 100_000: 30}  # for so many ticks of each motion, of processor time


TARGETS = "lib/batch_targets.h"  # compiled as built, with variants
VARIANTS = ("gcc", "-std=c99", "-w", "-Ilib", "-O2", "-ffp-contract=fast", "-no-pie", "-include")
VARIANTS += ("tests/mutants/coverage_cpu.h", "-finstrument-functions", "-c")
ROADS = "tests/mutants/roads.c"


@functools.cache
def features() -> str:
    """Of this processor."""
    info = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    return next((line for line in info.splitlines() if line.startswith("flags")), "")


def takes_every_road() -> bool:
    return {"avx2", "fma", "avx512bw", "avx512dq", "avx512vl"} <= set(features().split())


@dataclass(frozen=True)
class Program:
    """A test program: sources, macros, arguments."""

    name: str
    sources: tuple[str, ...]
    macros: tuple[str, ...] = ()
    arguments: tuple[str, ...] = ()
    quick: bool = False  # tried before the question whether other compilers make the same of it


def unity_test(name: str, *macros: str, quick: bool = False) -> Program:
    return Program(name, (f"tests/{name}.c",), macros, quick=quick)


BUSES = tuple(
    f"port/{n}.c"
    for n in ("loopback/loopback", "socketcan/socketcan", "socketcand/client")
    + ("socketcand/outbox", "socketcand/server")
)
# Quick ones first; the first that fails ends it.
PROGRAMS = (
    Program(
        "golden", ("tests/mutants/golden.c",), arguments=("tests/lib/golden_bits.txt",), quick=True
    ),
    unity_test("port/test_frames", quick=True),
    unity_test("port/test_node", 'TABLE_FILE="host_sim/node.h"', quick=True),
    unity_test("port/test_slcan", quick=True),
    Program(
        "port/test_buses",
        ("tests/port/test_buses.c", *BUSES),
        ("_POSIX_C_SOURCE=200809L",),
        quick=True,
    ),
    unity_test("lib/test_params", quick=True),
    unity_test("lib/test_short_ticks", quick=True),
    Program(
        "as before",
        ("tests/mutants/as_before.c",),
        ("_GNU_SOURCE",),
        ("programs/before.txt",),  # which its run on the original writes
        quick=True,
    ),
    unity_test("lib/test_paper"),
    unity_test("lib/test_laws"),
    Program("port/fuzz_frames", ("tests/port/fuzz_frames.c",), arguments=("50000",)),
    unity_test("lib/test_float", "TEST_TICKS=20000"),
    unity_test(
        "lib/test_hard_cases", "TEST_ZERO_TICKS=1000000", "TEST_TICKS=20000", "TEST_FINEST_BITS=20"
    ),
    unity_test("lib/test_batch", "TEST_TICKS=120000"),
    unity_test("lib/test_angle", "TEST_TICKS=20000", "TEST_KERNEL_STRIDE=20011u"),
    unity_test("lib/test_accuracy", "TEST_TICKS=50000"),
)


def run(*command: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(part) for part in command], cwd=cwd, capture_output=True, text=True, check=False
    )


def must(*command: str | Path, cwd: Path) -> str:
    done = run(*command, cwd=cwd)
    if done.returncode != 0:
        raise WorkshopError(f"{' '.join(map(str, command))}: {done.stderr.strip()[:2000]}")
    return done.stdout


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:20]


def limit_processor(seconds: float) -> None:
    """For the child: SIGPROF ends it after so much processor time."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.setitimer(signal.ITIMER_PROF, seconds)


@dataclass
class Built:
    """Objects of one mutant in one form, by unit; `differs` from the original's."""

    objects: dict[str, Path] = field(default_factory=dict)
    hashes: dict[str, str] = field(default_factory=dict)
    differs: set[str] = field(default_factory=set)

    def key(self) -> str:
        """The same for mutants of which the compiler made the same."""
        return " ".join(f"{unit}:{self.hashes[unit]}" for unit in sorted(self.differs))


@dataclass(frozen=True)
class Fate:
    """What became of a mutant: uncompiled, equal (to the original, says the compiler), killed,
    alive, or proven (alive, and listed as equivalent)."""

    id: str
    kind: str
    form: str = ""
    key: str = ""
    killer: str = ""


class Workshop:
    """One worker's own copy of the sources, its objects and programs."""

    def __init__(self, folder: Path, unity: Path, programs: Iterable[Program] = PROGRAMS) -> None:
        self.folder = folder
        self.unity = unity
        self.programs = list(programs)
        self.quick = [program for program in self.programs if program.quick]
        self.original: dict[tuple[str, str], tuple[Path, str]] = {}
        self.limits: dict[str, float] = {}
        self.includes: dict[str, set[str]] = {}
        self.reached: dict[str, set[str]] = {}
        self.judged: dict[str, Fate] = {}
        self.prepare()

    # ------------------------------------------------------------- at the start

    def prepare(self) -> None:
        """Two copies of the sources, one of which stays as it is."""
        lines = "".join(f'#include "lib/{name}.c"\n' for name in CORE)
        for folder in (self.folder, self.folder / "pristine"):
            for part in COPIED:
                shutil.copytree(ROOT / part, folder / part, dirs_exist_ok=True)
            (folder / WHOLE_CORE).write_text(lines)
            (folder / "no_gnu.h").write_text("#include <math.h>\n#undef __GNUC__\n")
        for unit in (*UNITS, WHOLE_CORE):
            self.includes[unit] = self.read_includes([unit], ())
        self.link(AS_BUILT, Built())
        must("gcc", "-O2", *UNITY_STOPS, "-c", self.unity / "unity.c", cwd=self.folder)
        must("ar", "rc", "libunity.a", "unity.o", cwd=self.folder)

    def make_ready(self, program: Program) -> None:
        """Builds a program when it is first needed, and sees how long the original takes."""
        self.includes[program.name] = self.read_includes(program.sources, program.macros)
        complaint = self.build_program(program, f"programs/{program.name}", pristine=True)
        if complaint:
            raise WorkshopError(f"{program.name}: {complaint}")
        self.reached[program.name] = self.units_reached(program)
        self.link(AS_BUILT, Built())
        self.limits[program.name] = self.measure(program)

    def read_includes(self, sources: Iterable[str], macros: Iterable[str]) -> set[str]:
        defines = [f"-D{macro}" for macro in macros]
        text = must(
            "gcc",
            *FLAGS,
            *defines,
            f"-I{self.unity}",
            *UNITY_STOPS,
            "-MM",
            *sources,
            cwd=self.folder,
        )
        words = text.replace("\\\n", " ").split()
        return {os.path.normpath(word) for word in words if not word.endswith(":")}

    def measure(self, program: Program) -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        if not self.passes(program, f"programs/{program.name}", 600):
            raise WorkshopError(f"{program.name} fails on the original")
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return TOO_LONG * used + GRACE

    # ------------------------------------------------------------- compiling

    def compile_command(self, form: Form, unit: str, to: Path) -> list[str | Path]:
        compiler, *flags = form.command(unit)
        return [compiler, *FLAGS, *flags, "-c", unit, "-o", to]

    def units_of(self, file: str) -> list[str]:
        """What has to be compiled anew when this file changes."""
        units = [unit for unit in UNITS if file in self.includes[unit]]
        if file.endswith(".h") and CORE_UNITS & set(units):
            units = [WHOLE_CORE] + [unit for unit in units if unit not in CORE_UNITS]
        return units

    def compile(self, form: Form, unit: str, built: Built) -> bool:
        """False: it does not compile."""
        path = self.folder / f"{form.name}-{Path(unit).stem}.o"
        if run(*self.compile_command(form, unit, path), cwd=self.folder).returncode != 0:
            return False
        built.objects[unit], built.hashes[unit] = path, digest(path)
        if built.hashes[unit] != self.original_of(form, unit)[1]:
            built.differs.add(unit)
        return True

    def original_of(self, form: Form, unit: str) -> tuple[Path, str]:
        """Object of the original and its hash, compiled once."""
        if (form.name, unit) not in self.original:
            path = self.folder / "original" / form.name / unit.replace("/", "-").replace(".c", ".o")
            path.parent.mkdir(parents=True, exist_ok=True)
            must(*self.compile_command(form, unit, path), cwd=self.folder / "pristine")
            self.original[form.name, unit] = path, digest(path)
        return self.original[form.name, unit]

    def link(self, form: Form, built: Built) -> None:
        left_out = CORE_UNITS if WHOLE_CORE in built.objects else set[str]()
        used = [
            built.objects.get(unit) or self.original_of(form, unit)[0]
            for unit in UNITS
            if unit not in left_out
        ]
        used += [built.objects[WHOLE_CORE]] if WHOLE_CORE in built.objects else []
        must("ld", "-shared", "-o", "libmutant.so", *used, cwd=self.folder)

    @contextlib.contextmanager
    def mutated(self, mutant: Mutant):
        """The sources with one mutant in them."""
        path = self.folder / mutant.file
        source = path.read_bytes()
        path.write_bytes(mutant.apply(source))
        try:
            yield
        finally:
            path.write_bytes(source)

    # ------------------------------------------------------------- programs

    def build_program(self, program: Program, to: str, pristine: bool = False) -> str:
        """What the compiler complains of; empty where it does not."""
        defines = [f"-D{macro}" for macro in program.macros]
        target = self.folder / to
        target.parent.mkdir(parents=True, exist_ok=True)
        done = run(
            "gcc",
            "-O2",
            *FLAGS,
            *defines,
            f"-I{self.unity}",
            *UNITY_STOPS,
            *program.sources,
            f"-L{self.folder}",
            "-lunity",
            "-lmutant",
            "-lm",
            "-o",
            target,
            cwd=self.folder / "pristine" if pristine else self.folder,
        )
        return done.stderr.strip() if done.returncode != 0 else ""

    def passes(self, program: Program, path: str, seconds: float) -> bool:
        try:
            done = subprocess.run(
                [path, *program.arguments],
                cwd=self.folder,
                env={"LD_LIBRARY_PATH": str(self.folder), "PATH": os.defpath},
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                check=False,
                timeout=20 * seconds + 20,  # only where it waits for something that never comes
                preexec_fn=functools.partial(limit_processor, seconds),
            )
        except subprocess.TimeoutExpired:
            return False
        return done.returncode == 0

    def kills(self, program: Program, mutant: Mutant) -> bool:
        """Whether the program notices the mutant, whose library is linked."""
        path = f"programs/{program.name}"
        if mutant.file in self.includes[program.name]:
            path = "programs/rebuilt"
            if self.build_program(program, path):
                return True
        return not self.passes(program, path, self.limits[program.name])

    @functools.cached_property
    def calls(self) -> tuple[dict[str, str], dict[str, set[str]]]:
        """The unit that defines each name, and the names that each unit calls."""
        defined: dict[str, str] = {}
        calls: dict[str, set[str]] = {}
        for unit in UNITS:
            path = self.original_of(AS_BUILT, unit)[0]
            defined |= dict.fromkeys(self.symbols(path, "--defined-only"), unit)
            calls[unit] = self.symbols(path, "--undefined-only")
        return defined, calls

    def units_reached(self, program: Program) -> set[str]:
        """Units that a program reaches by calls."""
        defined, calls = self.calls
        names = self.symbols(self.folder / "programs" / program.name, "--undefined-only")
        units: set[str] = set()
        while names:
            new = {defined[name] for name in names if name in defined} - units
            units |= new
            names = set().union(*(calls[unit] for unit in new))
        return units | ({WHOLE_CORE} if units & CORE_UNITS else set())

    def symbols(self, path: Path, which: str) -> set[str]:
        lines = must("nm", which, path, cwd=self.folder).splitlines()
        return {line.split()[-1].split("@")[0] for line in lines if line.strip()}

    # ------------------------------------------------------------- judging

    def stages(self, file: str) -> list[list[str]]:
        """Units to compile, the small ones of the core first: most mutants die there."""
        units = self.units_of(file)
        core = [unit for unit in units if unit in CORE_UNITS or unit == WHOLE_CORE]
        return [stage for stage in (core, [u for u in units if u not in core]) if stage]

    def judge(self, mutant: Mutant, listed: bool = False) -> Fate:
        """Of one `listed` as equivalent only the quick programs are asked."""
        with self.mutated(mutant):
            fate = self.judge_forms(mutant, listed)
        if fate.kind == "alive" and listed:
            fate = replace(fate, kind="proven")
        return fate

    def judge_forms(self, mutant: Mutant, listed: bool) -> Fate:
        if mutant.file == SMALL_CORE:
            return self.judge_small_core(mutant)
        if mutant.file == TARGETS:
            return self.judge_targets(mutant)
        if mutant.hinted:
            fate = self.judge_forms_of(mutant, PLAIN, PLAIN_CHECKED, listed)
            if fate.kind in ("killed", "alive"):
                return fate
        return self.judge_forms_of(mutant, AS_BUILT, CHECKED, listed)

    def judge_forms_of(self, mutant: Mutant, form: Form, checked: Form, listed: bool) -> Fate:
        """One that is alive is tried again where undefined behaviour stops it."""
        fate = self.judge_form(mutant, form, listed)
        if fate.kind == "alive" and not listed:
            again = self.judge_form(mutant, checked, listed)
            fate = again if again.kind == "killed" else fate
        return fate

    def judge_form(self, mutant: Mutant, form: Form, listed: bool) -> Fate:
        """What is known of the same objects holds again, where no program includes the mutant."""
        built = Built()
        known: list[Fate] = []
        fate = self.judge_stages(mutant, form, built, listed, known)
        if known:
            return replace(known[0], id=mutant.id)
        if fate.key and mutant.file.endswith(".c"):
            self.judged[form.name + fate.key] = fate
        return fate

    def judge_stages(
        self, mutant: Mutant, form: Form, built: Built, listed: bool, known: list[Fate]
    ) -> Fate:
        """Compiled and tried in stages; before the slow programs, what other compilers say."""
        tried = set[str]()
        stages = self.stages(mutant.file)
        for number, stage in enumerate(stages):
            if not all(self.compile(form, unit, built) for unit in stage):
                return Fate(mutant.id, "uncompiled")
            if form.name + built.key() in self.judged:
                known.append(self.judged[form.name + built.key()])
                return known[0]
            later = {unit for left in stages[number + 1 :] for unit in left}
            killer = self.killer(mutant, form, built, self.quick, later, tried)
            if killer:
                return Fate(mutant.id, "killed", form.name, built.key(), killer)
        if not built.differs or (form is AS_BUILT and self.is_equal_elsewhere(mutant, built)):
            return Fate(mutant.id, "equal", form.name)
        programs = self.quick if listed else self.programs
        killer = self.killer(mutant, form, built, programs, set(), tried)
        kind = "killed" if killer else "alive"
        return Fate(mutant.id, kind, form.name, built.key(), killer or "")

    def judge_small_core(self, mutant: Mutant) -> Fate:
        """By the hashes of golden_bits.txt's motions, against those of the original's image."""
        if self.compile_small_core("mutant-m0.o") is False:
            return Fate(mutant.id, "uncompiled")
        key = digest(self.folder / "mutant-m0.o")
        if key == digest(self.small_original / "core.o"):
            return Fate(mutant.id, "equal", "cortex-m0")
        for ticks in IMAGE_SECONDS:
            if self.image_says("mutant-m0.o", ticks) != self.small_bits(ticks):
                return Fate(mutant.id, "killed", "cortex-m0", key, "target/bits")
        if self.is_equal_without_hints():
            return Fate(mutant.id, "equal", "cortex-m0, plain")
        return Fate(mutant.id, "alive", "cortex-m0", key)

    def is_equal_without_hints(self) -> bool:
        """Whether a hint to the compiler is all that differs: without, the objects are the same."""
        hint, hashes = '__asm__("" : "+r"(x))', []
        for folder in (self.folder, self.folder / "pristine"):
            path = folder / "lib/bits.h"
            source = path.read_text()
            path.write_text(source.replace(hint, "((void)(x))"))
            self.compile_small_core(self.folder / "plain-m0.o", folder != self.folder)
            path.write_text(source)
            hashes.append(digest(self.folder / "plain-m0.o"))
        return hint in source and hashes[0] == hashes[1]

    def compile_small_core(self, to: str | Path, pristine: bool = False) -> bool:
        cwd = self.folder / "pristine" if pristine else self.folder
        command = ("arm-none-eabi-gcc", *CORTEX_M0, "-c", WHOLE_CORE, "-o", to)
        return run(*command, cwd=cwd).returncode == 0

    @functools.cached_property
    def small_original(self) -> Path:
        """Objects of what does not change: the original core, the start-up and the programs."""
        folder, compiler = self.folder / "small", ("arm-none-eabi-gcc", *CORTEX_M0)
        folder.mkdir()
        self.compile_small_core(folder / "core.o", pristine=True)
        for name in BARE:
            unit = f"port/cortex_m/{name}.c"
            must(*compiler, "-c", unit, "-o", folder / f"{name}.o", cwd=self.folder / "pristine")
        for ticks in IMAGE_SECONDS:
            to, define = folder / f"bits-{ticks}.o", f"-DBITS_TICKS={ticks}"
            unit = "tests/target/bits.c"
            must(*compiler, define, "-c", unit, "-o", to, cwd=self.folder / "pristine")
        return folder

    @functools.cache  # noqa: B019  (one workshop a process)
    def small_bits(self, ticks: int) -> str:
        said = self.image_says(self.small_original / "core.o", ticks)
        if ticks == max(IMAGE_SECONDS):
            golden = (self.folder / "tests/lib/golden_bits.txt").read_text()
            if said != golden:
                raise WorkshopError("the original's image does not print golden_bits.txt")
        return said

    def image_says(self, core: str | Path, ticks: int) -> str:
        parts = [self.small_original / f"{name}.o" for name in (*BARE, f"bits-{ticks}")]
        command = ("arm-none-eabi-gcc", *CORTEX_M0, *LAYOUT, *parts, core, "-lm", "-o", "image")
        must(*command, cwd=self.folder)
        done = subprocess.run(
            ["qemu-system-arm", *QEMU, "image"],
            cwd=self.folder,
            capture_output=True,
            text=True,
            check=False,
            preexec_fn=functools.partial(limit_processor, IMAGE_SECONDS[ticks]),
        )
        return done.stdout

    def judge_targets(self, mutant: Mutant) -> Fate:
        """By which variant is taken for which features, and what it gives."""
        objects = self.variants(self.folder, "mutant")
        if not objects:
            return Fate(mutant.id, "uncompiled")
        key = " ".join(map(digest, objects))
        if key == " ".join(map(digest, self.variants_original)):
            return Fate(mutant.id, "equal", "variants")
        killed = self.roads(objects) != self.roads_original
        return Fate(mutant.id, "killed" if killed else "alive", "variants", key, "roads" * killed)

    def variants(self, cwd: Path, to: str) -> list[Path]:
        """Objects of the files with variants; none where one does not compile."""
        paths = [self.folder / f"{to}-{name}.o" for name in VECTORS]
        commands = [(*VARIANTS, f"lib/{p.stem.removeprefix(f'{to}-')}.c", "-o", p) for p in paths]
        return paths if all(run(*c, cwd=cwd).returncode == 0 for c in commands) else []

    @functools.cached_property
    def variants_original(self) -> list[Path]:
        return self.variants(self.folder / "pristine", "original")

    @functools.cached_property
    def roads_original(self) -> str:
        said = self.roads(self.variants_original)
        if len(set(re.findall(r"_(avx2|avx512|plain)\b", said))) != 1 + 2 * takes_every_road():
            raise WorkshopError("not every variant is taken")
        return said

    def roads(self, objects: list[Path]) -> str:
        """What roads.c says, with names of variants for their addresses."""
        rest = [f"lib/{name}.c" for name in (*CORE, "batch_throughput_check")]
        command = ("gcc", "-std=c99", "-w", "-Ilib", "-O2", "-no-pie", ROADS, *rest, *objects)
        must(*command, "-lm", "-o", self.folder / "roads", cwd=self.folder / "pristine")
        names = {}
        for line in must("nm", self.folder / "roads", cwd=self.folder).splitlines():
            place, _, name = line.rpartition(" ")
            if re.search(r"_(avx2|avx512|plain)\b", name):
                names[f"{int(place.split()[0], 16):x}"] = name
        done = run(self.folder / "roads", features(), cwd=self.folder)
        words = (names.get(word, word) for word in done.stdout.split(" "))
        known = (word for word in words if not re.fullmatch("[0-9a-f]{6,8}", word))
        return f"{done.returncode} {' '.join(known)}"

    def is_equal_elsewhere(self, mutant: Mutant, built: Built) -> bool:
        """Whether each changed object is the same again by another compiler, or without hints (but
        not where the mutant stands in what only a compiler with hints sees)."""
        open_units = set(built.differs)
        for form in (*OTHERS, *(() if mutant.hinted else (PLAIN,))):
            other = Built()
            failed = {unit for unit in open_units if not self.compile(form, unit, other)}
            open_units &= other.differs | failed
        return not open_units

    def killer(
        self,
        mutant: Mutant,
        form: Form,
        built: Built,
        programs: Iterable[Program],
        later: set[str],
        tried: set[str],
    ) -> str | None:
        """The first program that fails, of those that reach nothing that is compiled later."""
        if not built.differs:
            return None
        self.link(form, built)
        for program in programs:
            if program.name not in self.limits:
                self.make_ready(program)
                self.link(form, built)
            reached = self.reached[program.name]
            concerned = reached & built.differs or mutant.file in self.includes[program.name]
            if program.name in tried or reached & later or not concerned:
                continue
            tried.add(program.name)
            if self.kills(program, mutant):
                return program.name
        return None
