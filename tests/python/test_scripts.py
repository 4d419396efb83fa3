# SPDX-License-Identifier: MIT
"""What the scripts of tools/ start, with which words and in which order, and how they end: in a
folder of their own, where every program that they call only notes how it was called.
"""

from __future__ import annotations

import itertools
import os
import re
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from dahl import bus
from loop_tools import wait_until

# Stands for a program: notes its words, then does what the test said that it does.
NOTE = """#!/bin/bash
name=$(basename "$0")
echo "$name $*" >>"$STAGE/calls"
[ ! -e "$STAGE/$name.does" ] || . "$STAGE/$name.does"
"""
PROGRAMS = (
    "bin/cmake",
    "bin/ctest",
    "tools/setup.sh",
    "build/venv/bin/python",
    "build/venv/bin/dahl",
)


class Stage:
    """The folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "note").write_text(NOTE)
        (folder / "note").chmod(0o755)

    def stand_in(self, name: str, does: str = "") -> None:
        """For the program at this place in the folder."""
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.unlink(missing_ok=True)
        path.symlink_to(self.folder / "note")
        self.does(path.name, does)

    def does(self, name: str, words: str) -> None:
        (self.folder / f"{name}.does").write_text(words + "\n")

    def run(self, script: str, *words: str, **variables: str) -> subprocess.CompletedProcess:
        path = f"{self.folder}/bin:{os.environ['PATH']}"
        return subprocess.run(
            [self.folder / "tools" / f"{script}.sh", *words],
            env={**os.environ, "STAGE": str(self.folder), "PATH": path, **variables},
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
            stdin=subprocess.DEVNULL,
        )

    def calls(self, *programs: str) -> list[str]:
        """Of these programs, of all if none is named, in order; paths begin at the folder."""
        noted = self.folder / "calls"
        lines = (
            noted.read_text().replace(f"{self.folder}/", "").splitlines() if noted.exists() else []
        )
        return [line for line in lines if not programs or line.split()[0] in programs]


def staged(root: Path, folder: Path) -> Stage:
    shutil.copytree(root / "tools", folder / "tools")
    shutil.copy(root / "pyproject.toml", folder)
    made = Stage(folder)
    for name in PROGRAMS:
        made.stand_in(name)
    return made


@pytest.fixture
def stage(root: Path, tmp_path: Path) -> Stage:
    return staged(root, tmp_path)


# --- tools/common.sh -----------------------------------------------------------------------------


@pytest.mark.parametrize("cdpath", ["", ".", "elsewhere:."])
def test_the_root_is_one_line_wherever_cd_looks(stage, cdpath):
    """With CDPATH exported, cd prints where it went, or goes to another folder of that name."""
    (stage.folder / "elsewhere/tools").mkdir(parents=True)
    done = subprocess.run(
        ["bash", "-c", '. tools/common.sh && printf "%s" "$ROOT"'],
        cwd=stage.folder,
        env={**os.environ, "CDPATH": cdpath},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.stdout, done.stderr) == (str(stage.folder), "")


# --- tools/demo.sh -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "need"),
    [
        ((), "demo"),
        (("--scene", "steering"), "demo"),
        (("--target", "m4f"), "firmware"),
        (("a log.csv", "--target=m0"), "firmware"),
    ],
)
def test_the_demo_gets_what_it_needs_builds_and_starts(stage, words, need):
    """Its exit code is the demo's; nobody builds while it does, and while it runs others may. A
    new build folder wants no Unity, one that is there keeps its tests.
    """
    stage.does("cmake", 'flock -n "$STAGE/build/build.lock" true && touch "$STAGE/unlocked"; true')
    free = 'flock -n "$STAGE/build/build.lock" true && exit 3'
    stage.does("dahl", f'printf "%s\\n" "$@" >"$STAGE/words"; {free}')
    assert stage.run("demo", *words).returncode == 3
    first, *built, last = stage.calls()
    assert (first, last.split()[:2]) == (f"setup.sh {need}", ["dahl", "demo"])
    build = "cmake --build build/host --target dahl-loop dahl_shared"
    assert built == ["cmake --preset host -DDAHL_BUILD_TESTS=OFF", build]
    assert not (stage.folder / "unlocked").exists()
    assert (stage.folder / "words").read_text().splitlines() == ["demo", *words]
    (stage.folder / "build/host").mkdir()
    (stage.folder / "build/host/build.ninja").touch()
    stage.run("demo", *words)
    assert stage.calls("cmake")[2:] == [build]


@pytest.mark.parametrize("script", ["demo", "test"])
@pytest.mark.parametrize("failing", ["setup.sh", "cmake"])
def test_what_fails_first_ends_it_and_is_shown(stage, script, failing):
    stage.does(failing, "echo why; exit 1")
    done = stage.run(script)
    assert done.returncode == 1
    assert "why" in (done.stderr if failing == "cmake" else done.stdout)
    assert stage.calls()[-1].split()[0] == failing


# --- tools/test.sh -------------------------------------------------------------------------------


def chosen_labels(call: str) -> set[str]:
    """Labels of the tests that a call of ctest runs; "" stands for a test without one."""
    words = call.split()
    excluded = words[words.index("--label-exclude") + 1] if "--label-exclude" in words else "^$a"
    included = words[words.index("--label-regex") + 1] if "--label-regex" in words else ""
    every = ("", "checks", "long", "soak")
    return {x for x in every if re.search(included, x) and not re.search(excluded, x)}


@pytest.mark.parametrize(
    ("mode", "need", "labels"),
    [
        ("", "test", {""}),
        ("--checks", "checks", {"", "checks"}),
        ("--full", "checks", {"", "checks", "long"}),
        ("--long", "checks", {"", "checks", "long"}),
        ("--soak", "checks", {"soak"}),
    ],
)
def test_each_mode_runs_its_tests(stage, mode, need, labels):
    """While others may build."""
    stage.does("ctest", 'flock -n "$STAGE/build/build.lock" true || touch "$STAGE/locked"')
    assert stage.run("test", *mode.split()).returncode == 0
    assert stage.calls()[0] == f"setup.sh {need}"
    assert "-DDAHL_BUILD_TESTS=ON" in " ".join(stage.calls("cmake"))
    [ctest] = stage.calls("ctest")
    assert not (stage.folder / "locked").exists()
    assert chosen_labels(ctest) == labels
    runs = [call for call in stage.calls("python") if "-m pytest" in call]
    folders = {folder for call in runs for folder in re.findall(r" tests/(\w+)(?= )", call)}
    assert folders == {"python"} | ({"proof", "fuzz", "static", "quality"} if mode else set())
    assert all(mode in call.split() for call in runs if mode)
    count = stage.calls("python")[-1]
    assert ("--note not run: " in count) == (not mode)


def test_words_of_the_user_reach_both_kinds_of_tests(stage):
    stage.run("test", "-k", "codec", "-x")
    assert "-R codec" in stage.calls("ctest")[0]
    assert stage.calls("python")[0].endswith("-k codec -x")
    note = 'case "$*" in *"-m pytest"*) printf "%s\\n" "$@" >"$STAGE/words" ;; esac'
    stage.does("python", note)
    stage.run("test", "-k", "slip or parallel")
    assert stage.calls("ctest")[-1].endswith("-R slip|parallel")  # a regular expression there
    assert (stage.folder / "words").read_text().splitlines()[-2:] == ["-k", "slip or parallel"]
    assert stage.run("test", "-k").returncode == 1
    (stage.folder / "calls").unlink()
    for mode, labels in (("--checks", {"", "checks"}), ("--soak", {"soak"})):
        stage.run("test", "-k", "codec", mode)
        runs = [call for call in stage.calls("python") if f"-k codec {mode}" in call]
        assert len(runs) == 2
        ctest = stage.calls("ctest")[-1]
        assert "-R codec" in ctest and chosen_labels(ctest) == labels


def test_a_build_that_fails_shows_the_end_of_its_own_log(stage):
    """15 lines of it; the log is that of this run alone, and holds all."""
    stage.does("cmake", "echo of the first run")
    stage.run("demo")
    stage.does("cmake", "for n in $(seq 40); do echo line $n; done; exit 1")
    done = stage.run("demo")
    shown = done.stderr.splitlines()
    assert shown[:-1] == [f"line {n}" for n in range(26, 41)]
    assert shown[-1] == "error: cmake could not configure; see build/build.log"
    log = (stage.folder / "build/build.log").read_text().splitlines()
    assert log == [f"line {n}" for n in range(1, 41)]


def test_all_run_whatever_fails_and_each_code_is_counted(stage):
    """Results of an earlier run do not count; the exit code is that of the count."""
    (stage.folder / "build/python.xml").write_text("old")
    stage.does("ctest", "exit 8")
    codes = "*tests/python*) exit 1 ;; *tests/proof*) exit 4 ;; *count_tests*) exit 7 ;;"
    stage.does("python", f'case "$*" in {codes} esac')
    assert stage.run("test", "--checks").returncode == 7
    runs = re.findall(r"build/(\w+\.xml=\d+)", stage.calls("python")[-1])
    assert sorted(runs) == ["checks.xml=4", "ctest.xml=8", "python.xml=1"]
    assert not (stage.folder / "build/python.xml").exists()


def test_a_run_that_is_ended_ends_its_checks(stage):
    """They run beside it, in a process group of their own."""
    beside = '*tests/proof*) echo $$ >"$STAGE/beside"; exec sleep 50 ;;'
    ended = '*tests/python*) until [ -s "$STAGE/beside" ]; do sleep 0.1; done; kill "$PPID" ;;'
    stage.does("python", f'case "$*" in {beside} {ended} esac')
    assert stage.run("test", "--checks").returncode != 0
    process = Path("/proc") / (stage.folder / "beside").read_text().strip() / "cmdline"
    wait_until(lambda: not process.exists() or b"sleep" not in process.read_bytes())


def test_an_own_unity_is_built_with(stage):
    stage.run("test", DAHL_UNITY_DIR="/my unity")
    assert "-DDAHL_UNITY_DIR=/my unity" in " ".join(stage.calls("cmake"))


# --- tools/bench.sh ------------------------------------------------------------------------------

TARGET, HOST, REPORT = (f"python tools/bench/{name}.py" for name in ("target", "host", "report"))


@pytest.mark.parametrize(
    ("words", "started"),
    [
        ("", [TARGET, HOST, f"{REPORT} --docs"]),
        ("--quick", [f"{TARGET} --quick", f"{HOST} --quick", REPORT]),
        ("target", [TARGET]),
        ("target --quick m0 m3", [f"{TARGET} --quick m0 m3"]),
        ("host", [HOST]),
        ("host --quick", [f"{HOST} --quick"]),
        ("report", [REPORT]),
        ("docs", [f"{REPORT} --docs"]),
    ],
)
def test_each_command_of_the_bench_and_its_words(stage, words, started):
    assert stage.run("bench", *words.split()).returncode == 0
    assert stage.calls()[0] == "setup.sh bench"
    assert [call for call in stage.calls("python") if ".py" in call] == started


@pytest.mark.parametrize("code", [0, 1])
def test_rivals_are_installed_once_and_stop_nothing(stage, code):
    """What could not be had is asked for again with the next run; so is what has other pins."""
    venv = '"-m venv "*) mkdir -p "$3/bin" && ln -s "$STAGE/note" "$3/bin/python" ;;'
    stage.does("python", f'case "$*" in {venv} *" install "*) exit {code} ;; esac')
    pins, asked = stage.folder / "tools/requirements/rivals.lock", []
    for more in ("", "", "# other\n"):
        pins.write_text(pins.read_text() + more)
        done = stage.run("bench", "host")
        assert done.returncode == 0 and ("could not; see" in done.stdout) == bool(code)
        assert HOST in stage.calls("python")[-1]
        asked.append(sum("--require-hashes -r tools/" in call for call in stage.calls("python")))
    assert asked == ([1, 2, 3] if code else [1, 1, 2])


# --- tools/lock.sh -------------------------------------------------------------------------------


def test_each_lock_stands_on_those_before_it(stage):
    """In their versions, and without their packages."""
    made = 'mkdir -p "$4/bin"; for name in python uv; do ln -s "$STAGE/note" "$4/bin/$name"; done'
    stage.stand_in("bin/python3", made)
    assert stage.run("lock", "--upgrade").returncode == 0
    on = {
        re.search(r" (\w+)\.txt -o \1\.lock$", call)[1]: re.findall(r"-c (\w+)\.lock", call)
        for call in stage.calls("uv")
    }
    assert on == {
        "demo": [],
        "identify": ["demo"],
        "test": ["demo", "identify"],
        "checks": ["demo", "identify", "test"],
        "rivals": [],
    }
    for call in stage.calls("uv"):
        assert "--generate-hashes" in call and "--upgrade" in call
        assert "--universal --python-version 3.11 " in call  # the oldest that setup.sh takes
        assert ("--no-emit-package=numpy" in call) == ("-c demo.lock" in call)


# --- tools/vm.sh ---------------------------------------------------------------------------------


@pytest.fixture
def machine(stage, tmp_path) -> Path:
    """A folder for tools/vm.sh, with an emulator that runs the machine's command here."""
    folder = tmp_path / "work"
    folder.mkdir()
    (stage.folder / "build/deps/kernel/lib/modules/6.1").mkdir(parents=True)
    (stage.folder / "build/deps/kernel/vmlinuz").write_text("kernel")
    for name in ("busybox", "ip", "modprobe", "qemu-system-x86_64"):
        stage.stand_in(f"bin/{name}")
    stage.stand_in("bin/cpio", "cat >/dev/null")
    there = f'sed "/^export/d" {folder}/.vm/command | bash >{folder}/.vm/output 2>&1'
    stage.does("qemu-system-x86_64", f"{there}; echo $? >{folder}/.vm/code")
    return folder


