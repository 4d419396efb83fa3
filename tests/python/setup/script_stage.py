# SPDX-License-Identifier: MIT
"""A copy of tools/ in which each program that the scripts call is a stand-in: it records its words,
then runs a script of the test. `Debian` is such a copy on a Debian without packages.
"""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from conftest import ROOT

NOTE = """#!/bin/bash
name=${0##*/}
echo "$name $*" >>"$STAGE/calls"
[ ! -e "$STAGE/$name.does" ] || . "$STAGE/$name.does"
"""


class Stage:
    """The folder: a copy of tools/, stand-ins in bin/ and where a test adds them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        shutil.copytree(ROOT / "tools", folder / "tools", ignore=shutil.ignore_patterns("__py*"))
        shutil.copy(ROOT / "pyproject.toml", folder)
        (folder / "note").write_text(NOTE)
        (folder / "note").chmod(0o755)

    def stand_in(self, name: str, does: str = "") -> None:
        """Replace the program at this place in the folder."""
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.unlink(missing_ok=True)
        path.symlink_to(self.folder / "note")
        self.does(path.name, does)

    def does(self, name: str, script: str) -> None:
        self.write(f"{name}.does", script)

    def write(self, file: str, *lines: str) -> None:
        path = self.folder / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("".join(f"{line}\n" for line in lines))

    def lines(self, file: str) -> list[str]:
        path = self.folder / file
        return path.read_text().splitlines() if path.exists() else []

    def run(self, script: str, *words: str, **variables: str) -> subprocess.CompletedProcess:
        (self.folder / "calls").unlink(missing_ok=True)
        path = f"{self.folder}/bin:{os.environ['PATH']}"
        return subprocess.run(
            [self.folder / "tools" / f"{script}.sh", *words],
            env={**os.environ, "STAGE": str(self.folder), "PATH": path, **variables},
            capture_output=True,
            text=True,
            timeout=250,
            check=False,
            stdin=subprocess.DEVNULL,
        )

    def calls(self, *programs: str) -> list[str]:
        """Return the calls of the last run; paths are relative to the folder."""
        lines = [line.replace(f"{self.folder}/", "") for line in self.lines("calls")]
        return [line for line in lines if not programs or line.split()[0] in programs]


# dpkg-query lists the packages of the file `installed`. apt-get adds all but those of `unknown`.
APT = """case "$*" in
    *--print-uris*)
        . /etc/os-release
        echo "'file:$STAGE/dists/$VERSION_CODENAME/InRelease' InRelease"
        mkdir -p "$STAGE/dists/$VERSION_CODENAME" && touch "$_/InRelease" ;;
    *" install "*)
        words=$*
        words=(${words##* install })
        for n in "${!words[@]}"; do [[ "${words[n]}" != -* ]] || unset "words[$n]"; done
        ! printf '%s\\n' "${words[@]}" | grep -qxFf "$STAGE/unknown" || exit 100
        printf '%s\\n' "${words[@]}" >>"$STAGE/installed" ;;
esac"""
DPKG = """sed 's/^/installed /' "$STAGE/installed" """
PYTHON = """case "$*" in
    -VV) cat "$STAGE/version" ;;
    -I*) exit "$(cat "$STAGE/damage")" ;;
    *ensurepip*) echo "$0" ;;
    "-m venv "*) mkdir -p "$3/bin"; ln -s "$STAGE/note" "$3/bin/python" ;;
    *" install "*) ln -s "$STAGE/note" "${0%/*}/uv" ;;
esac"""
UV = """case "$*" in
    --version) sed -n 's/^uv==\\([^ ]*\\).*/uv \\1 (a build)/p' "$STAGE/tools/requirements.lock" ;;
    venv*) rm -rf "$5"; mkdir -p "$5/bin"; ln -s "$STAGE/note" "$5/bin/python" ;;
    *--editable*) touch "$STAGE/build/venv/bin/dahl" ;;
esac"""


class Debian(Stage):
    """A Debian without packages, whose package source answers."""

    def __init__(self, folder: Path) -> None:
        if not Path("/usr/lib/apt/apt-helper").exists():
            pytest.skip("unproven: tools/setup.sh on Debian: this system is not Debian")
        super().__init__(folder)
        self.write("unknown")
        self.write("installed", "dpkg-dev")
        self.write("version", "3.11.2")
        self.write("damage", "0")  # 1: a file of a package is missing
        for file in ("unity.c", "unity.h", "unity_internals.h"):
            self.write(f"unity/{file}", "mine")
        programs = {"apt-get": APT, "dpkg-query": DPKG, "python3.11": PYTHON, "sudo": '"$@"'}
        programs["cmake"] = "echo cmake version 3.22.0"
        for name in ("apt-cache", "dpkg", "sleep", "cmake", *programs):
            self.stand_in(f"bin/{name}", programs.get(name, ""))
        self.does("python", PYTHON)
        self.does("uv", UV)

    def set_up(self, needs: str, **variables: str) -> tuple[subprocess.CompletedProcess, list[str]]:
        """Return the process, and the calls that install something."""
        given = {"DAHL_UNITY_DIR": f"{self.folder}/unity", "DAHL_PYTHON": "", **variables}
        done = self.run("setup", *needs.split(), **given)
        started = self.calls("apt-get", "python3.11", "python", "uv")
        return done, [call for call in started if re.search(r" install |\bvenv ", call)]
