#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: tests/socketcan/bus_off.sh FOLDER
#
# Runs at the same time as tools/vm.sh FOLDER. Makes can0 of the virtual machine go bus-off each time a program in it writes the file
# FOLDER/bus_off.request, which sets the variables of bus_off.gdb. Then moves that file to FOLDER/bus_off.done.
set -u
SCRIPT=$(dirname "$(readlink -f "$0")")/bus_off.gdb
cd "$1" || exit 1
while sleep 0.1; do
    [ -e bus_off.request ] || continue
    timeout 60 gdb -nx -batch -x bus_off.request -x "$SCRIPT" >>bus_off.log 2>&1 </dev/null
    mv bus_off.request bus_off.done
done
