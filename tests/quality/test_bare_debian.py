# SPDX-License-Identifier: MIT
"""tools/demo.sh on a bare Debian: time, disk space, and packages that it must not install."""

import json
from pathlib import Path

import pytest
from programs import call

SECONDS = 60
DEBIAN_MB, PYTHON_MB = 375, 300
FOREIGN = ("chromium", "cbmc", "qemu-system-arm", "arm-none-eabi-gcc", "clang", "g++", "git")


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_the_demo_on_a_bare_debian(root: Path, tmp_path: Path) -> None:
    script = root / "tests/quality/bare_debian.sh"
    done = call(script, tmp_path, "--scene", "steering", "--seconds", "3")
    print(done.stdout, done.stderr)
    lines = done.stdout.splitlines()
    if done.returncode == 77:
        pytest.skip(lines[-1])
    assert done.returncode == 0
    numbers = {name: int(number) for name, number in (line.split(": ") for line in lines[-5:])}
    assert numbers["setup_seconds"] <= SECONDS
    assert numbers["again_seconds"] <= 2
    assert numbers["debian_mb"] <= DEBIAN_MB
    assert numbers["python_mb"] <= PYTHON_MB
    system = tmp_path / "system"
    assert not [tool for tool in FOREIGN if list(system.glob(f"usr/bin/{tool}"))]
    summary = json.loads((system / "dahl/build/demo/summary.json").read_text())
    assert summary
    for name in ("loop.png", "run.log"):
        assert (system / "dahl/build/demo" / name).stat().st_size > 1000
