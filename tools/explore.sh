#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: tools/explore.sh [OUT.html]
#
# Writes one web page that runs the C library, compiled to WebAssembly. Move sliders and see the loop, beside other friction laws.
# Drop a CSV on it. Copy the code with your numbers. The default is build/explore.html. The page needs no other file and no network.
# Open it in any browser of 2023 or later. Sources: tools/explore.
set -euo pipefail
# shellcheck source=tools/common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

OUT=$BUILD/explore.html
case "${1:-}" in
    -h | --help) usage; exit 0 ;;
    -*) die "unknown option '$1' (see --help)" ;;
    ?*) OUT=$1 ;;
esac
[ $# -le 1 ] || die "one file at most, not: $*"

# -fno-builtin: clang would turn the loop of memset in library.c into a call of memset.
compile() { # OUT.wasm
    clang --target=wasm32 -std=c99 -O2 -Wall -Wextra -Werror -ffreestanding -fno-builtin -nostdlib -I"$ROOT/lib/include" \
        -Wl,--no-entry,--strip-all,--gc-sections "$ROOT"/lib/arith/*.c "$ROOT"/lib/model/*.c "$ROOT/tools/explore/library.c" -o "$1"
}

"$ROOT/tools/setup.sh" explore
for tool in clang wasm-ld; do
    command -v $tool >/dev/null || die "no $tool here, which compiles the library for the page (Debian: clang and lld)"
done
library=$(mktemp)
trap 'rm -f "$library"' EXIT
compile "$library"
"$VENV/bin/python" "$ROOT/tools/explore/build.py" "$library" "$OUT"
say "wrote $OUT; open it in a browser"
