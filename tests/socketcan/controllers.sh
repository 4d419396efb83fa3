#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: tests/socketcan/controllers.sh DAHL-LOOP RUN_FILE PYTHON FOLDER
#
# Run the node on can0 and its clients on can1, which are controllers of tools/vm.sh. Each case leaves its files in FOLDER/CASE, for
# tests/python/can/test_socketcan.py. FOLDER/test_rig.py is a test of the pytest plugin. Run bus_off.sh outside the virtual machine
# at the same time.
set -u
LOOP=$1
RUN=$2
PYTHON=$3
OUT=$4
declare -A PROCESS # by role: node, encoder

begin() { # CASE
    HERE=$OUT/$1
    mkdir -p "$HERE"
}

start() { # ROLE BUS TIMEOUT_MS OPTION...
    local role=$1 bus=$2
    { cat "$RUN"; echo "friction.timeout_ms = $3"; } >"$HERE/$role.run"
    shift 3
    "$LOOP" "$HERE/$role.run" --role "$role" --bus "socketcan:$bus" --counters "$HERE/$role.counters" "$@" 2>"$HERE/$role.err" &
    PROCESS[$role]=$!
    sleep 1
}

finish() { # ROLE
    wait "${PROCESS[$1]}"
    echo $? >"$HERE/$1.code"
}

stop() { # ROLE
    kill -INT "${PROCESS[$1]}"
    finish "$1"
}

in_lockstep() {
    begin lockstep
    candump -n 2000 -T 30000 -r 8000000 -L can1,100:7EF >"$HERE/candump.log" & # ids 100 and 110
    local witness=$!
    start node can0 60000
    start encoder can1 60000 --lockstep --seconds 1
    finish encoder
    stop node
    wait "$witness"
}

# python-can imports asammdf if it is there, and that imports pandas: too slow for an emulated processor.
plugin() {
    begin plugin
    start node can0 60000
    PYTEST_DISABLE_PLUGIN_AUTOLOAD=1 \
        "$PYTHON" -c 'import sys; sys.modules["asammdf"] = None; import pytest; sys.exit(pytest.main())' \
        -c /dev/null --noconftest -p dahl.pytest_plugin -p no:cacheprovider "$OUT/test_rig.py" \
        --dahl-interface socketcan --dahl-channel can1 --dahl-require --dahl-answer-timeout 60 >"$HERE/pytest.out" 2>&1
    stop node
}

address() { awk -v name="$1" '$3 == name { print "0x" $1 }' /proc/kallsyms; }

force_bus_off() { # of can0, at the next frame
    {
        echo "set \$interrupt = $(address sja1000_interrupt)"
        echo "set \$read_reg = $(address kvaser_pci_read_reg)"
    } >"$OUT/bus_off.part"
    mv "$OUT/bus_off.part" "$OUT/bus_off.request"
    until [ -e "$OUT/bus_off.done" ]; do sleep 0.1; done
    rm "$OUT/bus_off.done"
}

bus_off() { # the kernel restarts the controller after 200 ms
    begin bus_off
    ip link set can0 down
    ip link set can0 type can restart-ms 200
    ip link set can0 up
    start node can0 1000 --log "$HERE/node.log"
    start encoder can1 60000 --seconds 60
    force_bus_off
    sleep 1
    candump -n 5 -T 30000 -L can1,110:7FF >"$HERE/candump.log"
    ip -json -details -statistics link show can0 >"$HERE/can0.json"
    stop encoder
    stop node
}

[ -e /sys/class/net/can0 ] || { echo "no CAN controller here: the kernel has no kvaser_pci (see tools/setup.sh vm)"; exit 77; }

# With two processors, a sender fills the receive buffer (64 bytes) faster than the other processor handles its interrupts.
echo 0 >/sys/devices/system/cpu/cpu1/online
in_lockstep
bus_off
plugin
