#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: tools/setup.sh
#
# Gets what the build, the tests and the demo need, and nothing that is already there:
#   1. Debian packages (compilers, CMake, three small parser libraries), with apt-get; as root, else by sudo
#   2. Unity, the test framework, into build/deps/unity: from $DAHL_UNITY_DIR if given, else from Debian's own sources
#   3. where this kernel has no CAN: Debian's kernel, a few files of it, into build/deps/kernel, for tools/vm.sh
#   4. CBMC, for some of the proofs, into build/deps/cbmc: Debian 13's package with the C library that it wants
#   5. a Python environment in build/venv with the pinned packages of tools/requirements.txt and the command `dahl`
# A second run finds all in place and says so within a second or two. Safe to interrupt and to run twice at once.
#
# Environment: DAHL_PYTHON   a Python 3.11 or later to use (default: python3, then /usr/bin/python3)
#              DAHL_UNITY_DIR  a folder with unity.c, unity.h and unity_internals.h
set -euo pipefail
# shellcheck source=tools/common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

PACKAGES=(gcc g++ libc6-dev cmake ninja-build pkg-config python3 python3-venv libinih-dev libcsv-dev libcjson-dev
    git ca-certificates dpkg-dev xz-utils)
# Only some tests need these: another compiler, 32 bits, CAN tools. Without one of them those tests say so and are skipped.
EXTRAS=(clang libclang-rt-14-dev can-utils gcc-multilib g++-multilib valgrind sollya)
# Small cores, emulated (tests/python/test_target*.py, tools/bench.sh, tools/demo.sh --target).
EXTRAS+=(gcc-arm-none-eabi libnewlib-arm-none-eabi picolibc-arm-none-eabi qemu-system-arm
    gcc-riscv64-unknown-elf picolibc-riscv64-unknown-elf qemu-system-misc)
# A virtual machine with CAN (tools/vm.sh), and a browser for the page of `dahl report`.
EXTRAS+=(qemu-system-x86 busybox-static kmod cpio iproute2 chromium)
# Checkers: proofs, certified bounds, coverage, fuzzers, static analysis, a big-endian core (tests/{proof,fuzz,quality,static}).
EXTRAS+=(clang-19 llvm-19 libclang-rt-19-dev clang-tidy-19 cppcheck frama-c-base why3 z3 gappa libmpfr-dev
    qemu-user-static)
# Big-endian programs by clang: Debian's own cross compiler cannot stand beside gcc-multilib.
EXTRAS+=(binutils-s390x-linux-gnu libgcc-12-dev-s390x-cross libc6-dev-s390x-cross)
UNITY_FILES=(unity.c unity.h unity_internals.h)
CBMC_SUITE=trixie # has CBMC 6.6; Debian 12 has none
UNITY_TRIED=2e3a0610268455520a5796345b503d00c34a47fe97ed3750349cbd4b2b1990f3 # sha256 of unity.c 2.5.1

# --- 1. Debian packages -------------------------------------------------------------------------------------------

has_apt() { command -v apt-get >/dev/null && command -v dpkg-query >/dev/null; }

not_installed() {
    local have
    have=$(dpkg-query -W -f '${db:Status-Status} ${Package}\n' "$@" 2>/dev/null | sed -n 's/^installed //p' || true)
    comm -23 <(printf '%s\n' "$@" | sort) <(sort <<<"$have")
}

known_to_apt() {
    local package
    for package in "$@"; do
        if apt-cache show "$package" >/dev/null 2>&1; then echo "$package"; fi
    done
}

may_be_root() { [ "$(id -u)" = 0 ] || { command -v sudo >/dev/null && { [ -t 0 ] || sudo -n true 2>/dev/null; }; }; }

as_root() { if [ "$(id -u)" = 0 ]; then "$@"; else sudo "$@"; fi; }

apt() {
    as_root env DEBIAN_FRONTEND=noninteractive apt-get -q -y -o Acquire::Retries=5 -o Acquire::http::Timeout=60 \
        -o DPkg::Lock::Timeout=600 "$@" >>"$BUILD/setup.log" 2>&1 </dev/null
}

