# SPDX-License-Identifier: MIT
"""From measured logs to sigma0 and Fc, with intervals and a verdict.

readers -> log -> clean -> sweep -> fit -> explore -> verdict, in this order; pipeline runs them,
output writes what was found. What may be chosen otherwise is tried by explore: choices (terms),
delay, model_table (other models), all scored by cycles. The command is `dahl identify`
(dahl.commands.identify).
"""
