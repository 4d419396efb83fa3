# SPDX-License-Identifier: MIT
"""tools/setup.sh by Debian packages and by what it fetches: what each need brings, who may install,
sources that do not answer, archives that are not whole. Every program that reaches outside is a
stand-in. (Its Python environment: test_setup_python.py; with a network: tests/quality.)
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import tarfile
import time
from pathlib import Path

import pytest
from conftest import ROOT
from script_stage import APT, UNITY, Debian, codename


@pytest.fixture
def bare(tmp_path: Path) -> Debian:
    return Debian(tmp_path)


def installed(bare: Debian) -> list[str]:
    return bare.lines("installed")


# --- what each need brings -----------------------------------------------------------------------


def test_it_installs_what_is_missing_once_and_then_asks_nobody(bare):
    """Python's packages first, so that pip works while the rest is installed."""
    bare.write("build/setup.log", "of a run before")
    done, started = bare.set_up("demo")
    assert done.returncode == 0, done.stderr
    assert {"cmake", "ninja-build", "python3-venv"} <= set(installed(bare))
    assert len(installed(bare)) == len(set(installed(bare)))
    by_apt = [call for call in started if "apt-get" in call]
    assert all("--no-install-recommends" in call for call in by_apt)
    assert all("DPkg::Lock::Timeout=" in call for call in by_apt)  # of another apt-get at work
    assert by_apt[0].endswith(" python3 python3-venv")
    assert "of a run before" not in bare.lines("build/setup.log")
    assert bare.set_up("demo")[1] == []
    asked = " ".join(bare.calls())
    assert "--print-uris" not in asked and " download " not in asked


OWN = {
    "demo": "libc6-dev cmake ninja-build libinih-dev libcsv-dev libcjson-dev python3-venv",
    "firmware": "gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm",
    "identify": "gcc",
    "test": "gcc g++ git pkg-config valgrind",
    "bench": "gcc-riscv64-unknown-elf picolibc-riscv64-unknown-elf picolibc-arm-none-eabi"
    " qemu-system-misc",
    "": "gcc g++ git pkg-config valgrind",
    "vm": "can-utils qemu-system-x86 busybox-static kmod cpio iproute2",
    "identify firmware": "",
    "checks": "clang gcc-multilib qemu-user-static gcc-avr shellcheck cppcheck frama-c-base"
    " sollya gappa make chromium",
    "all": "",
}


def test_each_need_brings_what_it_stands_on(bare):
    """Debian packages and Python packages of the smaller needs, and its own."""
    has: dict[str, set[str]] = {}
    for need, own in OWN.items():
        bare.write("installed", "dpkg-dev")
        shutil.rmtree(bare.folder / "build", ignore_errors=True)
        done, started = bare.set_up(need)
        assert done.returncode == 0, done.stderr
        has[need] = {*re.findall(r"-r tools/(\S+lock)", " ".join(started)), *installed(bare)}
        assert set(own.split()) <= has[need], need
    assert has["demo"] < has["identify"] < has["test"] < has["checks"] <= has["all"]
    assert has["demo"] < has["firmware"] < has["checks"]
    assert has["demo"] < has["vm"] < has["checks"] and "gcc" not in has["vm"]
    assert has["identify"] | has["firmware"] < has["bench"] <= has["all"]
    assert has["identify firmware"] == has["identify"] | has["firmware"] and has[""] == has["test"]
    assert not {"gcc-arm-none-eabi", "chromium", "clang"} & has["test"]
    assert "gcc" not in has["demo"] and "requirements/checks.lock" not in has["bench"]


@pytest.mark.parametrize(
    ("there", "machine", "compiler"),
    [(True, "x86_64", set()), (False, "x86_64", {"tcc"}), (False, "aarch64", {"gcc"})],
)
def test_the_demo_gets_a_compiler_only_where_there_is_none(bare, there, machine, compiler):
    bare.stand_in("bin/cc", "exit 0" if there else "exit 127")
    bare.stand_in("bin/uname", f"echo {machine}")
    assert bare.set_up("demo")[0].returncode == 0
    assert {"tcc", "gcc"} & {*installed(bare)} == compiler


