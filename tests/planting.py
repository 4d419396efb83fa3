# SPDX-License-Identifier: MIT
"""How a fault is planted: in a copy of the sources, in one place of one file. The check that is run
on the copy must fail.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from pathlib import Path

from conftest import ROOT

SOURCES = ("lib", "port", "host_sim")


def copy(folder: Path, parts: Iterable[str] = SOURCES) -> Path:
    """Parts of the project in a folder of their own, the same way from one to the other."""
    for part in parts:
        shutil.copytree(ROOT / part, folder / part, dirs_exist_ok=True)
    return folder


def edit(file: Path, old: str, new: str) -> None:
    """Replace the one place where `old` stands; that there is one is part of the test."""
    text = file.read_text(encoding="utf-8")
    assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in {file.name}"
    file.write_text(text.replace(old, new), encoding="utf-8")
