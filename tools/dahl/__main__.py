# SPDX-License-Identifier: MIT
"""The program `dahl`, also as `python -m dahl`: Ctrl-C is one line from here on."""

import sys

from dahl import interrupt

interrupt.at_start()

from dahl.cli import main  # noqa: E402

if __name__ == "__main__":
    sys.exit(main())
