# SPDX-License-Identifier: MIT
"""`python -m dahl` is the command `dahl`."""

import sys

from dahl.cli import main

sys.exit(main())
