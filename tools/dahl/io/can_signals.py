# SPDX-License-Identifier: MIT
"""Signals of a CAN bus by a DBC, and channels of an MF4, at the times of the angle."""

from __future__ import annotations

import logging
import re
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from dahl.errors import Error, InputError, meant
from dahl.io import can_logs
from dahl.io.files import one_line

if TYPE_CHECKING:
    import can
    import cantools

TIME_COLUMN = "time [s]"  # frames and channels have their times in s
ALTERNATING_PART = 0.99  # of the frames, for two messages that alternate
NEEDS_DBC = "a CAN log needs --dbc FILE, --angle SIGNAL and --torque SIGNAL"
Columns = tuple[dict[str, str], dict[str, np.ndarray]]  # names with units, and values, by role
Series = tuple[np.ndarray, np.ndarray]  # times and values, (n,) each


class Signals:
    """Signals of a bus, fed frame by frame. Each has the times of its own frames."""

    def __init__(self, dbc: Path, names: Mapping[str, str]) -> None:
        """`names` has the SIGNAL, or MESSAGE.SIGNAL, of each role. Raises dahl.Error."""
        database = read_dbc(dbc)
        self.names = dict(names)
        self.messages = {role: _message_with(database, name) for role, name in names.items()}
        self.signals = {
            role: message.get_signal_by_name(names[role].rpartition(".")[2])
            for role, message in self.messages.items()
        }
        self.roles: dict[int, list[str]] = {}
        for role, message in self.messages.items():
            self.roles.setdefault(message.frame_id, []).append(role)
        # by role, then by channel and whether the id has 29 bits
        self.found: dict[str, dict[tuple[str, bool], list[tuple[float, float]]]] = {
            role: defaultdict(list) for role in names
        }

    @property
    def columns(self) -> dict[str, str]:
        """Names with units, as columns of a table have them, by role."""
        units = {role: signal.unit for role, signal in self.signals.items()}
        named = {role: _with_unit(name, units[role]) for role, name in self.names.items()}
        return {**named, "time": TIME_COLUMN}

    def feed(self, frame: can.Message) -> None:
        """Store the values of a frame that are in the range of the DBC."""
        roles = self.roles.get(frame.arbitration_id, [])
        if not roles or frame.is_error_frame or frame.is_remote_frame:
            return
        data, decode = bytes(frame.data), self.messages[roles[0]].decode_simple
        try:
            values: Any = decode(data, decode_choices=False, allow_truncated=True)
        except Exception:  # noqa: BLE001  (another kind of frame with the same id)
            return
        for role in roles:
            signal, origin = self.signals[role], (str(frame.channel), frame.is_extended_id)
            value = float(values.get(signal.name, np.nan))
            if _is_in_range(value, signal):
                self.found[role][origin].append((frame.timestamp, value))

    def rows(self) -> int:
        """Return the number of values of the rarest signal."""
        return min(sum(map(len, origins.values())) for origins in self.found.values())

    def values(self, place: Path | str) -> dict[str, np.ndarray]:
        """Return angle, torque, time and loads at the frames of the angle. Raises dahl.Error."""
        series = {role: self._series(place, role) for role in self.names}
        (angle_time, angle), torque = series.pop("angle"), series.pop("torque")
        rows, torques = _torque_at(angle_time, *torque)
        if len(rows) < 2:
            names = f"'{self.names['angle']}' and '{self.names['torque']}'"
            raise InputError(f"{place}: {names} share no time")
        time = angle_time[rows]
        loads = {role: np.interp(time, *one) for role, one in series.items()}
        return {"angle": angle[rows], "torque": torques, "time": time, **loads}

    def _series(self, place: Path | str, role: str) -> Series:
        """Return times and values of a signal. Raises dahl.Error if they are not of one channel.

        Ids of 11 and of 29 bits may have the same number; those of the DBC's kind come first.
        """
        found, name = self.found[role], self.names[role]
        kind = self.messages[role].is_extended_frame
        origins = [one for one in found if one[1] == kind] or list(found)
        channels = sorted(channel for channel, _ in origins)
        if len(channels) > 1:
            raise InputError(
                f"{place}: signal '{name}' comes on channels {', '.join(channels)}:"
                f" which one is it? -c {channels[0]} selects that"
            )
        pairs = found[origins[0]] if origins else []
        if len(pairs) < 2:
            raise InputError(f"{place}: signal '{name}' comes in {len(pairs)} valid frames")
        time, values = np.array(pairs).T
        check_clock(time, lambda row: f"{place}: frame {row + 1} of '{name}'")
        return time, values


def read_dbc(path: Path) -> cantools.database.Database:
    """Read a DBC, without free comments, which cantools rejects. Raises dahl.Error."""
    import cantools

    try:
        text = path.read_text(encoding="cp1252")
        text = re.sub(r"^CM_ \d.*$", "", text, flags=re.MULTILINE)
        found = cantools.database.load_string(text, database_format="dbc", strict=False)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a DBC (byte {error.start} is no text)") from None
    except (cantools.Error, ValueError) as error:
        raise InputError(f"{path}: not a DBC ({one_line(error)})") from None
    return cast("cantools.database.Database", found)


