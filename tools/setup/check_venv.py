# SPDX-License-Identifier: MIT
"""Compare this Python environment with a requirements file: `check_venv.py FILE`

Each package of the file must be installed in its version, and each installed file must have its
recorded size. Prints the differences. Exit code 0: no difference; 3: packages are missing or have
another version; 4: files are missing or changed.
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

MISSING, DAMAGED = 3, 4
PIN = re.compile(r"^([^\s#=]+==[^\\]+)", re.MULTILINE)


def pins(requirements: Path) -> Iterator[tuple[str, str]]:
    """Yield name and version of each package that this machine needs."""
    for line in PIN.findall(requirements.read_text()):
        pin = Requirement(line.strip())
        if pin.marker is None or pin.marker.evaluate():
            yield canonicalize_name(pin.name), next(iter(pin.specifier)).version


def installed(site: Path) -> dict[tuple[str, str], Path]:
    """Return the .dist-info folder of each installed package, by name and version."""
    found: dict[tuple[str, str], Path] = {}
    for folder in site.glob("*.dist-info"):
        name, _, version = folder.name.removesuffix(".dist-info").rpartition("-")
        found[canonicalize_name(name), version] = folder
    return found


def changed_files(site: Path, folder: Path) -> Iterator[str]:
    """Yield the files of one package that are missing or have another size."""
    record = folder / "RECORD"
    if not record.exists():
        yield str(record)
        return
    with record.open(newline="") as rows:
        for name, _, size in csv.reader(rows):
            path = site / name
            if size and not (path.exists() and path.stat().st_size == int(size)):
                yield name


def compare(site: Path, requirements: Path) -> tuple[list[str], list[str]]:
    """Return the packages that are missing in a folder, and the changed files in it."""
    present = installed(site)
    required = set(pins(requirements))
    missing = [f"{name} {version}" for name, version in sorted(required - present.keys())]
    if not any(name == "dahl" for name, _ in present):
        missing.append("dahl")
    both = required & present.keys()
    changed = [name for pin in both for name in changed_files(site, present[pin])]
    return missing, changed


def main(requirements: str) -> int:
    missing, changed = compare(Path(sysconfig.get_path("purelib")), Path(requirements))
    for name in missing:
        print(f"missing: {name}")
    for name in changed:
        print(f"changed: {name}")
    return DAMAGED if changed else MISSING if missing else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
