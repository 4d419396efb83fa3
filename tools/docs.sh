#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: tools/docs.sh
#
# Builds the site in build/docs: the pages, the C headers, the Python package and the page of tools/explore.sh, with one menu and one
# search. It fails on a warning and on a broken link inside the site. With Chromium it also fails on a page, an equation or a box
# that is clipped at 390 or 1280 px, and writes screenshots to build/docs-pictures. Open build/docs/index.html.
set -euo pipefail
# shellcheck source=tools/common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

case "${1:-}" in -h | --help) usage; exit 0 ;; esac
"$ROOT/tools/setup.sh" docs
build_demo # autodoc imports dahl, which loads libdahl.so
export DAHL_DOCS_EXPLORE=$BUILD/explore.html DAHL_DOCS_SOURCE=$BUILD/docs-source DAHL_DOCS_XML=$BUILD/docs-xml
"$ROOT/tools/explore.sh"
rm -rf "$BUILD/docs" "$DAHL_DOCS_SOURCE" "$DAHL_DOCS_XML"
mkdir -p "$DAHL_DOCS_SOURCE"
cd "$ROOT"
git ls-files -zco --exclude-standard | xargs -0 cp --parents -t "$DAHL_DOCS_SOURCE"
mv "$DAHL_DOCS_SOURCE/README.md" "$DAHL_DOCS_SOURCE/index.md"
doxygen docs/Doxyfile
"$VENV/bin/sphinx-build" -q -W --keep-going -c tools/docs -d "$DAHL_DOCS_SOURCE/.doctrees" "$DAHL_DOCS_SOURCE" "$BUILD/docs"
rm -f "$BUILD/docs/.buildinfo" # a hash of paths of this machine; the site of a release has equal bytes everywhere
"$VENV/bin/python" tools/docs/check.py "$BUILD/docs" "$BUILD/docs-pictures"
