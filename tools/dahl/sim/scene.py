# SPDX-License-Identifier: MIT
"""Read scene files: the parameters of the node and the measurement to compare with.

dahl-loop checks all sections, except the values of [measured], which only this module reads. A log
of the user also becomes a scene.
"""

from __future__ import annotations

import configparser
import math
import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from dahl import paths
from dahl.binding import models
from dahl.errors import InputError
from dahl.io import files, readers, units
from dahl.sim import scene_keys

MAX_TEXT_BYTES = scene_keys.text_size()
SHOWN_UNITS = ("deg", "rad", "mm")  # of angles in the picture of a user's own log

NODE_KEYS = scene_keys.node_settings()
OWN_KEYS = {row.key: name for name, row in models.table().items() if row.key}  # of one model only
KNOWN_KEYS = {section: scene_keys.names(section) for section, _ in scene_keys.rows("SECTION")}


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
    title: str
    model: str = "dahl"  # a name in models.table()
    # (sigma0 [N m/rad], Fc [N m]) of each element, or of each direction: forward, backward
    elements: tuple[tuple[float, float], ...] = ()
    theta_per_count: float = 0.0
    seconds: float = 0.0  # length of the motion; 0 if the scene does not give it
    motion: dict[str, str] = field(default_factory=dict)
    measured: Measured = field(default_factory=Measured)
    parts: tuple[str, ...] = ()  # sections in the file
    kinds: tuple[str, ...] = ()  # dahl or slip for each element
    breakaway: float = 0.0  # fraction of Fc
    compensates: bool = False  # gain, limit or ramp_ms is set: a part of the torque is answered
    friction: dict[str, float] = field(default_factory=dict)  # NODE_KEYS in the file
    status_ms: float = 0.0  # period of Status; 0: only after an event
    node: int = 0  # number of the node on the bus
    refusal: str = ""  # why dahl-loop refuses the node; element() raises it

    @property
    def name(self) -> str:
        """The name of the file without its ending."""
        return self.path.stem

    @property
    def has_directions(self) -> bool:
        """Whether `elements` are forward and backward instead of parallel."""
        model = models.table().get(self.model)
        return model is not None and model.has_directions

    @property
    def sigma0(self) -> float:
        """N m/rad, the sum of all elements; if Fc has a direction, that of both."""
        if self.has_directions:
            return self.elements[0][0]
        return sum(sigma0 for sigma0, _ in self.elements)

    @property
    def Fc(self) -> float:  # noqa: N802
        """N m, at a torque ratio of 1: the sum of all elements, or the larger of two directions."""
        if self.has_directions:
            return max(torque for _, torque in self.elements)
        return sum(torque for _, torque in self.elements)

    @property
    def log(self) -> str:
        """The log that the scene replays ([motion] file), else ""."""
        return self.motion.get("file", "") if self.motion.get("kind") == "log" else ""


def element(scene: Scene) -> models.AnyModel:
    """Return the model of a Node of this scene. Raises dahl.Error if dahl-loop refuses it."""
    if scene.refusal:
        raise InputError(f"{scene.path}: {scene.refusal}")
    model = models.table()[scene.model]
    sigma0, torques = ([pair[k] for pair in scene.elements] for k in (0, 1))
    own = getattr(scene, model.key) if model.key else None
    return models.make(model, sigma0[: model.sigma0s or None], torques, scene.theta_per_count, own)


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


class _Parser(configparser.ConfigParser):
    def optionxform(self, optionstr: str) -> str:
        """Keep the case of keys: Fc differs from fc."""
        return optionstr