def test_the_machine_has_two_buses_and_runs_the_words_as_they_are(stage, machine):
    words = ("bash", "-c", 'pwd; printf "<%s>" "$@"; exit 9', "x", "a b", "$HOME", "")
    done = stage.run("vm", str(machine), *words)
    assert done.stdout == f"{machine}\n<a b><$HOME><>"
    assert done.returncode == 9
    for name in ("vcan0", "vcan1"):
        assert f"ip link add dev {name} type vcan" in stage.calls("ip")
        assert f"ip link set {name} up" in stage.calls("ip")


def test_a_machine_that_does_not_run_is_an_error(stage, machine):
    stage.does("qemu-system-x86_64", "exec sleep 90")
    (machine / ".vm").mkdir()
    (machine / ".vm/code").write_text("0\n")  # of a run before
    done = stage.run("vm", str(machine), "true", DAHL_VM_SECONDS="1")
    assert done.returncode == 1
    assert done.stderr.endswith("error: the machine did not run\n")


def test_a_folder_with_a_comma_is_one_value_of_an_option(stage, machine):
    folder = machine.rename(machine.with_name("a,b,c"))
    stage.run("vm", str(folder), "true")
    (call,) = stage.calls("qemu-system-x86_64")
    assert "local,path=a,,b,,c,mount_tag=work," in call
    assert "-serial file:a,b,c/.vm/console" in call


