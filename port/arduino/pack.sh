#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: port/arduino/pack.sh FOLDER
#
# Create FOLDER/dahl in the layout of the Arduino IDE: library.properties, keywords.txt, examples/, and the sources in src/.
# Copy that folder into Arduino's libraries, or zip it for "Add .ZIP Library".
set -euo pipefail

case "${1:-}" in
    -h | --help) sed -n '3,/^[^#]/{/^#/s/^# \{0,1\}//p}' "$0"; exit 0 ;;
    '') echo "error: pack.sh needs the folder in which to create dahl/ (see --help)" >&2; exit 2 ;;
esac
here=$(CDPATH='' cd -- "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root=$here/../..
library=$1/dahl
if [ -e "$library" ]; then
    echo "error: $library exists; remove it, or name another folder" >&2
    exit 2
fi
mkdir -p "$library/src"
cp -R "$here/library.properties" "$here/keywords.txt" "$here/examples" "$root/LICENSE" "$library"
cp "$root"/lib/include/{dahl.h,dahl.hpp,dahl_encoder.h,dahl_parts.h,dahl_compensator.h,dahl_commission.h,dahl_node.h,dahl_frames.h,dahl_can_bus.h} "$library/src"
cp -R "$root"/lib/{arith,commission,compensator,cores,model,node,parts} "$library/src"
rm "$library/src/cores/choose.cmake" # not a source
mkdir "$library/extras"
mv "$library/src/node/dahl.dbc" "$library/extras"
echo "$library"
