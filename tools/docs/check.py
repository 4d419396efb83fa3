# SPDX-License-Identifier: MIT
"""Check a built site: its links, and in Chromium its widths on a phone and on a desk.

Usage: check.py SITE [PICTURES]. It prints each link without a target, each page that is wider than
the window, each equation and box that hides a part of its content, and each request to a network.
It exits with 1 if it found such a fault. PICTURES gets screenshots. Without Chromium it checks the
links only.
"""

import html
import json
import re
import shutil
import subprocess
import sys
import tempfile
from itertools import product
from pathlib import Path
from urllib.parse import unquote

WIDTHS = (390, 1280)
SHOWN = ("index", "explore", "docs/model", "docs/compensation", "c/dahl.h", "python/dahl.jax")
COLOURS = {"": "preferredColorScheme=1", "-dark": "preferredColorScheme=0"}
CHROMIUM = "chromium --headless --no-sandbox --disable-gpu --hide-scrollbars"
CHROMIUM += " --allow-file-access-from-files --disable-web-security --virtual-time-budget=600000"
MEASURE = """<body><script>
const frame = document.createElement("iframe");
document.body.append(frame);
async function measure(pages, widths) {
    const found = [];
    for (const width of widths) for (const page of pages) {
        frame.style = `width: ${width}px; height: 900px`;
        frame.src = page;
        await new Promise((loaded) => { frame.onload = loaded; });
        const inner = frame.contentWindow, root = inner.document.documentElement;
        const note = (what) => found.push(`${page} at ${width} px: ${what}`);
        if (root.scrollWidth > width) note(`${root.scrollWidth} px wide`);
        for (const box of root.querySelectorAll("article *")) {
            const hides = ["hidden", "clip"].includes(inner.getComputedStyle(box).overflowX);
            const text = box.textContent.replace(/\\s+/g, " ").slice(0, 50);
            if ((hides || box.matches("div.math")) && box.scrollWidth > box.clientWidth + 1)
                note(`<${box.localName}> hides a part of "${text}"`);
        }
        for (const { name } of inner.performance.getEntriesByType("resource"))
            if (!/^(file|data|blob):/.test(name)) note(`requests ${name}`);
    }
    document.body.innerHTML = "<pre></pre>";
    document.body.firstChild.textContent = JSON.stringify(found);
}
measure(PAGES, WIDTHS);
</script>"""


def chromium(page: Path, *options: str) -> str:
    """Open a local page in Chromium without a window; return what it prints."""
    words = [*CHROMIUM.split(), f"--user-data-dir={page.parent}/profile", *options, page.as_uri()]
    return subprocess.run(words, check=True, capture_output=True, text=True, timeout=600).stdout


def broken_links(pages: list[Path]) -> list[str]:
    """Return a line for each link inside the site that leads nowhere."""
    texts = {page: page.read_text() for page in pages}
    names = {
        page: re.findall(r'\bid="([^"]*)"', html.unescape(text)) for page, text in texts.items()
    }
    faults = []
    for page, text in texts.items():
        for link in re.findall(r'\b(?:href|src)="([^"]+)"', text):
            path, _, name = unquote(html.unescape(link)).partition("#")
            target = page.parent / path.partition("?")[0] if path else page
            is_there = target.exists() and (not name or name in names.get(target.resolve(), [name]))
            if not is_there and not re.match("[a-z]+:", link):
                faults.append(f"{page.as_uri()} has a link to {path}{name and '#'}{name}")
    return faults


def clipped(pages: list[str], folder: Path) -> list[str]:
    """Return a line for each fault of the pages."""
    (folder / "measure.html").write_text(
        MEASURE.replace("PAGES", json.dumps(pages), 1).replace("WIDTHS", str(list(WIDTHS)), 1)
    )
    found = re.search("<pre>(.*)</pre>", chromium(folder / "measure.html", "--dump-dom"), re.S)
    if found is None:
        sys.exit("error: Chromium did not measure the pages to the end")
    faults: list[str] = json.loads(html.unescape(found[1]))
    return faults


def take_pictures(site: Path, pictures: Path, folder: Path) -> None:
    """Write a picture of some pages side by side, for each width, light and dark."""
    pictures.mkdir(exist_ok=True)
    for width, (end, colours) in product(WIDTHS, COLOURS.items()):
        frames = [f'<iframe src="{(site / name).as_uri()}.html"></iframe>' for name in SHOWN]
        style = f"<style>body {{ margin: 0; width: {(width + 5) * len(frames)}px }} iframe"
        style += f" {{ width: {width}px; height: 1600px; border: 1px solid }}</style>"
        (folder / "pictures.html").write_text(style + "".join(frames))
        size = f"--window-size={(width + 5) * len(frames)},1610"
        shot = f"--screenshot={pictures}/{width}{end}.png"
        chromium(folder / "pictures.html", size, shot, f"--blink-settings={colours}")


def main(site: Path, *pictures: Path) -> int:
    pages = sorted(site.rglob("*.html"))
    faults = broken_links(pages)
    if not shutil.which("chromium"):
        print("no chromium here: the pages are not measured")
    else:
        with tempfile.TemporaryDirectory() as folder:
            faults += clipped([page.as_uri() for page in pages], Path(folder))
            for place in pictures:
                take_pictures(site, place, Path(folder))
    for fault in faults:
        print(f"error: {fault.removeprefix(site.as_uri() + '/')}", file=sys.stderr)
    print(f"{len(pages)} pages, {len(faults)} faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(*(Path(name).resolve() for name in sys.argv[1:])))
