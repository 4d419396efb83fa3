# SPDX-License-Identifier: MIT
"""Archives whose bytes depend on names, modes and contents of the files alone.

Members are sorted, belong to nobody, and have the time of the commit.
"""

from __future__ import annotations

import gzip
import io
import os
import tarfile
import time
import zipfile
from collections.abc import Iterable
from pathlib import Path


def files_below(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def mode_of(path: Path) -> int:
    return 0o755 if os.access(path, os.X_OK) else 0o644


def write_zip(archive: Path, folder: Path, seconds: int) -> None:
    """Write all files below a folder; names start at the folder."""
    moment = time.gmtime(seconds)[:6]
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as out:
        for path in files_below(folder):
            member = zipfile.ZipInfo(path.relative_to(folder).as_posix(), moment)
            member.create_system = 3  # Unix, so that the modes count
            member.external_attr = mode_of(path) << 16
            out.writestr(member, path.read_bytes(), zipfile.ZIP_DEFLATED)


def write_tar(archive: Path, folder: Path, files: Iterable[Path], seconds: int) -> None:
    """Write files, with their names below the folder, as .tar.gz."""
    plain = io.BytesIO()
    with tarfile.open(fileobj=plain, mode="w", format=tarfile.USTAR_FORMAT) as out:
        for path in sorted(files):
            member = tarfile.TarInfo(path.relative_to(folder).as_posix())
            member.size, member.mode, member.mtime = path.stat().st_size, mode_of(path), seconds
            out.addfile(member, io.BytesIO(path.read_bytes()))
    archive.write_bytes(gzip.compress(plain.getvalue(), mtime=0))
