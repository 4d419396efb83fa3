#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: tools/docs.sh
#
# Builds the site in build/docs: the pages of docs/, the C headers (Doxygen) and the Python package (pdoc), then checks all links
# inside the site. It fails on a warning and on a broken link. Open build/docs/index.html.
set -euo pipefail
# shellcheck source=tools/common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

case "${1:-}" in -h | --help) usage; exit 0 ;; esac
"$ROOT/tools/setup.sh" docs
build_demo # pdoc imports dahl, which loads libdahl.so
rm -rf "$BUILD/docs"
mkdir -p "$BUILD/docs"
(cd "$ROOT" && doxygen docs/Doxyfile)
"$VENV/bin/python" "$ROOT/tools/docs.py" "$BUILD/docs"
