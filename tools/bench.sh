#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: tools/bench.sh [--quick]
#        tools/bench.sh target [--quick] [--mhz CLOCK] [CORE...] | host [--quick] [--core-math FILE]
#        tools/bench.sh report [--cycles] | docs | laws [--docs]
#        tools/bench.sh axes [FIRST COUNT] [--only rigid|flexible] [--rows FILE]
#        tools/bench.sh servo_drive [--docs]
#
# Measures cost and error of the library and of other methods. Without a command it runs target, host and docs: 5 minutes on two
# cores. With --quick it runs target, host and report: 1 minute.
#   target   counts instructions, cycles, bytes and stack in QEMU, on all small cores or on those given (m4f rv32 ...), and on an
#            AVR (avr) in simavr; prints tables and writes build/bench/target.json and avr.json. --quick leaves picolibc out.
#            --mhz also prints microseconds at a clock: tools/bench.sh target --quick --mhz 48 m0
#   host     measures errors against long double, speed on this machine and calls from Python, also for MuJoCo, Newton, SciPy,
#            JAX and numba (installed in build/bench/venv); writes build/bench/host.json. --quick runs shorter motions.
#            --core-math FILE adds the expm1f.c of CORE-MATH, which neither Debian nor PyPI has
#   report   reads these two files; writes build/bench/results.json and the pictures speed, pareto and growth (.png, .svg).
#            --cycles shows cycles of Cortex-M0, M3 and M4F instead of instructions
#   docs     runs report, then writes the tables and pictures of docs/
#   laws     compares laws of friction compensation with five seeds: prints the tables of docs/compensation.md; --docs writes them
#   axes     commissions 300 rigid and 120 flexible random axes in 1 to 2 minutes; prints the tables of docs/commissioning.md,
#            or those of COUNT other axes of each kind:  tools/bench.sh axes 70000 20
#   servo_drive  measures flash, RAM, stack and worst tick of examples/servo_drive; --docs writes the table of its page
set -euo pipefail
# shellcheck source=tools/common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"
# shellcheck source=tools/setup/python.sh
source "$ROOT/tools/setup/python.sh"

case "${1:-}" in
    -h | --help) usage; exit 0 ;;
    '' | --quick) command=all ;;
    target | host | report | docs | laws | axes | servo_drive) command=$1; shift ;;
    *) die "unknown command '$1'; bench.sh has target, host, report, docs, laws, axes and servo_drive (see --help)" ;;
esac

python() { "$VENV/bin/python" "$ROOT/tools/bench/$1.py" "${@:2}"; }

# If this fails, the bench continues: host.py reports which rivals are missing.
install_rivals() {
    (install_uv && fill_venv "$BUILD/bench/venv" rivals) || say "the rivals could not be installed (log: build/setup.log)"
}

if [ "$command" = laws ]; then # without the cores
    "$ROOT/tools/setup.sh" demo >/dev/null
    build_demo
    python laws "$@"
    exit
fi
if [ "$command" = axes ]; then
    "$ROOT/tools/setup.sh" test >/dev/null
    start_build
    configure -DDAHL_BUILD_TESTS=ON
    build --target commission_axes dahl_binding
    exec 9>&-
    python axes "$@"
    exit
fi
"$ROOT/tools/setup.sh" bench >/dev/null
case "$command" in
    target) python target "$@" ;;
    host) install_rivals; python host "$@" ;;
    report) python report "$@" ;;
    servo_drive) build_demo; python servo_drive "$@" ;; # its shaft is in libdahl.so
    docs) python report --docs ;;
    all)
        say "counting instructions on seven cores"
        python target "$@" >"$BUILD/bench-target.log"
        install_rivals
        python host "$@"
        if [ $# -eq 0 ]; then python report --docs; else python report; fi
        ;;
esac
