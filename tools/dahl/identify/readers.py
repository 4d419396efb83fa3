# SPDX-License-Identifier: MIT
"""Logs of any usual kind as one Log in SI units: tables (CSV, TSV, JSON, MAT, Parquet) and CAN logs
(candump, ASC, BLF, TRC, MF4) with a DBC.

The reading itself is left to pandas, scipy, python-can, cantools and asammdf; here columns are
found, units applied, and whatever is wrong is said in one line that names file, row and column.
"""

from __future__ import annotations

import contextlib
import faulthandler
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from dahl import Error, files, logs
from dahl.identify import text_tables, units
from dahl.identify.log import Log, resolution_of

if TYPE_CHECKING:
    import can
    import cantools
    import pandas

CAN_LOGS = set(logs.CAN_LOGS)
FULL_TURN = 360.0  # deg
SLOW = 1.0  # s a row: the time is rather in ms
DATE, TIME_OF_DAY = re.compile(r"\d{4}-\d\d-\d\d"), re.compile(r"\d+:\d\d:\d\d")
BACK = np.timedelta64(-12, "h")  # by more than this a time of day goes back at midnight alone
CLOCK = "time [s]"  # of frames and channels, whose readers give seconds
NO_TIME = "no column of times: what depends on speed (viscous, inertia) is not fitted (--time)"
TAKE_TURNS = 0.99  # part of the frames, where two messages are said to take turns
NEEDS_DBC = "a CAN log needs --dbc FILE, --angle SIGNAL and --torque SIGNAL"


@dataclass(frozen=True)
class Source:
    """What the command line says about the logs."""

    angle: str = ""
    torque: str = ""
    time: str = ""
    angle_unit: str = ""
    torque_unit: str = ""
    time_unit: str = ""
    counts_per_turn: float = 0.0  # mm: per millimetre
    dbc: Path | None = None
    skip_gaps: bool = False
    load: tuple[str, ...] = ()  # what the friction may follow: their sum
    channel: str | None = None  # of a CAN log that has several

    @property
    def loads(self) -> dict[str, str]:
        """Roles and names of the columns of the load."""
        return {f"load {number}": name for number, name in enumerate(self.load, 1)}


def read(path: Path, source: Source) -> Log:
    """One log. Raises dahl.Error."""
    if path.is_dir():
        raise Error(f"{path}: a folder; --each takes the logs in it")
    if not path.is_file():
        raise Error(f"{path}: no such file")
    if path.stat().st_size == 0:
        raise Error(f"{path}: empty")
    if path.suffix.lower() in CAN_LOGS:
        return _log(path, source, *_read_can(path, source))
    return _log(path, source, *_read_table(path, source))


# --- tables ---------------------------------------------------------------------------------------


Columns = tuple[dict[str, str], dict[str, np.ndarray], list[str]]  # names, values by role; notes


def _read_table(path: Path, source: Source) -> Columns:
    """Names and values of angle, torque and, where there is one, time."""
    frame, first = _frame(path)
    known = [str(name) for name in frame.columns]
    names, notes = _columns(path, source, known, ("angle", "torque", "time"))
    if "time" not in names and (clock := _clock(frame, known, names)):
        names["time"] = clock
        notes.append(f"time taken from '{clock}', by its unit (--time)")
    columns = {what: frame.iloc[:, known.index(name)] for what, name in names.items()}
    passed = _from_the_first(columns["time"]) if "time" in columns else None
    if passed is not None:
        columns["time"] = passed
    values = {
        what: _numbers(f"{path}", first, names[what], column) for what, column in columns.items()
    }
    values = _without_gaps(path, source, names, values, first)
    return (names if passed is None else {**names, "time": CLOCK}), values, notes


def _columns(
    path: Path, source: Source, known: Sequence[str], sought: Sequence[str]
) -> tuple[dict[str, str], list[str]]:
    """The names of the columns that are sought, by role, and of those of the load; with notes."""
    loads = {what: units.wanted(name, known, f"{path}") for what, name in source.loads.items()}
    free = [name for name in known if name not in loads.values()]
    found = {
        what: units.column(what, getattr(source, what), known, f"{path}", free) for what in sought
    }
    notes = [note for _, some in found.values() for note in some]
    taken = {what: name for what, (name, _) in found.items()}
    names = {what: name for what, name in (taken | loads).items() if name}
    for what, name in names.items():
        twice = next((other for other in names if other != what and names[other] == name), None)
        if twice:
            raise Error(f"{path}: column '{name}' cannot be both {what} and {twice}")
    return names, notes


