# SPDX-License-Identifier: MIT
"""tools/setup.sh on machines of which each lacks something: rights, a source that answers, a whole
archive. Every program that reaches outside only notes how it was called.
"""

from __future__ import annotations

import fcntl
import os
import re
import runpy
import shutil
import subprocess
import sys
import tarfile
import time
from pathlib import Path

import pytest
from loop_tools import wait_until
from test_scripts import APT, PYTHON, Stage, bared, set_up, sourced, staged


@pytest.fixture
def bare(root: Path, tmp_path: Path) -> Stage:
    return bared(staged(root, tmp_path), root)


def installs(stage: Stage) -> list[list[str]]:
    """Packages of each call of apt-get that installs some."""
    calls = [call.split() for call in stage.calls("apt-get") if " install " in call]
    return [[w for w in c[c.index("install") + 1 :] if w[0] != "-"] for c in calls]


# --- what is asked for ----------------------------------------------------------------------------

HELP = {
    "setup": ("demo      compiler", "all       everything", "DAHL_UNITY_DIR  a folder"),
    "test": ("--soak     the tests", "-k WORD    only", "Leaves: build/{ctest,python,checks}.xml"),
    "demo": ("loop.png", "--target m4f", "--counts-per-turn 16384"),
    "bench": ("target   counts", "host     errors", "docs     report"),
    "lock": ("Run it after a change of a list", "tools/lock.sh --upgrade"),
    "vm": ("77 and a reason", "DAHL_VM_SECONDS  limit"),
}


