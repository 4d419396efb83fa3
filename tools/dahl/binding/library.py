# SPDX-License-Identifier: MIT
"""The C library by cffi. declarations.cdef has the declarations of the public headers.

`c.dahl_step_counts` is the function of that name, `c.new` makes a structure. The library is loaded
when the first of these names is used, so that importing this module is quick.
"""

from __future__ import annotations

import ctypes
from functools import cache
from importlib.machinery import ExtensionFileLoader, ModuleSpec
from pathlib import Path
from typing import Any

from dahl import paths
from dahl.errors import RunError


class Library:
    """Functions and enumerators of the headers, and new, buffer, ... of cffi, by name."""

    def __getattr__(self, name: str) -> Any:
        ffi, functions = load()
        value = getattr(functions if name.startswith(("dahl_", "DAHL_")) else ffi, name)
        setattr(self, name, value)  # the next use is an attribute without this call
        return value


c = Library()
DECLARATIONS = Path(__file__).with_name("declarations.cdef")


@cache
def load() -> tuple[Any, Any]:
    """cffi's FFI and the functions: of the compiled module if the build made one, else by libffi.
    Raises dahl.RunError for a missing library and for a file that is not this library.
    """
    path = paths.library()
    try:
        ctypes.CDLL(str(path), ctypes.RTLD_GLOBAL)  # the module finds its functions in it
        ffi, functions = _load_compiled() or _load_parsed(path)
        getattr(functions, "dahl_prepare")  # noqa: B009  (another library lacks it)
        return ffi, functions
    except (OSError, AttributeError) as error:
        raise RunError(f"{path}: not the shared library of dahl ({error})") from None


def _load_compiled() -> tuple[Any, Any] | None:
    """Return FFI and functions of the module, or None if this interpreter cannot load it."""
    path = paths.binding_module()
    loader = ExtensionFileLoader("_dahl", str(path))
    try:
        module: Any = loader.create_module(ModuleSpec("_dahl", loader, origin=str(path)))
    except ImportError:
        return None
    return module.ffi, module.lib


def _load_parsed(library: Path) -> tuple[Any, Any]:
    from cffi import FFI

    ffi = FFI()
    ffi.cdef(DECLARATIONS.read_text(encoding="utf-8"))
    return ffi, ffi.dlopen(str(library))
