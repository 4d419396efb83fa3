# shellcheck shell=bash disable=SC2034
# SPDX-License-Identifier: MIT
# What each need is made of. To add a package, add it here; a Python package goes into tools/requirements/NEED.txt.

NEEDS=(demo identify firmware test vm checks bench all)

# Needs that one brings along.
declare -A BRINGS=(
    [identify]='demo'
    [firmware]='demo'
    [test]='identify'
    [vm]='demo'
    [checks]='test firmware vm'
    [bench]='identify firmware'
    [all]='checks bench'
)

# Debian packages without which it fails.
declare -A MUST=(
    [demo]='libc6-dev cmake ninja-build libinih-dev libcsv-dev libcjson-dev python3 python3-venv'
    [identify]='gcc' # tcc, see below, makes the batches slow
    [firmware]='gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm dpkg-dev xz-utils'
    [test]='gcc g++ git ca-certificates pkg-config dpkg-dev xz-utils'
)

# The demo builds with any C compiler. Where there is none it gets tcc: 1 MB, and gcc is 190.
${CC:-cc} -v >/dev/null 2>&1 || case "$(uname -m)" in
    x86_64) MUST[demo]+=' tcc' ;;
    *) MUST[demo]+=' gcc' ;;
esac

# Debian packages without which it does less, and says so.
declare -A MAY=(
    [test]='valgrind'
    [vm]='can-utils qemu-system-x86 busybox-static kmod cpio iproute2'
    # Other compilers, 32 bits, big-endian programs by clang (Debian's own cross compiler cannot stand beside gcc-multilib).
    [checks]='tcc clang libclang-rt-14-dev gcc-multilib g++-multilib
        qemu-user-static binutils-s390x-linux-gnu libgcc-12-dev-s390x-cross libc6-dev-s390x-cross
        gcc-riscv64-unknown-elf picolibc-riscv64-unknown-elf picolibc-arm-none-eabi qemu-system-misc gcc-avr avr-libc arduino-core-avr make
        clang-19 llvm-19 libclang-rt-19-dev clang-tidy-19 cppcheck shellcheck frama-c-base gappa sollya
        chromium'
    [bench]='gcc-riscv64-unknown-elf picolibc-riscv64-unknown-elf picolibc-arm-none-eabi qemu-system-misc'
)

# Things that are fetched into build/deps.
declare -A FETCHED=(
    [firmware]='unity' # a core's preset configures its tests too
    [test]='unity'
    [vm]='kernel'
    [checks]='cbmc'
)

# Python packages: tools/requirements/NAME.lock. Each lock stands on those before it.
declare -A LOCK=([demo]=demo [identify]=identify [test]=test [checks]=checks)

declare -A WANTED=() # the needs of this run

is_need() { [[ " ${NEEDS[*]} " == *" $1 "* ]]; }

add_need() {
    local more
    WANTED[$1]=yes
    for more in ${BRINGS[$1]:-}; do add_need "$more"; done
}

# The words of one of the tables above, for the needs of this run.
words_of() { # TABLE
    local -n table=$1
    local need words=()
    for need in "${NEEDS[@]}"; do
        # shellcheck disable=SC2206 # several words in one entry
        [ -z "${WANTED[$need]:-}" ] || words+=(${table[$need]:-})
    done
    [ "${#words[@]}" -eq 0 ] || printf '%s\n' "${words[@]}"
}
