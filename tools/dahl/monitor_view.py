# SPDX-License-Identifier: MIT
"""What the monitor shows: the last ticks as curves, and a table of what has been seen of each
message.
"""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console, ConsoleOptions, Group, RenderResult
from rich.table import Table
from rich.text import Text

from dahl import Error, e2e, paths

if TYPE_CHECKING:
    import can
    from cantools.database.can import Message

COUNTERS = 16
SHOWN = {"EncoderState": {"Count"}, "FrictionTorque": {"State", "TorqueRatio"}}


@dataclass
class Seen:
    """One message: how often, how many are missing by its counter, what it last said."""

    message: Message
    frames: int = 0
    missing: int = 0
    wrong: int = 0  # CRC, length or contents that are not as they should be
    last: dict[str, Any] | None = None
    first_time: float = 0.0
    time: float = 0.0

    def rate(self) -> float:
        span = self.time - self.first_time
        return (self.frames - 1) / span if span > 0 else 0.0


class View:
    """Feed it frames; rich draws it, in the width and height that it is given."""

    def __init__(self, node: int = 0, window: int = 4000, dbc: Path | None = None) -> None:
        self.seen = {one.frame_id + node: Seen(one) for one in _messages(dbc)}
        self.names = {seen.message.name: seen for seen in self.seen.values()}
        self.time: deque[float] = deque(maxlen=window)
        self.count: deque[int] = deque(maxlen=window)
        self.ratio: deque[float] = deque(maxlen=window)
        self.frames, self.others = 0, 0
        self.states: Counter[str] = Counter()

    def feed(self, frame: can.Message) -> None:
        """Take one frame, whatever it is."""
        self.frames += 1
        seen = self.seen.get(frame.arbitration_id)
        if seen is None or frame.is_error_frame or frame.is_extended_id or frame.is_remote_frame:
            self.others += 1
            return
        try:
            if not e2e.is_whole(frame.arbitration_id, frame.data):
                raise ValueError("a wrong CRC or length")
            signals = seen.message.decode_simple(bytes(frame.data))
        except Exception:  # cantools has several for frames that are too short
            seen.wrong += 1
            return
        self._count(seen, signals, frame.timestamp)
        if seen.message.name == "FrictionTorque":
            self._answer(signals, frame.timestamp)

    def _count(self, seen: Seen, signals: dict[str, Any], now: float) -> None:
        if seen.last is None:
            seen.first_time = now
        elif "Counter" in signals:
            seen.missing += (signals["Counter"] - seen.last["Counter"] - 1) % COUNTERS
        seen.frames, seen.last, seen.time = seen.frames + 1, signals, now

    def _answer(self, signals: dict[str, Any], now: float) -> None:
        self.states[str(signals["State"])] += 1
        encoder = self.names["EncoderState"].last
        if encoder:
            self.time.append(now)
            self.count.append(encoder["Count"])
            self.ratio.append(signals["TorqueRatio"])

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        height = options.height or 36
        top, low = max(10, (height - 12) * 3 // 5), max(7, (height - 12) * 2 // 5)
        width = options.max_width
        yield Group(
            self._curve(self.count, self.ratio, "F/Fc over counts", width, top),
            self._beside(width, low),
            self._table(),
        )

    def _beside(self, width: int, height: int) -> Table:
        start = self.time[0] if self.time else 0.0
        seconds = [moment - start for moment in self.time]
        row = Table.grid()
        row.add_row(
            self._curve(seconds, self.ratio, "F/Fc over s", width // 2, height),
            self._curve(seconds, self.count, "counts over s", width - width // 2, height),
        )
        return row

    def _curve(self, x: Any, y: Any, title: str, width: int, height: int) -> Text:
        import plotext

        plotext.clear_figure()
        plotext.theme("clear")
        plotext.plotsize(width, height)
        plotext.title(title)
        if x:
            plotext.plot(list(x), list(y), marker="braille")
        return Text.from_ansi(plotext.build())

    def _table(self) -> Table:
        table = Table(
            "message",
            "frames",
            "1/s",
            "missing",
            "bad",
            "last",
            expand=True,
            box=None,
            header_style="bold",
        )
        for seen in self.names.values():
            table.add_row(
                seen.message.name,
                str(seen.frames),
                f"{seen.rate():.0f}",
                str(seen.missing),
                str(seen.wrong),
                _words(seen.last),
            )
        states = ", ".join(f"{name} {count}" for name, count in self.states.most_common())
        table.add_row("node states", "", "", "", "", states or "none yet")
        table.add_row("other frames", str(self.others))
        return table


def _words(signals: dict[str, Any] | None) -> str:
    if signals is None:
        return "not seen"
    shown = (
        f"{name} {value:.6f}" if isinstance(value, float) else f"{name} {value}"
        for name, value in signals.items()
        if name not in ("Crc", "Counter") and str(value) != "None"
    )
    return "  ".join(shown)


def _messages(dbc: Path | None) -> list[Message]:
    """Those of a bus description that has what is shown. Raises dahl.Error."""
    import cantools

    path = dbc or paths.DBC
    try:
        database = cantools.database.load_file(path)
        found: list[Message] = list(getattr(database, "messages", []))
    except OSError as error:
        raise Error(f"{path}: {error.strerror}") from None
    except (cantools.Error, ValueError) as error:
        raise Error(f"{path}: {' '.join(str(error).split())}") from None
    known = {message.name: {signal.name for signal in message.signals} for message in found}
    for name, signals in SHOWN.items():
        missing = sorted(signals - known.get(name, set()))
        if missing:
            raise Error(f"{path}: no signal '{missing[0]}' in a message '{name}'")
    return found
