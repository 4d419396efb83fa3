# SPDX-License-Identifier: MIT
"""The program `dahl`, also started by `python -m dahl`. From here on, Ctrl-C prints one line."""

import sys

from dahl import interrupt

interrupt.at_start()

from dahl.cli import main  # noqa: E402

if __name__ == "__main__":
    sys.exit(main())