@pytest.mark.parametrize(
    ("now", "again"), [("tcc version 0.9.27", False), ("gcc version 12.2.0", True)]
)
def test_what_tcc_built_is_built_anew_once_there_is_another(bare, now, again):
    made_by = "build/host/CMakeFiles/3.25.1/CMakeCCompiler.cmake"
    bare.write(made_by, 'set(CMAKE_C_COMPILER_ID "TinyCC")')
    bare.stand_in("bin/cc", f"echo '{now}' >&2")
    assert bare.set_up("identify")[0].returncode == 0
    assert (bare.folder / made_by).exists() != again
    assert any("--preset host" in call for call in bare.calls("cmake")) == again


def test_what_it_may_have_is_tried_once_a_day(bare):
    bare.unknown("valgrind")
    tried = lambda: [call for call in bare.set_up("test")[1] if "valgrind" in call]  # noqa: E731
    first, started = bare.set_up("test")
    assert first.returncode == 0 and any("valgrind" in call for call in started)
    assert len(re.findall(r"skipped: valgrind$", first.stdout, re.M)) == 1
    note = bare.folder / "build/deps/packages.tried"
    for hours, again in ((23, False), (25, True)):
        then = time.time() - hours * 3600
        os.utime(note, (then, then))
        assert bool(tried()) == again
    note.write_text("others\n")
    assert tried()


def test_what_apt_does_not_know_at_all_keeps_nothing_else_away(bare):
    bare.unknown("chromium")
    bare.does("apt-cache", '[ "$2" != chromium ]')
    done, _ = bare.set_up("checks")
    assert done.returncode == 0 and {"cppcheck", "shellcheck", "valgrind"} <= {*installed(bare)}
    assert re.search(r"skipped: chromium$", done.stdout, re.M)


@pytest.mark.parametrize("lacking", [None, "ninja", "csv.h"])
def test_on_another_system_it_says_what_the_build_will_miss(bare, lacking):
    """Without apt-get: programs are looked for, and headers by the compiler."""
    away = {"apt-get", "dpkg-query", "ninja", "cc"}
    (bare.folder / "usr").mkdir()
    for program in Path("/usr/bin").iterdir():
        if program.name not in away:
            (bare.folder / "usr" / program.name).symlink_to(program)
    for name in ("apt-get", "dpkg-query"):
        (bare.folder / "bin" / name).unlink()
    for name in {"ninja", "python3"} - {lacking}:
        bare.stand_in(f"bin/{name}")
    bare.stand_in("bin/cc", f"! grep -qF '<{lacking}>'")
    done, _ = bare.set_up("demo", PATH=f"{bare.folder}/bin:{bare.folder}/usr")
    assert done.returncode == (1 if lacking else 0), done.stderr
    assert re.findall(r"^not found: ([\w.]+)", done.stderr, re.M) == ([lacking] if lacking else [])


# --- rights and sources --------------------------------------------------------------------------


@pytest.mark.parametrize("sudo", [True, False])
def test_who_is_not_root_installs_by_sudo_or_is_told_what_to_install(bare, sudo):
    bare.stand_in("bin/id", "echo 1000")
    bare.does("sudo", '[ "$1" != -n ] || shift; "$@"' if sudo else "exit 1")
    done, started = bare.set_up("demo")
    by_sudo = [call for call in bare.calls("sudo") if " apt-get " in call]
    if sudo:
        assert done.returncode == 0, done.stderr
        assert len(by_sudo) == len(bare.calls("apt-get")) - 1  # one asks for addresses alone
        assert all("DEBIAN_FRONTEND=noninteractive" in call for call in by_sudo)
    else:
        assert done.returncode == 1 and not started and not by_sudo
        named = done.stderr.partition("apt-get install --no-install-recommends ")[2].split()
        assert {"libc6-dev", "cmake", "python3-venv"} <= set(named) and "arm" not in done.stderr


CODENAME = codename()
LIST = f"""deb http://debian {CODENAME} main contrib
deb [signed-by=/key] http://debian {CODENAME}-updates main
# deb http://debian {CODENAME} main
deb-src http://debian {CODENAME} main
deb http://security {CODENAME}-security main
deb http://debian {CODENAME}-backports main
deb http://others stable main
deb http://others {CODENAME} extra
"""