def _message_with(database: cantools.database.Database, name: str) -> cantools.database.Message:
    """Return the message of a SIGNAL or MESSAGE.SIGNAL. Raises dahl.Error if it is not just one."""
    within, _, signal = name.rpartition(".")
    known = {one.name: [part.name for part in one.signals] for one in database.messages}
    messages = [one for one in known if signal in known[one] and within in ("", one)]
    if len(messages) > 1:
        places = ", ".join(f"{one}.{signal}" for one in messages)
        raise InputError(f"signal '{signal}' is in several messages, which one is it: {places}?")
    if not messages:
        raise InputError(f"no signal '{name}' in the DBC{meant(name, sum(known.values(), []))}")
    return database.get_message_by_name(messages[0])


def _is_in_range(value: float, signal: cantools.database.Signal) -> bool:
    """Return whether the DBC allows a value; cantools reads [0|0] as no limits."""
    low = -np.inf if signal.minimum is None else signal.minimum
    high = np.inf if signal.maximum is None else signal.maximum
    return bool(low <= value <= high)


def _torque_at(angle_time: np.ndarray, time: np.ndarray, torque: np.ndarray) -> Series:
    """Return the rows of the angle that have a torque, and these torques.

    If the two messages alternate, a torque belongs to the angle before it, however late a busy bus
    sends it. Otherwise it is interpolated between its frames.
    """
    if np.array_equal(angle_time, time):
        return np.arange(len(angle_time)), torque
    first = np.searchsorted(time, angle_time)  # not before the angle
    rows = np.flatnonzero(first < len(time))
    rows = rows[time[first[rows]] < np.append(angle_time, np.inf)[rows + 1]]
    if len(rows) >= ALTERNATING_PART * max(len(angle_time), len(time)):
        return rows, torque[first[rows]]
    rows = np.flatnonzero((angle_time >= time[0]) & (angle_time <= time[-1]))
    return rows, np.interp(angle_time[rows], time, torque)


# --- channels of an MF4 ---------------------------------------------------------------------------


def read_channels(path: Path, choose: Callable[[list[str]], dict[str, str]]) -> Columns:
    """Read the channels of the names by role that `choose` returns. Raises dahl.Error."""
    from asammdf import MDF

    logging.getLogger("asammdf").setLevel(logging.CRITICAL)
    try:
        with can_logs.discard_broken_readers(), MDF(can_logs.mf4_in_memory(path)) as file:
            if "CAN_DataFrame" in file.channels_db:  # raw frames, by ASAM's name for them
                raise InputError(f"{path}: {NEEDS_DBC}")
            places = _unique_names(file.channels_db)
            names = choose(sorted(places))
            channels = {role: file.get(None, *places[name]) for role, name in names.items()}
    except Error:
        raise
    except Exception as error:  # asammdf has no root exception of its own
        raise InputError(f"{path}: broken, cut off or no MF4 ({one_line(error)})") from None
    for role, one in channels.items():
        if one.samples.dtype.kind not in "fiub" or one.samples.ndim != 1:
            raise InputError(f"{path}: channel '{names[role]}' holds no numbers")
    named = {role: _with_unit(name, channels[role].unit) for role, name in names.items()}
    return {**named, "time": TIME_COLUMN}, _at_the_angle(path, channels)


def _unique_names(channels: Mapping[str, Sequence[tuple[int, int]]]) -> dict[str, tuple[int, int]]:
    """Return group and index of each channel that is no clock, by a unique name."""
    return {
        name if len(places) == 1 else f"group {place[0]}: {name}": place
        for name, places in channels.items()
        if name not in ("t", "time", "timestamps")
        for place in places
    }


def _at_the_angle(path: Path, channels: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Return the channels at the times of the angle that all of them cover. Raises dahl.Error."""
    time, clocks = channels["angle"].timestamps, [one.timestamps for one in channels.values()]
    if any(len(clock) == 0 for clock in clocks):
        return {role: np.zeros(0) for role in ("time", *channels)}
    start, end = max(clock[0] for clock in clocks), min(clock[-1] for clock in clocks)
    rows = (time >= start) & (time <= end)
    if not rows.any():
        raise InputError(f"{path}: its channels share no time")
    values = {"time": time[rows]}
    for role, one in channels.items():
        is_same = np.array_equal(time, one.timestamps)  # also if several rows have one time
        values[role] = one.samples if is_same else np.interp(time, one.timestamps, one.samples)
        values[role] = np.asarray(values[role], dtype=float)[rows]
    return values


def _with_unit(name: str, unit: str | None) -> str:
    """Return a name and its unit as a column of a table has them."""
    return f"{name} [{unit}]" if unit else name


def check_clock(
    time: np.ndarray, place: Callable[[int], str], restarts: Sequence[int] | np.ndarray = ()
) -> None:
    """Raise dahl.Error if a time goes backward, but for restarts, with the place of its row."""
    back = np.setdiff1d(np.flatnonzero(np.diff(time) < 0) + 1, restarts)
    if len(back):
        row = int(back[0])
        before, now = time[row - 1], time[row]
        raise InputError(
            f"{place(row)}: {now:g} after {before:g}, the clock goes backward: split the log there,"
            " or sort its rows"
        )
