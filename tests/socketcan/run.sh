#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: tests/socketcan/run.sh DAHL-LOOP SCENE FOLDER
#
# dahl-loop on a real vcan0 (vcan1), with can-utils as foreign clients. Runs each case, leaves its files in FOLDER/CASE
# and judges nothing: tests/python/can/test_socketcan.py does. Needs both interfaces up, and to be root.
set -u
LOOP=$1
SCENE=$2
OUT=$3
PATIENT=(--set friction.timeout_ms=60000)

begin() { # CASE: a folder for it
    HERE=$OUT/$1
    mkdir -p "$HERE"
}

loop() { # NAME OPTION...
    local name=$1
    shift
    "$LOOP" --scene "$SCENE" --bus socketcan:vcan0 --summary "$HERE/$name.json" "$@" >"$HERE/$name.out" 2>"$HERE/$name.err"
    echo $? >"$HERE/$name.code"
}

witness() {
    candump -r 8000000 -L vcan0 >"$HERE/candump.log" &
    WITNESS=$!
    sleep 0.5
}

end_witness() { # once it has written nothing for a while
    local before=-1 now
    while now=$(stat -c %s "$HERE/candump.log") && [ "$now" != "$before" ]; do
        before=$now
        sleep 1.5
    done
    kill "$WITNESS"
    wait "$WITNESS" 2>/dev/null
}

node() { # a node that stays until end_node
    "$LOOP" --scene "$SCENE" --bus socketcan:vcan0 --role node "${PATIENT[@]}" --summary "$HERE/node.json" \
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
    loop both --virtual --seconds 2 --log "$HERE/run.log"
    end_witness
}

two_processes() {
    begin two
    witness
    node
    loop encoder --role encoder --lockstep --seconds 2
    end_node
    end_witness
}

replay() { # the encoder's frames of virtual time, sent by canplayer
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

noise() { # frames on the encoder's own id, and random extended ones, beside a running loop
    begin noise
    witness
    loop both --lockstep --seconds 3 "${PATIENT[@]}" --log "$HERE/run.log" &
    local running=$!
    sleep 1
    cangen vcan0 -I 100 -L 8 -D 0011223344556677 -g 2 -n 150
    cangen vcan0 -I 100 -L 7 -g 2 -n 150
    cangen vcan0 -e -g 2 -n 100
    wait "$running"
    end_witness
}

bus_off() { # the controller says so, in the middle of a stream; then four times without an answer in between
    begin off
    loop both --seconds 3 --log "$HERE/run.log" --set friction.timeout_ms=100 &
    local running=$!
    sleep 1
    cansend vcan0 20000004#0000000000000000
    cansend vcan0 20000040#0000000000000000
    wait "$running"
    loop latched --seconds 5 --set friction.timeout_ms=1000 --log "$HERE/latched.log" &
    running=$!
    sleep 1
    for _ in 1 2 3 4; do cansend vcan0 20000040#0000000000000000; done
    wait "$running"
}

full_queue() { # a queue that lets 2 kbit/s through, behind an encoder that wants more: ENOBUFS
    begin full
    if tc qdisc add dev vcan0 root tbf rate 2kbit burst 40 limit 64 2>"$HERE/tc.err"; then
        loop both --role encoder --seconds 1
        tc qdisc del dev vcan0 root
    fi
}

going_down() {
    begin down
    loop both --seconds 60 --log "$HERE/run.log" &
    local running=$!
    sleep 2
    ip link set vcan0 down
    wait "$running"
    loop absent --seconds 1
    ip link set vcan0 up
}

for case in virtual_time two_processes replay disturb bus_off noise full_queue going_down; do $case; done
