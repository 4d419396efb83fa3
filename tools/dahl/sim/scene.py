# SPDX-License-Identifier: MIT
"""Read scene files: the parameters of the node and the measurement to compare with.

scene_reader.py reads and checks the file. A log of the user also becomes a scene.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from dahl import paths
from dahl.binding import models
from dahl.errors import InputError
from dahl.io import files, readers, units
from dahl.sim import keys, scene_writer
from dahl.sim.scene_reader import Contents, SceneFile

SHOWN_UNITS = ("deg", "rad", "mm")  # of angles in the picture of a user's own log

NODE_KEYS = keys.node_settings()


@dataclass
class Measured:
    """Section [measured]: the torque column, and how to compare it with the model."""

    torque: str = ""  # column; "" if no torque was measured
    torque_scale: float = 1.0  # N m (N) per unit of the column, sign included
    offset: float = 0.0  # N m (N), added to the torque of the model
    spring: float = 0.0  # N m/rad (N/m), its product with the angle from the start is added
    settle: int = 0  # first rows not compared: the initial deflection is unknown
    label_angle: str = "angle from the start [rad]"
    label_torque: str = "friction torque [N m]"
    angle_scale: float = 1.0  # plotted unit per rad (m)

    @property
    def unit(self) -> str:
        """Unit in the label of the torque: N m, or N for linear motion."""
        return self.label_torque.rpartition("[")[2].rstrip("]")

    @property
    def units(self) -> dict[str, str]:
        """The unit of each parameter; with metres if the motion is linear."""
        way = "m" if self.unit == "N" else "rad"
        return {"sigma0": f"{self.unit}/{way}", "Fc": self.unit, "theta_per_count": way}


@dataclass
class Scene:
    """The contents of a scene file."""

    path: Path
    title: str  # the name of the file if it has none
    model: str = "dahl"  # a name in models.table()
    # (sigma0 [N m/rad], Fc [N m]) of each element, or two limits: forward, backward or slow, fast
    elements: tuple[tuple[float, float], ...] = ()
    theta_per_count: float = 0.0
    seconds: float = 0.0  # length of the motion; 0 if the scene does not give it
    measured: Measured = field(default_factory=Measured)
    parts: tuple[str, ...] = ()  # sections in the file
    own: Any = None  # of the model's own key: a number, or the words of `kinds`
    compensates: bool = False  # gain, limit or ramp_ms is set: a part of the torque is answered
    friction: dict[str, float] = field(default_factory=dict)  # NODE_KEYS in the file
    status_ms: float = 0.0  # period of Status; 0: only after an event
    node: int = 0  # number of the node on the bus
    file: Contents = field(default_factory=Contents, repr=False)

    @property
    def name(self) -> str:
        """The name of the file without its ending."""
        return self.path.stem

    @property
    def has_two_limits(self) -> bool:
        """Whether `elements` are forward and backward, or slow and fast, instead of parallel."""
        model = models.table().get(self.model)
        return model is not None and model.has_two_limits

    @property
    def sigma0(self) -> float:
        """N m/rad, the sum of all elements; of two limits, that of both."""
        if self.has_two_limits:
            return self.elements[0][0]
        return sum(sigma0 for sigma0, _ in self.elements)

    @property
    def Fc(self) -> float:  # noqa: N802
        """N m, at a torque ratio of 1: the sum of all elements, or the larger of two limits."""
        if self.has_two_limits:
            return max(torque for _, torque in self.elements)
        return sum(torque for _, torque in self.elements)

    @property
    def log(self) -> str:
        """The log that the scene replays ([motion] file), else ""."""
        return self.file.text("motion", "file")


def element(scene: Scene) -> models.AnyModel:
    """Return the model of a Node of this scene. Raises dahl.Error if the library refuses it."""
    if not scene.elements:
        raise InputError(f"{scene.path}: has no [friction]")
    model = models.table()[scene.model]
    sigma0, torques = ([pair[k] for pair in scene.elements] for k in (0, 1))
    try:
        return models.make(
            model, sigma0[: model.sigma0s or None], torques, scene.theta_per_count, scene.own
        )
    except InputError as error:
        raise InputError(f"{scene.file.place('friction')}: [friction] {error}") from None


def settings(scene: Scene) -> dict[str, Any]:
    """Return the keywords of a Node of this scene, except its friction and its number."""
    found: dict[str, Any] = {"status_period": scene.status_ms / 1e3}
    for key, value in scene.friction.items():
        name = key.removesuffix("_ms")
        found[name] = value if name == key else value / 1e3
    return found


def find(name: str, *others: str) -> Path:
    """Return the path of a shipped scene, given by name, or of a scene file, given by path. The
    error lists the shipped scenes and `others`.
    """
    for path in (paths.SCENES / f"{name}.ini", Path(name)):
        if path.is_file():
            return path
    known = ", ".join(sorted([*others, *(path.stem for path in paths.SCENES.glob("*.ini"))]))
    raise InputError(f"no scene '{name}' (shipped: {known}; or give the path of a scene file)")


def read(path: Path, sets: Sequence[str] = ()) -> Scene:
    """Read a scene file; `sets` are settings "section.key=value" that override it. Raises
    dahl.Error that names place, key, value and range.
    """
    file = SceneFile(path, sets)
    scene = Scene(path, file.text("scene", "title") or path.stem, file=file)
    scene.model = file.text("friction", "model")
    sigma0, torques = file.numbers("friction", "sigma0"), file.numbers("friction", "Fc")
    if scene.has_two_limits:
        sigma0 = sigma0 * len(torques)
    scene.elements = tuple(zip(sigma0, torques, strict=False))
    if key := models.table()[scene.model].key:
        own = file.get("friction", key)
        scene.own = tuple(own.split()) if isinstance(own, str) else own
    scene.theta_per_count = file.number("friction", "theta_per_count")
    scene.seconds = max(file.number(section, "seconds") for section in ("motion", "motor"))
    scene.measured = _measured(file)
    scene.parts = file.sections
    scene.friction = {
        key: file.number("friction", key) for key in NODE_KEYS if file.has("friction", key)
    }
    scene.status_ms = file.number("status", "period_ms")
    scene.node = int(file.number("friction", "node"))
    scene.compensates = any(file.has("friction", key) for key in ("gain", "limit", "ramp_ms"))
    return scene


def _measured(file: Contents) -> Measured:
    found: dict[str, Any] = {name: file.get("measured", name) for name in keys.names("measured")}
    return Measured(**found | {"settle": int(found["settle"])})


@dataclass
class OwnLog:
    """The options that describe a user's own log (see `dahl demo --help`)."""

    log: Path
    angle: str
    sigma0: float
    fc: float
    counts_per_turn: float
    torque: str = ""
    angle_unit: str = ""  # by default that of the column's name, else deg
    torque_scale: float | None = None  # N m (N) per unit; None: by the name of the column
    offset: float = 0.0
    spring: float = 0.0
    time: str = ""


