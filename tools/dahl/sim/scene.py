# SPDX-License-Identifier: MIT
"""Scene files, as far as Python needs them: what the node's parameters are and what was measured
beside the angle.

dahl-loop reads and checks all sections, so which there are is told there alone; only [measured] is
read here alone. A user's own log becomes a scene too, so that there is one way to run anything.
"""

from __future__ import annotations

import configparser
import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dahl import paths
from dahl.binding.bristles import Asymmetric, ElastoPlastic
from dahl.binding.friction import Friction, Plan
from dahl.binding.loaded import Loaded
from dahl.binding.slip import Parallel, Slip
from dahl.errors import Error
from dahl.io import files, logs, units

if TYPE_CHECKING:
    from dahl.can import node

TEXT = 160  # bytes of a text in a scene, with its end, as dahl-loop has them

UNITS = {  # of the angle column: (size in rad or m, unit of the torque)
    "deg": (math.pi / 180, "N m"),
    "rad": (1.0, "N m"),
    "mm": (1e-3, "N"),
}


NODE_KEYS = ("gain", "limit", "ramp_ms", "timeout_ms", "max_step")  # of [friction]

MODELS = ("dahl", "slip", "parallel", "asymmetric", "elastoplastic", "loaded")
ONE = {"dahl": (1, 1), "elastoplastic": (1, 1), "loaded": (1, 1), "asymmetric": (1, 2)}  # element
OWN_KEYS = {"kinds": "parallel", "breakaway": "elastoplastic"}  # of one model alone
KNOWN_KEYS = {  # of the sections that a node is made of
    "friction": ("model", "sigma0", "Fc", "theta_per_count", "node", *OWN_KEYS, *NODE_KEYS),
    "status": ("period_ms",),
}


@dataclass
class Measured:
    """[measured]: the torque column beside the angle, and how it compares with the model."""

    torque: str = ""  # column; empty: nothing measured
    torque_scale: float = 1.0  # N m (N) per unit of the column, sign included
    offset: float = 0.0  # N m (N), added to the model's torque
    spring: float = 0.0  # N m/rad (N/m), times the angle from the start, added too
    settle: int = 0  # rows not compared: the bristle's deflection before the first is unknown
    label_angle: str = "angle from the start [rad]"
    label_torque: str = "friction torque [N m]"
    angle_scale: float = 1.0  # plotted unit per rad (m)

    @property
    def unit(self) -> str:
        """N m, or N where motion is linear: as the label of the torque has it."""
        return self.label_torque.rpartition("[")[2].rstrip("]")

    @property
    def units(self) -> dict[str, str]:
        """Of each parameter; of a linear rig, where the torque is a force, by its metres."""
        way = "m" if self.unit == "N" else "rad"
        return {"sigma0": f"{self.unit}/{way}", "Fc": self.unit, "theta_per_count": way}


@dataclass
class Scene:
    """One scene file, read."""

    path: Path
    title: str
    model: str = "dahl"  # or slip, parallel, asymmetric, elastoplastic, loaded
    # sigma0, Fc of each; of Dahl's model one, of asymmetric forward and backward
    elements: tuple[tuple[float, float], ...] = ()
    theta_per_count: float = 0.0
    seconds: float = 0.0  # how long the motion lasts, where the scene says it
    motion: dict[str, str] = field(default_factory=dict)
    measured: Measured = field(default_factory=Measured)
    parts: tuple[str, ...] = ()  # sections that the file has
    kinds: tuple[str, ...] = ()  # of parallel: dahl or slip for each element
    breakaway: float = 0.0  # of elastoplastic: part of Fc
    compensates: bool = False  # the node answers a part of the torque: gain, limit or ramp are set
    friction: dict[str, float] = field(default_factory=dict)  # other keys that it has, numbers
    status_ms: float = 0.0  # period of Status; 0: only after an event
    node: int = 0  # number of the node on the bus
    refusal: str = ""  # why dahl-loop makes no node of it; only element() looks at it

    @property
    def name(self) -> str:
        """The file's name without its ending."""
        return self.path.stem

    @property
    def sigma0(self) -> float:
        """N m/rad, of all elements together; of asymmetric that of either direction."""
        if self.model == "asymmetric":
            return self.elements[0][0]
        return sum(sigma0 for sigma0, _ in self.elements)

    @property
    def Fc(self) -> float:  # noqa: N802
        """N m, what the ratio on the bus is of: all elements together, the larger of asymmetric."""
        if self.model == "asymmetric":
            return max(torque for _, torque in self.elements)
        return sum(torque for _, torque in self.elements)

    @property
    def log(self) -> str:
        """[motion] file of a scene that replays a log, else ''."""
        return self.motion.get("file", "") if self.motion.get("kind") == "log" else ""


