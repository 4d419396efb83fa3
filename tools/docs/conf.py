# SPDX-License-Identifier: MIT
"""Sphinx: the pages (MyST), the C headers (XML of Doxygen, read by breathe), Python (autodoc).

tools/docs.sh starts it in a copy of the project, so that it may add reference pages there.
"""

import os
import posixpath
import re
from pathlib import Path
from typing import Any

import dahl
import dahl.identify
from breathe.renderer.sphinxrenderer import SphinxRenderer
from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.addnodes import desc_signature
from sphinx.application import Sphinx

SOURCE = Path(os.environ["DAHL_DOCS_SOURCE"])
HEADERS = sorted(path.name for path in SOURCE.glob("lib/include/*.h*"))
MODULES = "dahl dahl.identify dahl.jax dahl.mujoco".split()
MODULES += "dahl.can.codec dahl.can.node dahl.can.pytest_plugin".split()
EXPLORE = "explore.html"  # by tools/explore.sh; no page of Sphinx
BUILT_IN = "dict, tuple, int, BaseException, OSError"  # their members are not listed
MENU = {  # pages that are not listed follow under "Project"
    "In a firmware": "microcontroller encoder recipes parts compensation commissioning steering"
    " rendering",
    "From a log": "identify log_to_compensator",
    "Simulate and test": "simulate simulators loop quadrants",
    "Model and numbers": "model accuracy speed verification",
    "Reference": "c python",
}
SUBMENUS = {"docs/c": "/c/*", "docs/python": "/python/*", "docs/decisions/README": "[0-9]*"}
NAME = re.compile(r"(docs/\w+\.md|tools/explore\.sh|\b(?:dahl|DAHL)[\w.]*\w)")
NOT_LINKED = (nodes.reference, nodes.FixedTextElement, nodes.title, nodes.math, desc_signature)
ROW = re.compile(r"( *)(\S(?:.*?\S)?) {2,}([^\s#].*)")  # of columns, not code with a comment
MARKUP = re.compile(r"(?<![\w`*|])[|*]+(?=\w)|(?<=\w)_(?!\w)")
RENDER_STRING = SphinxRenderer.render_string
ACCENT = ' accent="true"'  # it would sink a dot into its letter

project, author, release = "dahl", "the dahl authors", dahl.__version__
extensions = ["myst_parser", "breathe", "sphinx.ext.autodoc", "sphinx_copybutton"]
include_patterns = ["*.md", "docs/**", "examples/**", "c/**", "python/**"]
html_theme, html_title = "furo", f"dahl {release}"
html_extra_path = [os.environ["DAHL_DOCS_EXPLORE"]]
html_static_path, html_css_files = [str(Path(__file__).parent / "site.css")], ["site.css"]
html_show_copyright = html_copy_source = html_show_sourcelink = html_use_index = (
    html_domain_indices
) = False
pygments_style, pygments_dark_style = "default", "monokai"
highlight_language, default_role = "none", "code"
html_math_renderer = "mathml"
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
breathe_projects = {"dahl": os.environ["DAHL_DOCS_XML"]}
breathe_default_project = "dahl"
breathe_domain_by_extension = {"h": "c", "hpp": "cpp"}
breathe_show_include = False
autodoc_member_order = "bysource"
autodoc_class_signature = "mixed"
autodoc_type_aliases = {name: name for name in ("ArrayLike", "NDArray")}
autodoc_preserve_defaults = True
autodoc_mock_imports = ["jax", "dahl.simulators.mujoco_plugin"]  # they may not be installed
for module in (dahl, dahl.identify):  # autodoc does not call the __getattr__ of a module
    for name in module.__all__:
        setattr(module, name, getattr(module, name))


def write_reference() -> None:
    """Write a page for each header and each public module."""
    for folder in ("c", "python"):
        (SOURCE / folder).mkdir(exist_ok=True)
    sections = "briefdescription detaileddescription innerclass define enum func typedef "
    sections += "user-defined public-attrib public-func public-type"
    for header in HEADERS:
        text = f"# {header}\n\n```{{doxygenfile}} {header}\n:sections: {sections}\n```\n"
        if header.endswith(".hpp"):  # its classes are in a namespace
            text += "\n```{doxygennamespace} dahl\n:members:\n```\n"
        (SOURCE / f"c/{header}.md").write_text(text)
    options = f":members:\n   :undoc-members:\n   :inherited-members: {BUILT_IN}\n"
    for module in MODULES:
        text = f"{module}\n{'=' * len(module)}\n\n.. automodule:: {module}\n   {options}"
        (SOURCE / f"python/{module}.rst").write_text(text)


def menu(names: list[str], caption: str = "") -> str:
    """Return a list of pages for the menu; a name may be a pattern."""
    head = f":caption: {caption}\n" if caption else ""
    return f"\n```{{toctree}}\n:hidden:\n:glob:\n{head}\n" + "\n".join(names) + "\n```\n"


def main_menu() -> str:
    listed = [f"docs/{name}" for names in MENU.values() for name in names.split()]
    pages = [*SOURCE.glob("docs/*.md"), *SOURCE.glob("examples/**/README.md")]
    found = sorted(path.relative_to(SOURCE).with_suffix("").as_posix() for path in pages)
    others = [name for name in found if name not in listed]
    others += ["docs/decisions/README", "CONTRIBUTING", "CHANGELOG", "SECURITY"]
    parts = [menu([f"docs/{name}" for name in text.split()], key) for key, text in MENU.items()]
    return "".join(parts) + menu(others, "Project")


