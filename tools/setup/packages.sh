# shellcheck shell=bash
# SPDX-License-Identifier: MIT
# Debian packages, for tools/setup.sh.

APT_ANSWERS=yes
MIN_CMAKE=3.22 # as in CMakePresets.json
MISSING=()          # required packages that are not installed
MISSING_OPTIONAL=() # optional packages that are not installed

has_apt() { command -v apt-get >/dev/null && command -v dpkg-query >/dev/null; }

codename() { sed -n 's/^VERSION_CODENAME=//p' /etc/os-release; }

not_installed() {
    local have
    [ $# -gt 0 ] || return 0
    have=$(dpkg-query -W -f '${db:Status-Status} ${Package}\n' "$@" 2>/dev/null | sed -n 's/^installed //p' || true)
    comm -23 <(printf '%s\n' "$@" | sort -u) <(sort <<<"$have")
}

may_be_root() { [ "$(id -u)" = 0 ] || { command -v sudo >/dev/null && { [ -t 0 ] || sudo -n true 2>/dev/null; }; }; }

as_root() { if [ "$(id -u)" = 0 ]; then "$@"; else sudo "$@"; fi; }

apt() {
    as_root env DEBIAN_FRONTEND=noninteractive apt-get -q -y -o Acquire::Retries=3 -o Acquire::http::Timeout=30 \
        -o DPkg::Lock::Timeout=600 -o APT::Keep-Downloaded-Packages=false "$@" >>"$BUILD/setup.log" 2>&1 </dev/null
}

# A failed optional installation is tried again if its list changes, or after a day.
was_tried() { # NAME KEY
    [ -n "$(find "$BUILD/deps/$1.tried" -mmin -1440 2>/dev/null)" ] && [ "$(cat "$BUILD/deps/$1.tried")" = "$2" ]
}

note_tried() { [ "$APT_ANSWERS" = no ] || echo "$2" >"$BUILD/deps/$1.tried"; }

check_packages() {
    local must may
    if ! has_apt; then check_without_apt; return; fi
    add_python_headers
    mapfile -t must < <(words_of MUST)
    mapfile -t may < <(words_of MAY)
    mapfile -t MISSING < <(not_installed "${must[@]}")
    [ "${#MISSING[@]}" -eq 0 ] || may_be_root ||
        die "please install, then run this again: apt-get install --no-install-recommends ${MISSING[*]}"
    mapfile -t MISSING_OPTIONAL < <(not_installed "${may[@]}")
}

# Other distributions have other package names. Therefore check for the programs that the build uses.
check_without_apt() {
    local missing=() tool compiler=${CC:-cc}
    for tool in "${compiler%% *}" cmake ninja python3; do command -v "$tool" >/dev/null || missing+=("$tool"); done
    [ "${#missing[@]}" -eq 0 ] && { say "no apt-get here, but all programs of the build are in place"; return; }
    die "not found: ${missing[*]}; no apt-get here, so please install these. On Debian the packages are: $(words_of MUST | xargs)"
}

# A compiler or a CMake that apt-get does not replace would fail only after minutes, in the build.
check_build_tools() {
    local version
    if [ -n "${CC:-}" ]; then
        # shellcheck disable=SC2086 # CC may have options
        $CC -v >/dev/null 2>&1 || die "CC=$CC does not run: install this C compiler, or unset CC"
    fi
    command -v cmake >/dev/null || return 0
    version=$(cmake --version 2>/dev/null | sed -n '1s/.*version \([0-9][0-9.]*\).*/\1/p') || true
    [ -n "$version" ] || die "$(command -v cmake) does not run: repair it, or remove it from PATH"
    printf '%s\n' "$MIN_CMAKE" "$version" | sort -CV ||
        die "$(command -v cmake) has version $version: please install CMake $MIN_CMAKE or later"
}

needs_apt() { must_have_apt || may_fetch || may_try_optional; }

may_try_optional() { [ "${#MISSING_OPTIONAL[@]}" -gt 0 ] && ! was_tried packages "${MISSING_OPTIONAL[*]}" && may_be_root; }

must_have_apt() { [ "${#MISSING[@]}" -gt 0 ] || must_fetch; }

# Download one small file from Debian's own sources, with apt's transports and proxies.
reach_apt() {
    local uri uris
    mapfile -t uris < <(apt-get update --print-uris 2>>"$BUILD/setup.log" |
        sed -En "s!^'([^']*/dists/$(codename)[^']*InRelease)'.*!\1!p" | head -n 3)
    for uri in "${uris[@]}"; do
        timeout 7 /usr/lib/apt/apt-helper -o Acquire::Retries=0 -o Acquire::http::Timeout=5 -o APT::Sandbox::User=root \
            download-file "$uri" "$BUILD/deps/probe" >>"$BUILD/setup.log" 2>&1 || continue
        rm -f "$BUILD/deps/probe"
        return
    done
    return 1
}

# Write the entries for Debian itself among this machine's package sources into FOLDER, each with this TYPE (deb or deb-src).
# Third-party entries may be broken, and Debian's own entries may lack deb-src.
write_debian_sources() { # TYPE FOLDER
    local name
    name=$(codename)
    mkdir -p "$2"
    cat /etc/apt/sources.list.d/*.sources 2>/dev/null | grep -v '^#' | awk -v RS= -v ORS='\n\n' -v kind="$1" \
        -v suites="[\n]Suites:[^\n]*[ \t]$name(-updates|-security)?[ \t\n]" \
        '("\n" $0 "\n") ~ suites && /Components:[^\n]*[ \t]main/ { sub(/Types:[^\n]*/, "Types: " kind); print }' \
        >"$2/debian.sources" || true
    cat /etc/apt/sources.list /etc/apt/sources.list.d/*.list 2>/dev/null |
        sed -En "s/^deb( +\[[^]]*\])?( +[^ ]+ +$name(-updates|-security)? .*\<main\>.*)/$1\1\2/p" \
            >"$2/debian.list" || true
}

# The same for another suite of Debian on the same mirror.
write_other_sources() { # TYPE FOLDER SUITE
    local name
    name=$(codename)
    write_debian_sources "$1" "$2"
    sed -Ei "/^Suites:/{/[ \t]$name([ \t]|\$)/!s/.*/Enabled: no/;s/^Suites:.*/Suites: $3/}" "$2/debian.sources"
    sed -En -i "s/ $name +/ $3 /p" "$2/debian.list"
}

