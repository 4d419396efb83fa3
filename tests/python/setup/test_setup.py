# SPDX-License-Identifier: MIT
"""tools/setup.sh: packages of each need, rights, failing sources, the Python environment. All
programs that reach a network are stand-ins.
"""

from __future__ import annotations

import os
import re
import runpy
import shutil
import subprocess
import time
import tomllib
from pathlib import Path

import pytest
from conftest import ROOT
from script_stage import APT, PYTHON, Debian


@pytest.fixture
def bare(tmp_path: Path) -> Debian:
    return Debian(tmp_path)


def test_each_need_installs_what_is_missing_once(bare):
    has: dict[str, set[str]] = {}
    for need in ("", "demo", "firmware", "identify", "test", "docs", "vm", "bench", "checks"):
        bare.write("installed", "dpkg-dev")
        shutil.rmtree(bare.folder / "build", ignore_errors=True)
        done, started = bare.set_up(need)
        assert done.returncode == 0, done.stderr
        python = re.search(r"installing Python packages: (.*) \(", done.stdout)[1].split()
        has[need] = {*bare.lines("installed"), *(f"group {name}" for name in python)}
        by_apt = [call for call in started if "apt-get" in call]
        assert all("--no-install-recommends" in call for call in by_apt)
        assert by_apt[0].endswith(" python3 python3-venv")  # pip works during the next call
    assert has[""] == has["test"]
    assert has["demo"] < has["identify"] < has["test"] < has["docs"] < has["checks"]
    assert has["demo"] < has["firmware"] < has["checks"] and has["demo"] < has["vm"]
    assert has["identify"] | has["firmware"] < has["bench"]
    assert {"cmake", "ninja-build"} <= has["demo"]
    assert not {"gcc-arm-none-eabi", "clang", "doxygen"} & has["test"]
    assert bare.set_up("checks")[1] == []


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


CHANGES = {  # file and its new line: whether the environment is new, whether packages are installed
    ("state", "0"): (False, False),  # complete
    ("state", "3"): (False, True),  # packages are missing
    ("state", "4"): (True, True),  # files are damaged
    ("pyproject.toml", "[project]"): (False, True),
    ("version", "3.12.0"): (True, True),
}


@pytest.mark.parametrize(("file", "line"), CHANGES)
def test_the_environment_is_repaired_as_far_as_needed(bare, file, line):
    bare.set_up("demo")
    bare.write(file, line)
    done, started = bare.set_up("demo")
    is_new, installs = CHANGES[file, line]
    assert done.returncode == 0
    assert any("-m venv" in call for call in started) == is_new
    assert any("--require-hashes" in call for call in started) == installs
    assert any("--editable" in call for call in started) == installs


@pytest.mark.parametrize(("failing", "tries"), [("python", 3), ("python3.11", 0)])
def test_an_environment_that_fails_is_an_error_each_time(bare, failing, tries):
    bare.does(failing, f'case "$*" in *" install "*|*"-m venv"*) exit 1 ;; esac; {PYTHON}')
    for _ in range(2):
        done, started = bare.set_up("demo")
        assert done.returncode == 1 and "error: " in done.stderr
        assert sum("--require-hashes" in call for call in started) == tries


PINS = ("not.here==9 ; python_version < '3'", "Kept.One==1.0", "gone==2")
SITES = {  # change of a site that has all packages, and a file of 3 bytes: code and output
    "": (0, ""),
    "rm -r dahl-0.2.dist-info": (3, "missing: dahl\n"),
    "mv kept_one-1.0.dist-info kept_one-1.1.dist-info": (3, "missing: kept-one 1.0\n"),
    "rm -r gone-2.dist-info": (3, "missing: gone 2\n"),
    "echo 123 > file.py": (4, "changed: file.py\n"),
    "rm file.py gone-2.dist-info -r": (4, "missing: gone 2\nchanged: file.py\n"),
    "rm kept_one-1.0.dist-info/RECORD": (4, "changed: {}/kept_one-1.0.dist-info/RECORD\n"),
}


@pytest.mark.parametrize("change", SITES)
def test_missing_packages_and_changed_files_are_found(tmp_path, monkeypatch, capsys, change):
    """A package for other versions of Python is not needed. A size is that of the RECORD."""
    site = tmp_path / "site"
    for name in ("dahl-0.2", "kept_one-1.0", "gone-2"):
        (site / f"{name}.dist-info").mkdir(parents=True)
        (site / f"{name}.dist-info/RECORD").write_text("")
    (site / "kept_one-1.0.dist-info/RECORD").write_text("file.py,sha256=x,3\nRECORD,,\n")
    (site / "file.py").write_text("12\n")
    (tmp_path / "packages.txt").write_text(
        "".join(f"{pin} \\\n    --hash=sha256:0\n" for pin in PINS)
    )
    subprocess.run(change, shell=True, cwd=site, check=True)
    monkeypatch.setattr("sysconfig.get_path", lambda _name: str(site))
    main = runpy.run_path(str(ROOT / "tools/setup/check_venv.py"))["main"]
    code, printed = SITES[change]
    assert main(str(tmp_path / "packages.txt")) == code
    assert capsys.readouterr().out == printed.format(site)


def test_without_a_network_it_ends_with_one_line(tmp_path):
    shutil.copytree(ROOT / "tools", tmp_path / "tools")
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    away = os.environ | dict.fromkeys(("http_proxy", "https_proxy"), "http://127.0.0.1:9")
    script = [tmp_path / "tools/setup.sh", "test"]
    done = subprocess.run(script, env=away, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    [error] = done.stderr.splitlines()
    wanted = ["apt-get", "unity"] if shutil.which("apt-get") else []
    assert all(word in error for word in [*wanted, "(pip)", "build/venv", "build/setup.log"])


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
