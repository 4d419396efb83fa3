#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: tools/bench.sh target [--quick] [CORE...]
#        tools/bench.sh readme [--check]
#
#   target   counts instructions, bytes and stack on m0 m3 m4f m7 m33 rv32 (or those named) in QEMU, beside what else one
#            could write; prints a table and writes build/bench/target.json. --quick leaves picolibc out.
#   readme   puts the table of build/bench/target.json into README.md; --check only says whether it would change
set -euo pipefail
# shellcheck source=tools/common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

command=${1:-}
[ $# -eq 0 ] || shift
case "$command" in
    -h | --help) usage; exit 0 ;;
    target | readme) ;;
    *) die "bench.sh knows target and readme, not '$command' (see --help)" ;;
esac
"$ROOT/tools/setup.sh" >/dev/null
case "$command" in
    target) exec "$VENV/bin/python" "$ROOT/tools/bench/target.py" "$@" ;;
    readme) exec "$VENV/bin/python" "$ROOT/tools/bench/table.py" "$@" ;;
esac
