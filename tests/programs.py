# SPDX-License-Identifier: MIT
"""Programs that tests start, and C that they compile."""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path
from typing import Any

STRICT = ["-std=c11", "-Wall", "-Wextra", "-pedantic", "-Wconversion", "-Werror", "-O1"]


def run(*command: object, code: int = 0, **more: Any) -> str:
    """Run a command that must exit with this code; return its output, or its errors if code > 0."""
    words = [str(word) for word in command]
    done = subprocess.run(words, capture_output=True, text=True, check=False, **more)
    assert done.returncode == code, f"{' '.join(words)}\n{(done.stdout + done.stderr)[-9000:]}"
    return done.stderr if code else done.stdout


def shared_object(folder: Path, *words: object) -> ctypes.CDLL:
    """Compile C with these files and flags in the folder, and load it."""
    run("gcc", *STRICT, "-shared", "-fPIC", *words, "-o", folder / "made.so")
    return ctypes.CDLL(str(folder / "made.so"))