def write_own(own: OwnLog, path: Path) -> tuple[Scene, str]:
    """Write the scene of a user's own log to `path`, and next to it a table for dahl-loop. Return
    the scene and the unit of the angle. Raises dahl.Error.
    """
    if not (own.counts_per_turn > 0 and math.isfinite(own.counts_per_turn)):
        raise InputError(
            f"--counts-per-turn {own.counts_per_turn:g}: a number above 0 was expected"
        )
    _check_names(own)
    wanted = {role: getattr(own, role) for role in ("angle", "torque", "time")}
    wanted = {role: name for role, name in wanted.items() if name}
    names, columns = readers.read_columns(own.log, wanted)
    if len(set(wanted.values())) < len(wanted):
        raise InputError(f"{own.log}: angle, torque and time need different columns")
    # a line of numbers alone would be a row of the new table, not its names
    headers = {role: f"column {x}" if x.isdecimal() else x for role, x in wanted.items()}
    named = {"torque": "", "time": "", **headers}
    own = replace(own, angle=named["angle"], torque=named["torque"], time=named["time"])
    unit, _ = units.choose("angle", own.angle_unit, names["angle"], "deg")
    is_linear = unit in units.LENGTHS
    count = (1e-3 if is_linear else 2 * math.pi) / own.counts_per_turn  # m or rad
    size = count if unit == "counts" else units.ANGLES[unit]
    if not is_linear:
        columns["angle"], _ = readers.unwrap(columns["angle"], 2 * math.pi / size)
    if "torque" in columns:
        torque, _ = readers.restore_sign(columns["torque"])
        columns["torque"] = torque * _torque_scale(own, names["torque"], is_linear)
    if "time" in columns:
        time_unit, _ = units.choose("time", "", names["time"], "s")
        columns["time"] = columns["time"] * units.TIMES[time_unit]
    table = path.with_suffix(".csv")
    _write_table(table, {headers[role]: column for role, column in columns.items()})
    files.write_atomic(path, _scene_of(own, table.name, unit, size, count))
    return read(path), unit


def _torque_scale(own: OwnLog, name: str, is_linear: bool) -> float:
    """Return N m (N) per unit of the torque column."""
    if own.torque_scale is not None:
        return own.torque_scale
    unit, _ = units.choose("torque", "", name, "N" if is_linear else "Nm")
    return units.TORQUES[unit]


def _write_table(path: Path, columns: dict[str, np.ndarray]) -> None:
    import pandas as pd

    files.write_atomic(path, pd.DataFrame(columns).to_csv(index=False))


def _scene_of(own: OwnLog, table: str, unit: str, size: float, count: float) -> str:
    """Return the scene of a user's own log; unit of the angle and encoder count in rad (m)."""
    is_linear = unit in units.LENGTHS
    shown = unit if unit in SHOWN_UNITS else "m" if is_linear else "rad"
    sections: scene_writer.Sections = {
        "scene": {"title": own.log.name},
        "friction": {"sigma0": own.sigma0, "Fc": own.fc, "theta_per_count": count},
        "motion": {
            "kind": "log",
            "file": table,
            "angle": own.angle,
            "counts_per_unit": size / count,
            "time": own.time,
        },
        **scene_writer.STATUS,
        "measured": {
            "torque": own.torque,
            "offset": own.offset,
            "spring": own.spring,
            "label_angle": f"{own.angle} from the start [{shown}]",
            "label_torque": f"friction [{'N' if is_linear else 'N m'}]",
            "angle_scale": 1 / units.ANGLES[shown],
        },
    }
    return scene_writer.text_of(sections, "written by dahl demo")


def _check_names(own: OwnLog) -> None:
    """Raise dahl.Error for names that a scene file cannot hold."""
    columns = [("column", name) for name in (own.angle, own.time, own.torque) if name]
    for kind, name in [("log", own.log.name), *columns]:
        if not _is_representable(name):
            raise InputError(
                f"{kind} '{name}': a scene file cannot hold this name; rename the {kind}"
            )


def _is_representable(name: str) -> bool:
    """Return whether a scene file can contain a name: no comment sign, no outer spaces."""
    plain = re.fullmatch(r"\S(.*\S)?", name) and not re.search(r"(^|\s);", name)
    return bool(plain)
