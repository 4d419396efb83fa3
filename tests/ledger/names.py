# SPDX-License-Identifier: MIT
"""A plugin of pytest: every test that there is, with its marks, before any is left out."""

from __future__ import annotations

import pytest

MARK = "test with marks"


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """A line each: MARK, the marks with commas, module::name."""
    for item in items:
        marks = ",".join(sorted({mark.name for mark in item.iter_markers()}))
        print(f"{MARK}|{marks}|{item.path.stem}::{item.nodeid.partition('::')[2]}")