def read(path: Path) -> Scene:
    """Read a scene file. Raises dahl.Error that names file and key."""
    parser = _Parser(inline_comment_prefixes=(";",), interpolation=None, default_section="")
    try:
        parser.read_string(path.read_text(encoding="utf-8-sig"), source=str(path))
    except (OSError, UnicodeDecodeError, configparser.Error) as error:
        raise InputError(f"{path}: {' '.join(str(error).split())}") from None
    _check_sections(path, parser)
    scene = Scene(path, parser.get("scene", "title", fallback=path.stem))
    scene.model = parser.get("friction", "model", fallback="dahl")
    sigma0, torques = (_numbers(path, parser, "friction", key) for key in ("sigma0", "Fc"))
    scene.refusal = _refusal(parser, scene.model, len(sigma0), len(torques))
    scene.refusal = scene.refusal or _beyond_limits(path, parser)
    if scene.has_directions:
        sigma0 = sigma0 * len(torques)
    scene.elements = tuple(zip(sigma0, torques, strict=False))
    scene.kinds = tuple(parser.get("friction", "kinds", fallback="").split())
    scene.breakaway = _number(path, parser, "friction", "breakaway", 0.0)
    scene.theta_per_count = _number(path, parser, "friction", "theta_per_count", 0.0)
    scene.seconds = max(
        _number(path, parser, section, "seconds", 0.0) for section in ("motion", "motor")
    )
    scene.motion = dict(parser["motion"]) if parser.has_section("motion") else {}
    scene.measured = _read_measured(path, parser)
    scene.parts = tuple(parser.sections())
    scene.friction = {
        key: _number(path, parser, "friction", key, 0.0)
        for key in NODE_KEYS
        if parser.has_option("friction", key)
    }
    scene.status_ms = _number(path, parser, "status", "period_ms", 0.0)
    scene.node = _node_number(path, parser)
    scene.compensates = any(
        parser.has_option("friction", key) for key in ("gain", "limit", "ramp_ms")
    )
    return scene


def _check_sections(path: Path, parser: configparser.ConfigParser) -> None:
    """Raise dahl.Error for a section or a key that does not exist."""
    for section in parser.sections():
        if section not in KNOWN_KEYS:
            raise InputError(
                f"{path}: unknown section [{section}] (known: {', '.join(KNOWN_KEYS)})"
            )
        known = KNOWN_KEYS[section]
        for key in parser[section]:
            if key not in known:
                raise InputError(
                    f"{path}: [{section}] has no key '{key}' (known: {', '.join(known)})"
                )


def _refusal(parser: configparser.ConfigParser, model: str, sigma0: int, torques: int) -> str:
    """Return why dahl-loop would refuse [friction] or [status], "" if it would not."""
    known = models.table()
    if model not in known:
        return f"[friction] model = {model}: not one of {', '.join(known)}"
    if not sigma0 or not torques:
        return "[friction] has no sigma0 and Fc"
    if not known[model].fits(sigma0, torques):
        return f"[friction] sigma0 has {sigma0} numbers and Fc {torques}: not those of {model}"
    kinds = parser.get("friction", "kinds", fallback="").split()
    if model == "parallel" and (len(kinds) != torques or not {*kinds} <= {"dahl", "slip"}):
        return f"[friction] kinds = {' '.join(kinds)}: not dahl or slip for each of {torques}"
    for key in parser["friction"]:
        if OWN_KEYS.get(key, model) != model:
            return f"[friction] {key} has no meaning for model = {model}"
    return ""


def _beyond_limits(path: Path, parser: configparser.ConfigParser) -> str:
    """Return why dahl-loop would refuse a setting of the node, "" if it would not."""
    for section, name in (*(("friction", name) for name in NODE_KEYS), ("status", "period_ms")):
        key = scene_keys.keys()[section, name]
        value = _number(path, parser, section, name, key.high)
        if not key.low <= value <= key.high:
            return f"[{section}] {name} = {value:g} is outside {key.low:g} to {key.high:g}"
        if key.type == "WHOLE" and not value.is_integer():
            return f"[{section}] {name} = {value:g} is not a whole number"
    return ""


def _numbers(path: Path, parser: configparser.ConfigParser, section: str, key: str) -> list[float]:
    """Return numbers separated by blanks, one for each element; dahl-loop checks their count."""
    text = parser.get(section, key, fallback="")
    try:
        return [float(word) for word in text.split()]
    except ValueError:
        raise InputError(f"{path}: [{section}] {key} = '{text}' is not a number") from None


def _number(
    path: Path, parser: configparser.ConfigParser, section: str, key: str, default: float
) -> float:
    text = parser.get(section, key, fallback=None)
    try:
        return default if text is None else float(text)
    except ValueError:
        raise InputError(f"{path}: [{section}] {key} = '{text}' is not a number") from None