def _clock(frame: pandas.DataFrame, known: Sequence[str], names: dict[str, str]) -> str:
    """Of the columns left over the first that has a unit of time in brackets and values that never
    fall, as in 'Zeit [s]'; "" where there is none.
    """
    import pandas as pd

    for place, name in enumerate(known):
        if name not in names.values() and units.bracketed(name, units.TIMES):
            values = pd.to_numeric(frame.iloc[:, place], errors="coerce")
            if values.is_monotonic_increasing and values.nunique() > 1:
                return name
    return ""


def _frame(path: Path) -> tuple[pandas.DataFrame, int]:
    """The table, and the number of its first row as an editor counts (0: rows have no lines)."""
    kinds: dict[str, Callable[[Path], tuple[Any, int]]] = {
        ".json": _from_json,
        ".mat": _from_mat,
        ".parquet": _from_parquet,
    }
    try:
        return kinds.get(path.suffix.lower(), text_tables.read)(path)
    except Error:
        raise
    except Exception as error:  # for a damaged file each library has kinds beyond its own
        words = " ".join(str(error).split())[:160] or type(error).__name__
        raise Error(f"{path}: cannot be read as {path.suffix or 'a table'}: {words}") from None


def _from_json(path: Path) -> tuple[pandas.DataFrame, int]:
    """A list of rows (objects or lists), an object of columns, or an object that holds one."""
    import pandas as pd

    rows = _rows_in(files.read_json(path))
    if rows is None:
        raise Error(f"{path}: no list of rows and no columns of equal length in it")
    frame = pd.DataFrame(rows)
    if all(isinstance(name, int) for name in frame.columns):
        frame.columns = [str(i + 1) for i in range(frame.shape[1])]
    return frame, 0


def _rows_in(content: Any) -> Any:
    """The first list of rows, or object of columns of one length, in nested objects; else None."""
    if isinstance(content, list):
        return content if content and isinstance(content[0], (dict, list)) else None
    if not isinstance(content, dict):
        return None
    columns = {k: v for k, v in content.items() if _is_column(v)}
    if len(columns) > 1 and len(set(map(len, columns.values()))) == 1:
        return columns
    found = map(_rows_in, content.values())
    return next((rows for rows in found if rows is not None), None)


def _is_column(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], (int, float))


def _from_mat(path: Path) -> tuple[pandas.DataFrame, int]:
    import pandas as pd
    from scipy.io import loadmat

    if not _survives(lambda: loadmat(path)):
        raise Error(f"{path}: broken: reading it crashes")
    try:
        content = loadmat(path, squeeze_me=True, struct_as_record=False)
    except NotImplementedError:
        raise Error(f"{path}: MATLAB 7.3 (HDF5); save it with -v7") from None
    columns = dict(_vectors("", {k: v for k, v in content.items() if not k.startswith("__")}))
    if not columns:
        raise Error(f"{path}: no vectors in it")
    longest = max(map(len, columns.values()))
    return pd.DataFrame({k: v for k, v in columns.items() if len(v) == longest}), 0


def _survives(read: Callable[[], object]) -> bool:
    """Try in a process of its own: scipy takes the types in a MAT file as they come, and with a
    damaged one the whole program ends (scipy pull request 25349).
    """
    child = os.fork()
    if child == 0:
        faulthandler.disable()  # nobody waits for the child's words
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        with contextlib.suppress(Exception):  # of these the second reading tells
            read()
        os._exit(0)
    return not os.WIFSIGNALED(os.waitpid(child, 0)[1])


def _vectors(prefix: str, content: dict[str, Any]) -> Iterator[tuple[str, np.ndarray]]:
    """Vectors by name, fields of structures as `structure.field`, columns of matrices by number."""
    for name, value in content.items():
        if hasattr(value, "_fieldnames"):
            yield from _vectors(f"{prefix}{name}.", vars(value))
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiu":
            columns = [value] if value.ndim == 1 else list(value.T) if value.ndim == 2 else []
            for number, column in enumerate(columns):
                yield f"{prefix}{name}" + (f".{number + 1}" if value.ndim == 2 else ""), column


