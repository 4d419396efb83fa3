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
from script_stage import APT, PYTHON, Debian, codename


@pytest.fixture
def bare(tmp_path: Path) -> Debian:
    return Debian(tmp_path)


# --- Debian packages -----------------------------------------------------------------------------


def test_it_installs_missing_packages_once(bare):
    done, started = bare.set_up("demo")
    assert done.returncode == 0, done.stderr
    installed = bare.lines("installed")
    assert {"cmake", "ninja-build", "python3-venv"} <= {*installed}
    assert len(installed) == len({*installed})
    by_apt = [call for call in started if "apt-get" in call]
    assert all("--no-install-recommends" in call for call in by_apt)
    assert by_apt[0].endswith(" python3 python3-venv")
    assert bare.set_up("demo")[1] == []


def test_each_need_includes_smaller_needs(bare):
    has: dict[str, set[str]] = {}
    for need in ("", "demo", "firmware", "identify", "test", "docs", "vm", "bench", "checks"):
        bare.write("installed", "dpkg-dev")
        shutil.rmtree(bare.folder / "build", ignore_errors=True)
        done, _ = bare.set_up(need)
        assert done.returncode == 0, done.stderr
        python = re.search(r"installing Python packages: (.*) \(", done.stdout)[1].split()
        has[need] = {*bare.lines("installed"), *(f"group {name}" for name in python)}
    assert has[""] == has["test"]
    assert has["demo"] < has["identify"] < has["test"] < has["docs"] < has["checks"]
    assert has["demo"] < has["firmware"] < has["checks"] and has["demo"] < has["vm"]
    assert has["identify"] | has["firmware"] < has["bench"]
    assert {"libinih-dev", "libcsv-dev", "libcjson-dev"} <= has["demo"]
    assert not {"gcc-arm-none-eabi", "clang", "doxygen"} & has["test"]


def test_a_missing_optional_package_is_named_and_tried_once_a_day(bare):
    bare.without("valgrind")
    done, started = bare.set_up("test")
    assert done.returncode == 0 and any("valgrind" in call for call in started)
    assert len(re.findall(r"skipped: valgrind$", done.stdout, re.M)) == 1
    for hours, again in ((23, False), (25, True)):
        then = time.time() - hours * 3600
        os.utime(bare.folder / "build/deps/packages.tried", (then, then))
        assert any("valgrind" in call for call in bare.set_up("test")[1]) == again


def test_each_download_is_named_and_tried_once_a_day(bare):
    for is_first in (True, False):
        done, _ = bare.set_up("checks")
        named = re.findall(r"^setup: (\w+)(?:: in place| cannot be fetched)", done.stdout, re.M)
        assert done.returncode == 0 and sorted(named) == ["cbmc", "kernel", "unity"]
        assert bool(bare.calls("apt-get")) == is_first


@pytest.mark.parametrize(
    ("machine", "has_can", "is_fetched"),
    [("x86_64", False, True), ("x86_64", True, False), ("aarch64", False, False)],
)
def test_a_kernel_is_fetched_if_the_virtual_machine_can_run_it(bare, machine, has_can, is_fetched):
    bare.stand_in("bin/uname", f"echo {machine}")
    bare.stand_in("bin/python3", f"exit {0 if has_can else 1}")
    done, _ = bare.set_up("vm")
    assert done.returncode == 0, done.stderr
    assert any("linux-image" in call for call in bare.calls("apt-cache")) == is_fetched
    assert ("kernel: in place" in done.stdout) != is_fetched


@pytest.mark.parametrize("lacking", [None, "ninja", "csv.h"])
def test_without_apt_get_it_names_what_the_build_lacks(bare, lacking):
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


@pytest.mark.parametrize("has_sudo", [True, False])
def test_other_users_install_by_sudo_or_read_what_to_install(bare, has_sudo):
    bare.stand_in("bin/id", "echo 1000")
    bare.does("sudo", '[ "$1" != -n ] || shift; "$@"' if has_sudo else "exit 1")
    done, started = bare.set_up("demo")
    if has_sudo:
        assert done.returncode == 0, done.stderr
        assert any(" install " in call for call in bare.calls("sudo"))
    else:
        assert done.returncode == 1 and not started
        named = done.stderr.partition("apt-get install --no-install-recommends ")[2].split()
        assert {"libc6-dev", "cmake", "python3-venv"} <= set(named) and "arm" not in done.stderr


@pytest.mark.parametrize("failures", range(4))
def test_after_two_failures_it_uses_debians_own_sources_only(bare, failures):
    """With the present lists, with new lists, from Debian's own sources; then it is an error."""
    bare.write("list", f"deb http://debian {codename()} main", "deb http://others stable main")
    own = 'case "$*" in */etc/apt/*) exec /bin/cat "$STAGE/list" ;; esac; /bin/cat "$@"'
    bare.stand_in("bin/cat", own)
    bare.write("installed", "dpkg-dev", "python3", "python3-venv")
    bare.write("left", *["x"] * failures)
    count = 'if [ -s "$STAGE/left" ]; then sed -i 1d "$STAGE/left"; exit 100; fi'
    bare.does("apt-get", f'case "$*" in *" install "*) {count} ;; esac; {APT}')
    done, _ = bare.set_up("demo")
    calls = [call for call in bare.calls("apt-get") if "--print-uris" not in call]
    kinds = [re.search(r"install|update", call)[0] for call in calls]
    assert kinds == ["install", "update", "install", "update", "install"][: (1, 3, 5, 5)[failures]]
    assert ["sourceparts=" in call for call in calls] == [n > 2 for n in range(len(calls))]
    if failures == 3:
        assert done.returncode == 1 and re.search(r"^error: .*\bcmake\b", done.stderr, re.M)
    else:
        assert done.returncode == 0


