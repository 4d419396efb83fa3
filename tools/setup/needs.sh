# shellcheck shell=bash disable=SC2034
# SPDX-License-Identifier: MIT
# The contents of each need of tools/setup.sh. Add a Debian package here, a Python package in pyproject.toml.

NEEDS=(demo identify firmware docs release test vm explore checks bench all)

# Other needs that a need includes.
declare -A INCLUDES=(
    [identify]='demo'
    [firmware]='demo'
    [test]='identify'
    [docs]='test explore' # autodoc imports each module, the pytest plugin too
    [release]='docs'
    [vm]='demo'
    [explore]='demo'
    [checks]='test firmware vm release'
    [bench]='identify firmware'
    [all]='checks bench'
)

# Required Debian packages: set-up fails without them.
declare -A MUST=(
    [demo]='libc6-dev cmake ninja-build python3 python3-venv ca-certificates'
    [firmware]='gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm dpkg-dev xz-utils'
    [docs]='doxygen'
    [explore]='clang lld'
    [test]='gcc g++ git pkg-config dpkg-dev xz-utils'
)

# Any C compiler builds the demo. Without one, install gcc.
${CC:-cc} -v >/dev/null 2>&1 || MUST[demo]+=' gcc'

# Optional Debian packages: tests that need a missing one are skipped and say so.
declare -A MAY=(
    [test]='valgrind'
    [release]='binutils-aarch64-linux-gnu libc6-dev-arm64-cross libgcc-12-dev-arm64-cross' # with clang: a wheel for 64-bit Arm
    [docs]='chromium' # measures the pages and takes screenshots
    [vm]='can-utils qemu-system-x86 busybox-static kmod cpio iproute2 gdb'
    # clang of the need explore also builds the big-endian programs, because Debian's s390x gcc conflicts with gcc-multilib.
    [checks]='tcc libclang-rt-14-dev gcc-multilib g++-multilib
        qemu-user-static binutils-s390x-linux-gnu libgcc-12-dev-s390x-cross libc6-dev-s390x-cross
        gcc-riscv64-unknown-elf picolibc-riscv64-unknown-elf picolibc-arm-none-eabi qemu-system-misc gcc-avr avr-libc libsimavr-dev
        libelf-dev arduino-core-avr make
        gcc-mingw-w64-x86-64 wine64
        clang-19 llvm-19 libclang-rt-19-dev clang-tidy-19 cppcheck shellcheck gappa sollya'
    [bench]='gcc-riscv64-unknown-elf picolibc-riscv64-unknown-elf picolibc-arm-none-eabi qemu-system-misc gcc-avr avr-libc
        libsimavr-dev libelf-dev libsleef-dev'
)

# Downloads into build/deps (fetched.sh).
declare -A FETCHED=(
    [firmware]='unity' # the preset of a core configures its tests too
    [test]='unity'
    [vm]='kernel'
    [checks]='cbmc'
)

# Groups of Python packages in pyproject.toml.
declare -A PYTHON_GROUP=([demo]=demo [identify]=identify [docs]=docs [release]=release [test]=test [checks]=checks)

# Python.h makes calls of the C library cheaper (docs/decisions/13-cffi.md). Debian's Python has it in this package.
add_python_headers() { has_python_headers || MAY[demo]=python3-dev; }

declare -A WANTED=() # the needs of this run

is_need() { [[ " ${NEEDS[*]} " == *" $1 "* ]]; }

add_need() {
    local other
    WANTED[$1]=yes
    for other in ${INCLUDES[$1]:-}; do add_need "$other"; done
}

# Print the words of one of the tables above, for the needs of this run, each once.
words_of() { # TABLE
    local -n table=$1
    local need words=()
    for need in "${NEEDS[@]}"; do
        # shellcheck disable=SC2206 # an entry has several words
        [ -z "${WANTED[$need]:-}" ] || words+=(${table[$need]:-})
    done
    [ "${#words[@]}" -eq 0 ] || printf '%s\n' "${words[@]}" | awk '!seen[$0]++'
}
