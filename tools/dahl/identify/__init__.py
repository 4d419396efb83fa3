# SPDX-License-Identifier: MIT
"""From measured logs to sigma0 and Fc."""