# Debian's own entries of this machine's package sources, each made one of type $1 (deb or deb-src), into folder $2.
# Other entries may be broken, and Debian's may be lacking sources: so the few calls below use these alone.
write_debian_sources() {
    local codename
    codename=$(. /etc/os-release && echo "${VERSION_CODENAME:-}")
    mkdir -p "$2"
    cat /etc/apt/sources.list.d/*.sources 2>/dev/null | grep -v '^#' | awk -v RS= -v ORS='\n\n' -v kind="$1" \
        -v suites="[\n]Suites:[^\n]*[ \t]$codename(-updates|-security)?[ \t\n]" \
        '("\n" $0 "\n") ~ suites && /Components:[^\n]*[ \t]main/ { sub(/Types:[^\n]*/, "Types: " kind); print }' \
        >"$2/debian.sources" || true
    cat /etc/apt/sources.list /etc/apt/sources.list.d/*.list 2>/dev/null |
        sed -En "s/^deb( +\[[^]]*\])?( +[^ ]+ +$codename(-updates|-security)? .*\<main\>.*)/$1\1\2/p" \
            >"$2/debian.list" || true
}

# The same of another suite of Debian ($3), where the machine's own mirror has it.
write_other_sources() {
    local codename
    write_debian_sources "$1" "$2"
    codename=$(. /etc/os-release && echo "${VERSION_CODENAME:-}")
    sed -Ei "/^Suites:/{/[ \t]$codename([ \t]|\$)/!s/.*/Enabled: no/;s/^Suites:.*/Suites: $3/}" "$2/debian.sources"
    sed -Ein "s/ $codename +/ $3 /p" "$2/debian.list"
}

debian_only() { printf '%s\n' -o Dir::Etc::sourcelist=/dev/null -o "Dir::Etc::sourceparts=$1"; }

# From what apt knows now; else with fresh lists; else with Debian's own sources alone.
install_packages() {
    local only
    if apt install --no-install-recommends "$@"; then return; fi
    say "asking for fresh package lists"
    apt update || say "some package source of this machine does not answer; going on without it"
    if apt install --no-install-recommends "$@"; then return; fi
    write_debian_sources deb "$BUILD/deps/apt-deb"
    mapfile -t only < <(debian_only "$BUILD/deps/apt-deb")
    say "trying with Debian's own package sources alone"
    apt "${only[@]}" update && apt "${only[@]}" install --no-install-recommends "$@"
}

setup_packages() {
    local missing extras
    mapfile -t missing < <(not_installed "${PACKAGES[@]}")
    if [ "${#missing[@]}" -gt 0 ]; then
        may_be_root || die "please install, then run this again: apt-get install ${missing[*]}"
        say "installing Debian packages: ${missing[*]}"
        install_packages "${missing[@]}" || {
            tail -n 15 "$BUILD/setup.log" >&2
            die "apt-get could not install: ${missing[*]} (log: build/setup.log)"
        }
    fi
    say "Debian packages: in place"
    mapfile -t extras < <(not_installed "${EXTRAS[@]}")
    if [ "${#extras[@]}" -gt 0 ]; then setup_extras "${extras[@]}"; fi
}

