# SPDX-License-Identifier: MIT
"""Compare this Python environment with what is pinned: `check_venv.py LOCK...`

Every package of the locks must be there in its version, and every file that it installed, of the
size that it had. Prints what is not so. Exit code 0: all is there; 3: packages are lacking or of
another version; 4: files are lacking or changed.
"""

from __future__ import annotations

import csv
import re
import sys
import sysconfig
from collections.abc import Iterator
from pathlib import Path

from pip._vendor.packaging.requirements import Requirement
from pip._vendor.packaging.utils import canonicalize_name

LACKING, DAMAGED = 3, 4
PIN = re.compile(r"^([^\s#=]+==[^\\]+)", re.MULTILINE)


def pins(lock: Path) -> Iterator[tuple[str, str]]:
    """Name and version of each package that the lock wants on this machine."""
    for line in PIN.findall(lock.read_text()):
        wanted = Requirement(line.strip())
        if wanted.marker is None or wanted.marker.evaluate():
            yield canonicalize_name(wanted.name), next(iter(wanted.specifier)).version


def installed(site: Path) -> dict[tuple[str, str], Path]:
    """The .dist-info folder of each installed package, by name and version."""
    found: dict[tuple[str, str], Path] = {}
    for folder in site.glob("*.dist-info"):
        name, _, version = folder.name.removesuffix(".dist-info").rpartition("-")
        found[canonicalize_name(name), version] = folder
    return found


def changed_files(site: Path, folder: Path) -> Iterator[str]:
    """Files of one package that are not there, or not of the size that was noted."""
    record = folder / "RECORD"
    if not record.exists():
        yield str(record)
        return
    with record.open(newline="") as rows:
        for name, _, size in csv.reader(rows):
            path = site / name
            if size and not (path.exists() and path.stat().st_size == int(size)):
                yield name


def compare(site: Path, locks: list[Path]) -> tuple[list[str], list[str]]:
    """What is lacking in a folder of packages, and which files in it have changed."""
    there = installed(site)
    wanted = {pin for lock in locks for pin in pins(lock)}
    lacking = [f"{name} {version}" for name, version in sorted(wanted - there.keys())]
    if not any(name == "dahl" for name, _ in there):
        lacking.append("dahl")
    changed = [name for pin in wanted & there.keys() for name in changed_files(site, there[pin])]
    return lacking, changed


def main(locks: list[str]) -> int:
    lacking, changed = compare(Path(sysconfig.get_path("purelib")), [Path(lock) for lock in locks])
    for name in lacking:
        print(f"lacking: {name}")
    for name in changed:
        print(f"changed: {name}")
    return DAMAGED if changed else LACKING if lacking else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
