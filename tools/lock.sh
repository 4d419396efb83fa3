#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: tools/lock.sh [UV ARGUMENT...]
#
# Writes tools/requirements.lock: the packages of [dependency-groups] in pyproject.toml and all packages that they require, with
# version and SHA-256 sums, for every platform. Run it after a change of a group. A package keeps its locked version unless a
# group requires another one.
# The lock has one section for each group. A section leaves out the packages of the sections above it; `rivals` stands alone.
# Examples:  tools/lock.sh             after adding a line to a group
#            tools/lock.sh --upgrade   newest versions of all packages that the groups do not pin
set -euo pipefail
# shellcheck source=tools/common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

UV=uv==0.13.9
WORK=$BUILD/lock
STACKED=(demo identify test docs checks) # each section builds on those before it

compile_group() { # GROUP EARLIER_GROUP...
    local group=$1 earlier options=()
    shift
    for earlier; do
        options+=(-c "$WORK/$earlier.txt")
        mapfile -t -O "${#options[@]}" options < <(sed -n 's/^\([^ #=]*\)==.*/--no-emit-package=\1/p' "$WORK/$earlier.txt")
    done
    say "group $group"
    locked_packages "$group" >"$WORK/$group.txt" # uv keeps the versions of an output file that exists
    "$WORK/bin/uv" pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-annotate --no-header \
        "${options[@]}" "${UV_ARGUMENTS[@]}" --group "$ROOT/pyproject.toml:$group" -o "$WORK/$group.txt" >/dev/null
}

write_lock() {
    local group
    echo "# Written by tools/lock.sh from [dependency-groups] in pyproject.toml. Do not edit."
    for group in "${STACKED[@]}" rivals; do
        printf '# group %s\n' "$group"
        cat "$WORK/$group.txt"
    done
}

case "${1:-}" in -h | --help) usage; exit 0 ;; esac
UV_ARGUMENTS=("$@")
python3 -m venv --clear "$WORK"
"$WORK/bin/python" -m pip --quiet --disable-pip-version-check install "$UV"
for n in "${!STACKED[@]}"; do compile_group "${STACKED[n]}" "${STACKED[@]:0:n}"; done
compile_group rivals
write_lock >"$WORK/requirements.lock"
mv "$WORK/requirements.lock" "$LOCK_FILE"
