# SPDX-License-Identifier: MIT
"""Python classes over the C library: plans, friction models, arrays."""
