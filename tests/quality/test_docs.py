# SPDX-License-Identifier: MIT
"""tools/docs.sh: Doxygen and pdoc give no warning, and no link inside the site is broken."""

from pathlib import Path

from programs import call


def test_the_site_builds_without_a_warning_or_a_broken_link(root: Path) -> None:
    done = call(root / "tools/docs.sh")
    assert (done.returncode, done.stderr) == (0, "")
    site = root / "build/docs"
    for page in ("index.html", "docs/loop.html", "c/dahl_8h.html", "python/dahl.html"):
        assert (site / page).stat().st_size > 1000
