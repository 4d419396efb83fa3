#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: port/arduino/pack.sh FOLDER
#
# Puts the library into FOLDER/dahl as the Arduino IDE wants it: library.properties, keywords.txt, examples/, and the sources
# in src/. Copy that folder into Arduino's libraries, or zip it for "Add .ZIP Library".
set -euo pipefail

case "${1:-}" in
    -h | --help) sed -n '3,/^[^#]/{/^#/s/^# \{0,1\}//p}' "$0"; exit 0 ;;
    '') echo "error: pack.sh wants the folder to put dahl/ into (see --help)" >&2; exit 2 ;;
esac
here=$(CDPATH='' cd -- "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root=$here/../..
made=$1/dahl
if [ -e "$made" ]; then
    echo "error: $made is there already; remove it, or name another folder" >&2
    exit 2
fi
mkdir -p "$made/src"
cp -R "$here/library.properties" "$here/keywords.txt" "$here/examples" "$root/LICENSE" "$made"
cp "$root"/lib/include/{dahl.h,dahl.hpp,dahl_encoder.h,dahl_parts.h,dahl_node.h,dahl_frames.h,dahl_can_bus.h} "$made/src"
cp -R "$root"/lib/{arith,cores,model,node,parts} "$made/src"
rm "$made/src/cores/choose.cmake" # what is no source
mkdir "$made/extras"
mv "$made/src/node/dahl.dbc" "$made/extras"
echo "$made"
