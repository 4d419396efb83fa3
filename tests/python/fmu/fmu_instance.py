# SPDX-License-Identifier: MIT
"""An instance of an FMU, called as a simulator calls it: by the functions of its shared object."""

from __future__ import annotations

import ctypes
import tempfile
import zipfile
from ctypes import c_char_p, c_double, c_int, c_size_t, c_uint, c_void_p
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

OK, ERROR = 0, 3
CO_SIMULATION = 1
LOGGER = ctypes.CFUNCTYPE(None, c_void_p, c_char_p, c_int, c_char_p, c_char_p)


class Callbacks(ctypes.Structure):
    _fields_ = (("logger", LOGGER), *((name, c_void_p) for name in ("a", "f", "s", "e")))


class Instance:
    """`messages` are the errors that it sent."""

    def __init__(self, fmu: Path, binary: Path | None = None, **wrong: Any) -> None:
        with zipfile.ZipFile(fmu) as content:
            self.xml = ET.fromstring(content.read("modelDescription.xml"))
            (name,) = (one for one in content.namelist() if one.startswith("binaries/"))
            folder = tempfile.mkdtemp(dir=fmu.parent)  # each instance loads a file of its own
            self.functions = ctypes.CDLL(binary or content.extract(name, folder))
        rows = self.xml.iter("ScalarVariable")
        self.references = {row.get("name"): int(row.get("valueReference")) for row in rows}
        self.messages: list[str] = []
        self.callbacks = Callbacks(LOGGER(self._log))
        self.functions.fmi2Instantiate.restype = c_void_p
        guid = wrong.get("guid", self.xml.get("guid")).encode()
        words = b"one", wrong.get("kind", CO_SIMULATION), guid, b"file:///"
        made = self.functions.fmi2Instantiate(*words, ctypes.byref(self.callbacks), 0, 0)
        self.component = c_void_p(made)

    def _log(self, _: object, name: bytes, status: int, category: bytes, message: bytes) -> None:
        assert (name, status, category) == (b"one", ERROR, b"logStatusError")
        self.messages.append(message.decode("ascii"))

    def call(self, name: str, *arguments: Any) -> int:
        return int(getattr(self.functions, f"fmi2{name}")(self.component, *arguments))

    def initialize(self, **values: float) -> Instance:
        assert self.call("SetupExperiment", 0, c_double(0), c_double(0), 0, c_double(0)) == OK
        assert self.call("EnterInitializationMode") == OK and self.set(**values) == OK
        assert self.call("ExitInitializationMode") == OK
        return self

    def set(self, **values: float) -> int:
        references = (c_uint * len(values))(*(self.references[name] for name in values))
        return self.call("SetReal", references, c_size_t(len(values)), _doubles(*values.values()))

    def get(self, name: str) -> float:
        value = _doubles(0)
        assert self.call("GetReal", (c_uint * 1)(self.references[name]), c_size_t(1), value) == OK
        return value[0]

    def step(self, duration: float = 1e-3, **inputs: float) -> float:
        """Set the inputs, take a step and return the torque."""
        assert self.set(**inputs) == self.do_step(duration) == OK, self.messages
        return self.get("torque")

    def do_step(self, duration: float) -> int:
        return self.call("DoStep", c_double(0), c_double(duration), 0)

    def save(self) -> bytes:
        state, size = c_void_p(), c_size_t()
        assert self.call("GetFMUstate", ctypes.byref(state)) == OK
        assert self.call("SerializedFMUstateSize", state, ctypes.byref(size)) == OK
        saved = ctypes.create_string_buffer(size.value)
        assert self.call("SerializeFMUstate", state, saved, size) == OK
        assert self.call("FreeFMUstate", ctypes.byref(state)) == OK and not state
        return saved.raw

    def restore(self, saved: bytes) -> int:
        state = c_void_p()
        size, place = c_size_t(len(saved)), ctypes.byref(state)
        status = self.call("DeSerializeFMUstate", saved, size, place)
        return status or self.call("SetFMUstate", state) or self.call("FreeFMUstate", place)


def _doubles(*values: float) -> Any:
    return (c_double * len(values))(*values)
