# SPDX-License-Identifier: MIT
"""tools/setup.sh: packages of each need, rights, failing sources, the Python environment. All
programs that reach a network are stand-ins.
"""

import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest
from conftest import ROOT
from script_stage import APT, PYTHON, UV, Debian


@pytest.fixture
def bare(tmp_path: Path) -> Debian:
    return Debian(tmp_path)


def test_each_need_installs_what_is_missing_once(bare):
    has: dict[str, set[str]] = {}
    for need in ("", *"demo firmware identify test docs vm explore bench checks".split()):
        bare.write("installed", "dpkg-dev")
        shutil.rmtree(bare.folder / "build", ignore_errors=True)
        done, started = bare.set_up(need)
        assert done.returncode == 0, done.stderr
        python = re.findall(r"pyproject.toml:(\w+)", "".join(started))
        has[need] = {*bare.lines("installed"), *(f"group {name}" for name in python)}
        by_apt = [call for call in started if "apt-get" in call]
        assert all("--no-install-recommends" in call for call in by_apt)
    assert has[""] == has["test"]
    assert has["demo"] < has["identify"] < has["test"] < has["docs"] < has["checks"]
    assert has["demo"] < has["firmware"] < has["checks"] and has["demo"] < has["vm"]
    assert has["identify"] | has["firmware"] < has["bench"]
    assert {"cmake", "ninja-build"} <= has["demo"]
    assert has["explore"] == has["demo"] | {"clang", "lld"}
    assert not {"gcc-arm-none-eabi", "clang", "doxygen"} & has["test"]
    again = bare.set_up("checks")[1]
    assert len(again) == 1 and again[0].endswith(" --offline") and "checks" in again[0]


def test_an_optional_package_or_download_is_named_and_tried_once_a_day(bare):
    bare.write("unknown", "valgrind")
    for hours, is_tried in ((0, True), (23, False), (25, True)):
        then = time.time() - hours * 3600
        for tried in bare.folder.glob("build/deps/*.tried"):
            os.utime(tried, (then, then))
        done, started = bare.set_up("checks")
        assert any("valgrind" in call for call in started) == is_tried
        assert any("linux-image" in call for call in bare.calls("apt-cache")) == is_tried
        assert done.returncode == 0, done.stderr
        assert len(re.findall(r"skipped: .*\bvalgrind\b", done.stdout)) == 1
        named = re.findall(r"^setup: (\w+)(?:: in place| cannot be fetched)", done.stdout, re.M)
        assert sorted(named) == ["cbmc", "kernel", "unity"]


@pytest.mark.parametrize("has_sudo", [True, False])
def test_other_users_install_by_sudo_or_read_what_to_install(bare, has_sudo):
    bare.stand_in("bin/id", "echo 1000")
    bare.does("sudo", '[ "$1" != -n ] || shift; "$@"' if has_sudo else "exit 1")
    done, started = bare.set_up("demo")
    assert (done.returncode == 0) == has_sudo == bool(started)
    assert any(" install " in call for call in bare.calls("sudo")) == has_sudo
    named = done.stderr.partition("apt-get install --no-install-recommends ")[2].split()
    assert has_sudo or {"libc6-dev", "cmake", "python3-venv"} <= {*named}


def test_unity_with_other_sums_is_not_used(bare):
    """There are no C tests without Unity, so it is an error."""
    pack = 'tar -czf ntpsec_1.2.orig.tar.gz -C "$STAGE" --transform s,^,ntpsec/tests/, unity'
    bare.does("apt-get", f'case "$*" in *" source "*) {pack} ;; esac; {APT}')
    done, _ = bare.set_up("test", DAHL_UNITY_DIR="")
    assert done.returncode == 1 and "sums of Unity 2.5.1" in done.stderr
    assert not (bare.folder / "build/deps/unity").exists()


NEW = {"venv", "--editable"}  # words of the calls of uv
CHANGES = {  # file and its new line
    ("damage", "0"): set(),
    ("damage", "1"): NEW | {"--no-cache"},  # the cache may have the same damage
    ("build/venv/.complete", "an interrupted run"): NEW,
    ("version", "3.12.0"): NEW,
    ("pyproject.toml", "[project]"): {"--editable"},
    ("tools/dahl/version.py", "later"): {"--editable"},
}


@pytest.mark.parametrize(("file", "line"), CHANGES)
def test_the_environment_is_repaired_as_far_as_needed(bare, file, line):
    bare.set_up("demo")
    bare.write(file, line)
    done, started = bare.set_up("demo")
    assert done.returncode == 0
    words = {word for call in started for word in call.split()}
    assert words & (NEW | {"--no-cache"}) == CHANGES[file, line]
    [installs] = [call for call in started if "--group" in call]
    assert "--require-hashes --constraints tools/requirements.lock" in installs


FAILING = [  # program and words of its call
    *(("python3.11", "-m venv"), ("python", " install ")),
    *(("uv", "venv --clear"), ("uv", "--group"), ("uv", "--editable")),
]


@pytest.mark.parametrize(("program", "words"), FAILING)
def test_an_environment_that_fails_is_an_error_each_time(bare, program, words):
    works = UV if program == "uv" else PYTHON
    bare.does(program, f'case "$*" in *"{words}"*) exit 1 ;; esac; {works}')
    for _ in range(2):
        done, started = bare.set_up("demo")
        assert done.returncode == 1 and words in started[-1]
        assert "error: " in done.stderr and "log: build/setup.log" in done.stderr
    bare.does(program, works)
    assert bare.set_up("demo")[0].returncode == 0


