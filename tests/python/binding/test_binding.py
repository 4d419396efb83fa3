# SPDX-License-Identifier: MIT
"""The binding to C: it declares each public function, and both ways to call give equal results."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from conftest import built
from dahl.binding.library import c

HERE = Path(__file__).parent
MOVES = """
import pickle
import sys
import numpy
from dahl.binding import library
sys.path[:0] = sys.argv[2:]
if sys.argv[1] == "libffi":
    library._load_compiled = lambda: None
assert ("'_dahl'" in repr(library.load()[1])) == (sys.argv[1] == "module")
from test_public_classes import KINDS
for kind in KINDS.values():
    one = kind.make()
    for _ in range(3 if kind.move else 0):
        print(kind.move(one))
    print(repr(pickle.loads(pickle.dumps(one))))
    if hasattr(one, "run_counts") and "Loaded" not in repr(one):
        print(one.run_counts(numpy.arange(-50, 50)).tobytes().hex())
"""


def test_each_public_function_is_declared(root: Path) -> None:
    headers = "".join(path.read_text() for path in (root / "lib/include").glob("*.h"))
    code = re.sub(r"/\*.*?\*/", "", headers, flags=re.S)
    symbols = ["nm", "-D", "--defined-only", built("lib", "libdahl.so")]
    done = subprocess.run(symbols, capture_output=True, text=True, check=True)
    exported = set(re.findall(r" T (dahl_\w+)", done.stdout))
    public = exported & set(re.findall(r"\b(dahl_\w+)\(", code))
    assert len(public) > 70
    assert [name for name in public if not callable(getattr(c, name))] == []


def test_the_compiled_module_and_libffi_give_equal_results() -> None:
    outputs = []
    for way in ("module", "libffi"):
        words = [sys.executable, "-c", MOVES, way, HERE, HERE.parent]
        done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=60)
        assert done.returncode == 0, done.stderr
        outputs.append(done.stdout)
    assert outputs[0] == outputs[1] and len(outputs[0].splitlines()) > 40
