# SPDX-License-Identifier: MIT
"""Make the page of `dahl report`: page.html, filled with the numbers of a run. Jinja2 escapes
them.
"""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

import jinja2

from dahl.report import summary, traces
from dahl.report.simulated import Table


def page(numbers: dict[str, Any], picture: bytes, table: Table | None = None) -> str:
    """Return the page. `numbers`: from dahl.report.summary.read(); `picture`: bytes of a PNG;
    `table`: of a scene without dahl-loop.
    """
    folder = jinja2.FileSystemLoader(Path(__file__).parent)
    room = jinja2.Environment(loader=folder, autoescape=True, trim_blocks=True)
    room.filters["words"] = traces.words
    room.filters["number"] = lambda value: str(value) if isinstance(value, int) else f"{value:.6g}"
    return room.get_template("page.html").render(
        run=numbers,
        picture=base64.b64encode(picture).decode("ascii"),
        rows=dict(summary.rows(numbers)),
        simulated=table,
        wrong=traces.disagreements(numbers) if "faults" in numbers else {},
        made=_origin(numbers),
    )


def _origin(numbers: dict[str, Any]) -> str:
    """Return date and version of the run, as far as the summary has them."""
    words = [numbers.get("date", ""), "dahl " + numbers["version"] if "version" in numbers else ""]
    return ", ".join(word for word in words if word)