def test_packages_that_are_not_in_the_cache_come_from_the_index_of_pip(bare):
    bare.does("uv", f'case "$*" in *--offline) exit 1 ;; esac; echo "$UV_DEFAULT_INDEX"; {UV}')
    done, started = bare.set_up("demo", PIP_INDEX_URL="https://packages.example/simple")
    assert done.returncode == 0 and sum("--offline" in call for call in started) == 2
    assert "https://packages.example/simple" in bare.lines("build/setup.log")


def test_another_version_of_uv_in_the_lock_is_installed(bare):
    bare.set_up("demo")
    bare.does("uv", 'case "$*" in --version) echo "uv 0.1 (a build)" ;; esac')
    assert any("-m pip" in call for call in bare.set_up("demo")[1])


DAMAGES = {"": 0, "echo 123 >file.py": 1, "rm file.py": 1, "rm kept-1.0.dist-info/RECORD": 1}


@pytest.mark.parametrize("damage", DAMAGES)
def test_missing_and_changed_files_of_packages_are_found(tmp_path, damage):
    """A file must have its size of the RECORD."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", tmp_path], check=True)
    [site] = tmp_path.glob("lib/python*/site-packages")
    (site / "kept-1.0.dist-info").mkdir()
    (site / "kept-1.0.dist-info/METADATA").write_text("Name: kept\nVersion: 1.0\n")
    (site / "kept-1.0.dist-info/RECORD").write_text("file.py,sha256=x,3\nRECORD,,\n")
    (site / "file.py").write_text("12\n")
    subprocess.run(damage, shell=True, cwd=site, check=True)
    script = f"BUILD=$1; . {ROOT}/tools/setup/python.sh; is_undamaged $1"
    (tmp_path / "setup.log").touch()
    done = subprocess.run(["bash", "-c", script, "bash", tmp_path], check=False)
    assert done.returncode == DAMAGES[damage]


def test_without_a_network_it_ends_with_one_line(tmp_path):
    shutil.copytree(ROOT / "tools", tmp_path / "tools")
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    away = os.environ | dict.fromkeys(("http_proxy", "https_proxy"), "http://127.0.0.1:9")
    script = [tmp_path / "tools/setup.sh", "test"]
    done = subprocess.run(script, env=away, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    [error] = done.stderr.splitlines()
    wanted = ["apt-get", "unity"] if shutil.which("apt-get") else ["pip", "build/venv"]
    assert all(word in error for word in [*wanted, "build/setup.log"])


def laptop(folder: Path) -> Path:
    """Make a PATH without apt-get, a compiler and CMake."""
    hides = re.compile("apt-get|cc|c[89]9|gcc.*|clang.*|cmake|sudo")
    (folder / "path").mkdir(parents=True)
    for program in [*Path("/usr/bin").iterdir(), *Path("/bin").iterdir()]:
        link = folder / "path" / program.name
        if not hides.fullmatch(program.name) and not link.is_symlink():
            link.symlink_to(program)
    return folder / "path"


BROKEN = {  # what the PATH gains, CC, and the start of the only line
    "": ({}, "", "not found: cc cmake; no apt-get here"),
    "no cmake": ({"cc": "exit 0"}, "", "not found: cmake; no apt-get here"),
    "CC": ({}, "no-such-cc -m32", "CC=no-such-cc -m32 does not run: "),
    "old cmake": (
        {"cc": "", "cmake": "echo cmake version 3.21.9"},
        "",
        "{}/cmake has version 3.21.9",
    ),
    "bad cmake": ({"cc": "", "cmake": "exit 127"}, "", "{}/cmake does not run"),
}


@pytest.mark.parametrize("script", ["setup", "demo", "test"])
@pytest.mark.parametrize("case", BROKEN)
def test_without_a_compiler_or_cmake_one_line_says_so_and_nothing_starts(tmp_path, script, case):
    programs, compiler, line = BROKEN[case]
    path = laptop(tmp_path)
    for name, text in programs.items():
        (path / name).write_text(f"#!/bin/sh\n{text}\n")
        (path / name).chmod(0o755)
    shutil.copytree(ROOT / "tools", tmp_path / "tools")
    away = {"PATH": str(path), "HOME": str(tmp_path), **({"CC": compiler} if compiler else {})}
    done = subprocess.run(
        [tmp_path / "tools" / f"{script}.sh"], env=away, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    [error] = done.stderr.splitlines()
    assert error.startswith("error: " + line.format(path))
    assert not list(tmp_path.glob("build/venv")) and not list(tmp_path.glob("build/host"))


def test_a_wheel_without_a_compiler_names_it_in_one_line(tmp_path):
    words = ["cmake", "-S", ROOT, "-B", tmp_path, "-DDAHL_BUILD_WHEEL=ON"]
    away = os.environ | {"CC": "no-such-cc -m32"}
    done = subprocess.run(words, env=away, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    named = [line for line in done.stderr.splitlines() if "no-such-cc" in line]
    assert len(named) == 1 and "dahl needs a C compiler" in named[0]


def test_the_lock_has_the_versions_of_the_groups():
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text())["dependency-groups"]
    pins = {pin for group in groups.values() for pin in group if isinstance(pin, str)}
    lock = (ROOT / "tools/requirements.lock").read_text()
    pattern = r"(?im)^([\w-]+)(?:\[.*])?(==\S+)"
    listed, locked = ({*re.findall(pattern, text.lower())} for text in ("\n".join(pins), lock))
    assert len(listed) == len(pins) and listed <= locked, "run tools/lock.sh"
