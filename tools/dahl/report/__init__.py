# SPDX-License-Identifier: MIT
"""Results for people: traces, pictures, pages, summaries."""
