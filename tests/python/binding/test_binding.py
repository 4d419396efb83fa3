# SPDX-License-Identifier: MIT
"""The binding to C: it declares each public function, and both ways to call give equal results."""

import re
import sys
from pathlib import Path

from conftest import built
from dahl.binding.library import c
from programs import run

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
    symbols = run("nm", "-D", "--defined-only", built("lib", "libdahl.so"))
    exported = set(re.findall(r" T (dahl_\w+)", symbols))
    public = exported & set(re.findall(r"\b(dahl_\w+)\(", code))
    assert len(public) > 70
    assert [name for name in public if not callable(getattr(c, name))] == []


def test_the_compiled_module_and_libffi_give_equal_results() -> None:
    by_module, by_libffi = (
        run(sys.executable, "-c", MOVES, way, HERE, HERE.parent) for way in ("module", "libffi")
    )
    assert by_module == by_libffi and len(by_module.splitlines()) > 40
