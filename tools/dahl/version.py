# SPDX-License-Identifier: MIT
"""The version of the package; the build reads it here."""

__version__ = "0.3.0"
