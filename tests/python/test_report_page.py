# SPDX-License-Identifier: MIT
"""The page of `dahl report`, as a browser shows it: whole, by itself, with the run's numbers."""

from __future__ import annotations

import html.parser
import json
import re
import shutil
import subprocess

import dahl
import pytest

pytestmark = pytest.mark.checks

PROBE = """<script>window.onload = () => {
  const picture = document.getElementById("picture");
  const scrolled = document.getElementById("scrolled");
  const seen = {drawn: picture.clientWidth, box: scrolled.clientWidth, inside: scrolled.scrollWidth,
    wide: picture.naturalWidth, tall: picture.naturalHeight,
    sections: [...document.querySelectorAll("section")].map(s => s.id),
    cells: [...document.querySelectorAll("#faults td")].map(c => c.innerText),
    rows: [...document.querySelectorAll("#numbers tr")].map(r => r.innerText),
    made: document.getElementById("made")?.innerText,
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
    """What a headless browser finds in a page."""
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


def test_a_storm_as_a_browser_shows_it(storm, run_dahl, tmp_path):
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


def test_the_title_stands_once_and_a_quantity_has_one_name(storm, run_dahl, tmp_path):
    """The picture has the title of the run; the page names the tab by it."""
    assert run_dahl("report", storm, "-o", tmp_path / "page.html").returncode == 0
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    title = json.loads((storm / "summary.json").read_text())["title"]
    body = re.sub(r"<[^>]*>", " ", text.partition("<body>")[2])
    assert f"<title>{title}</title>" in text and title not in body


def test_a_counter_that_is_wrong_is_shown(storm, run_dahl, tmp_path):
    numbers = json.loads((storm / "summary.json").read_text())
    numbers["node"]["crc"] += 1
    (tmp_path / "summary.json").write_text(json.dumps(numbers))
    shutil.copy(storm / "loop.png", tmp_path)
    assert run_dahl("report", tmp_path, "-o", tmp_path / "page.html").returncode == 0
    assert "Not every fault was counted" in (tmp_path / "page.html").read_text(encoding="utf-8")
    assert shown(tmp_path / "page.html", tmp_path)["wrong"] == 1


def test_latencies_of_a_run_in_real_time(run_dahl, tmp_path, root, dahl_loop, library):
    folder = demo(tmp_path / "run", root, "--scene", "steering", "--seconds", "2")
    assert run_dahl("report", folder).returncode == 0
    seen = shown(folder / "report.html", tmp_path)
    assert seen["sections"] == ["numbers", "states", "counters"]
    numbers = json.loads((folder / "summary.json").read_text())
    assert any(row.startswith("jitter") and row.endswith(" µs") for row in seen["rows"])
    (latency,) = (row for row in seen["rows"] if row.startswith("latency"))
    quantiles = [float(word) for word in re.findall(r"\s(\d+)\b", latency)]
    assert quantiles == [round(numbers["latency_us"][key]) for key in ("p50", "p99", "max")]
    assert seen["made"].startswith(numbers["date"])
    assert f"dahl {dahl.__version__}: dahl demo" in seen["made"]
    assert "--scene steering --seconds 2" in seen["made"]


def test_it_is_read_on_a_telephone_and_in_the_dark(storm, run_dahl, tmp_path):
    """Nothing is wider than a window of 400 px but the picture, which is scrolled within the page;
    and dark paper has light ink.
    """
    assert run_dahl("report", storm, "-o", tmp_path / "page.html").returncode == 0
    narrow = shown(tmp_path / "page.html", tmp_path, "--window-size=400,800")
    assert narrow["wide_page"] <= narrow["window"] <= 500  # what the browser gives for 400
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