def element(scene: Scene) -> node.Model:
    """What a Node of this scene is made of. Raises dahl.Error for parameters that no node takes."""
    sigma0, torques = ([pair[k] for pair in scene.elements] for k in (0, 1))
    if scene.refusal:
        raise Error(f"{scene.path}: {scene.refusal}")
    if scene.model == "slip":
        return Slip(sigma0, torques, scene.theta_per_count)
    if scene.model == "asymmetric":
        return Asymmetric(sigma0[0], torques[0], torques[-1], scene.theta_per_count)
    if scene.model == "elastoplastic":
        theta, breakaway = scene.theta_per_count, scene.breakaway
        return ElastoPlastic(sigma0[0], torques[0], theta, breakaway)
    plans = [Plan(*pair, scene.theta_per_count) for pair in scene.elements]
    if scene.model == "parallel":
        return Parallel(*map(_part, scene.kinds, plans))
    if scene.model == "loaded":
        return Loaded(plans[0])
    return plans[0]


def _part(kind: str, plan: Plan) -> Friction | Slip:
    if kind == "slip":
        return Slip([plan.sigma0], [plan.Fc], plan.theta_per_count)
    return Friction(plan)


def settings(scene: Scene) -> dict[str, Any]:
    """The keywords of a Node of this scene, beside its element and its number."""
    found: dict[str, Any] = {"status_period": scene.status_ms / 1e3}
    for key, value in scene.friction.items():
        name = key.removesuffix("_ms")
        found[name] = value if name == key else value / 1e3
    return found


def find(name: str) -> Path:
    """A shipped scene by name, or a scene file by path. Raises dahl.Error that lists the shipped
    ones.
    """
    for path in (paths.SCENES / f"{name}.ini", Path(name)):
        if path.is_file():
            return path
    known = ", ".join(sorted(path.stem for path in paths.SCENES.glob("*.ini")))
    raise Error(f"no scene '{name}' (shipped: {known}; or give the path of a scene file)")


class _Parser(configparser.ConfigParser):
    def optionxform(self, optionstr: str) -> str:
        """Keys as they are written: Fc is not fc."""
        return optionstr


def read(path: Path) -> Scene:
    """Read a scene file. Raises dahl.Error naming file and key."""
    parser = _Parser(inline_comment_prefixes=(";",), interpolation=None)
    try:
        parser.read_string(path.read_text(encoding="utf-8-sig"), source=str(path))
    except (OSError, UnicodeDecodeError, configparser.Error) as error:
        raise Error(f"{path}: {' '.join(str(error).split())}") from None
    scene = Scene(path, parser.get("scene", "title", fallback=path.stem))
    scene.model = parser.get("friction", "model", fallback="dahl")
    sigma0, torques = (_numbers(path, parser, "friction", key) for key in ("sigma0", "Fc"))
    scene.refusal = _refusal(parser, scene.model, len(sigma0), len(torques))
    if scene.model == "asymmetric":
        sigma0 = sigma0 * len(torques)
    scene.elements = tuple(zip(sigma0, torques, strict=False))
    scene.kinds = tuple(parser.get("friction", "kinds", fallback="").split())
    scene.breakaway = _number(path, parser, "friction", "breakaway", 0.0)
    scene.theta_per_count = _number(path, parser, "friction", "theta_per_count", 0.0)
    scene.seconds = max(
        _number(path, parser, section, "seconds", 0.0) for section in ("motion", "motor")
    )
    scene.motion = dict(parser["motion"]) if parser.has_section("motion") else {}
    scene.measured = _measured(path, parser)
    scene.parts = tuple(parser.sections())
    scene.friction = {
        key: _number(path, parser, "friction", key, 0.0)
        for key in NODE_KEYS
        if parser.has_option("friction", key)
    }
    scene.status_ms = _number(path, parser, "status", "period_ms", 0.0)
    scene.node = _node(path, parser)
    scene.compensates = any(
        parser.has_option("friction", key) for key in ("gain", "limit", "ramp_ms")
    )
    return scene