def entry(uri: str, suites: str, components: str) -> str:
    return f"Types: deb\nURIs: {uri}\nSuites: {suites}\nComponents: {components}\n"


ENTRIES = [
    entry("http://debian", f"{CODENAME} {CODENAME}-updates", "main"),
    entry("http://security", f"{CODENAME}-security", "main contrib"),
    entry("http://others", CODENAME, "extra"),
    entry("http://others", "stable", "main"),
]
# A copy of the sources that a call of apt-get is told to use alone.
KEEP = (
    "words=$*; parts=${words##*sourceparts=}; parts=${parts%% *}\n"
    'case "$*" in *sourceparts=*) cp -rT "$parts" "$STAGE/asked" ;; esac\n'
)


def with_sources(bare: Debian) -> None:
    """This machine's sources, as setup.sh reads them, are those above."""
    bare.write("list", LIST)
    bare.write("entries", "\n".join(ENTRIES))
    here = '*/etc/apt/*.sources*) /bin/cat "$STAGE/entries" ;; */etc/apt/*) /bin/cat "$STAGE/list"'
    bare.stand_in("bin/cat", f'case "$*" in {here} ;; *) /bin/cat "$@" ;; esac')


def asked_sources(bare: Debian) -> tuple[list[str], list[dict[str, str]]]:
    """Those of the last call of apt-get that was told them: lines, and enabled entries."""
    blocks = "\n".join(bare.lines("asked/debian.sources")).strip().split("\n\n")
    entries = [dict(line.split(": ", 1) for line in block.splitlines()) for block in blocks]
    return bare.lines("asked/debian.list"), [e for e in entries if e.get("Enabled") != "no"]


@pytest.mark.parametrize("failures", range(4))
def test_a_source_that_fails_is_asked_afresh_and_then_debians_own_alone(bare, failures):
    """From what is known; with fresh lists; from Debian's own sources; then it is an error."""
    with_sources(bare)
    bare.write("installed", "dpkg-dev", "python3", "python3-venv")
    bare.write("left", *["x"] * failures)
    count = 'left="$STAGE/left"; if [ -s "$left" ]; then sed -i 1d "$left"; exit 100; fi'
    bare.does("apt-get", f'{KEEP} case "$*" in *" install "*) {count} ;; esac; {APT}')
    done, _ = bare.set_up("demo")
    calls = [c for c in bare.calls("apt-get", "dpkg") if "--print-uris" not in c]
    kinds = [re.search(r"install|update|configure", call)[0] for call in calls]
    tried = ["install", "configure", "update", "install", "update", "install"]
    assert kinds == tried[: (1, 4, 6, 6)[failures]]
    assert ["sourceparts=" in call for call in calls] == [n > 3 for n in range(len(calls))]
    assert done.returncode == (failures == 3)
    if failures == 3:
        assert re.search(r"^error: .*\bcmake\b", done.stderr, re.M)
        lines, entries = asked_sources(bare)
        assert lines == [LIST.splitlines()[n] for n in (0, 1, 4)]
        assert [one["URIs"] for one in entries] == ["http://debian", "http://security"]


@pytest.mark.parametrize("must", [True, False])
def test_sources_that_cannot_be_reached_are_named_with_what_needs_them(bare, must):
    """An error where something must come from them, a word where it only may."""
    known = set(bare.lines("known")) - {"valgrind"}
    bare.write("installed", *(known - {"g++"} if must else known))
    (bare.folder / f"dists/{codename()}/InRelease").unlink()
    done, started = bare.set_up("test")
    assert done.returncode == int(must)
    lacking = "g++ valgrind" if must else "valgrind"
    shown = done.stderr if must else done.stdout
    assert f": {lacking} build/venv (log: build/setup.log)\n" in shown and "apt-get" in shown
    assert not any("apt-get" in call for call in started) and bool(started) != must
    assert not (bare.folder / "build/deps/packages.tried").exists()
    if not must:
        assert "skipped: valgrind\n" in done.stdout


def test_one_of_several_sources_that_answers_is_enough(bare):
    dead = f"echo \"'file:$STAGE/dists/{codename()}/dead/InRelease' InRelease\""
    bare.does("apt-get", f'case "$*" in *--print-uris*) {dead} ;; esac; {APT}')
    done, _ = bare.set_up("demo")
    assert done.returncode == 0 and "cmake" in installed(bare)


