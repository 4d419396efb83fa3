# SPDX-License-Identifier: MIT
"""FMUs as a user writes them, and an instance that a test calls by the functions of FMI."""

import ctypes
import tempfile
import zipfile
from ctypes import byref, c_bool, c_char_p, c_double, c_int, c_size_t, c_uint, c_void_p
from pathlib import Path
from typing import Any, Self
from xml.etree import ElementTree as ET

from dahl.binding import models
from model_examples import OWN, numbers

OK, ERROR = 0, 3
CO_SIMULATION = 1
LOGGERS = {
    2: ctypes.CFUNCTYPE(None, c_void_p, c_char_p, c_int, c_char_p, c_char_p),
    3: ctypes.CFUNCTYPE(None, c_void_p, c_int, c_char_p, c_char_p),
}
ENVIRONMENT = 0x1234


def export(dahl: Any, fmi: int, model: models.Model, *more: object, name: str = "x.fmu") -> Path:
    """Write an FMU of an example of the model."""
    own = OWN.get(model.key)
    values = [*numbers(model), *([own if isinstance(own, list) else [own]] if own else [])]
    options = zip(("--sigma0", "--fc", f"--{model.key}"), values, strict=False)
    words = (word for option, value in options for word in (option, ",".join(map(str, value))))
    done = dahl("fmu", "--fmi", fmi, "--model", model.name, *words, *more, "--force", "-o", name)
    assert done.returncode == 0, done.stderr
    return Path(name).resolve()


class Callbacks(ctypes.Structure):
    _fields_ = (("logger", LOGGERS[2]), *((name, c_void_p) for name in ("a", "f", "s", "e")))


class Instance:
    """An instance of FMI 2.0 or 3.0. `messages` are the errors that it sent."""

    def __init__(self, fmu: Path, binary: Path | None = None, **wrong: Any) -> None:
        with zipfile.ZipFile(fmu) as content:
            self.xml = ET.fromstring(content.read("modelDescription.xml"))
            (name,) = (one for one in content.namelist() if one.endswith(".so"))
            if binary is None:  # each instance loads a file of its own
                binary = Path(content.extract(name, tempfile.mkdtemp(dir=fmu.parent)))
            self.functions = ctypes.CDLL(binary)
        self.fmi = int(self.xml.get("fmiVersion")[0])
        rows = self.xml.find("ModelVariables")
        self.references = {row.get("name"): int(row.get("valueReference")) for row in rows}
        self.guid = self.xml.get("guid" if self.fmi == 2 else "instantiationToken")
        self.messages: list[str] = []
        self.logger = LOGGERS[self.fmi](self._log)
        words = b"one", wrong.pop("guid", self.guid).encode()
        made = self._instantiate(*words, **wrong) if self.fmi == 2 else self._make(*words, **wrong)
        self.component = c_void_p(made)

    def _instantiate(self, name: bytes, guid: bytes, kind: int = CO_SIMULATION) -> Any:
        self.callbacks = Callbacks(self.logger, e=ENVIRONMENT)
        self.functions.fmi2Instantiate.restype = c_void_p
        return self.functions.fmi2Instantiate(
            name, kind, guid, b"file:///", byref(self.callbacks), 0, 0
        )

    def _make(
        self, name: bytes, guid: bytes, kind: str = "CoSimulation", events: bool = False, n: int = 0
    ) -> Any:
        make = getattr(self.functions, f"fmi3Instantiate{kind}")
        make.restype = c_void_p
        own = (c_bool(events), c_bool(True), (c_uint * 1)(), c_size_t(n))
        more = own if kind == "CoSimulation" else ()
        callbacks = c_void_p(ENVIRONMENT), self.logger, None, None, None
        return make(name, guid, None, c_bool(False), c_bool(False), *more, *callbacks)

    def _log(self, environment: int, *words: Any) -> None:
        *name, status, category, message = words
        assert name == ([b"one"] if self.fmi == 2 else [])
        assert (environment, status, category) == (ENVIRONMENT, ERROR, b"logStatusError")
        self.messages.append(message.decode("ascii"))

    def call(self, name: str, *arguments: Any) -> int:
        if self.fmi == 3:
            name = name.replace("DeSerialize", "Deserialize").replace("FMUstate", "FMUState")
        return int(getattr(self.functions, f"fmi{self.fmi}{name}")(self.component, *arguments))

    def free(self) -> None:
        getattr(self.functions, f"fmi{self.fmi}FreeInstance")(self.component)

    def enter(self, start: float = 0) -> int:
        """Enter the initialization."""
        times = c_double(0), c_double(start), 0, c_double(0)
        if self.fmi == 3:
            return self.call("EnterInitializationMode", 0, *times)
        return self.call("SetupExperiment", 0, *times) or self.call("EnterInitializationMode")

    def leave(self) -> int:
        return self.call("ExitInitializationMode")

    def initialize(self, **values: float) -> Self:
        assert self.enter() == self.set(**values) == self.leave() == OK, self.messages
        return self

    def access(self, verb: str, references: Any, count: int, values: Any) -> int:
        """Call the function that gets or sets variables."""
        kind, more = ("Real", []) if self.fmi == 2 else ("Float64", [c_size_t(count)])
        return self.call(f"{verb}{kind}", references, c_size_t(count), values, *more)

    def set(self, **values: float) -> int:
        references = (c_uint * len(values))(*(self.references[name] for name in values))
        return self.access("Set", references, len(values), _doubles(*values.values()))

    def get(self, name: str) -> float:
        value = _doubles(0)
        assert self.access("Get", (c_uint * 1)(self.references[name]), 1, value) == OK
        return value[0]

    def step(self, duration: float = 1e-3, **inputs: float) -> float:
        """Set the inputs, take a step and return the torque."""
        assert self.set(**inputs) == self.do_step(duration) == OK, self.messages
        return self.get("torque")

    def do_step(self, duration: float, start: float = 0) -> int:
        if self.fmi == 2:
            return self.call("DoStep", c_double(start), c_double(duration), 0)
        flags, last = (c_bool * 3)(True, True, True), c_double(-1)
        places = [byref(flags, k) for k in range(3)]
        status = self.call("DoStep", c_double(start), c_double(duration), 0, *places, byref(last))
        assert status or ([*flags], last.value) == ([False] * 3, start + duration)
        return status

    def save(self) -> bytes:
        state, size = c_void_p(), c_size_t()
        assert self.call("GetFMUstate", byref(state)) == OK
        assert self.call("SerializedFMUstateSize", state, byref(size)) == OK
        saved = ctypes.create_string_buffer(size.value)
        assert self.call("SerializeFMUstate", state, saved, size) == OK
        assert self.call("FreeFMUstate", byref(state)) == OK and not state
        return saved.raw

    def restore(self, saved: bytes) -> int:
        state = c_void_p()
        size, place = c_size_t(len(saved)), byref(state)
        status = self.call("DeSerializeFMUstate", saved, size, place)
        status = status or self.call("SetFMUstate", state)
        assert self.call("FreeFMUstate", place) == OK and not state
        return status


def _doubles(*values: float) -> Any:
    return (c_double * len(values))(*values)