def _from_parquet(path: Path) -> tuple[pandas.DataFrame, int]:
    """The columns, the index among them where it has a name."""
    import pandas as pd

    frame = pd.read_parquet(path)
    if any(frame.index.names):
        frame = frame.reset_index(allow_duplicates=True)
    return frame, 0


def _from_the_first(column: pandas.Series) -> pandas.Series | None:
    """Dates and times of day (ISO 8601) as s from the first; None where the column has no such. A
    cell that is none of them stays as it is.
    """
    moments = column if column.dtype.kind in "Mm" else _moments(column)
    if moments is None or moments.empty:
        return None
    passed: pandas.Series = (moments - moments.iloc[0]).dt.total_seconds()
    return passed.where(passed.notna(), column)


def _moments(column: pandas.Series) -> pandas.Series | None:
    """The same of text, with a decimal comma too; times of day go on over midnight."""
    import pandas as pd

    first = "" if column.empty else str(column.iloc[0]).strip()
    is_date = DATE.match(first)
    if not (is_date or TIME_OF_DAY.match(first)):
        return None
    text = column.astype(str).str.strip().str.replace(",", ".")
    if is_date:
        return pd.to_datetime(text, format="ISO8601", utc=True, errors="coerce")
    times = pd.to_timedelta(text, errors="coerce")
    return times + pd.to_timedelta((times.diff() < BACK).astype(int).cumsum(), unit="D")


def _numbers(path: str, first: int, name: str, column: pandas.Series) -> np.ndarray:
    """A column as float64; NaN where a cell is empty. Raises dahl.Error for what is no number."""
    import pandas as pd

    try:
        values = pd.to_numeric(column, errors="coerce").to_numpy(dtype=float)
    except OverflowError:
        raise Error(f"{path}: column '{name}': a number is beyond 1e308") from None
    words = np.flatnonzero(np.isnan(values) & column.notna().to_numpy())
    if len(words):
        row = int(words[0])
        place = f"{path}:{row + first}" if first else f"{path}: row {row + 1}"
        raise Error(f"{place}: column '{name}': '{column.iloc[row]}' is not a number")
    return values


def _without_gaps(
    path: Path, source: Source, names: dict[str, str], values: dict[str, np.ndarray], first: int
) -> dict[str, np.ndarray]:
    """All rows whole, or those that are where the user lets gaps be skipped."""
    whole = np.all([np.isfinite(column) for column in values.values()], axis=0)
    if whole.all():
        return values
    row = int(np.argmin(whole))
    what = next(what for what, column in values.items() if not np.isfinite(column[row]))
    if not source.skip_gaps or whole.sum() == 0:
        place = f"{path}:{row + first}" if first else f"{path}: row {row + 1}"
        raise Error(
            f"{place}: column '{names[what]}': no finite number here and in"
            f" {int((~whole).sum())} of {len(whole)} rows in all (--skip-gaps leaves them out)"
        )
    return {what: column[whole] for what, column in values.items()}


# --- CAN logs -------------------------------------------------------------------------------------


def _read_can(path: Path, source: Source) -> Columns:
    """Names and values by role, out of frames or out of the channels of an MF4."""
    if source.dbc is None and path.suffix.lower() == ".mf4":
        return _from_channels(path, source)
    if source.dbc is None:
        raise Error(f"{path}: {NEEDS_DBC}")
    if not (source.angle and source.torque):
        raise Error(f"{path}: name the signals with --angle SIGNAL and --torque SIGNAL")
    signals = Signals(source.dbc, source.angle, source.torque, source.loads)
    for frame in logs.frames_of(path):
        if source.channel is None or str(frame.channel) == source.channel:
            signals.feed(frame)
    return signals.columns, signals.values(path), []