def test_what_apt_does_not_know_is_looked_for_in_fresh_lists(bare):
    bare.does("apt-cache", '[ "$2" != valgrind ] || [ -e "$STAGE/fresh" ]')
    bare.does("apt-get", f'case "$*" in *" update") touch "$STAGE/fresh" ;; esac; {APT}')
    done, _ = bare.set_up("test")
    assert done.returncode == 0 and "valgrind" in installed(bare)


# --- what is fetched -----------------------------------------------------------------------------


def makes_archives(bare: Debian) -> None:
    """apt-get downloads packages; dpkg-deb unpacks a kernel of the modules that are asked for, and
    a CBMC whose loader tells its words.
    """
    script = (ROOT / "tools/setup/fetched.sh").read_text()
    wanted = re.search(r"KERNEL_PARTS=\((.*?)\)", script, re.S)
    files = ["boot/vmlinuz-6.1", "lib/modules/6.1/modules.dep", "boot/config-6.1"]
    files += [f"lib/modules/6.1/kernel/{part}/x.ko" for part in (*wanted[1].split(), "sound")]
    with tarfile.open(bare.folder / "kernel.tar", "w") as archive:
        for name in files:
            archive.add(bare.folder / "note", f"./{name}")
    fetched = "*' download '*) for n in ${words##*' download '}; do touch $n.deb; done ;;"
    bare.does("apt-get", f'{KEEP} case "$*" in {fetched} *) : ;; esac\n{APT}')
    bare.does("apt-cache", 'case "$1" in depends) echo "  Depends: linux-image-6.1-amd64" ;; esac')
    unpack = "d=$3/usr/lib/here; mkdir -p $d/gconv $3/usr/bin $3/usr/share/x; touch $d/x"
    unpack += "; printf '#!/bin/sh\\necho \"$@\"\\n' >$d/ld-linux.so.2; chmod +x $d/ld-linux.so.2"
    kernel = 'cat "$STAGE/kernel.tar"'
    bare.stand_in("bin/dpkg-deb", f'if [ "$1" = -x ]; then {unpack}; else {kernel}; fi')
    bare.stand_in("bin/depmod")
    bare.stand_in("bin/uname", "echo x86_64")
    bare.stand_in("bin/python3", "exit 1")  # which would say that this kernel has CAN


def without_cbmc() -> None:
    if shutil.which("cbmc"):
        pytest.skip("unproven: how CBMC is fetched: this machine has one of its own")


def test_a_kernel_and_cbmc_are_fetched_whole_and_once(bare):
    """CBMC of another Debian, from the same mirror, runs by the loader that came with it; what
    nobody needs of both is left out.
    """
    without_cbmc()
    with_sources(bare)
    makes_archives(bare)
    bare.write("build/deps/kernel.part/old")
    done, _ = bare.set_up("checks")
    assert done.returncode == 0, done.stderr
    deps = bare.folder / "build/deps"
    assert not list(deps.glob("*.part")) and not (deps / "kernel/old").exists()
    assert (deps / "kernel/vmlinuz").stat().st_size > 10
    kept = {path.parent.name for path in deps.glob("kernel/lib/modules/6.1/kernel/**/*.ko")}
    assert {"can", "vcan", "9p", "virtio"} <= kept and "sound" not in kept
    made = deps / "cbmc"
    assert not [*made.glob("usr/lib/here/gconv"), *made.glob("usr/share"), *made.glob("apt")]
    for name in ("cbmc", "goto-cc", "goto-instrument"):
        words = [made / "bin" / name, "a b"]
        said = subprocess.run(words, capture_output=True, text=True, check=True).stdout
        assert said.startswith(f"--library-path {made}/usr/lib/here:{made}/usr/lib ")
        assert said.endswith(f" {made}/usr/bin/{name} a b\n")
    lines, entries = asked_sources(bare)
    assert lines == ["deb http://debian trixie main contrib"]
    assert [(one["URIs"], one["Suites"]) for one in entries] == [("http://debian", "trixie")]
    assert " download " not in " ".join([*bare.set_up("checks")[1], *bare.calls("apt-get")])