def _node_number(path: Path, parser: configparser.ConfigParser) -> int:
    """[friction] node, from 0 to 15."""
    key = scene_keys.keys()["friction", "node"]
    number = _number(path, parser, "friction", "node", key.default)
    if not (key.low <= number <= key.high and number.is_integer()):
        limits = f"from {key.low:g} to {key.high:g}"
        raise InputError(f"{path}: [friction] node = {number:g} is not a whole number {limits}")
    return int(number)


def _read_measured(path: Path, parser: configparser.ConfigParser) -> Measured:
    measured = Measured()
    if not parser.has_section("measured"):
        return measured
    for key, text in parser["measured"].items():
        kind = type(getattr(measured, key))
        number = 0.0 if kind is str else _number(path, parser, "measured", key, 0.0)
        if kind is int and not number.is_integer():
            raise InputError(f"{path}: [measured] {key} = '{text}' is not a whole number")
        setattr(measured, key, text if kind is str else kind(number))
    return measured


@dataclass
class Recorded:
    """The columns of a log that are compared with the model; arrays of shape (rows,)."""

    torque: np.ndarray | None  # N m (N); None if it was not measured
    time: np.ndarray | None  # s; None if the log has no time
    rows: int


def read_log(scene: Scene, log: Path) -> Recorded:
    """Read torque and time of the scene's log, and check its angle. Raises dahl.Error."""
    wanted = {
        "angle": scene.motion.get("angle", ""),
        "torque": scene.measured.torque,
        "time": scene.motion.get("time", ""),
    }
    if not wanted["angle"]:
        raise InputError(
            f"{scene.path}: [motion] angle is missing: which column of {log.name} holds the angle?"
        )
    _, table = readers.read_columns(log, {role: name for role, name in wanted.items() if name})
    _check_unwrapped(scene, log, table["angle"])
    torque = table.get("torque")
    measured = None if torque is None else torque * scene.measured.torque_scale
    return Recorded(measured, table.get("time"), len(table["angle"]))


def _check_unwrapped(scene: Scene, log: Path, angle: np.ndarray) -> None:
    """Raise dahl.Error for an angle that wraps: dahl-loop would turn the shaft back in one tick."""
    try:
        per_unit = scene.theta_per_count * float(scene.motion.get("counts_per_unit", "1"))
    except ValueError:  # dahl-loop reports it with its line
        return
    if scene.measured.unit == "N" or not per_unit > 0:
        return
    turn = 2 * math.pi / per_unit
    jumps = np.abs(np.diff(angle)) > turn / 2
    if jumps.any():
        row = int(np.argmax(jumps))
        raise InputError(
            f"{log}: the angle goes from {angle[row]:g} to {angle[row + 1]:g} in one row, more than"
            " half a turn: does it start anew at each turn? Unwrap it, as numpy.unwrap does"
        )


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
    lines = [
        "; written by dahl demo",
        "[scene]",
        f"title = {own.log.name}",
        "[friction]",
        f"sigma0 = {own.sigma0!r}",
        f"Fc = {own.fc!r}",
        f"theta_per_count = {count!r}",
        "[motion]",
        "kind = log",
        f"file = {table}",
        f"angle = {own.angle}",
        f"counts_per_unit = {size / count!r}",
        *([f"time = {own.time}"] if own.time else []),
        "[status]",
        "period_ms = 100",
        "[measured]",
        *([f"torque = {own.torque}"] if own.torque else []),
        f"offset = {own.offset!r}",
        f"spring = {own.spring!r}",
        f"label_angle = {own.angle} from the start [{shown}]",
        f"label_torque = friction [{'N' if is_linear else 'N m'}]",
        f"angle_scale = {1 / units.ANGLES[shown]!r}",
    ]
    return "\n".join(lines) + "\n"


def _check_names(own: OwnLog) -> None:
    """Raise dahl.Error for names that a scene file cannot hold."""
    columns = [("column", name) for name in (own.angle, own.time, own.torque) if name]
    for kind, name in [("log", own.log.name), *columns]:
        if not _is_representable(name):
            raise InputError(
                f"{kind} '{name}': a scene file cannot hold this name; rename the {kind}"
            )


def _is_representable(name: str) -> bool:
    """Return whether a scene file can contain a name: no comment sign, no outer spaces, short."""
    plain = re.fullmatch(r"\S(.*\S)?", name) and not re.search(r"(^|\s);", name)
    return bool(plain) and len(name.encode("utf-8", "surrogateescape")) < MAX_TEXT_BYTES
