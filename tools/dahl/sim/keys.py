# SPDX-License-Identifier: MIT
"""Sections and keys of scenes and run files: the table of host_sim/keys.csv.

A scene is for people, and only this package reads it. A run file is what dahl-loop reads: one line
`section.key = value` for each key, without the keys that only a scene has.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Key:
    """One key of a section. low and high are both allowed; of a number, or of each in a list."""

    section: str
    name: str
    type: str  # NUMBER, WHOLE, LIST or TEXT
    need: str  # REQUIRED if the section is there, OPTIONAL, or OWN: of one friction model
    low: float = 0
    high: float = 0
    default: float | str = ""
    is_of_scene: bool = False  # a run file does not have it
    of: str = ""  # kinds of [motion] that have the key, or counters of the node that a fault raises

    @property
    def place(self) -> str:
        return f"[{self.section}] {self.name}"


# --- from host_sim/keys.csv by run_keys.py: begin
# fmt: off
SECTIONS = {
    "scene": "",
    "friction": "",
    "load": "friction",
    "motion": "",
    "rotor": "friction",
    "motor": "rotor",
    "control": "rotor motion",
    "hand": "rotor",
    "faults": "",
    "status": "",
    "measured": "",
}

_ROWS = (
    Key("scene", "title", "TEXT", "OPTIONAL", 0, 0, "", True),
    Key("friction", "model", "TEXT", "OPTIONAL", 0, 0, "dahl"),
    Key("friction", "kinds", "TEXT", "OWN", 0, 0),
    Key("friction", "sigma0", "LIST", "REQUIRED", 5.421010862427522e-20, 1.8446742974197924e+19),
    Key("friction", "Fc", "LIST", "REQUIRED", 5.421010862427522e-20, 1.8446742974197924e+19),
    Key("friction", "breakaway", "NUMBER", "OWN", 1e-37, 0.9999999403953552, 0),
    Key("friction", "theta_per_count", "NUMBER", "REQUIRED", 1e-37, 1e37, 0),
    Key("friction", "node", "WHOLE", "OPTIONAL", 0, 15, 0),
    Key("friction", "timeout_ms", "NUMBER", "OPTIONAL", 1, 60000, 100),
    Key("friction", "gain", "NUMBER", "OPTIONAL", 0, 1, 1),
    Key("friction", "limit", "NUMBER", "OPTIONAL", 0, 1, 1),
    Key("friction", "ramp_ms", "NUMBER", "OPTIONAL", 0, 60000, 0),
    Key("friction", "max_step", "WHOLE", "OPTIONAL", 1, 2147483647, 0),
    Key("load", "full", "NUMBER", "REQUIRED", 1e-9, 1e12, 0),
    Key("load", "rest", "NUMBER", "OPTIONAL", 0, 1, 0),
    Key("load", "rotor_limit", "NUMBER", "OPTIONAL", 1, 2, 1),
    Key("load", "column", "TEXT", "OPTIONAL", 0, 0, "", True),
    Key("motion", "kind", "TEXT", "REQUIRED", 0, 0),
    Key("motion", "start_count", "WHOLE", "OPTIONAL", -2147483647, 2147483647, 0),
    Key("motion", "theta1", "WHOLE", "REQUIRED", -2147483647, 2147483647, 0, False, "segments"),
    Key("motion", "theta2", "WHOLE", "REQUIRED", -2147483647, 2147483647, 0, False, "segments"),
    Key("motion", "theta3", "WHOLE", "REQUIRED", -2147483647, 2147483647, 0, False, "segments"),
    Key("motion", "speed", "NUMBER", "REQUIRED", 1e-9, 1e12, 0, False, "segments"),
    Key("motion", "hold_s", "NUMBER", "OPTIONAL", 0, 3600, 0, False, "segments steering"),
    Key("motion", "amplitude", "NUMBER", "REQUIRED", 0, 1e9, 0, False, "steering"),
    Key("motion", "sweep_s", "NUMBER", "REQUIRED", 0.001, 3600, 0, False, "steering"),
    Key("motion", "tremor", "NUMBER", "REQUIRED", 0, 1e9, 0, False, "steering"),
    Key("motion", "tremor_s", "NUMBER", "REQUIRED", 0, 3600, 0, False, "steering"),
    Key("motion", "seconds", "NUMBER", "REQUIRED", 0.001, 1e9, 0, False, "steering"),
    Key("motion", "file", "TEXT", "REQUIRED", 0, 0, "", False, "log"),
    Key("motion", "angle", "TEXT", "REQUIRED", 0, 0, "", True, "log"),
    Key("motion", "time", "TEXT", "OPTIONAL", 0, 0, "", True, "log"),
    Key("motion", "counts_per_unit", "NUMBER", "REQUIRED", -1e15, 1e15, 0, True, "log"),
    Key("rotor", "inertia", "NUMBER", "REQUIRED", 1e-9, 1e6, 0),
    Key("rotor", "viscous", "NUMBER", "OPTIONAL", 0, 1e6, 0),
    Key("rotor", "sigma0", "NUMBER", "REQUIRED", 1e-9, 1e12, 0),
    Key("rotor", "Fc", "NUMBER", "REQUIRED", 1e-9, 1e12, 0),
    Key("motor", "bias", "NUMBER", "OPTIONAL", -1e12, 1e12, 0),
    Key("motor", "amplitude", "NUMBER", "OPTIONAL", 0, 1e12, 0),
    Key("motor", "frequency", "NUMBER", "OPTIONAL", 0, 100, 0),
    Key("motor", "seconds", "NUMBER", "REQUIRED", 0.001, 1e9, 0),
    Key("control", "kp", "NUMBER", "REQUIRED", 0, 1e12, 0),
    Key("control", "kd", "NUMBER", "REQUIRED", 0, 1e12, 0),
    Key("control", "torque_limit", "NUMBER", "REQUIRED", 0, 1e12, 0),
    Key("hand", "stiffness", "NUMBER", "REQUIRED", 0, 1e12, 0),
    Key("hand", "damping", "NUMBER", "OPTIONAL", 0, 1e6, 0),
    Key("hand", "amplitude", "NUMBER", "REQUIRED", 0, 1e9, 0),
    Key("hand", "frequency", "NUMBER", "REQUIRED", 0, 100, 0),
    Key("hand", "start", "NUMBER", "OPTIONAL", 0, 1e9, 0),
    Key("faults", "drop", "NUMBER", "OPTIONAL", 0, 1, 0, False, "lost"),
    Key("faults", "duplicate", "NUMBER", "OPTIONAL", 0, 1, 0, False, "repeated"),
    Key("faults", "reorder", "NUMBER", "OPTIONAL", 0, 1, 0, False, "lost wrong_sequence"),
    Key("faults", "delay", "NUMBER", "OPTIONAL", 0, 1, 0, False, "lost wrong_sequence"),
    Key("faults", "corrupt", "NUMBER", "OPTIONAL", 0, 1, 0, False, "lost crc"),
    Key("faults", "length", "NUMBER", "OPTIONAL", 0, 1, 0, False, "lost format"),
    Key("faults", "id", "NUMBER", "OPTIONAL", 0, 1, 0, False, "lost ignored"),
    Key("faults", "extended", "NUMBER", "OPTIONAL", 0, 1, 0, False, "lost format"),
    Key("faults", "invalid", "NUMBER", "OPTIONAL", 0, 1, 0, False, "invalid"),
    Key("faults", "glitch", "NUMBER", "OPTIONAL", 0, 1, 0, False, "jump"),
    Key("faults", "babble", "NUMBER", "OPTIONAL", 0, 1, 0, False, "ignored"),
    Key("faults", "silence", "NUMBER", "OPTIONAL", 0, 1, 0, False, "stale rearm"),
    Key("faults", "bus_off", "NUMBER", "OPTIONAL", 0, 1, 0, False, "bus_off rearm"),
    Key("faults", "restart", "NUMBER", "OPTIONAL", 0, 1, 0, False, "resets"),
    Key("status", "period_ms", "NUMBER", "REQUIRED", 1, 60000, 0),
    Key("measured", "torque", "TEXT", "OPTIONAL", 0, 0, "", True),
    Key("measured", "torque_scale", "NUMBER", "OPTIONAL", -1e300, 1e300, 1, True),
    Key("measured", "offset", "NUMBER", "OPTIONAL", -1e300, 1e300, 0, True),
    Key("measured", "spring", "NUMBER", "OPTIONAL", -1e300, 1e300, 0, True),
    Key("measured", "settle", "WHOLE", "OPTIONAL", 0, 2147483647, 0, True),
    Key("measured", "label_angle", "TEXT", "OPTIONAL", 0, 0, "angle from the start [rad]", True),
    Key("measured", "label_torque", "TEXT", "OPTIONAL", 0, 0, "friction torque [N m]", True),
    Key("measured", "angle_scale", "NUMBER", "OPTIONAL", -1e300, 1e300, 1, True),
)
# fmt: on
# --- from host_sim/keys.csv: end

KEYS = {(key.section, key.name): key for key in _ROWS}


def names(section: str) -> tuple[str, ...]:
    """Return the names of all keys of a section, in the order of the table."""
    return tuple(name for place, name in KEYS if place == section)


def node_settings() -> tuple[str, ...]:
    """Return the keys of [friction] that set a node and not its friction: the optional numbers."""
    return tuple(
        key.name
        for key in _ROWS
        if (key.section, key.need) == ("friction", "OPTIONAL")
        and key.type != "TEXT"
        and key.name != "node"
    )
