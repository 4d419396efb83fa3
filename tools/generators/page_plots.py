# SPDX-License-Identifier: MIT
"""Draw docs/pictures/first-plot.png and simulate.png by the first block of Python of their pages.

The picture has what a reader gets, in the style of these pages.
"""

from __future__ import annotations

import contextlib
import re
import tempfile

import matplotlib as mpl
import matplotlib.pyplot as plt
from cycler import cycler
from dahl.paths import ROOT
from dahl.report import plots

PICTURES = {"python.md": "first-plot.png", "simulate.md": "simulate.png"}  # by page
STYLE = {
    **plots.STYLE,
    "axes.prop_cycle": cycler(color=[plots.COMPUTED, plots.MEASURED]),
    "figure.figsize": (7, 4.4),
    "figure.constrained_layout.use": True,
}


def main() -> None:
    mpl.use("agg")
    for page, picture in PICTURES.items():
        text = (ROOT / "docs" / page).read_text(encoding="utf-8")
        block = re.findall(r"```python\n(.*?)```", text, re.DOTALL)[0]
        with (
            mpl.rc_context(STYLE),
            tempfile.TemporaryDirectory() as folder,
            contextlib.chdir(folder),
        ):
            exec(compile(block, page, "exec"), {})
            plots.save(plt.gcf(), ROOT / "docs/pictures" / picture)
            plt.close()


if __name__ == "__main__":
    main()