def test_without_a_kernel_there_is_no_machine(stage, machine):
    (stage.folder / "build/deps/kernel/vmlinuz").unlink()
    assert stage.run("vm", str(machine), "true").returncode == 77
    assert stage.run("vm", "relative", "true").returncode == 1
    assert stage.run("vm", str(machine)).returncode == 1


# --- tools/setup.sh, on a Debian that has nothing yet --------------------------------------------

# Packages are what the file `installed` names; apt-get adds to it what the file `known` names.
APT = """case "$*" in
    *--print-uris*)
        . /etc/os-release
        echo "'file:$STAGE/dists/$VERSION_CODENAME/InRelease' InRelease" ;;
    *" install "*)
        words=$*
        for word in ${words##* install }; do
            [[ "$word" != -* ]] || continue
            grep -qx "$word" "$STAGE/known" || exit 100
            echo "$word"
        done >"$STAGE/more" && cat "$STAGE/more" >>"$STAGE/installed" ;;
esac"""
DPKG = """sed 's/^/installed /' "$STAGE/installed" """
PYTHON = """case "$*" in
    *"-m venv "*) mkdir -p "$3/bin"; ln -s "$STAGE/note" "$3/bin/python" ;;
    *check_venv*) exit "$(cat "$STAGE/state")" ;;
esac"""


