#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: tools/release.sh [-o FOLDER] [--repository URL] [--commit COMMIT] [--without-site] [--without-aarch64]
#
# Builds all files of a release from a commit into one folder, and prints the name of its tag:
#   dahl-VERSION-source.tar.gz        the checkout
#   dahl-VERSION-amalgamation.zip     dahl.c and dahl.h: friction alone, and all parts
#   dahl-VERSION.tar.gz, *.whl        Python: sdist, and wheels for Linux, named by auditwheel: of this processor, and on x86-64 by
#                                     clang also for aarch64 (Raspberry Pi), if Debian's packages for it are there
#   dahl-VERSION-arduino.zip          for "Add .ZIP Library" of the Arduino IDE
#   dahl-VERSION-platformio.tar.gz    for `pio pkg install`
#   dahl-VERSION-esp-idf.tgz          a component of ESP-IDF
#   dahl-VERSION-site.zip             pages and references (tools/docs.sh)
#   dahl-VERSION.cdx.json             bill of materials, CycloneDX 1.5
#   SHA256SUMS
# The same commit and tools give the same bytes. The version is that of dahl.h.
#   -o FOLDER         empty or new; default build/release
#   --repository URL  the page of the repository, entered into all manifests; default: [tool.dahl] of pyproject.toml
#   --commit COMMIT   default HEAD; the site is always of the checkout, so another commit needs --without-site
# Example:  tools/release.sh --repository https://host.name/owner/dahl
set -euo pipefail
# shellcheck source=tools/common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"
# shellcheck source=tools/setup/python.sh
source "$ROOT/tools/setup/python.sh"

OUT=$BUILD/release
COMMIT=HEAD
SITE=$BUILD/docs
ARGUMENTS=()
while [ $# -gt 0 ]; do
    case "$1" in
        -h | --help) usage; exit 0 ;;
        --without-site) SITE=; shift; continue ;;
        --without-aarch64) ARGUMENTS+=("$1"); shift; continue ;;
        -o | --repository | --commit) [ $# -ge 2 ] || die "$1 needs a value (see --help)" ;;
        *) die "unknown option '$1' (see --help)" ;;
    esac
    case "$1" in
        -o) OUT=$2 ;;
        --repository) ARGUMENTS+=(--repository "$2") ;;
        --commit) COMMIT=$2 ;;
    esac
    shift 2
done

hash=$(git -C "$ROOT" rev-parse --verify --quiet "$COMMIT^{commit}") || die "$COMMIT is no commit of this checkout"
COMMIT=$hash

# The site is built of the files of the checkout, so they must be those of the commit.
check_checkout() {
    [ -z "$(git -C "$ROOT" status --porcelain)" ] || die "the checkout has changes: commit them, or give --without-site"
    [ "$COMMIT" = "$(git -C "$ROOT" rev-parse HEAD)" ] ||
        die "the checkout is not at $COMMIT: check it out, or give --without-site"
}

build_release() { # PYTHON ARGUMENT...
    "$1" "$ROOT/tools/release/release.py" -o "$OUT" --commit "$COMMIT" ${ARGUMENTS[@]+"${ARGUMENTS[@]}"} "${@:2}"
}

[ -z "$SITE" ] || check_checkout
if python=$(find_python); then build_release "$python" --check; fi # before the set-up, which takes minutes
"$ROOT/tools/setup.sh" release
SOURCE_DATE_EPOCH=$(git -C "$ROOT" log -1 --format=%ct "$COMMIT")
export SOURCE_DATE_EPOCH
if [ -n "$SITE" ]; then "$ROOT/tools/docs.sh"; fi
build_release "$VENV/bin/python" ${SITE:+--site "$SITE"}