# Tried once for each list of what is missing: what this machine cannot have must not slow down every later run.
setup_extras() {
    local tried=$BUILD/deps/extras.tried known
    if [ "$(cat "$tried" 2>/dev/null)" != "$*" ] && may_be_root; then
        mapfile -t known < <(known_to_apt "$@")
        if [ "${#known[@]}" -lt $# ]; then apt update || true; mapfile -t known < <(known_to_apt "$@"); fi
        say "installing packages that only some tests need: ${known[*]:-none of them is known here}"
        if [ "${#known[@]}" -eq $# ] && install_packages "$@"; then return; fi
        install_packages "${known[@]}" || true
        echo "$*" >"$tried"
    fi
    say "not all here, so the tests that need them will be skipped: $*"
}

# On another distribution the names differ and are the user's to map; what counts is what the build will look for.
check_without_apt() {
    local missing=() tool module
    for tool in cc c++ cmake ninja pkg-config git python3; do command -v "$tool" >/dev/null || missing+=("$tool"); done
    for module in inih libcjson; do pkg-config --exists "$module" 2>/dev/null || missing+=("$module (library)"); done
    echo '#include <csv.h>' | cc -E - >/dev/null 2>&1 || missing+=("csv.h (libcsv)")
    [ "${#missing[@]}" -eq 0 ] && { say "no apt-get here, and all that the build needs is in place"; return; }
    printf 'not found: %s\n' "${missing[@]}" >&2
    die "this is no Debian: please install the packages that hold these. On Debian they are: ${PACKAGES[*]}"
}

# --- 2. Unity -----------------------------------------------------------------------------------------------------

unity_in_place() {
    local file
    for file in "${UNITY_FILES[@]}"; do [ -s "$BUILD/deps/unity/$file" ] || return 1; done
}

keep_unity() { # FOLDER: the files go to their place as a whole or not at all
    local part=$BUILD/deps/unity.part
    rm -rf "$part"
    mkdir -p "$part"
    (cd "$1" && cp -- "${UNITY_FILES[@]}" "$part/") || die "$1 lacks one of: ${UNITY_FILES[*]}"
    rm -rf "$BUILD/deps/unity"
    mv "$part" "$BUILD/deps/unity"
}

# Debian's source package ntpsec carries Unity 2.5.1. apt checks its signature; all state is kept under build/deps.
unity_from_debian() {
    local work=$BUILD/deps/ntpsec options
    rm -rf "$work"
    mkdir -p "$work"/{lists/partial,cache/archives/partial,files}
    write_debian_sources deb-src "$work/parts"
    mapfile -t options < <(debian_only "$work/parts")
    options+=(-o "Dir::State::lists=$work/lists" -o "Dir::Cache=$work/cache" -o APT::Sandbox::User=
        -o Acquire::Retries=5 -o Acquire::http::Timeout=60 -o Acquire::Languages=none)
    (cd "$work/files" && quietly setup apt-get -q "${options[@]}" update &&
        quietly setup apt-get -q "${options[@]}" source --download-only --tar-only ntpsec &&
        tar -xf ntpsec_*.orig.tar.* --wildcards --strip-components=3 '*/tests/unity/unity*') || return 1
    keep_unity "$work/files"
    rm -rf "$work"
}

check_unity() {
    local sum
    sum=$(sha256sum "$BUILD/deps/unity/unity.c")
    [ "${sum%% *}" = "$UNITY_TRIED" ] || say "note: this Unity is not the 2.5.1 that was tried; all the same"
}

setup_unity() {
    if [ -n "${DAHL_UNITY_DIR:-}" ]; then
        keep_unity "$(cd "$DAHL_UNITY_DIR" && pwd)"
    elif ! unity_in_place; then
        say "fetching Unity (a test framework in C) out of Debian's source package ntpsec"
        has_apt && unity_from_debian || {
            say "could not; CMake will look for it elsewhere (set DAHL_UNITY_DIR to a folder that has unity.c)"
            return 0
        }
    fi
    check_unity
    say "Unity: in place (build/deps/unity)"
}

# --- 3. A kernel with CAN -----------------------------------------------------------------------------------------

KERNEL_PARTS=(net/can net/9p net/sched/sch_tbf fs/9p fs/netfs fs/fscache drivers/virtio drivers/net/can/vcan
    drivers/net/can/dev)

kernel_has_can() {
    python3 -c 'import socket; socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)' 2>/dev/null
}

unpack_kernel() { # PACKAGE FOLDER
    local part parts=('./boot/vmlinuz-*' './lib/modules/*/modules.*')
    for part in "${KERNEL_PARTS[@]}"; do parts+=("./lib/modules/*/kernel/$part*"); done
    dpkg-deb --fsys-tarfile "$1" | tar -x -C "$2" --wildcards "${parts[@]}" || return 1
    mv "$2"/boot/vmlinuz-* "$2/vmlinuz" && /usr/sbin/depmod -b "$2" "$(ls "$2/lib/modules")"
}

fetch_kernel() {
    local package work=$BUILD/deps/kernel.part
    rm -rf "$work"
    mkdir -p "$work"
    package=$(apt-cache depends linux-image-amd64 2>/dev/null | sed -n 's/^ *Depends: \(linux-image-[0-9].*\)/\1/p')
    [ -n "$package" ] && (cd "$work" && quietly setup apt-get -q download "$package" &&
        quietly setup unpack_kernel ./*.deb "$work" && rm -f ./*.deb) || return 1
    rm -rf "$BUILD/deps/kernel"
    mv "$work" "$BUILD/deps/kernel"
}

setup_kernel() {
    if kernel_has_can || [ "$(uname -m)" != x86_64 ]; then return; fi
    if [ ! -s "$BUILD/deps/kernel/vmlinuz" ]; then
        say "fetching Debian's kernel, for a virtual machine with CAN: this kernel has none"
        fetch_kernel || { say "could not; tests on a real vcan will be skipped"; return; }
    fi
    say "kernel with CAN: in place (build/deps/kernel)"
}

# --- 4. CBMC ------------------------------------------------------------------------------------------------------

# Another Debian's program runs here on its own C library, which nothing else gets to see.
make_cbmc_commands() { # FOLDER
    local name
    mkdir "$1/bin"
    cat >"$1/bin/cbmc" <<'EOF'
#!/bin/sh
top=$(cd "$(dirname "$0")/../usr" && pwd)
for loader in "$top"/lib/*/ld-linux*.so.*; do
    exec "$loader" --library-path "$(dirname "$loader"):$top/lib" "$top/bin/$(basename "$0")" "$@"
done
EOF
    chmod +x "$1/bin/cbmc"
    for name in goto-cc goto-instrument; do ln -s cbmc "$1/bin/$name"; done
    "$1/bin/cbmc" --version
}

fetch_cbmc() {
    local work=$BUILD/deps/cbmc.part options package
    rm -rf "$work"
    mkdir -p "$work"/apt/{lists/partial,cache/archives/partial,files}
    write_other_sources deb "$work/apt/parts" "$CBMC_SUITE"
    mapfile -t options < <(debian_only "$work/apt/parts")
    options+=(-o "Dir::State::lists=$work/apt/lists" -o "Dir::Cache=$work/apt/cache" -o APT::Sandbox::User=
        -o Acquire::Retries=2 -o Acquire::http::Timeout=60 -o Acquire::Languages=none)
    quietly setup apt-get -q "${options[@]}" update || return 1
    (cd "$work/apt/files" &&
        quietly setup apt-get -q "${options[@]}" download cbmc minisat libc6 libgcc-s1 libstdc++6) || return 1
    for package in "$work"/apt/files/*.deb; do dpkg-deb -x "$package" "$work" || return 1; done
    rm -rf "$work"/{apt,etc,usr/share,usr/lib/*/gconv}
    quietly setup make_cbmc_commands "$work" || return 1
    rm -rf "$BUILD/deps/cbmc"
    mv "$work" "$BUILD/deps/cbmc"
}

# Tried once: what this machine cannot have must not slow down every later run.
setup_cbmc() {
    local tried=$BUILD/deps/cbmc.tried
    if command -v cbmc >/dev/null || [ -x "$BUILD/deps/cbmc/bin/cbmc" ]; then say "CBMC: in place"; return; fi
    if [ ! -e "$tried" ]; then
        say "fetching CBMC (a model checker for C) out of Debian's $CBMC_SUITE"
        if fetch_cbmc; then say "CBMC: in place (build/deps/cbmc)"; return; fi
        touch "$tried"
    fi
    say "CBMC is not to be had here, so its proofs will be skipped (remove build/deps/cbmc.tried to try again)"
}

# --- 5. Python ----------------------------------------------------------------------------------------------------

good_python() {
    "$1" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1
}

find_python() {
    local python
    for python in ${DAHL_PYTHON:+"$DAHL_PYTHON"} python3 /usr/bin/python3; do
        if good_python "$python"; then echo "$python"; return; fi
    done
    die "no Python 3.11 or later with venv (tried: ${DAHL_PYTHON:-} python3 /usr/bin/python3); set DAHL_PYTHON"
}

# What the environment depends on: pins, package metadata, interpreter, and where it lies (its scripts name their path).
venv_key() {
    {
        cat "$ROOT"/tools/{requirements,constraints}.txt
        sed '/^\[tool/,$d' "$ROOT/tools/pyproject.toml"
        echo "$VENV"
        "$1" -VV
    } | sha256sum
}

pip_install() {
    local try
    for try in 1 2 3; do
        quietly setup "$VENV/bin/python" -m pip --disable-pip-version-check install --quiet --progress-bar off \
            --retries 10 --timeout 60 "$@" && return
        say "pip did not get through (try $try of 3)"
        sleep $((try * 3))
    done
    die "pip could not install the Python packages (log: build/setup.log)"
}

# The stamp is written last: an environment without it was left half done and is made anew.
make_venv() {
    say "making the Python environment build/venv (pinned in tools/requirements.txt)"
    rm -rf "$VENV"
    quietly setup "$1" -m venv "$VENV" || die "$1 could not make a virtual environment (log: build/setup.log)"
    pip_install -r "$ROOT/tools/requirements.txt" -c "$ROOT/tools/constraints.txt"
    pip_install --no-deps --no-build-isolation -e "$ROOT/tools"
    echo "$2" >"$VENV/.complete"
}

setup_venv() {
    local python key
    python=$(find_python)
    key=$(venv_key "$python")
    if [ "$(cat "$VENV/.complete" 2>/dev/null)" != "$key" ]; then make_venv "$python" "$key"; fi
    say "Python environment: in place (build/venv)"
}

# ------------------------------------------------------------------------------------------------------------------

main() {
    case "${1:-}" in
        '') ;;
        -h | --help) usage; exit 0 ;;
        *) die "setup.sh takes no argument '$1' (see --help)" ;;
    esac
    one_at_a_time setup
    mkdir -p "$BUILD/deps"
    : >"$BUILD/setup.log"
    if has_apt; then setup_packages; else check_without_apt; fi
    setup_unity
    if has_apt; then setup_kernel; setup_cbmc; fi
    setup_venv
    say "done in $SECONDS s"
}

main "$@"