def bared(stage: Stage, root: Path) -> Stage:
    """Nothing is installed; what setup.sh needs is known to apt-get."""
    if not Path("/usr/lib/apt/apt-helper").exists():
        pytest.skip("this is no Debian: apt-helper is not here")
    (stage.folder / "tools/setup.sh").unlink()
    shutil.copy(root / "tools/setup.sh", stage.folder / "tools/setup.sh")
    shutil.rmtree(stage.folder / "build/venv")
    names = (stage.folder / "tools/setup/needs.sh").read_text()
    for file, text in {
        "known": "\n".join(re.findall(r"[a-z0-9][\w+.-]+", names)),
        "installed": "dpkg-dev\n",
        "state": "0",
    }.items():
        (stage.folder / file).write_text(text + "\n")
    (stage.folder / "unity").mkdir()
    for file in ("unity.c", "unity.h", "unity_internals.h"):
        (stage.folder / "unity" / file).write_text("mine")
    codename = re.search(r"^VERSION_CODENAME=(.*)", Path("/etc/os-release").read_text(), re.M)
    lists = stage.folder / "dists" / codename[1]
    lists.mkdir(parents=True)
    (lists / "InRelease").touch()
    stage.stand_in("bin/apt-get", APT)
    stage.stand_in("bin/dpkg-query", DPKG)
    stage.stand_in("bin/python3.11", PYTHON)
    stage.does("python", PYTHON)
    stage.stand_in("bin/sudo", '"$@"')
    for name in ("apt-cache", "dpkg", "sleep"):
        stage.stand_in(f"bin/{name}")
    return stage