def _refusal(parser: configparser.ConfigParser, model: str, sigma0: int, torques: int) -> str:
    """What dahl-loop would not take of [friction] and [status], else nothing: a key that is none,
    another number of elements than the model has, a kind that there is not.
    """
    if model not in MODELS:
        return f"[friction] model = {model} is none of {', '.join(MODELS)}"
    if not sigma0 or not torques:
        return "[friction] has no sigma0 and Fc"
    if (sigma0, torques) != ONE.get(model, (torques, torques)):
        return f"[friction] sigma0 has {sigma0} numbers and Fc {torques}: not those of {model}"
    kinds = parser.get("friction", "kinds", fallback="").split()
    if model == "parallel" and (len(kinds) != torques or not {*kinds} <= {"dahl", "slip"}):
        return f"[friction] kinds = {' '.join(kinds)}: not dahl or slip for each of {torques}"
    return _unknown_key(parser, model)


def _unknown_key(parser: configparser.ConfigParser, model: str) -> str:
    for section, known in KNOWN_KEYS.items():
        for key in parser[section] if parser.has_section(section) else ():
            if key not in known:
                return f"[{section}] has no key '{key}' (known: {', '.join(known)})"
            if OWN_KEYS.get(key, model) != model:
                return f"[friction] {key} has no meaning for model = {model}"
    return ""


def _numbers(path: Path, parser: configparser.ConfigParser, section: str, key: str) -> list[float]:
    """Numbers with blanks between them, one an element; dahl-loop checks how many there are."""
    text = parser.get(section, key, fallback="")
    try:
        return [float(word) for word in text.split()]
    except ValueError:
        raise Error(f"{path}: [{section}] {key} = '{text}' is not a number") from None


def _number(
    path: Path, parser: configparser.ConfigParser, section: str, key: str, default: float
) -> float:
    text = parser.get(section, key, fallback=None)
    try:
        return default if text is None else float(text)
    except ValueError:
        raise Error(f"{path}: [{section}] {key} = '{text}' is not a number") from None


def _node(path: Path, parser: configparser.ConfigParser) -> int:
    """[friction] node, from 0 to 15."""
    number = _number(path, parser, "friction", "node", 0.0)
    if number not in range(16):
        raise Error(f"{path}: [friction] node = {number:g} is not a whole number from 0 to 15")
    return int(number)


def _measured(path: Path, parser: configparser.ConfigParser) -> Measured:
    measured = Measured()
    if not parser.has_section("measured"):
        return measured
    for key, text in parser["measured"].items():
        if key not in vars(measured):
            raise Error(
                f"{path}: [measured] has no key '{key}' (known: {', '.join(vars(measured))})"
            )
        kind = type(getattr(measured, key))
        number = 0.0 if kind is str else _number(path, parser, "measured", key, 0.0)
        if kind is int and not number.is_integer():
            raise Error(f"{path}: [measured] {key} = '{text}' is not a whole number")
        setattr(measured, key, text if kind is str else kind(number))
    return measured


@dataclass
class Recorded:
    """What the log holds beside the angle; arrays of shape (rows,)."""

    torque: np.ndarray | None  # N m (N), None where nothing was measured
    time: np.ndarray | None  # s, None where the log has no time column
    rows: int


def read_log(scene: Scene, log: Path) -> Recorded:
    """Torque and time of each row of the scene's log.

    Reads the angle column as well, so that a bad log is named here, by line and column, before
    anything is started.
    """
    angle, torque, time = (
        scene.motion.get("angle", ""),
        scene.measured.torque,
        scene.motion.get("time", ""),
    )
    if not angle:
        raise Error(
            f"{scene.path}: [motion] angle is missing: which column of {log.name} holds the angle?"
        )
    table = logs.read_table(log, [angle, torque] if torque else [angle], time or None)
    _check_unwrapped(scene, log, table[angle])
    measured = table[torque] * scene.measured.torque_scale if torque else None
    return Recorded(measured, table[time] if time else None, len(table[angle]))


