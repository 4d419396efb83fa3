# SPDX-License-Identifier: MIT
"""Read measured logs: the one reader of all commands.

read() returns a Log in SI units for a fit; read_columns() returns named columns in the units of the
file. pandas, scipy, python-can, cantools and asammdf read the files; this module finds the columns
and applies their units. An error names file, line or row, column and value.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dahl.errors import Error, InputError, meant
from dahl.io import can_logs, encoder_grid, text_tables, units
from dahl.io.can_signals import (
    NEEDS_DBC,
    TIME_COLUMN,
    Columns,
    Signals,
    check_clock,
    read_channels,
)
from dahl.io.log import Log, resolution_of, restarts
from dahl.io.tables import open_table, row_of
from dahl.io.text_tables import Table

if TYPE_CHECKING:
    import pandas

MAX_ROW_PERIOD_S = 1.0  # from here on the time is probably in ms
MIN_WRAP_TURNS = 0.9  # between two rows: the angle starts anew
DATE, TIME_OF_DAY = re.compile(r"\d{4}-\d\d-\d\d"), re.compile(r"\d+:\d\d:\d\d")
MIDNIGHT = np.timedelta64(-12, "h")  # a time of day that goes back by more has passed midnight
NO_TIME = "no column of times: what depends on speed (viscous, inertia) is not fitted (--time)"

ROLES = {  # patterns of the names of columns
    "angle": r"angle|theta|position|deflection|displacement|encoder|counts?$|winkel|weg(?![a-z])"
    r"|(?<![a-z])pos(?![a-z])|(^|[/.])(?<!current\.)q\d*(?![a-z]|_(current|axis|volt))",
    "torque": r"torque|friction|force|trq|load|moment|kraft|effort|(?<![a-z])(N_?m|tau)(?![a-z])"
    r"|(?<![a-z])i_?q(?![a-z])|current(?![._ ]?(pos|angle|vel|speed|temp|time|state|mode))|amps",
    # not T and T_degC, which are temperatures
    "time": r"^_*time|stamp|^(uhr)?zeit|^(?-i:t)$|^t[\s_(\[]+[mun]?s(ec|econds)?(?![a-z])"
    r"|^(milli|micro|[mun])s(?![a-z])",
}
DERIVED = r"(?<![a-z])(vel|speed|rate|d+ot|acc(el|$|[^a-z])|err(or)?(?![a-z]))|theta_?d+ot"
SETPOINT = r"(?<![a-z])(ref|set|target|cmd|command|desired|demand)"
FORCE = r"force|load|kraft"  # a torque is more likely
CURRENT = r"(?<![a-z])i_?q(?![a-z])|current|amps"  # a torque or a force is more likely
SINCE_1970 = {"ns": 1e17, "us": 1e14, "ms": 1e11}  # least times in these units


@dataclass(frozen=True)
class Source:
    """The options that describe the columns of logs."""

    angle: str = ""
    torque: str = ""
    time: str = ""
    angle_unit: str = ""
    torque_unit: str = ""
    time_unit: str = ""
    torque_constant: float = 0.0  # N m/A (N/A) of a motor whose current is the torque
    counts_per_turn: float = 0.0  # of the encoder; for a linear motion counts per mm
    dbc: Path | None = None
    skip_gaps: bool = False
    load: tuple[str, ...] = ()  # columns whose sum the friction may follow
    channel: str | None = None  # for a CAN log with several

    @property
    def loads(self) -> dict[str, str]:
        """Names of the columns of the load, by role."""
        return {f"load {number}": name for number, name in enumerate(self.load, 1)}

    @property
    def signals(self) -> dict[str, str]:
        """Names of the signals on a bus, by role."""
        return {"angle": self.angle, "torque": self.torque, **self.loads}


def read(path: Path, source: Source, may_restart: bool = True) -> Log:
    """Read a log. Raises dahl.Error, also if its clock starts anew and that is not allowed."""
    _check_file(path)
    notes: list[str] = []
    if path.suffix.lower() not in can_logs.CAN_LOGS:
        columns = _read_table(path, source, notes, may_restart)
    elif source.dbc is None and path.suffix.lower() == ".mf4":
        columns = _read_channels(path, source, notes)
    else:
        columns = _read_frames(path, source, notes)
    return to_log(f"{path}", source, columns, notes)


def read_columns(path: Path, wanted: Mapping[str, str]) -> Columns:
    """Read columns of a table by role, in the units of the file. Raises dahl.Error.

    `wanted` has their names, or their numbers from 1. Moments of the role "time" become seconds.
    """
    _check_file(path)
    table = open_table(path, min_columns=1)
    places = {role: _index_of(name, table.names, table.head) for role, name in wanted.items()}
    return _columns_at(table, places)


def _check_file(path: Path) -> None:
    if path.is_dir():
        raise InputError(f"{path}: a folder; dahl identify --each reads the logs in it")
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    if path.stat().st_size == 0:
        raise InputError(f"{path}: empty")


def _read_frames(path: Path, source: Source, notes: list[str]) -> Columns:
    """Read the signals of a CAN log."""
    if source.dbc is None:
        raise InputError(f"{path}: {NEEDS_DBC}")
    if not (source.angle and source.torque):
        raise InputError(f"{path}: name the signals with --angle SIGNAL and --torque SIGNAL")
    signals = Signals(source.dbc, source.signals)
    for frame in can_logs.frames_of(path, notes):
        if source.channel is None or str(frame.channel) == source.channel:
            signals.feed(frame)
    return signals.columns, can_logs.with_notes(notes, lambda: signals.values(path))


def _read_channels(path: Path, source: Source, notes: list[str]) -> Columns:
    def choose(known: list[str]) -> dict[str, str]:
        found = find_columns(f"{path}", source, known, ("angle", "torque"), notes)
        return {role: known[place] for role, place in found.items()}

    names, values = read_channels(path, choose)
    place = partial(row_of, path)
    return names, _without_gaps(place, source.skip_gaps, names, values)


# --- tables ---------------------------------------------------------------------------------------


def _read_table(path: Path, source: Source, notes: list[str], may_restart: bool) -> Columns:
    """Read angle, torque, loads and, if there is one, the time. Raises dahl.Error."""
    table = open_table(path)
    places = find_columns(table.head, source, table.names, tuple(ROLES), notes)
    if "time" not in places and (clock := _clock(table, places)) is not None:
        places["time"] = clock
        notes.append(f"time read from '{table.names[clock]}' by its unit (--time)")
    if "time" in places and (rest := _nanoseconds(table.names, places["time"])) is not None:
        places["nanoseconds"] = rest
    names, values = _columns_at(table, places, source.skip_gaps, may_restart)
    if "nanoseconds" in values:
        values["time"] = values["time"] + 1e-9 * values.pop("nanoseconds")
    return names, values


def _nanoseconds(names: Sequence[str], seconds: int) -> int | None:
    """Return the column of the nanoseconds beside whole seconds, as ROS writes a stamp, or None."""
    stem = re.sub(r"secs?$", "", names[seconds])
    beside = (stem + end for end in ("nanosec", "nanosecs", "nsec", "nsecs"))
    found = (names.index(name) for name in beside if stem != names[seconds] and name in names)
    return next(found, None)


def _columns_at(
    table: Table, places: dict[str, int], skip_gaps: bool = False, may_restart: bool = False
) -> Columns:
    """Return the columns at the places of the roles. Raises dahl.Error."""
    names = {role: table.names[place] for role, place in places.items()}
    columns = {role: table.frame.iloc[:, place] for role, place in places.items()}
    seconds = _seconds_from_first(columns["time"]) if "time" in columns else None
    if seconds is not None:
        columns["time"] = seconds
    values = {role: _numbers(table, names[role], column) for role, column in columns.items()}
    values = _without_gaps(table.place, skip_gaps, names, values, may_restart)
    return names | ({} if seconds is None else {"time": TIME_COLUMN}), values


def _seconds_from_first(column: pandas.Series) -> pandas.Series | None:
    """Return dates and times of day (ISO 8601, decimal comma too) as s from the first.

    None if the first cell is neither; other cells stay unchanged.
    """
    import pandas as pd

    first = "" if column.empty else str(column.iloc[0]).strip()
    if first and column.dtype.kind in "Mm":
        moments = column
    elif DATE.match(first):
        text = _with_decimal_points(column)
        moments = pd.to_datetime(text, format="ISO8601", utc=True, errors="coerce")
    elif TIME_OF_DAY.match(first):
        times = pd.to_timedelta(_with_decimal_points(column), errors="coerce")
        days = (times.diff() < MIDNIGHT).cumsum()
        moments = times + pd.to_timedelta(days, unit="D")
    else:
        return None
    seconds: pandas.Series = (moments - moments.iloc[0]).dt.total_seconds()
    return seconds.where(seconds.notna(), column)


def _with_decimal_points(column: pandas.Series) -> pandas.Series:
    return column.astype(str).str.strip().str.replace(",", ".")


def _numbers(table: Table, name: str, column: pandas.Series) -> np.ndarray:
    """Return a column as float64, NaN for empty cells. Raises dahl.Error for other text."""
    import pandas as pd

    try:
        values = pd.to_numeric(column, errors="coerce").to_numpy(dtype=float)
    except OverflowError:
        raise InputError(f"{table.head}: column '{name}': a number is beyond 1e308") from None
    rows = np.flatnonzero(np.isnan(values) & column.notna().to_numpy())
    if len(rows):  # one of them leaves decimal commas as text too
        cells = [str(cell) for cell in column.iloc[rows]]
        first = next((k for k, cell in enumerate(cells) if not text_tables.is_number(cell)), 0)
        place, cell = table.place(int(rows[first])), cells[first][:60]
        raise InputError(f"{place}: column '{name}': '{cell}' is not a number")
    return values


def _without_gaps(
    place: Callable[[int], str],
    skip_gaps: bool,
    names: dict[str, str],
    values: dict[str, np.ndarray],
    may_restart: bool = False,
) -> dict[str, np.ndarray]:
    """Leave out rows without a number if that is allowed, and check the clock."""
    whole = np.all([np.isfinite(column) for column in values.values()], axis=0)
    missing = int(np.count_nonzero(~whole))
    if missing and (missing == len(whole) or not skip_gaps):
        row = int(np.argmin(whole))
        role = next(role for role, column in values.items() if not np.isfinite(column[row]))
        raise InputError(
            f"{place(row)}: column '{names[role]}': no finite number ({values[role][row]}) here and"
            f" in {missing} of {len(whole)} rows in all (--skip-gaps of dahl identify and dahl"
            " commission leaves them out)"
        )
    rows = np.flatnonzero(whole)
    if "time" in values:
        column = f"column '{names['time']}'"
        time, where = values["time"][rows], lambda row: f"{place(int(rows[row]))}: {column}"
        check_clock(time, where, restarts(time) if may_restart else ())
    return {role: column[rows] for role, column in values.items()} if missing else values


# --- which column is what -------------------------------------------------------------------------


def find_columns(
    place: str, source: Source, known: Sequence[str], roles: Sequence[str], notes: list[str]
) -> dict[str, int]:
    """Return the index of the column of each role, and of the loads. Raises dahl.Error.

    An option names the column, else it is the one with the likeliest name. A time may be absent.
    """
    found = {role: _index_of(name, known, place) for role, name in source.loads.items()}
    free = [k for k in range(len(known)) if k not in found.values()]
    for role in roles:
        given = getattr(source, role)
        fitting = [_index_of(given, known, place)] if given else _likeliest(role, known, free)
        if fitting:
            found[role] = fitting[0]
        elif role != "time":
            hint = meant(role, known)
            raise InputError(f"{place}: which column is the {role}? Name it with --{role}{hint}")
        if len(fitting) > 1 and role != "time":
            first, *others = (f"'{known[k]}'" for k in fitting)
            notes.append(f"{role} read from {first}, not from {' or '.join(others)} (--{role})")
    for one, other in itertools.combinations(found, 2):
        if found[one] == found[other]:
            name = known[found[one]]
            raise InputError(f"{place}: column '{name}' cannot be both {one} and {other}")
    return found


def _likeliest(role: str, known: Sequence[str], free: Sequence[int]) -> list[int]:
    """Return the columns whose names fit best: no setpoints, and a torque before a force."""
    fitting = [k for k in free if re.search(ROLES[role], known[k], re.IGNORECASE)]
    if role == "time":
        return fitting
    fitting = [k for k in fitting if not re.search(DERIVED, known[k], re.IGNORECASE)]
    doubts = [
        4 * bool(re.search(SETPOINT, known[k], re.IGNORECASE))
        + 2 * bool(role == "torque" and re.search(CURRENT, known[k], re.IGNORECASE))
        + bool(re.search(FORCE, known[k], re.IGNORECASE))
        for k in fitting
    ]
    return [k for k, doubt in zip(fitting, doubts, strict=True) if doubt == min(doubts)]


def _index_of(given: str, known: Sequence[str], place: str) -> int:
    """Return the column of a name, with or without its unit in brackets, or of a number from 1."""
    plain = [units.BRACKETS.sub("", name).strip() for name in known]
    for names in (known, plain):
        if list(names).count(given) == 1:
            return list(names).index(given)
    if given not in known and given.isdecimal() and 1 <= int(given) <= len(known):
        return int(given) - 1
    if given in known:
        raise InputError(
            f"{place}: {list(known).count(given)} columns '{given}': give a number from 1"
        )
    raise InputError(f"{place}: no column '{given}'{meant(given, known)}")


def _clock(table: Table, places: dict[str, int]) -> int | None:
    """Return the first other column with a unit of time in brackets whose values never fall."""
    import pandas as pd

    for place, name in enumerate(table.names):
        if place not in places.values() and units.unit_in_brackets(name, units.TIMES):
            values = pd.to_numeric(table.frame.iloc[:, place], errors="coerce")
            if values.is_monotonic_increasing and values.nunique() > 1:
                return place
    return None


# --- units ----------------------------------------------------------------------------------------


def to_log(name: str, source: Source, columns: Columns, notes: Sequence[str] = ()) -> Log:
    """Apply the units of columns, and unwrap angle and torque. Raises dahl.Error."""
    names, values = columns
    if len(values["angle"]) < 2:
        raise InputError(f"{name}: {len(values['angle'])} rows; a log has more than one")
    unit, angle_notes = units.choose("angle", source.angle_unit, names["angle"], "deg")
    linear, counts = unit in units.LENGTHS, source.counts_per_turn
    if unit == "counts" and not counts:
        raise InputError(f"{name}: an angle in counts needs --counts-per-turn")
    theta = values["angle"] * (2 * np.pi / counts if unit == "counts" else units.ANGLES[unit])
    theta, unwrap_notes = (theta, []) if linear else unwrap(theta, 2 * np.pi)
    try:
        torque, torque_notes = _torque(source, names["torque"], values["torque"], linear)
    except Error as error:
        raise InputError(f"{name}: {error}") from None
    time, time_notes = _time(source, names.get("time", ""), values.get("time"))
    log = Log(name, theta, torque, time, linear)
    log.notes = [*notes, *angle_notes, *unwrap_notes, *torque_notes, *time_notes]
    if not units.stated("angle", source.angle_unit, names["angle"]):
        asked = encoder_grid.question(values["angle"], unit, counts)
        log.questions |= {"angle": asked} if asked else {}
    is_torque = units.stated("torque", source.torque_unit, names["torque"])
    if not (is_torque or source.torque_constant):
        asked = f"is the torque in {log.unit}? '{names['torque']}' names no unit of it"
        log.questions["torque"] = f"{asked} (--torque-unit)"
    count = (1e-3 if linear else 2 * np.pi) / counts if counts else 0.0
    log.resolution = count or resolution_of(theta)
    if source.loads:
        log.load = np.sum([values[role] for role in source.loads], axis=0)
    return log


def unwrap(angle: np.ndarray, turn: float) -> tuple[np.ndarray, list[str]]:
    """Unwrap an angle that stays within a turn and jumps by one, with a note."""
    jumps = np.abs(np.diff(angle)).max(initial=0.0) > MIN_WRAP_TURNS * turn
    if not (jumps and np.ptp(angle) <= turn * (1 + 1e-9)):
        return angle, []
    return np.unwrap(angle, period=turn), ["angle wraps at a turn: unwrapped"]


def _torque(
    source: Source, name: str, torque: np.ndarray, linear: bool
) -> tuple[np.ndarray, list[str]]:
    """Return the torque in N m, the force of a linear motion in N, with notes."""
    if source.torque_constant or _is_current(source, name):
        return _from_current(source, name, torque)
    unit, notes = units.choose("torque", source.torque_unit, name, "N" if linear else "Nm")
    if unit in units.FORCES and not linear:
        notes.append(f"'{name}' is a force over an angle: N taken for N m")
    if unit in units.MOMENTS and linear:
        notes.append(f"'{name}' is a torque over a way: N m taken for N")
    torque, sign_notes = restore_sign(torque)
    return torque * units.TORQUES[unit], notes + sign_notes


def _is_current(source: Source, name: str) -> bool:
    unit = units.stated("torque", source.torque_unit, name)
    return unit in units.CURRENTS if unit else bool(re.search(CURRENT, name, re.IGNORECASE))


def _from_current(source: Source, name: str, current: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Return the torque of a motor by its current, with a note. Raises dahl.Error."""
    unit, constant = units.stated("torque", source.torque_unit, name) or "A", source.torque_constant
    if not constant:
        raise InputError(
            f"column '{name}' is a current, not a torque: give the motor's torque constant in N m/A"
            " with --torque-constant, or another column with --torque"
        )
    if unit not in units.CURRENTS:
        raise InputError(
            f"--torque-constant {constant:g}: column '{name}' is in {unit}, no current"
        )
    note = f"torque from the current '{name}' by {constant:g} N m/A: losses of a gear count too"
    return current * units.CURRENTS[unit] * constant, [note]


def restore_sign(torque: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Return a torque as it was if a signed 16-bit number was read as unsigned, with a note."""
    is_16_bit = torque.min() >= 0 and 32768 <= torque.max() <= 65535 and not (torque % 1).any()
    if not is_16_bit or ((torque > 16384) & (torque < 49152)).any():
        return torque, []
    words = "torque is a signed 16-bit number read as unsigned: 65536 subtracted above 32767"
    return np.where(torque > 32767, torque - 65536, torque), [words]


def _time(
    source: Source, name: str, time: np.ndarray | None
) -> tuple[np.ndarray | None, list[str]]:
    """Return the time in s, with a note if its unit was assumed or if there is no time."""
    if time is None:
        return None, [NO_TIME]
    usual = next((unit for unit, least in SINCE_1970.items() if time[0] > least), "s")
    unit, notes = units.choose("time", source.time_unit, name, usual)
    step = float(np.ptp(time)) / (len(time) - 1)
    doubt = f"; a row comes every {step:.3g} s" + ", is it in ms?" * (step >= MAX_ROW_PERIOD_S)
    return time * units.TIMES[unit], [note + doubt for note in notes]
