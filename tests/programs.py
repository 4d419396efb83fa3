# SPDX-License-Identifier: MIT
"""Programs that tests start, and C that they compile."""

import ctypes
import subprocess
from pathlib import Path
from typing import Any

STRICT = ["-std=c11", "-Wall", "-Wextra", "-pedantic", "-Wconversion", "-Werror", "-O1"]


def call(*command: object, **more: Any) -> subprocess.CompletedProcess[str]:
    """Run a command to its end, with any exit code."""
    words = [str(word) for word in command]
    return subprocess.run(words, capture_output=True, text=True, check=False, **more)


def run(*command: object, code: int = 0, **more: Any) -> str:
    """Run a command that must exit with this code; return its output, or its errors if code > 0."""
    done = call(*command, **more)
    text = (done.stdout + done.stderr)[-9000:]
    assert done.returncode == code, f"{' '.join(map(str, command))}\n{text}"
    return done.stderr if code else done.stdout


def shared_object(folder: Path, *words: object) -> ctypes.CDLL:
    """Compile C with these files and flags in the folder, and load it."""
    run("gcc", *STRICT, "-shared", "-fPIC", *words, "-o", folder / "made.so")
    return ctypes.CDLL(str(folder / "made.so"))