@pytest.fixture
def bare(stage, root) -> Iterator[Stage]:
    """Afterwards: pip was a module of Python, and each setting of apt-get stood behind its -o."""
    yield bared(stage, root)
    for call in stage.calls("apt-get", "python", "python3.11"):
        words = ["", *call.split()]
        for before, word in itertools.pairwise(words):
            assert (word == "pip") <= (before == "-m") and ("::" in word) <= (before == "-o"), call


def set_up(stage: Stage, need: str) -> tuple[subprocess.CompletedProcess, list[str]]:
    """The run, and what it started that installs something."""
    (stage.folder / "calls").unlink(missing_ok=True)
    own = str(stage.folder / "unity")
    done = stage.run("setup", need, DAHL_UNITY_DIR=own, DAHL_PYTHON="")
    started = stage.calls("apt-get", "python3.11", "python")
    return done, [call for call in started if re.search(r" install | venv ", call)]


def test_it_installs_what_is_missing_once(bare):
    done, started = set_up(bare, "demo")
    assert done.returncode == 0, done.stderr
    installed = (bare.folder / "installed").read_text().split()
    assert {"cmake", "ninja-build", "python3-venv"} <= set(installed)
    assert len(installed) == len(set(installed))
    assert all("--no-install-recommends" in call for call in started if "apt-get" in call)
    assert sum("-m venv" in call for call in started) == 1
    first = next(call for call in started if "apt-get" in call)
    assert first.endswith(" python3 python3-venv")  # pip works while the rest is installed
    assert set_up(bare, "demo")[1] == []


def test_each_need_brings_what_it_stands_on(bare):
    """Debian packages and Python packages of the smaller needs, and its own."""
    has: dict[str, set[str]] = {}
    for need in ("demo", "identify", "firmware", "test", "checks", "bench", "all"):
        (bare.folder / "installed").write_text("dpkg-dev\n")
        shutil.rmtree(bare.folder / "build", ignore_errors=True)
        done, started = set_up(bare, need)
        assert done.returncode == 0, done.stderr
        locks = re.findall(r"-r tools/(\S+lock)", " ".join(started))
        has[need] = {*locks, *(bare.folder / "installed").read_text().split()}
    assert has["demo"] < has["identify"] < has["test"] < has["checks"] <= has["all"]
    assert has["demo"] < has["firmware"] < has["checks"]
    assert has["identify"] | has["firmware"] < has["bench"] <= has["all"]
    assert "requirements/checks.lock" not in has["bench"]
    own = {
        "demo": "libc6-dev cmake ninja-build libinih-dev libcsv-dev libcjson-dev python3-venv",
        "firmware": "gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm",
        "identify": "gcc",
        "test": "gcc g++ git pkg-config valgrind",
        "bench": "gcc-riscv64-unknown-elf picolibc-riscv64-unknown-elf picolibc-arm-none-eabi"
        " qemu-system-misc",
        "checks": "clang gcc-multilib qemu-user-static gcc-avr shellcheck cppcheck frama-c-base"
        " sollya gappa make chromium qemu-system-x86 busybox-static kmod cpio iproute2",
    }
    for need, packages in own.items():
        assert set(packages.split()) <= has[need], need
    assert not {"gcc-arm-none-eabi", "chromium", "clang"} & has["test"]
    assert "gcc" not in has["demo"]


