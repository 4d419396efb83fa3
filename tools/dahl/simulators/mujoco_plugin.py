# SPDX-License-Identifier: MIT
"""Compile the plugin for the installed MuJoCo and load it.

The layout of MuJoCo's structures changes with its version. The plugin is therefore compiled on this
machine, once for each version, with the headers of the package mujoco.
"""

from __future__ import annotations

import hashlib
import os
import shlex
import subprocess
import tempfile
from pathlib import Path

from dahl import dependencies, paths
from dahl.binding import library
from dahl.errors import RunError

MIN_VERSION = 3, 8  # the oldest one that is tested; headers of 3.6 lack what the plugin needs
FOLDERS = [paths.PORT / name for name in ("mujoco", "simulators")]
FLAGS = "-std=c99 -O2 -fPIC -shared -ffp-contract=off".split()


def load() -> None:
    """Register dahl.friction. Raises dahl.RunError if a C compiler or MuJoCo is missing, or if
    MuJoCo is too old.
    """
    try:
        import mujoco
    except ImportError as error:
        reason = f"dahl.mujoco cannot import mujoco ({error})"
        raise RunError(f"{reason}; {dependencies.hint(['mujoco'], 'mujoco')}") from None
    if tuple(map(int, mujoco.__version__.split(".")[:2])) < MIN_VERSION:
        least = ".".join(map(str, MIN_VERSION))
        reason = f"dahl.mujoco needs MuJoCo {least} or later; this is {mujoco.__version__}"
        raise RunError(f"{reason}; {dependencies.hint([f'mujoco>={least}'], 'mujoco')}")
    library.load()  # the plugin finds the functions of libdahl.so in this process
    plugin = ensure_compiled(Path(mujoco.__file__).parent, mujoco.__version__)
    mujoco.mj_loadPluginLibrary(str(plugin))


def ensure_compiled(package: Path, version: str) -> Path:
    """Return the plugin for this MuJoCo. Compile it if the sources or the version are new."""
    files = [file for folder in (*FOLDERS, paths.INCLUDE) for file in folder.glob("*.[ch]")]
    content = b"".join(path.read_bytes() for path in sorted(files))
    folder = paths.ROOT / "build"
    if paths.INSTALLED:
        folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "dahl"
    name = f"dahl_friction-{version}-{hashlib.sha256(content).hexdigest()[:16]}.so"
    target = folder / "mujoco" / name
    if not target.exists():
        _compile(package, target)
    return target


def _compile(package: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    words = [*shlex.split(os.environ.get("CC") or "cc"), *FLAGS]
    words += [f"-I{paths.INCLUDE}", f"-I{package / 'include'}"]
    sources = [file for folder in FOLDERS for file in folder.glob("*.c")]
    words += map(str, [*sources, *package.glob("libmujoco.so*")])
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        part = Path(folder) / target.name  # another process may compile the same plugin
        try:
            done = subprocess.run(
                [*words, "-lm", "-o", str(part)], capture_output=True, text=True, check=False
            )
        except OSError as error:
            raise RunError(
                f"dahl.mujoco compiles its plugin at its first import, but cannot start {words[0]}"
                f" ({error.strerror}); install a C compiler, or set CC"
            ) from None
        if done.returncode != 0:
            raise RunError(f"{shlex.join(words)} failed: {done.stderr.strip()}")
        part.replace(target)
