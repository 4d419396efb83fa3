# SPDX-License-Identifier: MIT
"""Write the C source of the Python extension module `_dahl` from declarations of the headers.

Usage: binding.py DECLARATIONS HEADER... OUTPUT.c   (tools/binding.cmake runs it)

cffi writes the module: Python then calls each function of the library directly, without libffi.
"""

from __future__ import annotations

import sys
from pathlib import Path

from cffi import FFI


def main(declarations: str, *headers_and_output: str) -> None:
    *headers, output = headers_and_output
    ffi = FFI()
    ffi.cdef(Path(declarations).read_text(encoding="utf-8"))
    includes = "".join(f'#include "{header}"\n' for header in headers)
    ffi.set_source("_dahl", includes, py_limited_api=True)
    ffi.emit_c_code(output)


if __name__ == "__main__":
    main(*sys.argv[1:])