@pytest.mark.parametrize("machine, compiler", [("x86_64", "tcc"), ("aarch64", "gcc")])
def test_the_demo_takes_any_compiler_and_a_small_one_where_there_is_none(bare, machine, compiler):
    for there in (True, False):
        bare.stand_in("bin/cc", "exit 0" if there else "exit 127")
        bare.stand_in("bin/uname", f"echo {machine}")
        done, _ = set_up(bare, "demo")
        installed = (bare.folder / "installed").read_text().split()
        assert done.returncode == 0 and {"tcc", "gcc"} & {*installed} == {compiler} - {
            there and compiler
        }


@pytest.mark.parametrize(
    "now, again", [("tcc version 0.9.27", False), ("gcc version 12.2.0", True)]
)
def test_what_tcc_built_is_built_anew_once_there_is_another(bare, now, again):
    made_by = bare.folder / "build/host/CMakeFiles/3.25.1/CMakeCCompiler.cmake"
    made_by.parent.mkdir(parents=True)
    made_by.write_text('set(CMAKE_C_COMPILER_ID "TinyCC")\n')
    bare.stand_in("bin/cc", f"echo '{now}' >&2")
    assert set_up(bare, "identify")[0].returncode == 0
    assert made_by.exists() != again
    assert any("--preset host" in call for call in bare.calls("cmake")) == again


@pytest.mark.parametrize("what", ["cmake", "pip", "python"])
def test_what_it_must_have_and_cannot_get_is_an_error(bare, what):
    if what == "cmake":
        known = (bare.folder / "known").read_text()
        (bare.folder / "known").write_text(known.replace("\ncmake\n", "\n"))
    else:
        name = {"pip": "python", "python": "python3.11"}[what]
        bare.does(name, f'case "$*" in *" install "*|*"-m venv"*) exit 1 ;; esac; {PYTHON}')
    done, started = set_up(bare, "demo")
    assert done.returncode == 1
    assert "error: " in done.stderr
    if what == "pip":
        assert sum("--require-hashes" in call for call in started) == 3
    assert set_up(bare, "demo")[0].returncode == 1


def test_what_it_may_have_is_tried_once_a_day(bare):
    known = (bare.folder / "known").read_text()
    (bare.folder / "known").write_text(known.replace("\nvalgrind\n", "\n"))
    tried = lambda: [call for call in set_up(bare, "test")[1] if "valgrind" in call]  # noqa: E731
    first, started = set_up(bare, "test")
    assert first.returncode == 0
    assert first.stdout.count("will be skipped: valgrind\n") == 1
    assert any("valgrind" in call for call in started)
    note = bare.folder / "build/deps/packages.tried"
    for hours, again in ((1, False), (23, False), (25, True)):
        then = time.time() - hours * 3600
        os.utime(note, (then, then))
        assert bool(tried()) == again
    note.write_text("others\n")
    assert tried()


@pytest.mark.parametrize(
    ("answers", "fetched", "tries", "here"),
    [("yes", "true", 1, True), ("yes", "false", 1, False), ("no", "true", 0, False)],
)
def test_what_is_fetched_comes_whole_or_not_at_all(bare, answers, fetched, tries, here):
    """Without it the rest goes on; an attempt that failed is not repeated at once."""
    (bare.folder / "build/deps/kernel.part").mkdir(parents=True)
    (bare.folder / "build/deps/kernel.part/old").touch()
    fetch = f'fetch_kernel() {{ echo try >>tries; echo new >"$1/vmlinuz"; {fetched}; }}'
    for _ in range(2):
        words = f"{fetch}; APT_ANSWERS={answers}; kernel_is_here || get_kernel"
        assert (
            sourced(bare, f"kernel_is_here() {{ [ -e build/deps/kernel ]; }}; {words}").returncode
            == 0
        )
    noted = bare.folder / "tries"
    assert (noted.read_text().count("try") if noted.exists() else 0) == tries
    place = bare.folder / "build/deps/kernel"
    assert ([path.name for path in place.iterdir()] == ["vmlinuz"]) if here else not place.exists()


