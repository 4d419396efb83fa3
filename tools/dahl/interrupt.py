# SPDX-License-Identifier: MIT
"""A wish to end, asked for by a signal and met in order."""

from __future__ import annotations

import signal


class Stop:
    """Set by Ctrl-C or SIGTERM while it is entered; a second Ctrl-C then ends the program at
    once.
    """

    def __init__(self) -> None:
        self.asked = False

    def __enter__(self) -> Stop:
        self._before = {
            number: signal.signal(number, self._ask) for number in (signal.SIGINT, signal.SIGTERM)
        }
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _ask(self, number: int, _: object) -> None:
        self.asked = True
        signal.signal(number, signal.default_int_handler)