def database_of(path: Path) -> cantools.database.Database:
    """A DBC, without the free comments that cantools does not take. Raises dahl.Error."""
    import cantools

    try:
        text = path.read_text(encoding="cp1252")
    except OSError as error:
        raise Error(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise Error(f"{path}: not a DBC (byte {error.start} is no text)") from None
    text = re.sub(r"^CM_ \d.*$", "", text, flags=re.MULTILINE)
    try:
        found = cantools.database.load_string(text, database_format="dbc", strict=False)
        return cast("cantools.database.Database", found)
    except (cantools.Error, ValueError) as error:
        words = " ".join(str(error).split())[:160]
        raise Error(f"{path}: not a DBC ({words})") from None


class Signals:
    """Signals of a bus, frame by frame: each with the times of its own frames."""

    def __init__(
        self, dbc: Path, angle: str, torque: str, loads: Mapping[str, str] | None = None
    ) -> None:
        database = database_of(dbc)
        self.loads = dict(loads or {})
        self.names = {"angle": angle, "torque": torque, **self.loads}
        self.take = {name: _message_with(database, name) for name in self.names.values()}
        self.columns = {role: self._column(name) for role, name in self.names.items()}
        self.columns["time"] = CLOCK
        self.wanted: dict[int, list[str]] = {}
        for name, message in self.take.items():
            self.wanted.setdefault(message.frame_id, []).append(name)
        self.found: dict[str, list[tuple[float, float]]] = {name: [] for name in self.take}
        self.origins: dict[str, set[tuple[str, bool]]] = {name: set() for name in self.take}

    def _column(self, name: str) -> str:
        """A signal with its unit in the DBC, as columns are called."""
        return _with_unit(name, self.take[name].get_signal_by_name(_signal(name)).unit)

    def feed(self, frame: can.Message) -> None:
        """Keep what a frame says of the signals, where that is within the range the DBC gives."""
        names = self.wanted.get(frame.arbitration_id)
        if names and not (frame.is_error_frame or frame.is_remote_frame):
            for name, value in _values(self.take[names[0]], frame, names):
                if self._is_of(name, frame):
                    self.found[name].append((frame.timestamp, value))

    def values(self, place: Path | str) -> dict[str, np.ndarray]:
        """Angle, torque, time and loads at the frames of the angle. Raises dahl.Error."""
        series = {}
        for role, name in self.names.items():
            pairs = self.found[name]
            self._refuse_channels(place, name)
            if len(pairs) < 2:
                raise Error(f"{place}: signal '{name}' comes in {len(pairs)} valid frames")
            series[role] = np.array(pairs).T
            _check_time(place, series[role][0])
        (angle_time, angle), (torque_time, torque) = series["angle"], series["torque"]
        rows, values = _torque_at(angle_time, torque_time, torque)
        if len(rows) < 2:
            raise Error(
                f"{place}: '{self.names['angle']}' and '{self.names['torque']}' share no time"
            )
        time = angle_time[rows]
        loads = {role: np.interp(time, *series[role]) for role in self.loads}
        return {"angle": angle[rows], "torque": values, "time": time, **loads}

    def _is_of(self, name: str, frame: can.Message) -> bool:
        """Whether a frame is the one that has a signal: where ids of 11 and of 29 bits have one
        number, those of the kind that the DBC names.
        """
        origins, kind = self.origins[name], self.take[name].is_extended_frame
        known = {is_extended for _, is_extended in origins}
        if frame.is_extended_id != kind and kind in known:
            return False
        if frame.is_extended_id == kind and not known <= {kind}:
            origins.clear()
            self.found[name].clear()
        origins.add((str(frame.channel), frame.is_extended_id))
        return True

    def _refuse_channels(self, place: Path | str, name: str) -> None:
        """Raise dahl.Error where several channels have a signal."""
        channels = sorted(channel for channel, _ in self.origins[name])
        if len(channels) > 1:
            raise Error(
                f"{place}: signal '{name}' comes on channels {', '.join(channels)}:"
                f" which one is it? -c {channels[0]} takes that"
            )

    def log(self, place: Path | str, source: Source) -> Log:
        """All until now as a log."""
        return _log(place, source, self.columns, self.values(place))


def _torque_at(
    angle_time: np.ndarray, torque_time: np.ndarray, torque: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the angle that have a torque, and their torques. Where the two messages take turns, a
    torque belongs to the angle before it, however late a busy bus brings it; else it is
    interpolated between its frames.
    """
    if np.array_equal(angle_time, torque_time):
        return np.arange(len(angle_time)), torque
    first = np.searchsorted(torque_time, angle_time)  # not before the angle
    rows = np.flatnonzero(first < len(torque_time))
    rows = rows[torque_time[first[rows]] < np.append(angle_time, np.inf)[rows + 1]]
    if len(rows) >= TAKE_TURNS * max(len(angle_time), len(torque_time)):
        return rows, torque[first[rows]]
    rows = np.flatnonzero((angle_time >= torque_time[0]) & (angle_time <= torque_time[-1]))
    return rows, np.interp(angle_time[rows], torque_time, torque)


def _values(
    message: cantools.database.Message, frame: can.Message, names: list[str]
) -> Iterator[tuple[str, float]]:
    try:
        values: dict[str, Any] = message.decode_simple(
            bytes(frame.data), decode_choices=False, allow_truncated=True
        )
    except Exception:  # noqa: BLE001  (a frame of another kind under the same id)
        return
    for name in names:
        signal = message.get_signal_by_name(_signal(name))
        value = float(values.get(signal.name, np.nan))
        low = -np.inf if signal.minimum is None else signal.minimum
        high = np.inf if signal.maximum is None else signal.maximum
        if low == high or low <= value <= high:
            yield name, value


def _with_unit(name: str, unit: str | None) -> str:
    """A name and the unit that a file gives beside it, as columns are called."""
    return f"{name} [{unit}]" if unit else name


def _signal(name: str) -> str:
    """A signal's own name, without the message that may stand before it."""
    return name.rpartition(".")[2]


def _message_with(database: cantools.database.Database, name: str) -> cantools.database.Message:
    """The message of a SIGNAL, or MESSAGE.SIGNAL. Raises dahl.Error where there is not just one."""
    within, _, signal = name.rpartition(".")
    known = {one.name: [part.name for part in one.signals] for one in database.messages}
    having = [one for one in known if signal in known[one] and within in ("", one)]
    if len(having) > 1:
        places = ", ".join(f"{one}.{signal}" for one in having)
        raise Error(f"signal '{signal}' is in several messages, which one is it: {places}?")
    if not having:
        raise Error(f"no signal '{name}' in the DBC{logs.meant(name, sum(known.values(), []))}")
    return database.get_message_by_name(having[0])


def _from_channels(path: Path, source: Source) -> Columns:
    """An MF4 that holds measured channels in place of frames, by asammdf."""
    import logging

    from asammdf import MDF

    logging.getLogger("asammdf").setLevel(logging.CRITICAL)
    try:
        with logs.copies_of_its_own(path), MDF(path) as file:
            if "CAN_DataFrame" in file.channels_db:  # raw frames, named as ASAM's bus logging does
                raise Error(f"{path}: {NEEDS_DBC}")
            places = _places_of_channels(file.channels_db)
            names, notes = _columns(path, source, sorted(places), ("angle", "torque"))
            channels = {what: file.get(None, *places[name]) for what, name in names.items()}
    except Error:
        raise
    except Exception as error:  # asammdf has no root exception of its own
        sys.unraisablehook = lambda _: None  # its half-opened files complain again when collected
        words = " ".join(str(error).split())[:120] or type(error).__name__
        raise Error(f"{path}: broken, cut off or no MF4 ({words})") from None
    for what, one in channels.items():
        if one.samples.dtype.kind not in "fiub" or one.samples.ndim != 1:
            raise Error(f"{path}: channel '{names[what]}' holds no numbers")
    names = {what: _with_unit(name, channels[what].unit) for what, name in names.items()}
    names["time"] = CLOCK
    return names, _without_gaps(path, source, names, _together(path, channels), 0), notes


def _together(path: Path, channels: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Channels at the times of the angle, as far as all of them were measured then."""
    time, others = channels["angle"].timestamps, [one.timestamps for one in channels.values()]
    if any(len(one) == 0 for one in others):
        return {what: np.zeros(0) for what in ("time", *channels)}  # a log without rows
    here = (time >= max(one[0] for one in others)) & (time <= min(one[-1] for one in others))
    if not here.any():
        raise Error(f"{path}: its channels share no time")
    values = {
        what: one.samples
        if np.array_equal(time, one.timestamps)
        else np.interp(time, one.timestamps, one.samples)
        for what, one in channels.items()
    }
    values["time"] = time
    return {what: np.asarray(one, dtype=float)[here] for what, one in values.items()}


def _places_of_channels(
    channels: Mapping[str, Sequence[tuple[int, int]]],
) -> dict[str, tuple[int, int]]:
    """Group and index of each channel but the clocks, by a name that it has alone."""
    found = {}
    for name in channels.keys() - {"t", "time", "timestamps"}:
        alone = len(channels[name]) == 1
        for group, index in channels[name]:
            found[name if alone else f"group {group}: {name}"] = group, index
    return found


# --- units ----------------------------------------------------------------------------------------


def _log(
    path: Path | str,
    source: Source,
    names: dict[str, str],
    values: dict[str, np.ndarray],
    found: Sequence[str] = (),
) -> Log:
    """Units applied, wraps undone, time checked; `found` are notes from the reading."""
    if len(values["angle"]) < 2:
        raise Error(f"{path}: {len(values['angle'])} rows; a log has more than one")
    torque, notes = _signed(values["torque"])
    unit, more = units.of("angle", source.angle_unit, names["angle"], units.ANGLES, "deg")
    size, linear = units.ANGLES[unit]
    usual = "N" if linear else "Nm"
    torque_unit, also = units.of(
        "torque", source.torque_unit, names["torque"], units.TORQUES, usual
    )
    if torque_unit in units.FORCE_UNITS and not linear:
        also.append(f"'{names['torque']}' is a force over an angle: N taken for N m")
    if linear and torque_unit not in units.FORCE_UNITS:
        also.append(f"'{names['torque']}' is a torque over a way: N m taken for N")
    scale = units.TORQUES[torque_unit]
    time, clock = _seconds(path, source, names, values)
    theta, counts = values["angle"], source.counts_per_turn
    if _wraps(theta, unit, counts):
        theta = np.unwrap(theta, period=_turn(unit, counts))
        notes.append("angle wraps at a turn: unwrapped")
    notes = [*found, *notes, *more, *also, *clock]
    if unit == "counts":
        if not counts:
            raise Error(f"{path}: an angle in counts needs --counts-per-turn")
        size = 2 * np.pi / counts
    log = Log(str(path), theta * size, torque * scale, time, linear, notes=notes)
    given = (1e-3 if linear else 2 * np.pi) / counts if counts else 0.0
    log.resolution = given or resolution_of(log.theta)
    if source.loads:
        log.load = np.sum([values[what] for what in source.loads], axis=0)
    return log


def _seconds(
    path: Path | str, source: Source, names: dict[str, str], values: dict[str, np.ndarray]
) -> tuple[np.ndarray | None, list[str]]:
    """The time column, with a note where its unit was assumed, or where there is none."""
    if "time" not in values:
        return None, [NO_TIME]
    _check_time(path, values["time"])
    unit, notes = units.of("time", source.time_unit, names["time"], units.TIMES, "s")
    step = float(np.ptp(values["time"])) / (len(values["time"]) - 1)
    told = f"; a row comes every {step:.3g} s" + ", is it in ms?" * (step >= SLOW)
    return values["time"] * units.TIMES[unit], [note + told for note in notes]


def _check_time(path: Path | str, time: np.ndarray) -> None:
    """Raise dahl.Error where the time goes backward."""
    back = np.flatnonzero(np.diff(time) < 0)
    if len(back):
        row = int(back[0]) + 1
        raise Error(
            f"{path}: row {row + 1}: {time[row]:g} after {time[row - 1]:g}, the clock goes backward"
        )


def _signed(torque: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """A 16-bit number that was read without its sign, put right."""
    whole = torque.min() >= 0 and 32768 <= torque.max() <= 65535 and (torque % 1 == 0).all()
    if whole and not ((torque > 16384) & (torque < 49152)).any():
        return np.where(torque > 32767, torque - 65536, torque), [
            "torque is a signed 16-bit number read as unsigned: 65536 taken off above 32767"
        ]
    return torque, []


def _turn(unit: str, counts: float) -> float:
    """A turn in the unit of an angle; 0: a linear motion has none."""
    turns = {"deg": FULL_TURN, "rad": 2 * np.pi, "mrad": 2e3 * np.pi, "turn": 1.0, "counts": counts}
    return turns.get(unit, 0.0)


def _wraps(angle: np.ndarray, unit: str, counts: float) -> bool:
    """Whether an angle jumps by a turn."""
    turn = _turn(unit, counts)
    jumps = np.abs(np.diff(angle)).max() > 0.9 * turn
    return bool(turn and np.ptp(angle) <= turn and jumps)
