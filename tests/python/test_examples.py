# SPDX-License-Identifier: MIT
"""The examples that need no emulator, run as their page says."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest


@pytest.fixture
def node(dahl_loop, root):
    """A node on the desk that serves one client, and the port that it serves on."""
    command = [dahl_loop, "--scene", root / "host_sim/scenes/segments.ini", "--role", "node"]
    command += ["--bus", "socketcand:0", "--wait-clients", "1", "--until-idle"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        yield re.search(r":(\d+) ", process.stdout.readline())[1]
        process.kill()


def test_python_can_asks_a_node(node, root, tmp_path):
    text = (root / "examples/python_can/test_node.py").read_text()
    assert '"port": 28600' in text
    (tmp_path / "test_node.py").write_text(text.replace("28600", node))
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    command += ["--rootdir", tmp_path, tmp_path / "test_node.py"]
    done = subprocess.run(
        command, cwd=root, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0 and "1 passed" in done.stdout, done.stdout