def prepare_page(app: Sphinx, docname: str, content: list[str]) -> None:
    """Let links lead to the pages of the site, and add the menu."""
    folder = posixpath.dirname(docname)

    def link(found: re.Match[str]) -> str:
        path = posixpath.normpath(posixpath.join(folder, found[1]))
        if path == "README.md":
            path = "index.md"
        elif path.startswith("lib/include/"):
            path = f"c/{posixpath.basename(path)}.md"
        elif (SOURCE / path / "README.md").exists():
            path += "/README.md"
        else:
            return found[0]
        return "](" + posixpath.relpath(path, folder or ".")

    content[0] = re.sub(r"\]\(([^):#\s]+)", link, content[0])
    if docname in SUBMENUS:
        content[0] += menu([SUBMENUS[docname]])
    elif docname == "index":
        content[0] += main_menu()


def link_names(app: Sphinx, tree: nodes.document, docname: str) -> None:
    """Link the names of functions, headers, pages ("docs/x.md") and tools/explore.sh."""
    c, python = app.env.domains["c"], app.env.domains["py"]
    places = {name: place for name, _, _, *place, _ in (*c.get_objects(), *python.get_objects())}
    places |= {header: [f"c/{header}", ""] for header in HEADERS}
    places["tools/explore.sh"] = [EXPLORE.removesuffix(".html"), ""]
    places |= {f"docs/{path.name}": [f"docs/{path.stem}", ""] for path in SOURCE.glob("docs/*.md")}
    for text in [text for text in tree.findall(nodes.Text) if not is_inside(text, NOT_LINKED)]:
        parts: list[nodes.Node] = []
        for word in re.split(NAME, text):
            page, anchor = places.get(word, ("", ""))
            if page in ("", docname) or not re.search(r"[_./]", word):
                parts.append(nodes.Text(word))
            else:
                address = app.builder.get_relative_uri(docname, page) + (anchor and f"#{anchor}")
                label = f'"{app.env.titles[page].astext()}"' if word.endswith(".md") else word
                parts.append(nodes.reference("", label, refuri=address, internal=True))
        text.parent.replace(text, parts)


def is_inside(node: nodes.Node, kinds: tuple[type, ...]) -> bool:
    return isinstance(node, kinds) or (node.parent is not None and is_inside(node.parent, kinds))


def add_explore_page(
    app: Sphinx, docname: str, template: str, context: dict[str, Any], *_: Any
) -> None:
    """Begin the menu with the page of tools/explore.sh."""
    link = f'<a class="reference" href="{context["pathto"](EXPLORE, 1)}">Try it in this browser</a>'
    item = f'<ul><li class="toctree-l1">{link}</li></ul>'
    context["furo_navigation_tree"] = item + context["furo_navigation_tree"]


def format_docstring(app: Sphinx, *arguments: Any) -> None:
    """Add markup, and escape what looks like markup: |F|, **keys and PREFIX_."""
    text = re.sub(r"Alias for field number .*\n", "", "\n".join(arguments[-1]))
    paragraphs = map(with_markup, re.split(r"\n[ \t]*\n", text))
    lines = "\n\n".join(paragraphs).split("\n")
    for number, line in enumerate(lines):
        if not re.match(r" {4}|>>>|\.\.\.", line):
            lines[number] = re.sub(MARKUP, r"\\\g<0>", line)
    arguments[-1][:] = lines


def with_markup(paragraph: str) -> str:
    """Make a list of columns, and Python of other indented lines. A paragraph has columns if its
    first line and another one have. A deeper line continues the row above.
    """
    lines = paragraph.split("\n")
    rows = [ROW.fullmatch(line) for line in lines]
    if rows[0] is None or sum(row is not None for row in rows) < 2:
        return f".. code-block:: python\n\n{paragraph}" if paragraph[:4].isspace() else paragraph
    items: list[str] = []
    for line, row in zip(lines, rows, strict=True):
        if row and row[1] == rows[0][1]:
            items.append(f"- ``{row[2]}``: " + re.sub(" {2,}", "; ", row[3], count=1))
        else:
            items[-1] += " " + re.sub(" {2,}", " ", line.strip())
    return "\n".join(items)


def write_math(self: Any, node: nodes.Element) -> None:
    """Write an equation as MathML: no script, no font, no network."""
    is_block = isinstance(node, nodes.math_block)
    equation = tex2mathml(node.astext(), as_block=is_block).replace(ACCENT, "")
    self.body.append(f'<div class="math">{equation}</div>' if is_block else equation)
    raise nodes.SkipNode


def render_string(self: Any, text: str) -> list[nodes.Node]:
    """Keep the indent of code: breathe drops strings of blanks."""
    is_indent = text.isspace() and "\n" not in text
    return [nodes.Text(text)] if is_indent else RENDER_STRING(self, text)


def setup(app: Sphinx) -> None:
    write_reference()
    SphinxRenderer.render_string = render_string
    app.add_html_math_renderer("mathml", (write_math, None), (write_math, None))
    app.connect("source-read", prepare_page)
    app.connect("autodoc-process-docstring", format_docstring)
    app.connect("doctree-resolved", link_names)
    app.connect("html-page-context", add_explore_page, priority=900)  # after furo made the menu
