#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: tools/lock.sh [UV ARGUMENT...]
#
# Writes tools/requirements.lock: the packages of [dependency-groups] in pyproject.toml and all packages that they require, with
# version and SHA-256 sums, for every platform and every Python from 3.11 on. Run it after a change of a group. A package keeps its
# locked version unless a group requires another one. It also fills each tools/setup/mujoco-VERSION.lock.
# Examples:  tools/lock.sh             after adding a line to a group
#            tools/lock.sh --upgrade   newest versions of all packages that the groups do not pin
set -euo pipefail
# shellcheck source=tools/common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"
# shellcheck source=tools/setup/python.sh
source "$ROOT/tools/setup/python.sh"

case "${1:-}" in -h | --help) usage; exit 0 ;; esac
mkdir -p "$BUILD"
install_uv
set_uv_index
lock() { # LOCK_FILE ARGUMENT...
    "$UV" pip compile --quiet --universal --python-version 3.11 --generate-hashes --annotation-style line --no-emit-index-url \
        --custom-compile-command tools/lock.sh "${@:2}" --output-file "$1" >/dev/null
}

lock "$LOCK_FILE" "$@" --group "$ROOT/pyproject.toml:all"
for file in "$ROOT"/tools/setup/mujoco-*.lock; do
    version=$(basename "${file##*/mujoco-}" .lock)
    lock "$file" --no-deps - <<<"mujoco==$version"
done
