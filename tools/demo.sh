#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: tools/demo.sh [LOG.csv --angle COLUMN --torque COLUMN --sigma0 X --fc Y --counts-per-turn N] [--scene NAME] [--target CORE]
#
# Installs what it needs, builds, and runs the demo: an encoder replays a measured log on a CAN bus, and a friction node answers each
# angle. Writes in build/demo
#   loop.png      measured and computed torque over angle and over time
#   run.log       all frames, candump lines (canplayer can replay them)
#   summary.json  the numbers of the printed table
# All arguments are passed to `dahl demo`. After the first run, `build/venv/bin/dahl demo --help` lists them.
# Examples:  tools/demo.sh
#            tools/demo.sh --scene steering
#            tools/demo.sh --scene commission     an axis measures its own friction: commission.png, summary.json
#            tools/demo.sh --scene compensation   laws of friction compensation, without a bus: compensation.png, summary.json
#            tools/demo.sh --scene park-steer     a power steering with two nodes: park-steer.png, run.log, summary.json
#            tools/demo.sh --target m4f     the torque from firmware on an emulated Cortex-M4F
#            tools/demo.sh shaft.csv --angle angle_deg --torque torque_Nm --sigma0 120 --fc 0.8 --counts-per-turn 16384
set -euo pipefail
# shellcheck source=tools/common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

case "${1:-}" in -h | --help) usage; exit 0 ;; esac
needs=(demo)
for word; do case "$word" in --target | --target=*) needs=(firmware) ;; esac; done
"$ROOT/tools/setup.sh" "${needs[@]}"
build_demo
exec "$VENV/bin/dahl" demo "$@"