def _check_unwrapped(scene: Scene, log: Path, angle: np.ndarray) -> None:
    """An angle that starts anew at each turn would send the shaft back by a turn within a tick."""
    try:
        per_unit = scene.theta_per_count * float(scene.motion.get("counts_per_unit", "1"))
    except ValueError:  # dahl-loop says so, with the line
        return
    if scene.measured.unit == "N" or not per_unit > 0:
        return
    turn = 2 * math.pi / per_unit
    jumps = np.abs(np.diff(angle)) > turn / 2
    if jumps.any():
        row = int(np.argmax(jumps))
        raise Error(
            f"{log}: the angle goes from {angle[row]:g} to {angle[row + 1]:g} in one row, more than"
            " half a turn: does it start anew at each turn? Unwrap it, as numpy.unwrap does"
        )


@dataclass
class OwnLog:
    """What the command line says about a user's own log (see `dahl demo --help`)."""

    log: Path
    angle: str
    torque: str
    sigma0: float
    fc: float
    counts_per_turn: float
    angle_unit: str = "deg"
    torque_scale: float = 1.0
    offset: float = 0.0
    spring: float = 0.0
    time: str = ""


def unit_in(column: str) -> str:
    """deg, rad, mm or counts, as the name of an angle column says it; deg where it says nothing.
    Raises dahl.Error where it says another unit.
    """
    words = re.split(r"[^a-z\d]+|_", column.lower())
    unit = next((unit for unit in ("rad", "mm", "counts") if unit in words), "")
    other = unit or units.unit_in(column, units.ANGLES, "deg")
    if other not in UNITS and other != "counts":
        raise Error(
            f"--angle {column}: in {other}; deg, rad, mm or counts were expected: scale the column,"
            " or say with --angle-unit what it is"
        )
    return other


def write_own(own: OwnLog, path: Path) -> Scene:
    """Write the scene of a user's own log to `path`, and read it back."""
    if not (own.counts_per_turn > 0 and math.isfinite(own.counts_per_turn)):
        raise Error(f"--counts-per-turn {own.counts_per_turn:g}: a number above 0 was expected")
    _check_names(own)
    whole = str(own.log.absolute())
    unit = own.angle_unit if own.angle_unit in UNITS else "rad"
    size, torque_unit = UNITS[unit]
    lines = [
        "; written by dahl demo",
        "[scene]",
        f"title = {own.log.name}",
        "[friction]",
        f"sigma0 = {own.sigma0!r}",
        f"Fc = {own.fc!r}",
        f"theta_per_count = {_theta_per_count(own)!r}",
        "[motion]",
        "kind = log",
        f"file = {whole if _can_hold(whole) else own.log.name}",
        f"angle = {own.angle}",
        f"counts_per_unit = {_counts_per_unit(own)!r}",
        *([f"time = {own.time}"] if own.time else []),
        "[status]",
        "period_ms = 100",
        "[measured]",
        *([f"torque = {own.torque}"] if own.torque else []),
        f"torque_scale = {own.torque_scale!r}",
        f"offset = {own.offset!r}",
        f"spring = {own.spring!r}",
        f"label_angle = {own.angle} from the start [{unit}]",
        f"label_torque = friction [{torque_unit}]",
        f"angle_scale = {1 / size!r}",
    ]
    files.keep(path, "\n".join(lines) + "\n")
    return read(path)


def _check_names(own: OwnLog) -> None:
    """Raise dahl.Error for a name that a scene file cannot hold."""
    columns = [("column", name) for name in (own.angle, own.time, own.torque) if name]
    for kind, name in [("log", own.log.name), *columns]:
        if not _can_hold(name):
            raise Error(f"{kind} '{name}': a scene file cannot hold this name; rename the {kind}")


def _can_hold(name: str) -> bool:
    """Whether a scene file can: no comment sign in it, no spaces around it, and not too long for
    dahl-loop.
    """
    plain = re.fullmatch(r"\S(.*\S)?", name) and not re.search(r"(^|\s);", name)
    return bool(plain) and len(name.encode("utf-8", "surrogateescape")) < TEXT


def _theta_per_count(own: OwnLog) -> float:
    """rad per count; for millimetres counts_per_turn is counts per millimetre, and this is m per
    count.
    """
    return (
        1e-3 / own.counts_per_turn if own.angle_unit == "mm" else 2 * math.pi / own.counts_per_turn
    )


def _counts_per_unit(own: OwnLog) -> float:
    per_turn = {"deg": 360.0, "rad": 2 * math.pi, "mm": 1.0, "counts": own.counts_per_turn}
    return own.counts_per_turn / per_turn[own.angle_unit]
