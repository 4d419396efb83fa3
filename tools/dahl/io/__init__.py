# SPDX-License-Identifier: MIT
"""Files: tables, CAN logs, measured data sets, safe writing."""
