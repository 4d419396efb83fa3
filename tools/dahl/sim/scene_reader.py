# SPDX-License-Identifier: MIT
"""Read a scene file and settings of the command line, and check them: each value by the table of
keys.py, then the scene as a whole. An error names file and line, or the setting, key, value and
range.
"""

from __future__ import annotations

import configparser
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn, TypeAlias

from dahl.binding import models
from dahl.errors import InputError
from dahl.sim import keys
from dahl.sim.keys import Key

Value: TypeAlias = float | str | tuple[float, ...]  # of NUMBER and WHOLE, TEXT, LIST
Name: TypeAlias = tuple[str, str]  # section, key; a key of "" is the section

KINDS = ("segments", "steering", "log")  # of [motion]
SECTION_LINE = re.compile(r"\s*\[([^\]]+)\]")
KEY_LINE = re.compile(r"\s*([^\s=:\[;#][^=:]*?)\s*[=:]")
SETTING = re.compile(r"(\w+)\.(\w+)=(.*)", re.DOTALL)


class _Parser(configparser.ConfigParser):
    def optionxform(self, optionstr: str) -> str:
        """Keep the case of keys: Fc differs from fc."""
        return optionstr


def _syntax_error(error: configparser.Error) -> str:
    """Return line and reason."""
    if isinstance(error, configparser.DuplicateSectionError):
        return f":{error.lineno}: [{error.section}] is given twice"
    if isinstance(error, configparser.DuplicateOptionError):
        return f":{error.lineno}: [{error.section}] {error.option} is given twice"
    if isinstance(error, configparser.MissingSectionHeaderError):
        return f":{error.lineno}: {error.line.strip()[:80]!r} stands before the first [section]"
    if isinstance(error, configparser.ParsingError):
        line, text = error.errors[0]
        return f":{line}: {text[:80]}: neither a [section], nor key = value, nor a comment"
    return f": {' '.join(str(error).split())}"


@dataclass
class Contents:
    """The checked contents of a scene: values by section and key, and the names of its sections."""

    path: Path = Path()
    values: dict[Name, Value] = field(default_factory=dict)
    sections: tuple[str, ...] = ()
    places: dict[Name, str] = field(default_factory=dict)  # file and line, or the setting

    def has(self, section: str, name: str = "") -> bool:
        return (section, name) in self.values if name else section in self.sections

    def get(self, section: str, name: str) -> Value:
        """Return the value of a key, else its default."""
        return self.values.get((section, name), keys.KEYS[section, name].default)

    def number(self, section: str, name: str) -> float:
        value = self.get(section, name)
        assert isinstance(value, (int, float)), name
        return value

    def text(self, section: str, name: str) -> str:
        return str(self.get(section, name))

    def numbers(self, section: str, name: str) -> tuple[float, ...]:
        value = self.values.get((section, name), ())
        assert isinstance(value, tuple), name
        return value

    def place(self, section: str, name: str = "") -> str:
        """Return file and line, or the setting of the command line, of a section or a key."""
        return self.places.get((section, name)) or self.places.get((section, "")) or f"{self.path}"

    def fail(self, section: str, name: str, words: str) -> NoReturn:
        raise InputError(f"{self.place(section, name)}: {words}")


