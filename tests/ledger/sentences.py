# SPDX-License-Identifier: MIT
"""What README.md and lib/dahl.h say, sentence by sentence, so that each can be put into the ledger.

A table row is a sentence. Headings, code and the tables that a command regenerates (between
`<!-- name -->` marks) are not: the latter stand as one sentence `<!-- name -->`.
"""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
END = re.compile(r"(?<=[.!?])\s+(?=[A-Z0`\[(*])")
RULE = re.compile(r"[|\-: ]+")
GENERATED = re.compile(r"<!-- (\S+) -->.*?<!-- /\1 -->", re.DOTALL)
CODE = re.compile(r"```.*?```", re.DOTALL)


def one_line(text: str) -> str:
    return " ".join(text.split())


def _of_block(block: str) -> list[str]:
    """The sentences of one paragraph or table of Markdown."""
    if block.lstrip().startswith("#"):
        return []
    if block.lstrip().startswith("|"):
        return [row for row in map(one_line, block.splitlines()) if not RULE.fullmatch(row)]
    return END.split(one_line(block))


def of_readme(text: str) -> list[str]:
    """All sentences of a page in Markdown."""
    text = CODE.sub("\n\n", GENERATED.sub(r"\n\n<!-- \1 -->\n\n", text))
    sentences = [s for block in re.split(r"\n\s*\n", text) for s in _of_block(block)]
    return [s for s in sentences if s]


def of_header(text: str) -> list[str]:
    """All sentences of the comments of a C header, but the licence line."""
    found: list[str] = []
    for comment in re.findall(r"/\*(.*?)\*/", text, re.DOTALL):
        lines = (re.sub(r"^\s*\*+ ?", "", line) for line in comment.splitlines())
        found += END.split(one_line(" ".join(lines)))
    return [s for s in found if s and not s.startswith("SPDX")]


def all_sentences() -> dict[str, str]:
    """Each sentence and the file that says it."""
    said = dict.fromkeys(of_readme((ROOT / "README.md").read_text()), "README.md")
    header = of_header((ROOT / "lib" / "dahl.h").read_text())
    return dict.fromkeys(header, "lib/dahl.h") | said
