# SPDX-License-Identifier: MIT
"""Find measured sets by name: in $DAHL_DATA, in ../shared/data next to the project, in the cache,
on the network.

A download is pinned to a commit and to one sha256 for each file, checked after cutting and before
use.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from dahl import paths
from dahl.errors import Error, InputError, RunError

SOURCE = "https://raw.githubusercontent.com/{repo}/{commit}/{path}"  # or $DAHL_DATA_URL
DOWNLOAD_TIMEOUT_S = 15  # without an answer


@dataclass(frozen=True)
class File:
    """One file: its name here, sha256 as used, path upstream, and how it is cut out of the upstream
    file.
    """

    name: str
    sha256: str
    path: str
    cut: Callable[[bytes], bytes] | None = None


@dataclass(frozen=True)
class Set:
    """One measured set. Without a commit it is derived from its source and cannot be downloaded."""

    what: str
    licence: str
    repo: str
    commit: str = ""
    files: tuple[File, ...] = ()


def cut_tribometer(text: bytes) -> bytes:
    """Return the header and the rows with 8.6 s <= t < 129 s of the upstream test_data_2.txt."""
    header, *rows = text.decode("ascii").splitlines()
    kept = [row for row in rows if row and 8.6 <= float(row.split("\t")[0]) < 129]
    return ("\n".join([header, *kept]) + "\n").encode("ascii")


def _as_upstream(folder: str, names: dict[str, str], prefix: str = "") -> tuple[File, ...]:
    """Files that are used byte by byte as they are upstream."""
    return tuple(File(prefix + name, sha256, f"{folder}/{name}") for name, sha256 in names.items())


SETS = {
    "tribometer": Set(
        "reciprocating friction rig, 30 cycles, 200 Hz, 0.1 um; F = -Friction",
        "MIT",
        "jchristopherson/FrictionModels.jl",
        "e60a4bd245dfc96aeb7045998a535f9bcb24cb0c",
        (
            File(
                "reciprocating.tsv",
                "8c32c40c0eb2e302de4bdbfd6ff7898b813658195adb9497d4d1943a33ae84df",
                "examples/test_data_2.txt",
                cut_tribometer,
            ),
        ),
    ),
    "cycloidal": Set(
        "rotary actuator with a printed cycloidal reducer, output locked, slow torque ramps",
        "CC BY-SA 4.0",
        "JelmerV/Anti-Backlash-Cycloidal-Actuator (read back from its figures)",
    ),
    "friction_damper": Set(
        "banded rotary friction damper with backlash, sinusoids, 1024 Hz",
        "CC BY-SA 4.0",
        "ARTS-Laboratory/Dataset-Friction-Damper-with-Backlash",
        "0e09aa9d950760277e31c08cd93fd01f39a5af09",
        _as_upstream(
            "data/dataset-1/characterization datasets",
            {
                "0.5Hz80lbtension.json": "746d23b401d606e408d5833568dfd61039675729a226f57864b3620815397dca",
            },
            "dataset-1_",
        )
        + _as_upstream(
            "data/dataset-3/characterization tests",
            {
                "0.5Hz30lbtension0.5amplitude.json": "5c5d33664239122c251a3f5a66f65f56ce5a02b00649126341d3ffe114bba0d0",
            },
            "dataset-3_",
        )
        + _as_upstream(
            "data/dataset-4",
            {
                "harmonic0.015forward.json": "7e61d7553139ff14e61ddc619c16864bc59c5f2f761dab1fe0ab03b006ff05ab",
            },
            "dataset-4_",
        ),
    ),
    "pneumatic": Set(
        "seal friction of 3D printed cylinders, about 95 Hz, no header; position has spikes",
        "CC0 1.0",
        "EvaZillen/3D-printed-pneumatic-actuator",
        "6e0bcb4633bd53b2a8544cdbd497c4c06539afc7",
        _as_upstream(
            "results_pneumatic-actuator/data/friction",
            {
                "Circle_1bar.csv": "b795d01ad801c0a4222ca0bd4fa561dbbb7a3c87546b0e2cbdc13efc2c9c874b",
                "Circle_5bar.csv": "163b266a3ae723b4d3d8be90ad50f3caca390fa5e76ff13a7c5287a1c8502755",
                "PK_3bar.csv": "1b8279a4350d3f4ebadde61637fd80a0dabd0345056a07250625b26471edd004",
            },
        ),
    ),
    "servo_pendulum": Set(
        "XL330 servo lifting a pendulum; load wraps at 16 bits",
        "Apache-2.0",
        "Rhoban/bam",
        "af2260462471ff45ac18af159b1327ea51d8db15",
        _as_upstream(
            "bam/data.bak/raw",
            {
                "2026-01-15_10h28m10.json": "e58f3c2a08a5e0e37a2c5e930d0830a438bc102b8d21482767124f495b92f2ce",
                "2026-01-15_10h29m04.json": "7996c43314a9f60094a6119346b54ff9ff84cb6726c967f4a88a7175278f6515",
            },
        ),
    ),
    "nested_loops": Set(
        "steel yielding damper, growing nested loops", "Apache-2.0", "cslotboom/hysteresis (a copy)"
    ),
    "can_steering": Set(
        "CAN log of a parked car, steering frames, as log, asc and blf",
        "CC0 1.0",
        "projectgus/hyundai-kona-ev-can-logs (a subset)",
    ),
}


def named(name: str) -> Set:
    """Return a set by name. Raises dahl.Error that lists all sets."""
    if name not in SETS:
        raise InputError(f"no measured set '{name}' (there are: {', '.join(SETS)})")
    return SETS[name]


def cache_folder() -> Path:
    """Return the folder of downloads: the cache folder of the user, by pooch ($XDG_CACHE_HOME)."""
    import pooch

    return Path(pooch.os_cache("dahl"))


def local_folder(name: str) -> Path | None:
    """Return the folder of a set on this machine, or None."""
    named(name)
    beside = None if paths.INSTALLED else paths.ROOT.parent / "shared" / "data"
    roots: list[str | Path | None] = [os.environ.get("DAHL_DATA"), beside]
    for root in roots:
        if root and (Path(root) / name).is_dir():
            return Path(root) / name
    kept = cache_folder() / name
    return kept if _is_whole(kept, SETS[name]) else None


def folder(name: str) -> Path:
    """Return the folder of a set; download it if it is not on this machine. Raises dahl.Error or
    dahl.RunError if that fails.
    """
    found = local_folder(name)
    if found:
        return found
    try:
        return download(name)
    except Error as error:  # a RunError is one too
        root = os.environ.get("DAHL_DATA")
        raise type(error)(f"{error}; {root} (DAHL_DATA) has no {name}" if root else error) from None


def _is_whole(kept: Path, wanted: Set) -> bool:
    return bool(wanted.files) and all((kept / file.name).is_file() for file in wanted.files)


def download(name: str) -> Path:
    """Fetch a set into the cache. Each file gets its name only once its sha256 is right."""
    wanted = named(name)
    if not wanted.commit:
        raise InputError(
            f"set '{name}' is derived from {wanted.repo} and cannot be downloaded;"
            " point DAHL_DATA at the folder that holds it"
        )
    target = cache_folder() / name
    target.mkdir(parents=True, exist_ok=True)
    for file in wanted.files:
        if not (target / file.name).is_file():
            _fetch(wanted, file, target)
    return target


def _fetch(wanted: Set, file: File, target: Path) -> None:
    import pooch

    pattern = os.environ.get("DAHL_DATA_URL", SOURCE)
    url = pattern.format(repo=wanted.repo, commit=wanted.commit, path=quote(file.path))
    pooch.get_logger().setLevel("ERROR")
    try:
        raw = Path(
            pooch.retrieve(
                url,
                None if file.cut else file.sha256,
                fname=f"{file.name}.upstream",
                path=target,
                downloader=pooch.HTTPDownloader(timeout=DOWNLOAD_TIMEOUT_S),
            )
        )
    except ValueError as error:
        raise RunError(f"{url}: {error}") from None
    except OSError as error:  # what requests raises is one too
        raise RunError(f"{url} cannot be fetched: {type(error).__name__}") from None
    _store_file(raw, file, target, url)


def _store_file(raw: Path, file: File, target: Path, url: str) -> None:
    content = raw.read_bytes()
    raw.unlink()
    if file.cut:
        try:
            content = file.cut(content)
        except (ValueError, UnicodeDecodeError):
            raise RunError(f"{url}: not the file that was expected") from None
    found = hashlib.sha256(content).hexdigest()
    if found != file.sha256:
        raise RunError(f"{url}: sha256 of {file.name} is {found}, expected {file.sha256}")
    part = target / f"{file.name}.part"
    part.write_bytes(content)
    part.replace(target / file.name)


def find_log(relative: str, beside: Path) -> Path:
    """Return the log of a scene: an absolute path, a file in the folder of the scene, or SET/FILE
    of a measured set.

    Raises dahl.Error or dahl.RunError if it cannot be found.
    """
    path = beside / relative
    if path.is_file():
        return path
    name, _, rest = relative.partition("/")
    if Path(relative).is_absolute() or name not in SETS:
        raise InputError(f"{path}: no such file")
    found = folder(name) / rest
    if not found.is_file():
        raise InputError(f"{found}: no such file in the measured set '{name}'")
    return found
