#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: tools/vm.sh FOLDER COMMAND [ARGUMENT...]
#
# Runs a command in QEMU on a Linux kernel with CAN, if the kernel of this machine has no CAN. The command finds vcan0 and vcan1,
# two SJA1000 controllers on one bus of 1 Mbit/s (can0, can1), the files of this machine (read-only), and FOLDER (an absolute path)
# for its output. The script prints that output and exits with the code of the command. If no virtual machine can run, it prints
# the reason and exits with 77. `tools/setup.sh vm` installs it. FOLDER/.vm/gdb is a socket for gdb (target remote).
# Examples: tools/vm.sh /tmp/out sh -c 'cangen -n 3 vcan0 & candump -n 3 vcan0 >/tmp/out/log'
#           tools/vm.sh /tmp/out sh -c 'candump -n 1 can1 & sleep 1; cansend can0 100#0011'
#
# Environment: DAHL_VM_SECONDS  time limit in s (default: 240)
set -euo pipefail
# shellcheck source=tools/common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

PATH=$PATH:/usr/sbin # ip and modprobe, for users other than root
KERNEL=$BUILD/deps/kernel
MODULES=(virtio_pci 9pnet_virtio 9p can-raw vcan can-gw sch_tbf kvaser_pci)

absent() { say "no virtual machine here: $*"; exit 77; }

check() {
    local tool
    for tool in qemu-system-x86_64 busybox cpio ip modprobe; do
        command -v "$tool" >/dev/null || absent "$tool is not installed (tools/setup.sh vm installs it)"
    done
    [ -s "$KERNEL/vmlinuz" ] || absent "no kernel in build/deps/kernel (tools/setup.sh vm fetches it)"
}

# Print the modules above and their dependencies, in the order of loading.
module_files() {
    local name version
    version=$(ls "$KERNEL/lib/modules")
    for name in "${MODULES[@]}"; do
        modprobe -d "$KERNEL" -S "$version" --show-depends "$name" | sed -n 's/^insmod \([^ ]*\).*/\1/p'
    done | awk '!seen[$0]++'
}

write_init() { # FOLDER: first program of the virtual machine
    cat >"$1/init" <<'INIT'
#!/bin/busybox sh
b=/bin/busybox
$b mount -t proc proc /proc
$b mount -t devtmpfs dev /dev
for module in $($b cat /modules); do $b insmod "/lib/$module" || echo "vm: $module did not load"; done
$b mount -t 9p -o trans=virtio,version=9p2000.L,ro,msize=262144,cache=loose root /root || echo "vm: no root"
$b mount -o bind /root /host
for place in proc sys dev tmp run; do $b mount -o bind /$place /root/$place 2>/dev/null; done
$b mount -t sysfs sys /root/sys
$b mount -t tmpfs tmp /root/tmp
work=$($b cat /where) project=$($b cat /project)
$b mkdir -p "/root$project"
$b mount -o bind "/host$project" "/root$project" # also visible if the project is under /tmp
$b mkdir -p "/root$work"
$b mount -t 9p -o trans=virtio,version=9p2000.L,msize=262144 work "/root$work" || echo "vm: no work"
$b chroot /root /bin/bash "$work/.vm/command" >"/root$work/.vm/output" 2>&1
echo $? >"/root$work/.vm/code"
$b sync
$b poweroff -f
INIT
    chmod +x "$1/init"
}

make_initramfs() { # FOLDER
    local root=$1/.vm/root file
    mkdir -p "$root"/{bin,lib,proc,sys,dev,tmp,run,root,host}
    cp "$(command -v busybox)" "$root/bin/busybox"
    echo "$1" >"$root/where"
    echo "$ROOT" >"$root/project"
    for file in $(module_files); do
        cp "$file" "$root/lib/"
        basename "$file"
    done >"$root/modules"
    write_init "$root"
    (cd "$root" && find . | cpio --quiet -o -H newc) >"$1/.vm/initramfs"
    rm -rf "$root"
}

write_command() { # FOLDER COMMAND...
    local folder=$1
    shift
    {
        echo 'export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/tmp'
        # shellcheck disable=SC2016 # expanded by the shell in the virtual machine
        echo 'for bus in vcan0 vcan1; do ip link add dev $bus type vcan && ip link set $bus up; done'
        # shellcheck disable=SC2016
        echo 'for bus in $(ls /sys/class/net | grep ^can); do ip link set $bus up type can bitrate 1000000; done'
        printf 'cd %q\n' "$folder"
        printf '%q ' "$@"
        echo
    } >"$folder/.vm/command"
}

# no_timer_check: on a busy machine the kernel would take its timer for broken, and panic.
boot() { # FOLDER
    cd "$1/.vm" # a path of a socket is limited to 107 characters
    timeout "${DAHL_VM_SECONDS:-240}" qemu-system-x86_64 -accel tcg -cpu max -m 512 -smp 2 -no-reboot -display none \
        -monitor none -serial "file:$1/.vm/console" -kernel "$KERNEL/vmlinuz" -initrd "$1/.vm/initramfs" \
        -append "console=ttyS0 quiet panic=-1 mitigations=off no_timer_check" -gdb unix:gdb,server=on,wait=off \
        -object can-bus,id=bus -device kvaser_pci,canbus=bus -device kvaser_pci,canbus=bus \
        -virtfs local,path=/,mount_tag=root,security_model=none,readonly=on,multidevs=remap \
        -virtfs "local,path=${1//,/,,},mount_tag=work,security_model=none,multidevs=remap" </dev/null >"$1/.vm/qemu" 2>&1
}

main() {
    case "${1:-}" in -h | --help) usage; exit 0 ;; esac
    if [ $# -lt 2 ] || [ "${1:0:1}" != / ]; then die "vm.sh needs an absolute folder and a command (see --help)"; fi
    local folder=$1
    shift
    check
    rm -rf "$folder/.vm"
    mkdir -p "$folder/.vm"
    make_initramfs "$folder"
    write_command "$folder" "$@"
    boot "$folder" || say "QEMU ended with code $?"
    cat "$folder/.vm/output" 2>/dev/null || true
    [ -s "$folder/.vm/code" ] || {
        tail -n 5 "$folder/.vm/console" "$folder/.vm/qemu" >&2 || true # QEMU may have ended before it wrote a console
        die "the virtual machine did not run"
    }
    return "$(cat "$folder/.vm/code")"
}

main "$@"
