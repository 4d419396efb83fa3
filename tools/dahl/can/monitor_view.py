# SPDX-License-Identifier: MIT
"""The view of the monitor: a table of the messages, and curves of the last ticks below it."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.table import Table
from rich.text import Text

from dahl import paths
from dahl.can import codec
from dahl.can.bus import NOTICEABLE_LAG_S
from dahl.can.counters import Sequence
from dahl.can.monitor_curves import panel
from dahl.errors import InputError

if TYPE_CHECKING:
    import can
    from cantools.database.can import Message

MIN_WIDE_COLUMNS = 110  # from which the table also holds the last values of each message
UNLIMITED_ROWS = 27  # of curves, if the height is not limited
MIN_PANEL_ROWS, MIN_TWO_PANELS_ROWS = 6, 18  # for one row of panels, and for two
MIN_HALF_COLUMNS = 40  # of each of two panels side by side
ALWAYS = ("EncoderState", "FrictionTorque", "Status")  # always have a row
NUMBERED = ALWAYS  # their counters count frames; other counters belong to the requester
FINE = {"OK", "Init"}  # states without colour
HIDDEN_SIGNALS = {"State", "Crc", "Counter"}  # State stands first, in its colour
SHOWN = {"EncoderState": {"Count"}, "FrictionTorque": {"State", "TorqueRatio"}}


@dataclass
class Seen:
    """One message: its frames, the missing ones by its counter, its last values."""

    message: Message
    frames: int = 0
    missing: int = 0
    wrong: int = 0  # CAN FD frames, wrong CRC, length or contents
    last: dict[str, Any] | None = None
    first_time: float = 0.0
    time: float = 0.0
    sequence: Sequence = field(default_factory=Sequence)

    def rate(self) -> float:
        span = self.time - self.first_time
        return (self.frames - 1) / span if span > 0 else 0.0


class View:
    """Receives frames; rich draws it in the given width and height."""

    def __init__(
        self,
        node: int = 0,
        window: int = 4000,
        dbc: Path | None = None,
        Fc: float | None = None,  # noqa: N803 (the field's name)
        unit: str = "N m",
    ) -> None:
        self.fills_screen = False  # whether it uses the full height of the terminal
        self.Fc, self.unit = Fc, unit  # at a torque ratio of 1; None until a ParamReply has it
        self.seen = {one.frame_id + node: Seen(one) for one in _messages(dbc)}
        self.names = {seen.message.name: seen for seen in self.seen.values()}
        self.time: deque[float] = deque(maxlen=window)
        self.count: deque[int] = deque(maxlen=window)
        self.ratio: deque[float] = deque(maxlen=window)
        self.frames, self.others = 0, 0
        self.states: Counter[str] = Counter()
        self.lag_s = self.most_lag_s = 0.0  # how far reading is behind the bus

    def feed(self, frame: can.Message) -> None:
        """Process one frame of any kind."""
        self.frames += 1
        seen = self.seen.get(frame.arbitration_id)
        if seen is None or frame.is_error_frame or frame.is_extended_id or frame.is_remote_frame:
            self.others += 1
            return
        try:
            if frame.is_fd or not codec.is_whole(frame.arbitration_id, frame.data):
                raise ValueError("CAN FD, a wrong CRC or length")
            signals = seen.message.decode_simple(bytes(frame.data))
        except Exception:  # cantools raises several kinds for short frames
            seen.wrong += 1
            return
        self._count(seen, signals, frame.timestamp)
        if seen.message.name == "FrictionTorque":
            self._answer(signals, frame.timestamp)
        elif seen.message.name == "ParamReply":
            value = signals.get("Fc")
            self.Fc = float(value) if isinstance(value, (int, float)) else self.Fc

    def _count(self, seen: Seen, signals: dict[str, Any], now: float) -> None:
        if seen.last is None:
            seen.first_time = now
        if seen.message.name in NUMBERED and "Counter" in signals:
            if signals["Counter"] == 0 and str(signals.get("State")) == "Init":
                seen.sequence.restart()
            gap = seen.sequence.gap(signals["Counter"], now)
            seen.missing += gap.least if gap else 0
        seen.frames, seen.last, seen.time = seen.frames + 1, signals, now

    def _answer(self, signals: dict[str, Any], now: float) -> None:
        self.states[str(signals["State"])] += 1
        encoder = self.names["EncoderState"].last
        if encoder:
            self.time.append(now)
            self.count.append(encoder["Count"])
            self.ratio.append(signals["TorqueRatio"])

    def as_dict(self) -> dict[str, Any]:
        """Return the numbers of the view, for JSON."""
        return {
            "frames": self.frames,
            "other_frames": self.others,
            "states": dict(self.states.most_common()),
            "Fc": self.Fc,
            "behind_s": self.lag_s,
            "most_behind_s": self.most_lag_s,
            "messages": {
                name: {
                    "frames": seen.frames,
                    "per_s": seen.rate(),
                    "missing": seen.missing,
                    "bad": seen.wrong,
                    "last": {key: _json_value(value) for key, value in (seen.last or {}).items()},
                }
                for name, seen in self.names.items()
            },
        }

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        height = console.size.height if self.fills_screen else options.height
        words = Group(*self._words(options.max_width, fold=height is None))
        used = len(console.render_lines(words, options.update(height=None)))
        rows = UNLIMITED_ROWS if height is None else height - used
        yield words
        yield from self._panels(options.max_width, rows)

    def _panels(self, width: int, rows: int) -> Iterator[RenderableType]:
        """Yield the loop, and both curves over time if there is space."""
        if rows < MIN_PANEL_ROWS:
            return
        low = rows * 2 // 5 if rows >= MIN_TWO_PANELS_ROWS else 0
        beside = width >= 2 * MIN_HALF_COLUMNS
        if not low and beside:
            yield self._side_by_side(
                self._loop(width // 2, rows), self._time_curves(width, rows)[0]
            )
            return
        yield self._loop(width, rows - low)
        if low:
            first, second = self._time_curves(width if beside else 2 * width, low)
            yield self._side_by_side(first, second) if beside else first

    @staticmethod
    def _side_by_side(*panels: RenderableType) -> Table:
        row = Table.grid()
        row.add_row(*panels)
        return row

    def _torque(self) -> tuple[list[float], str]:
        """Return the torques and their label: in N m if Fc is known."""
        if self.Fc is None:
            return list(self.ratio), "F/Fc"
        return [ratio * self.Fc for ratio in self.ratio], f"F [{self.unit}]"

    def _loop(self, width: int, rows: int) -> Text:
        torque, name = self._torque()
        return panel(self.count, torque, f"{name} over counts", width, rows, "cyan")

    def _time_curves(self, width: int, rows: int) -> tuple[Text, Text]:
        start = self.time[0] if self.time else 0.0
        seconds = [moment - start for moment in self.time]
        torque, name = self._torque()
        half = width // 2
        return (
            panel(seconds, torque, f"{name} over s", half, rows, "cyan"),
            panel(seconds, self.count, "counts over s", width - half, rows, "green"),
        )

    def _words(self, width: int, fold: bool) -> Iterator[RenderableType]:
        """Yield the table of counters, with the last values in a column or below. Without `fold`
        each message has one row.
        """
        wide = width >= MIN_WIDE_COLUMNS
        shown = [seen for name, seen in self.names.items() if seen.frames or name in ALWAYS]
        table = Table(expand=wide, box=None, header_style="bold", pad_edge=False)
        table.add_column("message", no_wrap=True)
        for name in ("frames", "1/s", "missing", "bad"):
            table.add_column(name, justify="right", no_wrap=True)
        if wide:
            table.add_column("last", ratio=1, no_wrap=not fold, overflow="ellipsis")
        for seen in shown:
            table.add_row(*_row(seen), *([self._last(seen)] if wide else []))
        yield table
        listed = [seen for seen in shown if seen.last and (fold or seen.message.name in ALWAYS)]
        lines = [] if wide else [self._last_line(seen) for seen in listed]
        states = ", ".join(f"{name} {count}" for name, count in self.states.most_common())
        style = "" if set(self.states) <= FINE else "yellow"
        lines.append(Text.assemble("node states  ", (states or "none yet", style)))
        lines.append(Text.assemble(f"other frames  {self.others}  behind  ", self._lag()))
        for line in lines:
            line.no_wrap, line.overflow = not fold, "fold" if fold else "ellipsis"
            yield line

    def _lag(self) -> tuple[str, str]:
        """Return the delay of reading as text, and its colour."""
        words = f"{self.lag_s:.1f} s, at most {self.most_lag_s:.1f} s"
        return words, "yellow" if self.most_lag_s > NOTICEABLE_LAG_S else ""

    def _last_line(self, seen: Seen) -> Text:
        return Text.assemble((f"{seen.message.name}  ", "bold"), self._last(seen))

    def _last(self, seen: Seen) -> Text:
        """Return the last values of a message: the torque in its unit, faults in colour."""
        if seen.last is None:
            return Text("not seen")
        signals = dict(seen.last)
        words = self._torque_and_state(signals)
        errors = [name.removeprefix("Error") for name, v in signals.items() if str(v) == "Seen"]
        if errors:
            words.append(f"seen: {' '.join(errors)}  ", "yellow")
        for name, value in _move_version_last(signals).items():
            if name not in HIDDEN_SIGNALS and str(value) not in ("None", "Seen"):
                value_text = f"{value:.6f}" if isinstance(value, float) else str(value)
                words.append(f"{name} {value_text}  ")
        return words

    def _torque_and_state(self, signals: dict[str, Any]) -> Text:
        words = Text()
        if self.Fc is not None and "TorqueRatio" in signals:
            words.append(f"{signals['TorqueRatio'] * self.Fc:+.6f} {self.unit}  ", "cyan")
        if "State" in signals:
            state = str(signals["State"])
            words.append(f"State {state}  ", "" if state in FINE else "yellow")
        return words


def _move_version_last(signals: dict[str, Any]) -> dict[str, Any]:
    """Return the signals with the version as one signal at the end, which a narrow window cuts."""
    parts = [signals.pop(name, None) for name in ("VersionMajor", "VersionMinor")]
    return signals if None in parts else {**signals, "Version": "{}.{}".format(*parts)}


def _row(seen: Seen) -> tuple[Text, ...]:
    """Return name and counts of a message; counts that should be 0 are coloured."""
    return (
        Text(seen.message.name),
        Text(str(seen.frames)),
        Text(f"{seen.rate():.0f}"),
        Text(str(seen.missing), "yellow" if seen.missing else ""),
        Text(str(seen.wrong), "red" if seen.wrong else ""),
    )


def _json_value(value: Any) -> Any:
    return value if isinstance(value, (int, float)) else str(value)


def _messages(dbc: Path | None) -> list[Message]:
    """Return the messages of a DBC. Raises dahl.Error if it lacks one that the view needs."""
    import cantools

    path = dbc or paths.DBC
    try:
        database = cantools.database.load_file(path)
        found: list[Message] = list(getattr(database, "messages", []))
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None
    except (cantools.Error, ValueError) as error:
        raise InputError(f"{path}: {' '.join(str(error).split())}") from None
    found = _without_other_nodes(found)
    known = {message.name: {signal.name for signal in message.signals} for message in found}
    for name, signals in SHOWN.items():
        missing = sorted(signals - known.get(name, set()))
        if missing:
            raise InputError(f"{path}: no signal '{missing[0]}' in a message '{name}'")
    return found


def _without_other_nodes(messages: list[Message]) -> list[Message]:
    """Return the messages without those of nodes 1 to 15: node n has the messages of node 0 at
    id + n, and a DBC of several nodes lists them too.
    """
    ids = {one.frame_id for one in messages}
    numbers = [one.frame_id % codec.NODES for one in messages]
    return [
        one
        for one, number in zip(messages, numbers, strict=True)
        if number == 0 or one.frame_id - number not in ids
    ]