def test_another_debians_cbmc_runs_on_its_own_library(bare):
    """Each of its commands by the loader that came with it; what nobody needs is left out."""
    bare.does(
        "apt-get",
        'case "$*" in *" download "*) for n in ${*##*download }; do touch $n.deb; done ;; esac',
    )
    loader = "printf '#!/bin/sh\\necho \"$@\"\\n'"
    unpack = "d=$3/usr/lib/here; mkdir -p $d/gconv $3/usr/bin $3/usr/share/$(basename $2)"
    unpack += f"; {loader} >$d/ld-linux.so.2"
    bare.stand_in("bin/dpkg-deb", f"{unpack}; chmod +x $d/ld-linux.so.2; touch $d/$(basename $2)")
    words = "codename() { echo bookworm; }; mkdir -p build/deps/x; fetch_cbmc build/deps/x"
    done = sourced(bare, words)
    assert done.returncode == 0, done.stderr
    made = bare.folder / "build/deps/x"
    kept = {path.name for path in (made / "usr/lib/here").iterdir()}
    assert {"cbmc.deb", "libc6.deb", "libgcc-s1.deb", "libstdc++6.deb", "minisat.deb"} <= kept
    assert "gconv" not in kept and not (made / "usr/share").exists() and not (made / "apt").exists()
    for name in ("cbmc", "goto-cc", "goto-instrument"):
        said = subprocess.run(
            [made / "bin" / name, "a b"], capture_output=True, text=True, check=True
        )
        assert said.stdout.startswith(f"--library-path {made}/usr/lib/here:{made}/usr/lib ")
        assert said.stdout.endswith(f" {made}/usr/bin/{name} a b\n")


@pytest.mark.parametrize("machine", ["x86_64", "aarch64"])
def test_a_kernel_is_fetched_where_this_one_has_no_can(bare, machine):
    """It is one for x86_64."""
    bare.stand_in("bin/uname", f"echo {machine}")
    wanted = machine == "x86_64" and not bus.has_socketcan()
    assert (sourced(bare, "kernel_is_here").returncode != 0) == wanted


@pytest.mark.parametrize(("state", "made"), [("0", 0), ("3", 0), ("4", 1)])
def test_the_environment_is_mended_as_far_as_needed(bare, state, made):
    set_up(bare, "demo")
    (bare.folder / "state").write_text(state)
    done, started = set_up(bare, "demo")
    assert done.returncode == 0
    assert sum("-m venv" in call for call in started) == made
    assert any("--require-hashes" in call for call in started) == (state != "0")


@pytest.mark.parametrize("there", ["no pip", "pip", "environment"])
def test_without_pips_index_nothing_is_tried_for_minutes(bare, there):
    """Also where there is no pip to ask with before the environment is made, or it lacks some."""
    if there == "environment":
        set_up(bare, "demo")
        (bare.folder / "state").write_text("3")
    shutil.copy(bare.folder / "known", bare.folder / "installed")
    before = 'case "$*" in *"pip --version"*) exit 1 ;; esac;' if there == "no pip" else ""
    offline = 'case "$*" in *" download "*) exit 1 ;; esac;'
    bare.does("python3.11", f"{before} {offline} {PYTHON}")
    bare.does("python", f"{offline} {PYTHON}")
    done, started = set_up(bare, "demo")
    assert done.returncode == 1
    assert "cannot reach the index of Python packages (pip)" in done.stderr
    assert not [call for call in started if "pip" in call]


