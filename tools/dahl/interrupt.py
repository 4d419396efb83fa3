# SPDX-License-Identifier: MIT
"""Ctrl-C and other wishes to end: one line and code 130 at any time, in order where a bus runs.

Nothing but the interpreter's own start comes before `at_start()`, so this module imports little.
"""

from __future__ import annotations

import _thread
import os
import signal
import sys
import threading

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable

CODE = 130  # what a shell says of a program that Ctrl-C has ended
WORDS = "interrupted"


class _Now:
    """What holds in this process."""

    asked = False  # by Ctrl-C, since guarded() was entered
    running = False  # there is something that an exception can end


def at_start() -> None:
    """Until guarded() takes over there is nothing to clean up: Ctrl-C ends the program at once."""
    signal.signal(signal.SIGINT, _leave)


def _leave(*_: object) -> None:
    os.write(2, f"{WORDS}\n".encode())
    os._exit(CODE)


def _interrupt(*_: object) -> None:
    _Now.asked = True
    if _Now.running:
        raise KeyboardInterrupt


def _again(unraisable: sys.UnraisableHookArgs) -> None:
    """An interrupt that fell into a place that cannot raise (a __del__, a callback): once more,
    when that place is left.
    """
    if unraisable.exc_type is KeyboardInterrupt:
        threading.Timer(0.02, _thread.interrupt_main).start()
    elif not _Now.asked:
        sys.__unraisablehook__(unraisable)


def guarded(run: Callable[[], int]) -> int:
    """What run() returns; CODE after one line on stderr where Ctrl-C has ended it.

    An interrupt may surface as any exception, or as none: libraries turn it into their own.
    """
    if threading.current_thread() is not threading.main_thread():
        return run()
    _Now.asked = False
    before = signal.signal(signal.SIGINT, _interrupt)
    hook, sys.unraisablehook = sys.unraisablehook, _again
    try:
        try:
            _Now.running = True
            code = run()
        finally:
            _Now.running = False
    except BaseException:
        if not _Now.asked:
            raise
    finally:
        sys.unraisablehook = hook
        done = _Now.asked or before is _leave  # the program's own end is not interrupted
        signal.signal(signal.SIGINT, signal.SIG_IGN if done else before)
    if not _Now.asked:
        return code
    exec("")  # else Python dies of an interrupt that left the last exec() of a text, even if caught
    print(WORDS, file=sys.stderr)
    return CODE


def is_asked() -> bool:
    """Whether Ctrl-C has come since guarded() was entered."""
    return _Now.asked


class Stop:
    """Set by Ctrl-C, SIGTERM or a hang-up while it is entered; a second signal then ends the
    program at once. Where Ctrl-C is the end that a command is meant to have (is_its_end), its exit
    code is its own, else CODE.
    """

    def __init__(self, is_its_end: bool = False) -> None:
        self.asked, self._is_its_end = False, is_its_end

    def __enter__(self) -> Stop:
        self.asked = _Now.running and _Now.asked  # before, and something swallowed the exception
        self._before = {}
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if number == signal.SIGINT or signal.getsignal(number) != signal.SIG_IGN:  # nohup
                self._before[number] = signal.signal(number, self._ask)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _ask(self, number: int, _: object) -> None:
        self.asked = True
        _Now.asked = _Now.asked or (number == signal.SIGINT and not self._is_its_end)
        signal.signal(number, _interrupt)
