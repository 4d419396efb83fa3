# SPDX-License-Identifier: MIT
"""tools/docs.sh: the site builds without a warning, is one whole, and hides nothing."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import need
from programs import call, run

WIDTHS = ("390", "1280")
LINKS = {  # page: a page that it must link to
    "index.html": "docs/microcontroller.html",
    "docs/microcontroller.html": "../c/dahl.h.html#c.dahl_prepare",
    "docs/model.html": "../c/dahl_parts.h.html",
    "docs/python.html": "../python/dahl.html#dahl.Client",
    "docs/c.html": "../c/dahl_compensator.h.html",
    "docs/identify.html": "../python/dahl.identify.html",
    "docs/simulators.html": "../python/dahl.jax.html",
    "docs/verification.html": "../explore.html",
    "search.html": "explore.html",
    "c/dahl.h.html": "../docs/microcontroller.html",
    "c/dahl_encoder.h.html": "../docs/encoder.html",
    "python/dahl.can.node.html": "../docs/loop.html",
}
WORDS = {  # page: what a reader must find there
    "docs/model.html": '<math xmlns="http://www.w3.org/1998/Math/MathML" display="block">',
    "c/dahl.h.html": "w += (s - w) g(u),    g(u) = 1 - exp(-u)          exact for one tick",
    "c/dahl_parts.h.html": '<span class="n">dahl_damping_apply</span>',
    "c/dahl.hpp.html": 'href="#_CPPv4N4dahl4NodeE"',
    "c/dahl_node.h.html": '\n<span class="w">    </span><span class="k">if</span>',
    "python/dahl.html": "Friction(plan)</span></code>:",
    "python/dahl.identify.html": "dahl.identify.Options",
    "python/dahl.jax.html": 'id="dahl.jax.ElastoPlastic.step"',
    "python/dahl.mujoco.html": "dahl.friction",
    "explore.html": "AGFzbQEAAAAB",  # the library as WebAssembly
}


@pytest.fixture(scope="module")
def site(root: Path) -> Iterator[Path]:
    done = call(root / "tools/docs.sh")
    assert (done.returncode, done.stderr) == (0, "")
    yield root / "build/docs"


@pytest.mark.parametrize("page", LINKS)
def test_guides_and_references_link_to_each_other(site: Path, page: str) -> None:
    assert f'href="{LINKS[page]}' in (site / page).read_text()


@pytest.mark.parametrize("page", WORDS)
def test_a_page_has_its_equations_code_and_columns(site: Path, page: str) -> None:
    assert WORDS[page] in (site / page).read_text()


def test_each_page_is_in_the_menu_and_in_the_search_of_all(site: Path) -> None:
    index = (site / "searchindex.js").read_text()
    pages = {path.relative_to(site).with_suffix("").as_posix() for path in site.rglob("*.html")}
    found = set(re.findall(r'"([^"]*)"', index.split('"docnames":[')[1].split("]")[0]))
    assert pages - found <= {"search", "explore"} and found <= pages
    folders = {page.split("/")[0] for page in found if "/" in page}
    assert folders == {"docs", "c", "python", "examples"}
    menu = (site / "search.html").read_text()
    assert [page for page in found - {"index"} if f'href="{page}.html"' not in menu] == []


def test_nothing_is_clipped_on_a_phone_and_on_a_desk(site: Path, root: Path) -> None:
    need("chromium", "no page of the site is clipped")
    assert run("python3", root / "tools/docs/check.py", site).endswith(" pages, 0 faults\n")
    assert all((root / f"build/docs-pictures/{width}.png").exists() for width in WIDTHS)


def test_the_check_finds_what_is_clipped_or_broken(root: Path, tmp_path: Path) -> None:
    need("chromium", "the measurement of pages finds faults")
    (tmp_path / "good.html").write_text("<article>text</article>")
    (tmp_path / "wide.html").write_text('<article><p style="width: 700px">text</article>')
    hidden = '<article><p style="width: 90px; overflow: hidden; white-space: pre">'
    (tmp_path / "hidden.html").write_text(hidden + "a long line of text" * 9)
    (tmp_path / "remote.html").write_text('<article><img src="http://localhost:9/x.png">')
    (tmp_path / "links.html").write_text(
        '<article id="a"><a href="good.html"><a href="#a"><a href="http://localhost:9/">'
        '<a href="none.html"><a href="good.html#none"><img src="none%20.png">'
    )
    faults = run("python3", root / "tools/docs/check.py", tmp_path, code=1).splitlines()
    broken = [fault.split(" to ")[1] for fault in faults if "links.html" in fault]
    assert broken == ["none.html", "good.html#none", "none .png"]
    faults = [fault for fault in faults if "links.html" not in fault]
    found = {
        (page, width) for page, width in re.findall(r"(\w+).html at (\d+) px", "\n".join(faults))
    }
    wanted = {
        ("wide", "390"),
        *((page, width) for page in ("hidden", "remote") for width in WIDTHS),
    }
    assert found == wanted and len(faults) == len(wanted)