@pytest.mark.parametrize("lacking", [None, "ninja", "csv.h"])
def test_on_another_system_it_says_what_the_build_will_miss(bare, lacking):
    """Without apt-get: programs are looked for, and headers by the compiler."""
    for name in ("cmake", "ninja", "python3"):
        bare.stand_in(f"bin/{name}")
    bare.stand_in("bin/cc", f"! grep -qF '<{lacking}>'")
    system = 'has_apt() { false; }; command() { [[ "$2" != ' + f'"{lacking}"' + " ]]; }"
    words = f"{system}; look_at_packages"
    done = sourced(bare, words)
    assert done.returncode == (1 if lacking else 0)
    assert re.findall(r"not found: ([\w.]+)", done.stderr) == ([lacking] if lacking else [])


def test_a_changed_package_is_installed_again_into_the_same_environment(bare):
    set_up(bare, "demo")
    project = bare.folder / "pyproject.toml"
    project.write_text(project.read_text().replace("[project]", "[project]\n# changed", 1))
    started = set_up(bare, "demo")[1]
    assert any("--editable" in call for call in started)
    assert not any("-m venv" in call for call in started)


def test_an_own_python_comes_first(bare):
    bare.stand_in("bin/mine", PYTHON)
    bare.run("setup", "demo", DAHL_PYTHON=str(bare.folder / "bin/mine"))
    assert any("-m venv" in call for call in bare.calls("mine"))
    assert not any("-m venv" in call for call in bare.calls("python3.11"))


LIST = """deb http://debian bookworm main contrib
deb [signed-by=/key] http://debian bookworm-updates main
# deb http://debian bookworm main
deb-src http://debian bookworm main
deb http://security bookworm-security main
deb http://debian bookworm-backports main
deb http://others stable main
deb http://others bookworm extra
"""
ENTRIES = """Types: deb
URIs: http://debian
Suites: bookworm bookworm-updates
Components: main

Types: deb
URIs: http://security
Suites: bookworm-security
Components: main contrib

Types: deb
URIs: http://others
Suites: bookworm
Components: extra

Types: deb
URIs: http://others
Suites: stable
Components: main
"""


def sourced(stage: Stage, words: str) -> subprocess.CompletedProcess:
    """Run words of a shell that knows what tools/setup.sh knows."""
    parts = ("common", "setup/needs", "setup/packages", "setup/fetched", "setup/python")
    known = "".join(f". tools/{part}.sh; " for part in parts)
    path = f"{stage.folder}/bin:{os.environ['PATH']}"
    return subprocess.run(
        ["bash", "-euo", "pipefail", "-c", known + words],
        env={**os.environ, "STAGE": str(stage.folder), "PATH": path},
        cwd=stage.folder,
        capture_output=True,
        text=True,
        check=False,
    )


def sources(stage: Stage, call: str) -> tuple[list[str], list[dict[str, str]]]:
    """What a function of packages.sh makes of this machine's sources: lines, and entries."""
    (stage.folder / "list").write_text(LIST)
    (stage.folder / "entries").write_text(ENTRIES)
    read = 'case "$*" in *.sources*) command cat entries ;; *) command cat list ;; esac'
    done = sourced(stage, f"codename() {{ echo bookworm; }}; cat() {{ {read}; }}; {call}")
    assert done.returncode == 0, done.stderr
    blocks = (stage.folder / "out/debian.sources").read_text().strip().split("\n\n")
    entries = [dict(line.split(": ", 1) for line in block.splitlines()) for block in blocks]
    return (stage.folder / "out/debian.list").read_text().splitlines(), entries


def test_debians_own_sources_are_found_among_others(stage):
    lines, entries = sources(stage, "write_debian_sources deb-src out")
    assert lines == [
        "deb-src http://debian bookworm main contrib",
        "deb-src [signed-by=/key] http://debian bookworm-updates main",
        "deb-src http://security bookworm-security main",
    ]
    assert [entry["URIs"] for entry in entries] == ["http://debian", "http://security"]
    assert {entry["Types"] for entry in entries} == {"deb-src"}


def test_another_suite_is_asked_of_the_same_mirror(stage):
    lines, entries = sources(stage, "write_other_sources deb out trixie")
    assert lines == ["deb http://debian trixie main contrib"]
    asked = [entry for entry in entries if entry.get("Enabled") != "no"]
    assert [(entry["URIs"], entry["Suites"]) for entry in asked] == [("http://debian", "trixie")]
