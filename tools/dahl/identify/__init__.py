# SPDX-License-Identifier: MIT
"""From measured logs to sigma0 and Fc, with intervals and a verdict.

readers -> log -> clean -> sweep -> fit -> verdict, in this order; pipeline runs them, output writes
what was found. The command is `dahl identify` (dahl.commands.identify).
"""