@pytest.mark.parametrize("script", HELP)
@pytest.mark.parametrize("word", ["-h", "--help"])
def test_the_help_tells_all_of_it_and_nothing_else(root, script, word):
    done = subprocess.run(
        [root / "tools" / f"{script}.sh", word], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[0].startswith(f"Usage: tools/{script}.sh")
    for words in HELP[script]:
        assert words in done.stdout
    assert not re.search(r"^#|^set -|SPDX", done.stdout, re.MULTILINE)


def test_by_itself_it_takes_what_the_tests_need(bare):
    done = bare.run("setup", DAHL_UNITY_DIR=str(bare.folder / "unity"), DAHL_PYTHON="")
    assert done.returncode == 0, done.stderr
    installed = " ".join(call for call in bare.calls("python") if "--require-hashes" in call)
    locks = re.findall(r"-r tools/requirements/(\w+).lock", installed)
    assert locks == ["demo", "identify", "test"]
    assert bare.run("setup", "tests").stderr.startswith("error: setup.sh knows demo ")


def test_what_is_in_place_asks_nobody(bare):
    """And the log is that of the last run."""
    (bare.folder / "build").mkdir(exist_ok=True)
    (bare.folder / "build/setup.log").write_text("of a run before\n")
    set_up(bare, "demo")
    assert "of a run before" not in (bare.folder / "build/setup.log").read_text()
    set_up(bare, "demo")
    asked = " ".join(bare.calls())
    assert "--print-uris" not in asked and " download " not in asked


@pytest.mark.parametrize(
    ("script", "lock"), [("setup", "setup"), ("demo", "build"), ("test", "build")]
)
def test_one_set_up_and_one_build_at_a_time(root, tmp_path, script, lock):
    """The second waits, says so, and then does its work."""
    stage = staged(root, tmp_path)
    if script == "setup":
        bared(stage, root)
    (stage.folder / "build").mkdir(exist_ok=True)
    own = {"DAHL_UNITY_DIR": str(stage.folder / "unity") if script == "setup" else ""}
    with (stage.folder / f"build/{lock}.lock").open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        second = subprocess.Popen(
            [stage.folder / f"tools/{script}.sh", *["demo"] * (script == "setup")],
            env={**os.environ, **own, "STAGE": str(stage.folder), "DAHL_PYTHON": "",
                 "PATH": f"{stage.folder}/bin:{os.environ['PATH']}"},
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, stdin=subprocess.DEVNULL,
        )  # fmt: skip
        said = f"{script}: another {lock} is at work here; waiting for it\n"
        assert second.stdout.readline() == said
        time.sleep(0.2)
        assert second.poll() is None and not stage.calls("cmake", "apt-get")
    out, errors = second.communicate(timeout=60)
    assert second.returncode == 0, out + errors
    assert stage.calls("apt-get" if script == "setup" else "cmake")


# --- rights ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("sudo", [True, False])
def test_who_is_not_root_installs_by_sudo_or_is_told_what_to_install(bare, sudo):
    bare.stand_in("bin/id", "echo 1000")
    bare.does("sudo", '[ "$1" != -n ] || shift; "$@"' if sudo else "exit 1")
    done, started = set_up(bare, "demo")
    by_sudo = [call for call in bare.calls("sudo") if " apt-get " in call]
    if sudo:
        assert done.returncode == 0, done.stderr
        assert len(by_sudo) == len(bare.calls("apt-get")) - 1  # one asks for addresses alone
        assert all("DEBIAN_FRONTEND=noninteractive" in call for call in by_sudo)
    else:
        assert done.returncode == 1 and not started and not by_sudo
        said = "please install, then run this again: apt-get install --no-install-recommends "
        named = done.stderr.removeprefix(f"error: {said}").split()
        assert {"gcc", "cmake", "python3-venv"} <= set(named) and "arm" not in done.stderr


def test_root_needs_no_sudo(bare):
    set_up(bare, "demo")
    assert (os.getuid() == 0) == (bare.calls("sudo") == [])


# --- sources that do not answer -------------------------------------------------------------------


def test_a_source_that_fails_is_asked_afresh_and_then_debians_own_alone(bare):
    """From what is known; with fresh lists; from Debian's own sources; then it is an error."""
    for failures in range(4):
        bare.run("setup", "--help")
        (bare.folder / "installed").write_text("dpkg-dev\npython3\npython3-venv\n")
        (bare.folder / "left").write_text("x\n" * failures)
        count = 'left="$STAGE/left"; if [ -s "$left" ]; then sed -i 1d "$left"; exit 100; fi'
        bare.does("apt-get", f'case "$*" in *" install "*) {count} ;; esac; {APT}')
        done, _ = set_up(bare, "demo")
        calls = [c for c in bare.calls("apt-get", "dpkg") if "--print-uris" not in c]
        kinds = [re.search(r"install|update|configure", call)[0] for call in calls]
        tried = ["install", "configure", "update", "install", "update", "install"]
        assert kinds == tried[: (1, 4, 6, 6)[failures]]
        own = ["sourceparts=build/deps/apt-deb" in call for call in calls]
        assert own == [n > 3 for n in range(len(calls))]
        assert done.returncode == (failures == 3)
    assert re.search(r"^error: apt-get could not install: .*gcc", done.stderr, re.MULTILINE)


def test_python_comes_first_and_all_else_beside_it(bare):
    """What pip gets and what apt-get gets come at the same time."""
    set_up(bare, "demo")
    first, second = installs(bare)
    assert sorted(first) == ["python3", "python3-venv"]
    assert {"gcc", "cmake"} <= set(second) and "python3" not in second


@pytest.mark.parametrize("must", [True, False])
def test_sources_that_cannot_be_reached_are_named_with_what_needs_them(bare, must):
    """An error where something must come from them, a word where it only may."""
    known = set((bare.folder / "known").read_text().split()) - {"valgrind"}
    (bare.folder / "installed").write_text("\n".join([*(known - {"g++"} if must else known), ""]))
    for release in bare.folder.glob("dists/*/InRelease"):
        release.unlink()
    done, started = set_up(bare, "test")
    said = "cannot reach this Debian's package sources (apt-get); needed for: "
    assert done.returncode == int(must)
    lacking = "g++ valgrind" if must else "valgrind"
    shown = done.stderr if must else done.stdout
    assert f"{said}{lacking} build/venv (log: build/setup.log)\n" in shown
    assert not installs(bare) and bool(started) != must
    assert not (bare.folder / "build/deps/packages.tried").exists()
    if not must:
        assert "will be skipped: valgrind\n" in done.stdout


def test_who_cannot_install_leaves_no_download_behind(bare):
    """apt-get fails for good while pip is at work: pip ends too."""
    (bare.folder / "known").write_text("python3\npython3-venv\n")
    beside = (
        f'case "$*" in *--require-hashes*) echo $$ >"$STAGE/pip"; exec sleep 50 ;; esac; {PYTHON}'
    )
    bare.does("python", 'case "$*" in *" download "*) exit 0 ;; esac; ' + beside)
    wait = 'case "$*" in *" gcc "*) until [ -s "$STAGE/pip" ]; do command sleep 0.1; done ;; esac'
    bare.does("sleep", 'command -p sleep "$@"')
    bare.does("apt-get", f"{wait.replace('command sleep', 'command -p sleep')}; {APT}")
    done, _ = set_up(bare, "demo")
    assert done.returncode == 1 and "apt-get could not install" in done.stderr
    process = Path("/proc") / (bare.folder / "pip").read_text().strip() / "cmdline"
    wait_until(lambda: not process.exists() or b"sleep" not in process.read_bytes())


def test_what_comes_is_not_said_to_be_lacking(bare):
    done, _ = set_up(bare, "test")
    assert done.returncode == 0 and "skipped" not in done.stdout
    assert "valgrind" in (bare.folder / "installed").read_text().split()


@pytest.mark.parametrize("tool", ["qemu-system-x86_64", "busybox", "cpio"])
def test_a_machine_without_its_tools_is_none_and_says_which(root, tmp_path, tool):
    """Code 77, by which a test knows that it cannot be run."""
    stage = staged(root, tmp_path)
    (stage.folder / "build/deps/kernel").mkdir(parents=True)
    (stage.folder / "build/deps/kernel/vmlinuz").write_text("kernel")
    for name in ("qemu-system-x86_64", "busybox", "cpio", "ip", "modprobe"):
        stage.stand_in(f"few/{name}")
    for name in ("bash", "env", "dirname", "basename", "sed"):
        (stage.folder / f"few/{name}").symlink_to(shutil.which(name))
    (stage.folder / f"few/{tool}").unlink()
    words = [stage.folder / "tools/vm.sh", stage.folder, "true"]
    few = {"PATH": f"{stage.folder}/few", "STAGE": str(stage.folder)}
    done = subprocess.run(words, env=few, capture_output=True, text=True, check=False)
    assert done.returncode == 77
    assert done.stdout == f"vm: no virtual machine here: {tool} is not installed\n"


# --- Python ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("variable", "option"), [("1", "--compile"), ("", "--no-compile")])
def test_packages_are_compiled_where_python_may_not_do_so_later(bare, variable, option):
    own = str(bare.folder / "unity")
    bare.run("setup", "demo", DAHL_UNITY_DIR=own, PYTHONDONTWRITEBYTECODE=variable)
    calls = [call.split() for call in bare.calls("python") if "--require-hashes" in call]
    filled = next(words for words in calls if "install" in words)
    assert option in filled and "--no-deps" in filled


@pytest.mark.parametrize(("version", "good"), [((3, 10, 99), False), ((3, 11, 0), True)])
def test_a_python_that_is_too_old_is_passed_over(bare, version, good):
    told = f'exec {sys.executable} -c "import sys; sys.version_info = {version}; $2"'
    for name in ("mine", "python3.11", "python3"):
        bare.stand_in(f"bin/{name}", told if name == "mine" else "exit 1")
    found = sourced(bare, "DAHL_PYTHON=mine find_python")
    assert found.stdout == ("mine\n" if good else "/usr/bin/python3\n")


def test_without_a_python_it_says_which_were_tried(bare):
    refused = sourced(bare, "find_python() { :; }; DAHL_PYTHON=/my/python; start_python")
    assert refused.returncode == 1
    tried = "(tried: /my/python python3.11 python3 /usr/bin/python3); set DAHL_PYTHON"
    assert f"error: no Python 3.11 or later with venv {tried}" in refused.stderr


def test_another_interpreter_wants_another_environment(bare):
    bare.does("python3.11", f'case "$*" in -VV) cat "$STAGE/version" ;; esac; {PYTHON}')
    for version, made in (("3.11.2", True), ("3.11.2", False), ("3.12.0", True)):
        (bare.folder / "version").write_text(version)
        _, started = set_up(bare, "demo")
        assert any("-m venv" in call for call in started) == made


@pytest.fixture
def checked(root, tmp_path, capsys):
    """Exit code and words of check_venv.py for a lock, in a folder that has package one 1.0."""
    space = runpy.run_path(str(root / "tools/setup/check_venv.py"))
    for name, record in (("one-1.0", "one.py,sha256=x,4\n"), ("dahl-0.1", "")):
        (tmp_path / f"site/{name}.dist-info").mkdir(parents=True)
        (tmp_path / f"site/{name}.dist-info/RECORD").write_text(record)
    (tmp_path / "site/one.py").write_text("1+1\n")
    space["main"].__globals__["sysconfig"] = type(
        "Here", (), {"get_path": staticmethod(lambda name: str(tmp_path / "site"))}
    )

    def check(*locks: str) -> tuple[int, list[str]]:
        paths = []
        for n, lock in enumerate(locks):
            (tmp_path / f"{n}.lock").write_text(lock)
            paths.append(str(tmp_path / f"{n}.lock"))
        return space["main"](paths), capsys.readouterr().out.splitlines()

    return tmp_path / "site", check


def test_the_state_of_an_environment_is_an_exit_code(checked):
    """Of every lock; what is for another system or Python is not missed."""
    site, check = checked
    one = "one==1.0 \\\n    --hash=sha256:00\n"
    assert check(one) == (0, [])
    other = "two[extra]==2.5 ; python_version >= '3' \\\n    --hash=sha256:00\n"
    other += "three==1 ; sys_platform == 'win32' \\\n    --hash=sha256:00\n# four==4\n"
    assert check(one, other) == (3, ["lacking: two 2.5"])
    (site / "one.py").write_text("1\n")
    assert check(one) == (4, ["changed: one.py"])
    assert check(one, other) == (4, ["lacking: two 2.5", "changed: one.py"])
    assert check(other) == (3, ["lacking: two 2.5"])  # what no lock names is nobody's business


PROGRAMS = {  # and headers, with the package of Debian that has them
    "demo": {
        "gcc": "gcc",
        "stdio.h": "libc6-dev",
        "cmake": "cmake",
        "ninja": "ninja-build",
        "ini.h": "libinih-dev",
        "csv.h": "libcsv-dev",
        "cJSON.h": "libcjson-dev",
        "python3": "python3",
        "venv": "python3-venv",
    },
    "firmware": {
        "arm-none-eabi-gcc": "gcc-arm-none-eabi",
        "math.h": "libnewlib-arm-none-eabi",
        "qemu-system-arm": "qemu-system-arm",
        "dpkg-source": "dpkg-dev",
        "unxz": "xz-utils",
    },
    "test": {"g++": "g++", "git": "git", "pkg-config": "pkg-config", "dpkg-source": "dpkg-dev"},
}


@pytest.mark.parametrize("need", PROGRAMS)
def test_what_a_need_starts_comes_from_a_package_that_it_must_have(bare, need):
    found = sourced(bare, f"add_need {need}; words_of MUST; echo; words_of MAY").stdout
    must, _, may = found.partition("\n\n")
    assert set(PROGRAMS[need].values()) <= set(must.split())
    assert ("valgrind" in may.split()) == (need == "test")


# --- what is fetched ------------------------------------------------------------------------------


def test_unity_comes_out_of_debians_source_package(bare, root):
    """Its three files, proved by their sums, and nothing else is left."""
    whole = root / "build/deps/unity"
    if not (whole / "unity.c").exists():
        pytest.skip("unproven: how Unity is unpacked: build/deps/unity is not here to pack")
    with tarfile.open(bare.folder / "source.tar.gz", "w:gz") as archive:
        for name in ("unity.c", "unity.h", "unity_internals.h"):
            archive.add(whole / name, f"ntpsec-1.2/tests/unity/{name}")
        archive.add(root / "README.md", "ntpsec-1.2/README")
    copied = 'case "$*" in *" source "*) cp "$STAGE/source.tar.gz" ntpsec_1.2.orig.tar.gz ;; esac'
    bare.does("apt-get", copied)
    (bare.folder / "build/deps/unity").mkdir(parents=True)
    (bare.folder / "build/deps/unity/old").touch()
    done = sourced(bare, "mkdir -p build/deps; get_unity; unity_is_here")
    assert done.returncode == 0, done.stderr
    names = {path.name for path in (bare.folder / "build/deps/unity").iterdir()}
    assert names == {"unity.c", "unity.h", "unity_internals.h"}
    assert not (bare.folder / "build/deps/unity.part").exists()
    update, source = bare.calls("apt-get")
    assert update.endswith(" update") and source.endswith(" ntpsec")
    for call in (update, source):  # from Debian's sources alone, into a folder of its own
        assert "sourceparts=build/deps/unity.part/parts" in call
        assert "Dir::State::lists=build/deps/unity.part/lists" in call


def test_a_unity_that_cannot_be_fetched_says_what_to_do(bare):
    bare.does("apt-get", "exit 100")
    done = sourced(bare, "mkdir -p build/deps; get_unity")
    assert done.returncode == 1
    assert "could not fetch Unity" in done.stderr and "DAHL_UNITY_DIR" in done.stderr


def test_a_kernel_is_unpacked_with_what_can_needs(bare):
    """Its newest package's kernel and modules for CAN and for folders, no others."""
    modules = bare.folder / "package/lib/modules/6.1.0-9"
    wanted = ("net/can/can.ko", "drivers/net/can/vcan.ko", "fs/9p/9p.ko", "net/sched/sch_tbf.ko")
    for name in (*wanted, "sound/sound.ko"):
        (modules / "kernel" / name).parent.mkdir(parents=True, exist_ok=True)
        (modules / "kernel" / name).touch()
    for name in ("net/9p/9p.ko", "fs/netfs/n.ko", "fs/fscache/f.ko", "drivers/virtio/v.ko"):
        (modules / "kernel" / name).parent.mkdir(parents=True, exist_ok=True)
        (modules / "kernel" / name).touch()
    (modules / "kernel/drivers/net/can/dev").mkdir()
    (modules / "kernel/drivers/net/can/dev/can-dev.ko").touch()
    (modules / "modules.order").touch()
    (bare.folder / "package/boot").mkdir()
    (bare.folder / "package/boot/vmlinuz-6.1.0-9").write_text("kernel")
    bare.stand_in("bin/dpkg-deb", 'tar -c -C "$STAGE/package" ./boot ./lib')
    bare.stand_in("bin/depmod")
    bare.does("apt-cache", 'echo "  Depends: linux-image-6.1.0-9-amd64"; echo "  Depends: other"')
    bare.does("apt-get", 'case "$*" in *" download "*) touch linux-image.deb ;; esac')
    done = sourced(bare, "mkdir -p build/deps; get_kernel; kernel_is_here")
    assert done.returncode == 0, done.stderr + (bare.folder / "build/setup.log").read_text()
    place = bare.folder / "build/deps/kernel"
    assert (place / "vmlinuz").read_text() == "kernel" and not list(place.glob("*.deb"))
    kept = {str(path.relative_to(place)) for path in place.rglob("*.ko")}
    assert {f"lib/modules/6.1.0-9/kernel/{name}" for name in wanted} < kept
    assert not any("sound" in name for name in kept)
    assert bare.calls("apt-get")[-1].endswith("download linux-image-6.1.0-9-amd64")
    assert bare.calls("depmod")[0].endswith("6.1.0-9")


def test_the_commands_of_cbmc_run_on_their_own_c_library(bare):
    """Each name starts the program of that name, by the loader that came with it."""
    top = bare.folder / "cbmc"
    (top / "usr/lib/x86").mkdir(parents=True)
    (top / "usr/bin").mkdir()
    loader = top / "usr/lib/x86/ld-linux-x86.so.2"
    loader.write_text('#!/bin/bash\necho "$1 $2"; shift 2; exec "$@"\n')
    for name in ("cbmc", "goto-cc", "goto-instrument"):
        (top / "usr/bin" / name).write_text(f'#!/bin/bash\necho "I am {name}: $*"\n')
    for path in (loader, *(top / "usr/bin").iterdir()):
        path.chmod(0o755)
    done = sourced(bare, 'make_cbmc_commands "$PWD/cbmc"')
    assert "I am cbmc: --version" in done.stdout
    for name in ("cbmc", "goto-cc", "goto-instrument"):
        words = [top / "bin" / name, "a b", "c"]
        said = subprocess.run(words, capture_output=True, text=True, check=True).stdout.splitlines()
        assert said == [f"--library-path {top}/usr/lib/x86:{top}/usr/lib", f"I am {name}: a b c"]


@pytest.mark.parametrize("broken", ["", "libc6.deb", "cbmc.deb"])
def test_cbmc_comes_from_another_suite_and_leaves_only_what_runs(bare, broken):
    """An archive that cannot be unpacked leaves nothing, and the rest goes on."""
    unpack = 'mkdir -p "$3/usr/bin" "$3/usr/share" "$3/etc"; [ "$(basename "$2")" != "$BROKEN" ]'
    bare.stand_in("bin/dpkg-deb", unpack.replace("$BROKEN", broken or "none"))
    get = 'case "$*" in *" download "*) touch cbmc.deb libc6.deb ;; *update) ;; *) exit 1 ;; esac'
    bare.does("apt-get", get)
    words = "make_cbmc_commands() { mkdir -p $1/bin; }; cbmc_is_here() { [ -d build/deps/cbmc ]; }"
    done = sourced(bare, f"{words}; mkdir -p build/deps; get_cbmc; cbmc_is_here")
    place = bare.folder / "build/deps/cbmc"
    assert (done.returncode == 0) == place.exists() == (not broken), done.stderr
    assert "download cbmc " in bare.calls("apt-get")[-1]
    if broken:
        assert "cbmc is not to be had here" in done.stdout
        assert (bare.folder / "build/deps/cbmc.tried").read_text() == "any\n"
    else:
        assert {path.name for path in place.iterdir()} == {"bin", "usr"}
        assert [path.name for path in (place / "usr").iterdir()] == ["bin"]


FETCHED = {"demo": "", "identify": "", "firmware": "unity", "test": "unity", "bench": "unity"}
FETCHED |= dict.fromkeys(("checks", "all"), "cbmc kernel unity")


@pytest.mark.parametrize("need", FETCHED)
def test_each_need_fetches_what_it_builds_and_runs_with(bare, need):
    """What is not in place, once, and from the network only where it is not in place."""
    lacking = 'for x in unity kernel cbmc; do eval "${x}_is_here() { false; }"; done'
    got = "get_unity() { echo unity; }; get_kernel() { echo kernel; }; get_cbmc() { echo cbmc; }"
    words = f"{got}; add_need {need}; look_at_fetched; get_fetched"
    found = sourced(bare, f"{lacking}; {words}; must_fetch && echo must")
    assert sorted(set(found.stdout.split()) - {"must"}) == FETCHED[need].split()
    assert ("must" in found.stdout) == ("unity" in FETCHED[need])
    there = sourced(
        bare, f"{lacking.replace('false', 'true')}; {words}; wants_fetched || echo none"
    )
    assert {line.split(": ")[1] for line in there.stdout.splitlines()[:-1]} == set(
        FETCHED[need].split()
    )
    assert there.stdout.endswith("none\n")


@pytest.mark.parametrize("left_out", [None, "test", "demo"])
def test_words_of_a_need_are_those_of_all_that_it_brings(bare, left_out):
    """And of no other; python is told by its locks in the order in which they stand."""
    table = "declare -A T=([demo]='a b' [test]='c' [checks]='d')"
    if left_out:
        table = table.replace(f"[{left_out}]=", "[none]=")
    done = sourced(bare, f"{table}; add_need test; words_of T")
    assert done.stdout.split() == [
        word
        for need, words in (("demo", "ab"), ("test", "c"))
        for word in words
        if need != left_out
    ]
