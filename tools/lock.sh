#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: tools/lock.sh [UV ARGUMENT...]
#
# Writes tools/requirements/*.lock anew: every Python package that the lists tools/requirements/*.txt name or pull in, with
# version and the SHA-256 sums of its files, for every platform. Run it after a change of a list; what the locks hold keeps
# its version unless a list wants another. Each lock holds only what the ones before it do not.
# Examples:  tools/lock.sh             after adding a line to a list
#            tools/lock.sh --upgrade   takes the newest of all that the lists leave open
set -euo pipefail
# shellcheck source=tools/common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

UV=uv==0.13.9
PINS=$ROOT/tools/requirements

compile() { # GROUP EARLIER_GROUP...: what GROUP.txt needs beyond the earlier groups
    local group=$1 earlier options=()
    shift
    for earlier; do
        options+=(-c "$earlier.lock")
        mapfile -t -O "${#options[@]}" options < <(sed -n 's/^\([^ #=]*\)==.*/--no-emit-package=\1/p' "$earlier.lock")
    done
    say "$group.lock"
    "$BUILD/lock/bin/uv" pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-annotate \
        --custom-compile-command tools/lock.sh "${options[@]}" "${UV_ARGUMENTS[@]}" "$group.txt" -o "$group.lock" >/dev/null
}

case "${1:-}" in -h | --help) usage; exit 0 ;; esac
UV_ARGUMENTS=("$@")
python3 -m venv --clear "$BUILD/lock"
"$BUILD/lock/bin/python" -m pip --quiet --disable-pip-version-check install "$UV"
cd "$PINS"
compile demo
compile identify demo
compile test demo identify
compile checks demo identify test
compile rivals