@pytest.mark.parametrize(("answers", "tries"), [(True, 1), (False, 0)])
def test_what_cannot_be_fetched_is_not_there_and_not_tried_again_at_once(bare, answers, tries):
    without_cbmc()
    makes_archives(bare)
    bare.does("apt-get", f'case "$*" in *" download "*) exit 100 ;; esac; {APT}')
    bare.write("installed", *bare.lines("known"))
    if not answers:
        (bare.folder / f"dists/{codename()}/InRelease").unlink()
    downloads = []
    for _ in range(2):
        done, _ = bare.set_up("checks")
        assert done.returncode == 0, done.stderr
        assert len(re.findall(r"^setup: (?:kernel|cbmc) is not", done.stdout, re.M)) == 2
        downloads.append(sum(" download linux-image" in c for c in bare.calls("apt-get")))
    assert downloads == [tries, 0]
    assert not (bare.folder / "build/deps/kernel").exists()


@pytest.mark.parametrize("need", ["vm", "checks"])
@pytest.mark.parametrize("machine", ["x86_64", "aarch64"])
def test_a_kernel_is_fetched_only_where_it_can_run(bare, need, machine):
    makes_archives(bare)
    bare.stand_in("bin/uname", f"echo {machine}")
    bare.set_up(need)
    assert (bare.folder / "build/deps/kernel").exists() == (machine == "x86_64")


def pack_unity(bare: Debian, files: Path) -> None:
    """Debian's source package, which apt-get copies to where it is called."""
    with tarfile.open(bare.folder / "source.tar.gz", "w:gz") as archive:
        for name in UNITY:
            archive.add(files / name, f"ntpsec-1.2/tests/unity/{name}")
        archive.add(ROOT / "README.md", "ntpsec-1.2/README")
    copied = '*" source "*) cp "$STAGE/source.tar.gz" ntpsec_1.2.orig.tar.gz ;;'
    bare.does("apt-get", f'case "$*" in {copied} esac; {APT}')


def test_unity_comes_out_of_debians_source_package(bare):
    """Its three files and no more; a file that was changed since is fetched anew."""
    whole, unity = ROOT / "build/deps/unity", bare.folder / "build/deps/unity"
    if not (whole / "unity.c").exists():
        pytest.skip("unproven: how Unity is unpacked: build/deps/unity is not here to pack")
    pack_unity(bare, whole)
    bare.write("build/deps/unity/unity.c", "changed")
    bare.write("build/deps/unity/old")
    done, _ = bare.set_up("test", DAHL_UNITY_DIR="")
    assert done.returncode == 0, done.stderr
    assert {path.name: path.read_bytes() for path in unity.iterdir()} == {
        name: (whole / name).read_bytes() for name in UNITY
    }
    assert not unity.with_name("unity.part").exists()
    private = [call for call in bare.calls("apt-get") if call.endswith((" ntpsec", "-q update"))]
    assert all("sourceparts=build/deps/unity.part/" in call for call in private)
    bare.set_up("test", DAHL_UNITY_DIR="")
    assert not any(call.endswith(" ntpsec") for call in bare.calls("apt-get"))


def test_files_that_are_not_unitys_are_not_used(bare):
    """Without Unity there is no test, so that is an error that says what to do."""
    pack_unity(bare, bare.own_unity)
    done, _ = bare.set_up("test", DAHL_UNITY_DIR="")
    assert done.returncode == 1 and "2.5.1" in done.stderr
    assert done.stderr.count(hashlib.sha256(b"mine").hexdigest()) == 3
    bare.does("apt-get", f'case "$*" in *" source "*) exit 100 ;; esac; {APT}')
    done, _ = bare.set_up("test", DAHL_UNITY_DIR="")
    assert done.returncode == 1 and "DAHL_UNITY_DIR" in done.stderr
    assert not (bare.folder / "build/deps/unity").exists()


@pytest.mark.parametrize("lacking", UNITY)
def test_an_own_unity_is_looked_at(bare, lacking):
    (bare.own_unity / lacking).write_text("")
    done, started = bare.set_up("test")
    assert done.returncode == 1 and not started
    assert f"{bare.own_unity} has no {lacking}\n" in done.stderr
