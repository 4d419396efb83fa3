# shellcheck shell=bash
# SPDX-License-Identifier: MIT
# Downloads of tools/setup.sh into build/deps: Unity, a kernel with CAN, CBMC. A download is moved to its place when complete.

TO_FETCH=()

# SHA-256 of the files of Unity 2.5.1.
UNITY_SUMS='2e3a0610268455520a5796345b503d00c34a47fe97ed3750349cbd4b2b1990f3  unity.c
681ac98a63ac11effb11e59d580f6ca82abca1bd34069465c38e3b15344256c0  unity.h
adfd612c217e59468c5ebe978640e77e5f539e820ffc0c195a98c5a36f0ac868  unity_internals.h'
KERNEL_PARTS=(net/can net/9p net/sched/sch_tbf fs/9p fs/netfs fs/fscache drivers/virtio drivers/net/can/vcan
    drivers/net/can/dev drivers/net/can/sja1000)
CBMC_SUITE=trixie # has CBMC 6.6; Debian 12 has no CBMC

check_fetched() {
    local name
    for name in $(words_of FETCHED); do "${name}_is_here" || TO_FETCH+=("$name"); done
    if [ -n "${DAHL_UNITY_DIR:-}" ]; then check_given_unity; fi
}

may_fetch() {
    local name
    for name in "${TO_FETCH[@]}"; do was_tried "$name" any || return 0; done
    return 1
}

must_fetch() { [[ " ${TO_FETCH[*]} " == *" unity "* ]]; }

fetch_missing() {
    local name
    for name in $(words_of FETCHED); do
        if [[ " ${TO_FETCH[*]} " == *" $name "* ]]; then "get_$name"; else say "$name: in place"; fi
    done
}

# Run apt-get with its lists and files in FOLDER and with the sources of FOLDER/parts only.
private_apt() { # FOLDER WORD...
    local work=$1 options
    shift
    mkdir -p "$work"/{lists/partial,cache/archives/partial}
    mapfile -t options < <(debian_only "$work/parts")
    quietly setup apt-get -q "${options[@]}" -o "Dir::State::lists=$work/lists" -o "Dir::Cache=$work/cache" \
        -o APT::Sandbox::User= -o Acquire::Retries=3 -o Acquire::http::Timeout=30 -o Acquire::Languages=none "$@"
}

# --- Unity: a test framework in C ---------------------------------------------------------------------------------

check_given_unity() {
    local file
    for file in unity.c unity.h unity_internals.h; do
        [ -s "$DAHL_UNITY_DIR/$file" ] || die "DAHL_UNITY_DIR: $DAHL_UNITY_DIR has no $file"
    done
}

unity_sums_hold() { (cd "$1" 2>/dev/null && sha256sum --check --status <<<"$UNITY_SUMS" 2>/dev/null); }

unity_is_here() { [ -n "${DAHL_UNITY_DIR:-}" ] || unity_sums_hold "$BUILD/deps/unity"; }

# Debian's source package ntpsec contains Unity 2.5.1; apt checks its signature.
fetch_unity() { # FOLDER
    write_debian_sources deb-src "$1/parts"
    private_apt "$1" update || return 1
    (cd "$1" && private_apt "$1" source --download-only --tar-only ntpsec &&
        tar -xf ntpsec_*.orig.tar.* --wildcards --strip-components=3 '*/tests/unity/unity*')
}

