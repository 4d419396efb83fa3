# SPDX-License-Identifier: MIT
"""A folder for the scripts of tools/ in which every program that they call is a stand-in: it notes
its words, then does what the test says. On top of it a Debian that has nothing installed yet.
"""

from __future__ import annotations

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
    """The folder: tools/ as it is, stand-ins in bin/ and where a test puts more."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        shutil.copytree(ROOT / "tools", folder / "tools", ignore=shutil.ignore_patterns("__py*"))
        shutil.copy(ROOT / "pyproject.toml", folder)
        (folder / "note").write_text(NOTE)
        (folder / "note").chmod(0o755)

    @property
    def path(self) -> str:
        return f"{self.folder}/bin:{os.environ['PATH']}"

    def stand_in(self, name: str, does: str = "") -> None:
        """For the program at this place in the folder."""
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.unlink(missing_ok=True)
        path.symlink_to(self.folder / "note")
        self.does(path.name, does)

    def does(self, name: str, words: str) -> None:
        """What the stand-in of that name does from now on, in bash."""
        (self.folder / f"{name}.does").write_text(words + "\n")

    def run(self, script: str, *words: str, **variables: str) -> subprocess.CompletedProcess:
        return subprocess.run(
            [self.folder / "tools" / f"{script}.sh", *words],
            env={**os.environ, "STAGE": str(self.folder), "PATH": self.path, **variables},
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
            stdin=subprocess.DEVNULL,
        )

    def calls(self, *programs: str) -> list[str]:
        """Of these programs, of all if none is named, in order; paths begin at the folder."""
        noted = self.folder / "calls"
        text = noted.read_text() if noted.exists() else ""
        lines = text.replace(f"{self.folder}/", "").splitlines()
        return [line for line in lines if not programs or line.split()[0] in programs]

    def forget(self) -> None:
        """The calls so far."""
        (self.folder / "calls").unlink(missing_ok=True)

    def lines(self, file: str) -> list[str]:
        """Of a file in the folder, none where there is no such file."""
        path = self.folder / file
        return path.read_text().splitlines() if path.exists() else []


# Packages are what the file `installed` names; apt-get adds to it what the file `known` names.
APT = """case "$*" in
    *--print-uris*)
        . /etc/os-release
        echo "'file:$STAGE/dists/$VERSION_CODENAME/InRelease' InRelease" ;;
    *" install "*)
        words=$*
        words=(${words##* install })
        for n in "${!words[@]}"; do [[ "${words[n]}" != -* ]] || unset "words[$n]"; done
        ! printf '%s\\n' "${words[@]}" | grep -qvxFf "$STAGE/known" || exit 100
        printf '%s\\n' "${words[@]}" >>"$STAGE/installed" ;;
esac"""
DPKG = """sed 's/^/installed /' "$STAGE/installed" """
PYTHON = """case "$*" in
    *"-m venv "*) mkdir -p "$3/bin"; ln -s "$STAGE/note" "$3/bin/python" ;;
    *check_venv*) exit "$(cat "$STAGE/state")" ;;
esac"""
UNITY = ("unity.c", "unity.h", "unity_internals.h")


class Debian(Stage):
    """A Debian with dpkg-dev alone; what setup.sh may want is known to apt-get, and each source
    answers.
    """

    def __init__(self, folder: Path) -> None:
        if not Path("/usr/lib/apt/apt-helper").exists():
            pytest.skip("unproven: what setup.sh does on Debian: this is none")
        super().__init__(folder)
        needs = (folder / "tools/setup/needs.sh").read_text()
        self.write("known", *re.findall(r"[a-z0-9][\w+.-]+", needs))
        self.write("installed", "dpkg-dev")
        self.write("state", "0")  # of the Python environment, by check_venv.py
        self.own_unity = self.folder / "unity"
        self.own_unity.mkdir()
        for file in UNITY:
            (self.own_unity / file).write_text("mine")
        self.write(f"dists/{codename()}/InRelease")
        self.stand_in("bin/apt-get", APT)
        self.stand_in("bin/dpkg-query", DPKG)
        self.stand_in("bin/python3.11", PYTHON)
        self.does("python", PYTHON)
        self.stand_in("bin/sudo", '"$@"')
        for name in ("apt-cache", "dpkg", "sleep", "cmake"):
            self.stand_in(f"bin/{name}")

    def write(self, file: str, *lines: str) -> None:
        path = self.folder / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("".join(f"{line}\n" for line in lines))

    def unknown(self, package: str) -> None:
        """From now on apt-get does not know it."""
        self.write("known", *(name for name in self.lines("known") if name != package))

    def set_up(self, needs: str, **variables: str) -> tuple[subprocess.CompletedProcess, list[str]]:
        """The run, and what it started that installs something."""
        self.forget()
        own = {"DAHL_UNITY_DIR": str(self.own_unity), "DAHL_PYTHON": "", **variables}
        done = self.run("setup", *needs.split(), **own)
        for call in self.calls("apt-get"):  # each setting stands behind its -o
            words = call.split()
            assert all(words[n - 1] == "-o" for n, word in enumerate(words) if "::" in word), call
        started = self.calls("apt-get", "python3.11", "python")
        return done, [call for call in started if re.search(r" install | venv ", call)]


def codename() -> str:
    """Of this machine's Debian."""
    text = Path("/etc/os-release").read_text()
    found = re.search(r"^VERSION_CODENAME=(.*)", text, re.M)
    return found[1] if found else "none"
