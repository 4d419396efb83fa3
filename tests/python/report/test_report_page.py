# SPDX-License-Identifier: MIT
"""The page of `dahl report` in a browser."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess

import pytest
from conftest import need
from log_reading import run as command

pytestmark = pytest.mark.checks

PROBE = """<script>window.onload = () => {
  const picture = document.getElementById("picture");
  const scrolled = document.getElementById("scrolled");
  const light = name => getComputedStyle(document.body)[name].match(/\\d+/g)
    .slice(0, 3).reduce((sum, one) => sum + Number(one), 0) / 3;
  document.title = JSON.stringify({drawn: picture.clientWidth, box: scrolled.clientWidth,
    wide: picture.naturalWidth, sections: [...document.querySelectorAll("section")].map(s => s.id),
    contrast: light("backgroundColor") - light("color"), page: document.body.scrollWidth,
    window: window.innerWidth, loaded: performance.getEntriesByType("resource").map(r => r.name)});
};</script>"""


@pytest.fixture(scope="module")
def page(tmp_path_factory, dahl_loop, library):
    folder = tmp_path_factory.mktemp("storm")
    words = ("--scene", "fault-storm", "--seconds", "2")
    assert command("demo", *words, "--output", folder).returncode == 0
    assert command("report", folder).returncode == 0
    path = folder / "report.html"
    path.write_text(path.read_text(encoding="utf-8").replace("</body>", PROBE + "</body>"))
    return path


def shown(page, *options: str) -> dict:
    browser = shutil.which("google-chrome") or need("chromium", "the page fits a browser")
    words = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
    words += ["--virtual-time-budget=5000", f"--user-data-dir={page.parent}/profile", "--dump-dom"]
    done = subprocess.run(
        [*words, *options, page.as_uri()], capture_output=True, text=True, timeout=250, check=False
    )
    title = re.search(r"<title>(\{.*?\})</title>", done.stdout)
    assert title, done.stdout[-500:] + done.stderr[-500:]
    return json.loads(html.unescape(title[1]))


def test_the_page_is_complete_and_fits_narrow_windows_and_dark_themes(page):
    narrow = shown(page, "--window-size=400,800")
    assert narrow["wide"] > 1000
    assert narrow["sections"] == ["numbers", "faults", "states", "counters"]
    assert not [name for name in narrow["loaded"] if not name.startswith("data:")]
    assert narrow["page"] <= narrow["window"] <= 500  # that the browser opens for 400
    assert narrow["box"] < narrow["window"] < 700 <= narrow["drawn"]
    dark = shown(page, "--force-dark-mode", "--blink-settings=preferredColorScheme=0")
    assert narrow["contrast"] > 150 and dark["contrast"] < -150
