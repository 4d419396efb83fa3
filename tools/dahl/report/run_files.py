# SPDX-License-Identifier: MIT
"""The files that dahl has written into the folder of a run, so that the next run can remove them.

The folder has a list of them, with size and time of change. A file that has changed since, or that
is not in the list, is not removed: it may be the user's. If the next run writes a file of its name,
it is renamed.
"""

from __future__ import annotations

import contextlib
import json
import stat
from collections.abc import Iterable, Iterator
from pathlib import Path

from dahl.errors import Error
from dahl.io import files

LIST = ".dahl-files.json"
WRITTEN = (  # by a demo, `dahl plot` and `dahl report`
    *("own.ini", "own.csv", "hub.ini", "run.log", "trace.csv"),
    *("faultless.log", "uncompensated.csv"),
    *(f"{role}.err" for role in ("node", "encoder", "both")),
    *("params.*.bin", "qemu.*.err", "summary.json", "report.html"),
    *("loop.png", "commission.png", "compensation.png", "park-steer.png"),
)
Stamp = list[int]  # size in bytes, time of change in ns


def written_in(folder: Path) -> list[Path]:
    """Return the files of a folder with names that dahl writes."""
    return [path for name in WRITTEN for path in folder.glob(name)]


def _stamp(path: Path) -> Stamp | None:
    """None if it is no regular file."""
    try:
        status = path.lstat()
    except OSError:
        return None
    return [status.st_size, status.st_mtime_ns] if stat.S_ISREG(status.st_mode) else None


def _stamps(folder: Path) -> dict[str, Stamp]:
    pairs = ((path.name, _stamp(path)) for path in written_in(folder))
    return {name: stamp for name, stamp in pairs if stamp}


def _read(folder: Path) -> dict[str, Stamp]:
    """Return the list of a folder, of files that exist and have names that dahl writes; empty if
    there is no list. Any program may have written it.
    """
    try:
        known = files.read_json(folder / LIST)
    except Error:
        return {}
    names = {path.name for path in written_in(folder)}
    pairs = known.items() if isinstance(known, dict) else ()
    return {name: stamp for name, stamp in pairs if name in names}


def _write(folder: Path, known: dict[str, Stamp]) -> None:
    if known:
        files.write_atomic(folder / LIST, json.dumps(known, indent=2) + "\n")
    else:
        (folder / LIST).unlink(missing_ok=True)


@contextlib.contextmanager
def track(folder: Path) -> Iterator[None]:
    """Add to the list the files that are written meanwhile, also if that fails."""
    before = _stamps(folder)
    try:
        yield
    finally:
        now = _stamps(folder)
        changed = {name: stamp for name, stamp in now.items() if before.get(name) != stamp}
        with contextlib.suppress(Error):  # of a full disk; then the files stay
            _write(folder, _read(folder) | changed)


def add(path: Path) -> None:
    """Add a file to the list of its folder, if there is a list and dahl chose its name."""
    stamp, folder = _stamp(path), path.parent
    if stamp and (folder / LIST).is_file() and path in written_in(folder):
        _write(folder, _read(folder) | {path.name: stamp})


def remove_earlier(folder: Path, spared: Iterable[Path] = ()) -> None:
    """Remove the files in the list that have not changed since, except those that are read."""
    kept = {}
    for name, stamp in _read(folder).items():
        path = folder / name
        if stamp != _stamp(path):
            continue
        if any(one.exists() and one.samefile(path) for one in spared):
            kept[name] = stamp
        else:
            path.unlink()
    _write(folder, kept)


def set_aside(folder: Path, *names: str) -> None:
    """Rename files of these names to NAME~ if they are not in the list, or have changed since."""
    known = _read(folder)
    for path in (folder / name for name in names):
        stamp = _stamp(path)
        if path.is_file() and (stamp is None or known.get(path.name) != stamp):
            path.replace(path.with_name(f"{path.name}~"))