debian_only() { printf '%s\n' -o Dir::Etc::sourcelist=/dev/null -o "Dir::Etc::sourceparts=$1"; }

# Try the present package lists first. If that fails, repair an interrupted installation and update the lists. If that fails too,
# use Debian's own sources only.
install_packages() {
    local only
    if apt install --no-install-recommends "$@"; then return; fi
    as_root dpkg --configure -a >>"$BUILD/setup.log" 2>&1 </dev/null || true
    say "updating the package lists"
    apt update || say "a package source of this machine does not answer; continuing without it"
    if apt install --no-install-recommends "$@"; then return; fi
    write_debian_sources deb "$BUILD/deps/apt-deb"
    mapfile -t only < <(debian_only "$BUILD/deps/apt-deb")
    say "trying Debian's own package sources only"
    apt "${only[@]}" update && apt "${only[@]}" install --no-install-recommends "$@"
}

must_install() {
    say "installing Debian packages: $*"
    install_packages "$@" || {
        tail -n 15 "$BUILD/setup.log" >&2
        die "apt-get could not install: $* (log: build/setup.log)"
    }
}

install_missing() {
    has_apt || return 0
    if [ "${#MISSING[@]}" -gt 0 ]; then must_install "${MISSING[@]}"; fi
    say "Debian packages: in place"
    if [ "${#MISSING_OPTIONAL[@]}" -gt 0 ]; then install_optional "${MISSING_OPTIONAL[@]}"; fi
}

known_to_apt() {
    local package
    for package in "$@"; do
        if apt-cache show "$package" >/dev/null 2>&1; then echo "$package"; fi
    done
}

install_optional() {
    local known
    if may_try_optional && [ "$APT_ANSWERS" = yes ]; then
        mapfile -t known < <(known_to_apt "$@")
        if [ "${#known[@]}" -lt $# ]; then apt update || true; mapfile -t known < <(known_to_apt "$@"); fi
        say "installing optional packages: ${known[*]:-not known to apt-get}"
        if [ "${#known[@]}" -eq $# ] && install_packages "$@"; then return; fi
        install_packages "${known[@]}" || true
        note_tried packages "$*"
    fi
    mapfile -t known < <(not_installed "$@")
    say "continuing without optional packages; tests that need them will be skipped: ${known[*]}"
}