get_unity() {
    local part=$BUILD/deps/unity.part
    rm -rf "$part"
    mkdir -p "$part/unity"
    say "fetching Unity (a test framework in C) from Debian's source package ntpsec"
    fetch_unity "$part" || die "could not fetch Unity (log: build/setup.log); get unity.c, unity.h and
       unity_internals.h from the project ThrowTheSwitch/Unity and set DAHL_UNITY_DIR to their folder"
    mv "$part"/unity*.[ch] "$part/unity"
    unity_sums_hold "$part/unity" || {
        (cd "$part/unity" && sha256sum ./*) >&2
        die "these files do not have the sums of Unity 2.5.1 in tools/setup/fetched.sh: not used"
    }
    rm -rf "$BUILD/deps/unity"
    mv "$part/unity" "$BUILD/deps/unity"
    rm -rf "$part"
    say "unity: in place (build/deps/unity)"
}

# --- A kernel with CAN --------------------------------------------------------------------------------------------

kernel_is_here() {
    local driver="$BUILD/deps/kernel/lib/modules/*/kernel/drivers/net/can/sja1000/kvaser_pci.ko"
    compgen -G "$driver" >/dev/null || [ "$(uname -m)" != x86_64 ] || ! has_apt ||
        python3 -c 'import socket; socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)' 2>/dev/null
}

unpack_kernel() { # PACKAGE FOLDER
    local part parts=('./boot/vmlinuz-*' './lib/modules/*/modules.*')
    for part in "${KERNEL_PARTS[@]}"; do parts+=("./lib/modules/*/kernel/$part*"); done
    dpkg-deb --fsys-tarfile "$1" | tar -x -C "$2" --wildcards "${parts[@]}" || return 1
    mv "$2"/boot/vmlinuz-* "$2/vmlinuz" && PATH=$PATH:/usr/sbin depmod -b "$2" "$(ls "$2/lib/modules")"
}

fetch_kernel() { # FOLDER
    local package
    package=$(apt-cache depends linux-image-amd64 2>/dev/null | sed -n 's/^ *Depends: \(linux-image-[0-9].*\)/\1/p')
    [ -n "$package" ] && (cd "$1" && quietly setup apt-get -q download "$package" &&
        quietly setup unpack_kernel ./*.deb "$1" && rm -f ./*.deb)
}

get_kernel() { get_optional kernel "Debian's kernel, for a virtual machine with CAN: this kernel has none"; }

# --- CBMC ---------------------------------------------------------------------------------------------------------

cbmc_is_here() {
    command -v cbmc >/dev/null || ! has_apt || "$BUILD/deps/cbmc/bin/cbmc" --version >>"$BUILD/setup.log" 2>&1
}

# A program of another Debian must run with the C library of that Debian; only these commands use it.
make_cbmc_commands() { # FOLDER
    local name
    mkdir "$1/bin"
    cat >"$1/bin/cbmc" <<'EOF'
#!/bin/sh
top=$(CDPATH='' cd -- "$(dirname "$0")/../usr" && pwd)
for loader in "$top"/lib/*/ld-linux*.so.*; do
    exec "$loader" --library-path "$(dirname "$loader"):$top/lib" "$top/bin/$(basename "$0")" "$@"
done
EOF
    chmod +x "$1/bin/cbmc"
    for name in goto-cc goto-instrument; do ln -s cbmc "$1/bin/$name"; done
    "$1/bin/cbmc" --version
}

fetch_cbmc() { # FOLDER
    local work=$1/apt package
    write_other_sources deb "$work/parts" "$CBMC_SUITE"
    private_apt "$work" update || return 1
    (cd "$work" && private_apt "$work" download cbmc minisat libc6 libgcc-s1 libstdc++6) || return 1
    for package in "$work"/*.deb; do dpkg-deb -x "$package" "$1" || return 1; done
    rm -rf "${1:?}"/{apt,etc,usr/share,usr/lib/*/gconv}
    quietly setup make_cbmc_commands "$1"
}

get_cbmc() { get_optional cbmc "CBMC (a model checker for C) from Debian's $CBMC_SUITE"; }

# ------------------------------------------------------------------------------------------------------------------

get_optional() { # NAME WHAT
    local part=$BUILD/deps/$1.part
    if ! was_tried "$1" any && [ "$APT_ANSWERS" = yes ]; then
        say "fetching $2"
        rm -rf "$part"
        mkdir -p "$part"
        if "fetch_$1" "$part"; then
            rm -rf "$BUILD/deps/$1"
            mv "$part" "$BUILD/deps/$1"
            say "$1: in place (build/deps/$1)"
            return
        fi
        note_tried "$1" any
    fi
    say "$1 cannot be fetched here, so the tests that need it will be skipped"
}
