# SPDX-License-Identifier: MIT
"""Handle SIGINT, SIGTERM and SIGHUP: one line and exit code 130, and an orderly end of a bus.

`at_start()` must run early, so this module imports little.
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

EXIT_CODE = 130  # the shell's code for a program that Ctrl-C ended
MESSAGE = "interrupted"


class _Process:
    is_asked = False  # Ctrl-C came since run_guarded() was entered
    is_running = False  # run_guarded() is in run(), which an exception can end


def at_start() -> None:
    """Let Ctrl-C end the program at once until run_guarded() is entered."""
    signal.signal(signal.SIGINT, _exit_at_once)


def _exit_at_once(*_: object) -> None:
    os.write(2, f"{MESSAGE}\n".encode())
    os._exit(EXIT_CODE)


def _interrupt(*_: object) -> None:
    _Process.is_asked = True
    if _Process.is_running:
        raise KeyboardInterrupt


def _repeat_interrupt(unraisable: sys.UnraisableHookArgs) -> None:
    """Repeat an interrupt that came in a place that cannot raise, such as __del__ or a callback."""
    if unraisable.exc_type is KeyboardInterrupt:
        threading.Timer(0.02, _thread.interrupt_main).start()
    elif not _Process.is_asked:
        sys.__unraisablehook__(unraisable)


def run_guarded(run: Callable[[], int]) -> int:
    """Return the exit code of run(). If Ctrl-C ended it, print one line and return EXIT_CODE.

    Libraries may turn an interrupt into another exception, or swallow it.
    """
    if threading.current_thread() is not threading.main_thread():
        return run()
    _Process.is_asked = False
    before = signal.signal(signal.SIGINT, _interrupt)
    hook, sys.unraisablehook = sys.unraisablehook, _repeat_interrupt
    try:
        try:
            _Process.is_running = True
            code = run()
        finally:
            _Process.is_running = False
    except BaseException:
        if not _Process.is_asked:
            raise
    finally:
        sys.unraisablehook = hook
        done = (
            _Process.is_asked or before is _exit_at_once
        )  # the end of the program must not be interrupted
        signal.signal(signal.SIGINT, signal.SIG_IGN if done else before)
    if not _Process.is_asked:
        return code
    exec("")  # else Python dies of an interrupt during its last exec() of a text, even if caught
    print(MESSAGE, file=sys.stderr)
    return EXIT_CODE


def is_asked() -> bool:
    """Return whether Ctrl-C came since run_guarded() was entered."""
    return _Process.is_asked


class Stop:
    """Context manager whose `asked` becomes True on SIGINT, SIGTERM or SIGHUP. A second signal ends
    the program at once. If Ctrl-C is the usual end of a command (is_its_end), the command keeps its
    exit code; else the code is EXIT_CODE.
    """

    def __init__(self, is_its_end: bool = False) -> None:
        self.asked, self._is_its_end = False, is_its_end

    def __enter__(self) -> Stop:
        self.asked = (
            _Process.is_running and _Process.is_asked
        )  # an earlier one whose exception was swallowed
        self._before = {}
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if number == signal.SIGINT or signal.getsignal(number) != signal.SIG_IGN:  # nohup
                self._before[number] = signal.signal(number, self._on_signal)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _on_signal(self, number: int, _: object) -> None:
        self.asked = True
        _Process.is_asked = _Process.is_asked or (number == signal.SIGINT and not self._is_its_end)
        signal.signal(number, _interrupt)
