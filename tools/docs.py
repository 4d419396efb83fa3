# SPDX-License-Identifier: MIT
"""Write the Markdown pages and the Python pages of the site, then check its links.

Usage: docs.py SITE, after Doxygen has written SITE/c (tools/docs.sh). A page keeps its place in the
project: docs/loop.md becomes SITE/docs/loop.html. The files that a page links to are copied.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import warnings
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import dahl
import jinja2
import pdoc
from markdown_it import MarkdownIt
from markdown_it.token import Token

ROOT = Path(__file__).resolve().parents[1]
PYTHON_MODULES = ("dahl", "dahl.can.codec", "dahl.can.node", "dahl.can.pytest_plugin")
HEADERS = "lib/include/"
PAGE = jinja2.Template(
    """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{{ title }}</title><style>
body { max-width: 60rem; margin: 1rem auto; padding: 0 1rem; font: 1rem/1.5 sans-serif; }
table { border-collapse: collapse; } td, th { border: 1px solid #ccc; padding: .2rem .5rem; }
pre { background: #f4f4f4; padding: .5rem; overflow-x: auto; } img { max-width: 100%; }
</style></head><body>
<nav><a href="{{ top }}index.html">dahl</a> | <a href="{{ top }}c/files.html">C</a> |
<a href="{{ top }}python/dahl.html">Python</a></nav>
{{ body }}</body></html>
""",
    autoescape=False,
)


def markdown_files() -> list[str]:
    """Return the pages of the project that are in git."""
    words = ["git", "ls-files", "--", "*.md"]
    names = subprocess.run(words, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    places = ("docs/", "examples/")
    return [name for name in names.split() if "/" not in name or name.startswith(places)]


def write_page(site: Path, name: str) -> None:
    """Render one Markdown file. README.md at the top becomes index.html."""
    markdown = MarkdownIt("commonmark").enable("table")
    tokens = markdown.parse((ROOT / name).read_text())
    add_heading_ids(tokens)
    for token in inline_tokens(tokens):
        for attribute in {"href", "src"} & token.attrs.keys():
            token.attrs[attribute] = site_link(site, name, str(token.attrs[attribute]))
    page = site / page_name(name)
    page.parent.mkdir(parents=True, exist_ok=True)
    body = markdown.renderer.render(tokens, markdown.options, {})
    page.write_text(PAGE.render(title=name, top="../" * name.count("/"), body=body))


def inline_tokens(tokens: list[Token]) -> Iterator[Token]:
    for token in tokens:
        yield from token.children or ()


def add_heading_ids(tokens: list[Token]) -> None:
    """Give each heading the anchor that GitHub gives it."""
    for heading, text in zip(tokens, tokens[1:], strict=False):
        if heading.type == "heading_open":
            words = re.sub(r"[^\w\- ]", "", text.content.lower())
            heading.attrs["id"] = words.replace(" ", "-")


def page_name(name: str) -> str:
    """Return the place of a Markdown file in the site."""
    return "index.html" if name == "README.md" else name.removesuffix(".md") + ".html"


def site_link(site: Path, page: str, link: str) -> str:
    """Return a link of a page as the site has it; copy the file that it names."""
    parts = urlsplit(link)
    if parts.scheme or not parts.path:
        return link
    up = "../" * page.count("/")
    target = ((ROOT / page).parent / unquote(parts.path)).resolve()
    if not target.is_relative_to(ROOT) or not target.exists():
        return link  # check_links reports it
    name = str(target.relative_to(ROOT))
    if target.is_dir() and (target / "README.md").exists():
        name += "/README.md"
    if name.endswith(".md"):
        name = page_name(name)
    elif name.startswith(HEADERS):
        name = f"c/{target.name.replace('_', '__').replace('.', '_8')}.html"  # names of Doxygen
    elif target.is_file():
        (site / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(target, site / name)
    return up + name + (f"#{parts.fragment}" if parts.fragment else "")


def write_python_pages(site: Path) -> None:
    """Render the docstrings of the public modules. A warning of pdoc is an error."""
    for name in dahl.__all__:  # pdoc does not call the __getattr__ of a module
        setattr(dahl, name, getattr(dahl, name))
    pdoc.render.configure(show_source=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        pdoc.pdoc(*PYTHON_MODULES, output_directory=site / "python")
    for page in (site / "python").rglob("*.html"):
        remove_links_without_anchor(page)


def remove_links_without_anchor(page: Path) -> None:
    """pdoc links to members of private base classes, which it does not render."""
    anchors = Links(page).anchors
    link = re.compile(r'<a href="#([\w.]+)">(.*?)</a>', re.DOTALL)
    text = link.sub(lambda found: found[0 if found[1] in anchors else 2], page.read_text())
    page.write_text(text)


class Links(HTMLParser):
    """The links and the anchors of one page."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(page.read_text())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if value and (name == "id" or (tag == "a" and name == "name")):
                self.anchors.add(value)
            elif value and name in ("href", "src"):
                self.links.append(value)


def broken_links(site: Path) -> Iterator[str]:
    """Yield each link inside the site that has no file or no anchor."""
    pages = {page: Links(page) for page in sorted(site.rglob("*.html"))}
    for page, content in pages.items():
        for link in content.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (page.parent / unquote(parts.path)).resolve() if parts.path else page
            anchors = pages[target].anchors if target in pages else set()
            if not target.exists() or (parts.fragment and unquote(parts.fragment) not in anchors):
                yield f"{page.relative_to(site)}: {link}"


def main(folder: str) -> int:
    site = Path(folder).resolve()
    names = markdown_files()
    for name in names:
        write_page(site, name)
    write_python_pages(site)
    broken = list(broken_links(site))
    for link in broken:
        print(f"error: broken link: {link}", file=sys.stderr)
    if not broken:
        print(f"docs: {len(names)} pages, C and Python in {folder}/index.html; no broken link")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
