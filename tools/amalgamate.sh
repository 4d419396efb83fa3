#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: tools/amalgamate.sh [--with PART,PART...] [-o FOLDER]
#
# Writes the library as two files, dahl.c and dahl.h, to copy into any project: Keil, IAR, STM32CubeIDE, Arduino, a Makefile.
# They have the Dahl element and the encoder. --with adds more:
#   parts        other friction elements, energy (dahl_parts.h)
#   compensator  friction compensation and the residual observer (dahl_compensator.h)
#   commission   an axis measures its own friction (dahl_commission.h), with the compensator
#   node         a friction node on a CAN bus (dahl_node.h), with the parts
# The default FOLDER is build/amalgamation. The files are written anew each time, so do not edit them. They give the bits of the
# library, by the C alone: the ticks in assembly for Cortex-M (lib/cores) are not in them. Needs Python 3 only.
# Examples:  tools/amalgamate.sh -o firmware/dahl
#            tools/amalgamate.sh --with compensator,node -o firmware/dahl
set -euo pipefail
# shellcheck source=tools/common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

for word; do case "$word" in -h | --help) usage; exit 0 ;; esac; done
"${DAHL_PYTHON:-python3}" "$ROOT/tools/generators/amalgamate.py" -o "$BUILD/amalgamation" "$@"
