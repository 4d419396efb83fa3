#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: tests/socketcan/run.sh DAHL-LOOP RUN_FILE FOLDER
#
# Run dahl-loop on a real vcan0 with can-utils as other clients. Each case leaves its files in FOLDER/CASE, which
# tests/python/can/test_socketcan.py checks. Both interfaces, vcan0 and vcan1, must be up; run as root.
set -u
LOOP=$1
RUN=$2
OUT=$3

run_with() { # TIMEOUT_MS: print the path of a run file with this timeout
    { cat "$RUN"; echo "friction.timeout_ms = $1"; } >"$OUT/timeout_$1.run"
    echo "$OUT/timeout_$1.run"
}

begin() { # CASE
    HERE=$OUT/$1
    mkdir -p "$HERE"
}

loop() { # NAME RUN_FILE OPTION...
    local name=$1
    shift
    "$LOOP" "$@" --bus socketcan:vcan0 --counters "$HERE/$name.counters" >"$HERE/$name.out" 2>"$HERE/$name.err"
    echo $? >"$HERE/$name.code"
}

witness() {
    candump -r 8000000 -L vcan0 >"$HERE/candump.log" &
    WITNESS=$!
    sleep 0.5
}

end_witness() { # when its log has stopped growing
    local before=-1 now
    while now=$(stat -c %s "$HERE/candump.log") && [ "$now" != "$before" ]; do
        before=$now
        sleep 1.5
    done
    kill "$WITNESS"
    wait "$WITNESS" 2>/dev/null
}

node() { # until end_node
    "$LOOP" "$(run_with 60000)" --bus socketcan:vcan0 --role node --counters "$HERE/node.counters" \
        2>"$HERE/node.err" &
    NODE=$!
    sleep 1
}

end_node() {
    kill -INT "$NODE"
    wait "$NODE"
    echo $? >"$HERE/node.code"
}

virtual_time() {
    begin virtual
    witness
    loop both "$RUN" --virtual --seconds 2 --log "$HERE/run.log"
    end_witness
}

two_processes() {
    begin two
    witness
    node
    loop encoder "$RUN" --role encoder --lockstep --seconds 2
    end_node
    end_witness
}

replay() { # canplayer sends the encoder's frames of virtual_time
    begin replay
    witness
    node
    sed -n 's/^(0000/(1000/; / 100#/p' "$OUT/virtual/run.log" >"$HERE/angles.log"
    canplayer -I "$HERE/angles.log" vcan0=vcan0
    sleep 1
    end_node
    end_witness
}

disturb() {
    begin disturb
    ip link show vcan0 | grep -q 'mtu 72' || { ip link set vcan0 down && ip link set vcan0 mtu 72 && ip link set vcan0 up; }
    node
    cansend vcan0 100#0011223344556677
    cansend vcan0 100#00112233
    cansend vcan0 00000100#0011223344556677
    cansend vcan0 100#R8
    cansend vcan0 100##00011223344556677
    cansend vcan0 "100##1$(printf '%0128d' 0)"
    cansend vcan0 7FF#00
    cansend vcan0 20000040#0000000000000000
    sleep 0.5
    end_node
}

noise() { # frames with the encoder's id, and random extended ones, during a run
    begin noise
    witness
    loop both "$(run_with 60000)" --lockstep --seconds 3 --log "$HERE/run.log" &
    local running=$!
    sleep 1
    cangen vcan0 -I 100 -L 8 -D 0011223344556677 -g 2 -n 150
    cangen vcan0 -I 100 -L 7 -g 2 -n 150
    cangen vcan0 -e -g 2 -n 100
    wait "$running"
    end_witness
}

bus_off() { # once during a stream; then four times without an answer in between
    begin off
    loop both "$(run_with 100)" --seconds 3 --log "$HERE/run.log" &
    local running=$!
    sleep 1
    cansend vcan0 20000004#0000000000000000
    cansend vcan0 20000040#0000000000000000
    wait "$running"
    loop latched "$(run_with 1000)" --seconds 5 --log "$HERE/latched.log" &
    running=$!
    sleep 1
    for _ in 1 2 3 4; do cansend vcan0 20000040#0000000000000000; done
    wait "$running"
}

full_queue() { # a queue of 2 kbit/s is too slow for the encoder: ENOBUFS
    begin full
    if tc qdisc add dev vcan0 root tbf rate 2kbit burst 40 limit 64 2>"$HERE/tc.err"; then
        loop both "$RUN" --role encoder --seconds 1
        tc qdisc del dev vcan0 root
    fi
}

going_down() {
    begin down
    loop both "$RUN" --seconds 60 --log "$HERE/run.log" &
    local running=$!
    sleep 2
    ip link set vcan0 down
    wait "$running"
    loop absent "$RUN" --seconds 1
    ip link set vcan0 up
}

for case in virtual_time two_processes replay disturb bus_off noise full_queue going_down; do $case; done
