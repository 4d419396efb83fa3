# SPDX-License-Identifier: MIT
"""Programs that tests start."""

from __future__ import annotations

import subprocess
from typing import Any


def run(*command: object, code: int = 0, **more: Any) -> str:
    """Run a command that must exit with this code; return its output, or its errors if code > 0."""
    words = [str(word) for word in command]
    done = subprocess.run(words, capture_output=True, text=True, check=False, **more)
    assert done.returncode == code, f"{' '.join(words)}\n{(done.stdout + done.stderr)[-9000:]}"
    return done.stderr if code else done.stdout
