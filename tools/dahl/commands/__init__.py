# SPDX-License-Identifier: MIT
"""One file per sub-command: HELP, EXAMPLE, add_arguments(parser), run(args). Heavy imports wait
until run().
"""
