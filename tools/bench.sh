#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: tools/bench.sh [--quick]
#        tools/bench.sh target [--quick] [CORE...] | host [--quick] | report | docs
#
#   (none)   all of it: target, host, report and, but for --quick, the tables and pictures of docs/.
#            10 minutes on two cores, 1 with --quick
#   target   counts instructions, bytes and stack on every small core (or those named: m4f rv32 ...) in QEMU, beside what else one
#            could write; prints a table and writes build/bench/target.json. --quick leaves picolibc out.
#   host     errors of every way against long double, speed on this machine, and rivals from outside (MuJoCo, Newton, SciPy,
#            in a Python environment of their own); writes build/bench/host.json. --quick takes shorter motions.
#   report   from these two files: build/bench/results.json, pareto.png, pareto.svg, growth.png, growth.svg
#   docs     report, and the tables and pictures of docs/
set -euo pipefail
# shellcheck source=tools/common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

case "${1:-}" in
    -h | --help) usage; exit 0 ;;
    '' | --quick) command=all ;;
    target | host | report | docs) command=$1; shift ;;
    *) die "bench.sh knows target, host, report and docs, not '$1' (see --help)" ;;
esac

python() { "$VENV/bin/python" "$ROOT/tools/bench/$1.py" "${@:2}"; }

# An environment that cannot be made is no reason to stop: host.py names the rivals that are missing.
rivals_from_outside() {
    local venv=$BUILD/bench/venv pins=$ROOT/tools/requirements/rivals.lock key
    key=$(sha256sum <"$pins")
    [ "$(cat "$venv/.complete" 2>/dev/null)" != "$key" ] || return 0
    say "installing rivals into build/bench/venv (tools/requirements/rivals.txt)"
    mkdir -p "$BUILD/bench"
    rm -rf "$venv"
    if "$VENV/bin/python" -m venv "$venv" >"$venv.log" 2>&1 && "$venv/bin/python" -m pip --disable-pip-version-check install \
        --quiet --progress-bar off --retries 2 --timeout 15 --no-deps --require-hashes -r "$pins" >>"$venv.log" 2>&1; then
        echo "$key" >"$venv/.complete"
    else
        say "could not; see build/bench/venv.log"
    fi
}

"$ROOT/tools/setup.sh" bench >/dev/null
case "$command" in
    target) python target "$@" ;;
    host) rivals_from_outside; python host "$@" ;;
    report) python report "$@" ;;
    docs) python report --docs ;;
    all)
        say "counting instructions on six cores"
        python target "$@" >"$BUILD/bench-target.log"
        rivals_from_outside
        python host "$@"
        if [ $# -eq 0 ]; then python report --docs; else python report; fi
        ;;
esac
