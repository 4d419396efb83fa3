# SPDX-License-Identifier: MIT
"""The page of `dahl report` in a browser."""

from __future__ import annotations

import html.parser
import json
import re
import shutil
import subprocess

import pytest

pytestmark = pytest.mark.checks

PROBE = """<script>window.onload = () => {
  const picture = document.getElementById("picture");
  const scrolled = document.getElementById("scrolled");
  const seen = {drawn: picture.clientWidth, box: scrolled.clientWidth, inside: scrolled.scrollWidth,
    wide: picture.naturalWidth, tall: picture.naturalHeight,
    sections: [...document.querySelectorAll("section")].map(s => s.id),
    cells: [...document.querySelectorAll("#faults td")].map(c => c.innerText),
    paper: getComputedStyle(document.body).backgroundColor,
    ink: getComputedStyle(document.body).color,
    wrong: document.querySelectorAll(".wrong").length, wide_page: document.body.scrollWidth,
    window: window.innerWidth,
    loaded: performance.getEntriesByType("resource").map(r => r.name)};
  document.title = JSON.stringify(seen);
};</script>"""


@pytest.fixture(scope="module")
def storm(tmp_path_factory, dahl_loop, library, root):
    """A demo of the fault storm, in virtual time."""
    return demo(tmp_path_factory.mktemp("storm"), root, "--scene", "fault-storm", "--seconds", "8")


def demo(folder, root, *words):
    import sys

    command = [sys.executable, "-m", "dahl", "demo", "--output", str(folder), *words]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return folder


def shown(page, folder, *options) -> dict:
    """Results of the probe in a headless browser."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if not browser:
        pytest.skip("chromium is not installed (tools/setup.sh installs it where it can)")
    probed = folder / "probed.html"
    probed.write_text(page.read_text(encoding="utf-8").replace("</body>", PROBE + "</body>"))
    command = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
    command += ["--virtual-time-budget=5000", f"--user-data-dir={folder}/profile", "--dump-dom"]
    command += options
    done = subprocess.run(
        [*command, probed.as_uri()], capture_output=True, text=True, timeout=120, check=False
    )
    title = re.search(r"<title>(\{.*?\})</title>", done.stdout)
    assert title, done.stdout[-500:] + done.stderr[-500:]
    return json.loads(html.unescape(title[1]))


def test_the_page_of_a_storm_is_complete_without_other_files(storm, run_dahl, tmp_path):
    done = run_dahl("report", storm)
    assert done.returncode == 0, done.stderr
    seen = shown(storm / "report.html", tmp_path)
    assert seen["wide"] > 1000
    assert seen["tall"] > 1000
    assert seen["sections"] == ["numbers", "faults", "states", "counters"]
    assert seen["wrong"] == 0
    assert not [name for name in seen["loaded"] if not name.startswith("data:")]
    numbers = json.loads((storm / "summary.json").read_text())
    cells = seen["cells"]
    for name, count in numbers["faults"]["injected"].items():
        assert cells[cells.index(name.replace("_", " ")) + 1] == str(count)
    at = len(numbers["faults"]["injected"]) * 2
    for i, (name, due) in enumerate(numbers["faults"]["expected"].items()):
        want = [name.replace("_", " "), str(due), str(numbers["node"][name])]
        assert cells[at + 3 * i : at + 3 * i + 3] == want


def test_the_page_fits_a_narrow_window_and_a_dark_theme(storm, run_dahl, tmp_path):
    """Only the picture is wider, and it scrolls inside the page."""
    assert run_dahl("report", storm, "-o", tmp_path / "page.html").returncode == 0
    narrow = shown(tmp_path / "page.html", tmp_path, "--window-size=400,800")
    assert (
        narrow["wide_page"] <= narrow["window"] <= 500
    )  # the window that the browser opens for 400
    assert narrow["box"] < narrow["window"] < 700 <= narrow["drawn"] == narrow["inside"]

    def light(colour: str) -> float:
        return sum(map(int, re.findall(r"\d+", colour)[:3])) / 3

    assert light(narrow["paper"]) - light(narrow["ink"]) > 150
    dark = shown(
        tmp_path / "page.html",
        tmp_path,
        "--force-dark-mode",
        "--blink-settings=preferredColorScheme=0",
    )
    assert light(dark["ink"]) - light(dark["paper"]) > 150