class SceneFile(Contents):
    """A scene that is read from a file and from settings. Raises dahl.Error."""

    def __init__(self, path: Path, sets: Sequence[str] = ()) -> None:
        super().__init__(path)
        self._parser = _Parser(
            inline_comment_prefixes=(";",), interpolation=None, default_section=""
        )
        self._read()
        for text in sets:
            self._set(text)
        self.sections = tuple(self._parser.sections())
        self._check_names()
        self.values = {
            (section, name): self._value(keys.KEYS[section, name], text)
            for section in self.sections
            for name, text in self._parser[section].items()
        }
        self._check()

    # --- names and values -------------------------------------------------------------------------

    def _read(self) -> None:
        try:
            text = self.path.read_text(encoding="utf-8-sig")
            self._parser.read_string(text, source=str(self.path))
        except configparser.Error as error:
            raise InputError(f"{self.path}{_syntax_error(error)}") from None
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"{self.path}: {getattr(error, 'strerror', error)}") from None
        section = ""
        for number, line in enumerate(text.splitlines(), 1):
            if match := SECTION_LINE.match(line):
                section = match[1]
                self.places.setdefault((section, ""), f"{self.path}:{number}")
            elif match := KEY_LINE.match(line):
                self.places.setdefault((section, match[1]), f"{self.path}:{number}")

    def _set(self, text: str) -> None:
        """Apply a setting "section.key=value"."""
        match = SETTING.fullmatch(text)
        if not match:
            raise InputError(f"--set {text}: not section.key=value")
        section, name, value = match.groups()
        if not self._parser.has_section(section):
            self._parser.add_section(section)
            self.places[section, ""] = f"--set {text}"
        self._parser.set(section, name, value.strip())
        self.places[section, name] = f"--set {text}"

    def _check_names(self) -> None:
        for section in self.sections:
            if section not in keys.SECTIONS:
                known = ", ".join(keys.SECTIONS)
                self.fail(section, "", f"unknown section [{section}] (known: {known})")
            known_keys = keys.names(section)
            for name in self._parser[section]:
                if name not in known_keys:
                    words = f"[{section}] has no key '{name}' (known: {', '.join(known_keys)})"
                    self.fail(section, name, words)

    def _value(self, key: Key, text: str) -> Value:
        if not text:
            self.fail(key.section, key.name, f"{key.place} is empty")
        if key.type == "TEXT":
            return text
        if key.type != "LIST":
            return self._number(key, text)
        return tuple(self._number(key, word) for word in text.split())

    def _number(self, key: Key, text: str) -> float:
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        why = ""
        if not math.isfinite(number):
            why = "not a finite number"
        elif key.type == "WHOLE" and not number.is_integer():
            why = "not a whole number"
        elif not key.low <= number <= key.high:
            why = f"outside {key.low:.10g} to {key.high:.10g}"
        if why:
            self.fail(key.section, key.name, f"{key.place} = {text}: {why}")
        return number

    # --- the whole --------------------------------------------------------------------------------

    def _check(self) -> None:
        if not self.has("friction") and not self.has("motion"):
            raise InputError(f"{self.path}: has neither [friction] nor [motion]")
        if self.has("motion"):
            self._check_kind()
        for key in keys.KEYS.values():
            self._check_key(key)
        self._check_sections()
        self._check_faults()
        if self.has("friction"):
            self._check_model()
        self._check_load()

    def _check_kind(self) -> None:
        if not self.has("motion", "kind"):
            self.fail("motion", "", "[motion] has no key 'kind'")
        kind = self.text("motion", "kind")
        if kind not in KINDS:
            self.fail("motion", "kind", f"[motion] kind = {kind}: not one of {', '.join(KINDS)}")

    def _check_key(self, key: Key) -> None:
        """Check that a required key is there, and no key of another kind of motion."""
        kind = self.text("motion", "kind")
        is_for_kind = key.section != "motion" or not key.of or kind in key.of.split()
        is_given = self.has(key.section, key.name)
        if self.has(key.section) and key.need == "REQUIRED" and is_for_kind and not is_given:
            self.fail(key.section, "", f"[{key.section}] has no key '{key.name}'")
        if is_given and not is_for_kind:
            self.fail("motion", key.name, f"{key.place} has no meaning for kind = {kind}")

    def _check_sections(self) -> None:
        for section in self.sections:
            for needed in keys.SECTIONS[section].split():
                if not self.has(needed):
                    self.fail(section, "", f"[{section}] needs [{needed}]")
        if self.has("rotor") and self.has("motor") == self.has("control"):
            self.fail("rotor", "", "[rotor] needs one of [motor] and [control]")
        if self.has("motor") and self.has("motion"):
            self.fail("motion", "", "[motor] moves the shaft, so [motion] has no meaning")

    def _check_faults(self) -> None:
        rates = math.fsum(self.number("faults", name) for name in keys.names("faults"))
        if rates > 1:
            self.fail("faults", "", f"[faults] rates add up to {rates:.9g}: above 1")
        if self.has("faults") and not self.has("friction", "max_step"):
            words = "[faults] needs [friction] max_step, so that the node detects a glitch"
            self.fail("faults", "", words)

    def _check_model(self) -> None:
        known, name = models.table(), self.text("friction", "model")
        if name not in known:
            words = f"[friction] model = {name}: not one of {', '.join(known)}"
            self.fail("friction", "model", words)
        model = known[name]
        for key in sorted({row.key for row in known.values()} - {""}):
            if self.has("friction", key) and key != model.key:
                self.fail("friction", key, f"[friction] {key} has no meaning for model = {name}")
            if key == model.key and not self.has("friction", key):
                self.fail("friction", "model", f"[friction] model = {name} needs the key '{key}'")
        sigma0s, torques = (len(self.numbers("friction", key)) for key in ("sigma0", "Fc"))
        if not model.fits(sigma0s, torques):
            words = f"sigma0 has {sigma0s} numbers and Fc {torques}: not those of model {name}"
            self.fail("friction", "Fc", f"[friction] {words}")
        kinds = self.text("friction", "kinds").split()
        if name == "parallel" and (len(kinds) != torques or not {*kinds} <= {"dahl", "slip"}):
            words = f"[friction] kinds = {' '.join(kinds)}: not dahl or slip for each of {torques}"
            self.fail("friction", "kinds", words)

    def _check_load(self) -> None:
        """A load is the motor's torque or a column of the log."""
        name, has_encoder = self.text("friction", "model"), self.has("motion") or self.has("motor")
        if name == "loaded" and has_encoder and not self.has("load"):
            self.fail("friction", "model", "[friction] model = loaded needs [load]")
        if name != "loaded" and self.has("load"):
            self.fail("load", "", f"[load] has no meaning for model = {name}")
        if self.has("load"):
            self._check_load_source()

    def _check_load_source(self) -> None:
        has_shaft, has_column = self.has("rotor"), self.has("load", "column")
        if not has_shaft and self.text("motion", "kind") != "log":
            self.fail("load", "", "[load] needs a [rotor], or [motion] kind = log")
        if has_shaft and has_column:
            self.fail("load", "column", "[load] column has no meaning with a [rotor]")
        if not has_shaft and not has_column:
            words = "[load] has no key 'column': which column of the log holds the load?"
            self.fail("load", "", words)
        if not has_shaft and self.has("load", "rotor_limit"):
            self.fail("load", "rotor_limit", "[load] rotor_limit has no meaning without a [rotor]")