def test_unity_with_other_sums_is_not_used(bare):
    """There are no C tests without Unity, so it is an error."""
    pack = 'tar -czf ntpsec_1.2.orig.tar.gz -C "$STAGE" --transform s,^,ntpsec/tests/, unity'
    bare.does("apt-get", f'case "$*" in *" source "*) {pack} ;; esac; {APT}')
    done, _ = bare.set_up("test", DAHL_UNITY_DIR="")
    assert done.returncode == 1 and "sums of Unity 2.5.1" in done.stderr
    assert not (bare.folder / "build/deps/unity").exists()


# --- the Python environment ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("state", "is_new", "installs"),
    [
        ("0", False, False),  # complete
        ("3", False, True),  # packages are missing
        ("4", True, True),  # files are damaged
        ("changed", False, True),  # pyproject.toml
        ("other Python", True, True),
    ],
)
def test_the_environment_is_repaired_as_far_as_needed(bare, state, is_new, installs):
    bare.does("python3.11", f'case "$*" in -VV) cat "$STAGE/version" ;; esac; {PYTHON}')
    bare.write("version", "3.11.2")
    bare.set_up("demo")
    project = bare.folder / "pyproject.toml"
    if state == "changed":
        project.write_text(project.read_text().replace("[project]", "[project]\n# new", 1))
    elif state == "other Python":
        bare.write("version", "3.12.0")
    else:
        bare.write("state", state)
    done, started = bare.set_up("demo")
    assert done.returncode == 0
    assert any("-m venv" in call for call in started) == is_new
    assert any("--require-hashes" in call for call in started) == installs
    assert any("--editable" in call for call in started) == installs


@pytest.mark.parametrize("failing", ["pip", "python"])
def test_an_environment_that_fails_is_an_error_each_time(bare, failing):
    name = {"pip": "python", "python": "python3.11"}[failing]
    bare.does(name, f'case "$*" in *" install "*|*"-m venv"*) exit 1 ;; esac; {PYTHON}')
    for _ in range(2):
        done, started = bare.set_up("demo")
        assert done.returncode == 1 and "error: " in done.stderr
    assert sum("--require-hashes" in call for call in started) == (3 if failing == "pip" else 0)


@pytest.mark.parametrize(
    ("pin", "missing"),
    [
        ("one==1.0 \\\n    --hash=sha256:00\n", []),
        ("one==1.1 \\\n", ["one 1.1"]),
        ("two[extra]==2.5 ; python_version >= '3' \\\n", ["two 2.5"]),
        ("three==1 ; sys_platform == 'win32' \\\n# four==4\n", []),
    ],
)
def test_missing_and_changed_packages_are_found(tmp_path, pin, missing):
    compare = runpy.run_path(str(ROOT / "tools/setup/check_venv.py"))["compare"]
    for name in ("one-1.0", "dahl-0.1"):
        (tmp_path / f"{name}.dist-info").mkdir()
        (tmp_path / f"{name}.dist-info/RECORD").write_text("one.py,sha256=x,4\n")
    (tmp_path / "one.py").write_text("1+1\n")
    pins = tmp_path / "packages.txt"
    pins.write_text(pin)
    assert compare(tmp_path, pins) == (missing, [])
    (tmp_path / "one.py").write_text("1\n")
    is_pinned = pin.startswith("one==1.0")
    assert compare(tmp_path, pins) == (missing, ["one.py"] if is_pinned else [])
    (tmp_path / "dahl-0.1.dist-info").rename(tmp_path / "other-0.1.dist-info")
    assert compare(tmp_path, pins)[0] == [*missing, "dahl"]


# --- the files as they are -----------------------------------------------------------------------


def test_without_a_network_it_ends_with_one_line(tmp_path):
    shutil.copytree(ROOT / "tools", tmp_path / "tools")
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    nowhere = dict.fromkeys(("http_proxy", "https_proxy"), "http://127.0.0.1:9")
    script = [tmp_path / "tools/setup.sh", "test"]
    variables = {**os.environ, **nowhere}
    done = subprocess.run(script, env=variables, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    [error] = done.stderr.splitlines()
    wanted = ["apt-get", "unity"] if shutil.which("apt-get") else []
    assert all(word in error for word in [*wanted, "(pip)", "build/venv", "build/setup.log"])


def pins_of(text: str) -> set[tuple[str, str]]:
    pins = re.findall(r"^([\w.-]+)(?:\[[^]]*\])?==([^\s;\\]+)", text.lower(), re.MULTILINE)
    return {(re.sub("[-_.]+", "-", name), version) for name, version in pins}


def test_the_lock_has_the_versions_of_the_groups():
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text())["dependency-groups"]
    _, *sections = (ROOT / "tools/requirements.lock").read_text().split("\n# group ")
    locked: set[tuple[str, str]] = set()
    for section in sections:
        name = section.split()[0]
        locked = pins_of(section) | (locked if name != "rivals" else set())
        listed = pins_of("\n".join(one for one in groups.pop(name) if isinstance(one, str)))
        assert listed and listed <= locked, "run tools/lock.sh"
    assert not groups
