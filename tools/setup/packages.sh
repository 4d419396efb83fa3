# shellcheck shell=bash
# SPDX-License-Identifier: MIT
# Debian packages, for tools/setup.sh.

APT_ANSWERS=yes
MISSING=() # packages that must be installed
LATER=()   # and may be

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

# What this machine could not have is tried again when the list of it changes, or after a day.
was_tried() { # NAME KEY
    [ -n "$(find "$BUILD/deps/$1.tried" -mmin -1440 2>/dev/null)" ] && [ "$(cat "$BUILD/deps/$1.tried")" = "$2" ]
}

note_tried() { [ "$APT_ANSWERS" = no ] || echo "$2" >"$BUILD/deps/$1.tried"; }

look_at_packages() {
    local must may
    mapfile -t must < <(words_of MUST)
    mapfile -t may < <(words_of MAY)
    if ! has_apt; then check_without_apt; return; fi
    mapfile -t MISSING < <(not_installed "${must[@]}")
    [ "${#MISSING[@]}" -eq 0 ] || may_be_root ||
        die "please install, then run this again: apt-get install --no-install-recommends ${MISSING[*]}"
    mapfile -t LATER < <(not_installed "${may[@]}")
}

# On another distribution the names differ and are the user's to map; what counts is what the build will look for.
check_without_apt() {
    local missing=() tool file
    for tool in cc cmake ninja python3; do command -v "$tool" >/dev/null || missing+=("$tool"); done
    for file in ini.h csv.h cjson/cJSON.h; do
        echo "#include <$file>" | cc -E - >/dev/null 2>&1 || missing+=("$file (library)")
    done
    [ "${#missing[@]}" -eq 0 ] && { say "no apt-get here, and all that the build needs is in place"; return; }
    printf 'not found: %s\n' "${missing[@]}" >&2
    die "this is no Debian: please install the packages that hold these. On Debian they are: $(words_of MUST | tr '\n' ' ')"
}

wants_apt() { must_have_apt || wants_fetched || may_try_later; }

may_try_later() { [ "${#LATER[@]}" -gt 0 ] && ! was_tried packages "${LATER[*]}" && may_be_root; }

must_have_apt() { [ "${#MISSING[@]}" -gt 0 ] || must_fetch; }

# One small file of Debian's own sources, by apt's own means of transport and proxies.
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

# Debian's own entries of this machine's package sources, each made one of type $1 (deb or deb-src), into folder $2.
# Other entries may be broken, and Debian's may be lacking sources: so the few calls below use these alone.
write_debian_sources() {
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

# The same of another suite of Debian ($3), where the machine's own mirror has it.
write_other_sources() {
    local name
    name=$(codename)
    write_debian_sources "$1" "$2"
    sed -Ei "/^Suites:/{/[ \t]$name([ \t]|\$)/!s/.*/Enabled: no/;s/^Suites:.*/Suites: $3/}" "$2/debian.sources"
    sed -En -i "s/ $name +/ $3 /p" "$2/debian.list"
}

debian_only() { printf '%s\n' -o Dir::Etc::sourcelist=/dev/null -o "Dir::Etc::sourceparts=$1"; }

# From what apt knows now; else with fresh lists, after mending an installation that was broken off; else with Debian's own
# sources alone.
install_packages() {
    local only
    if apt install --no-install-recommends "$@"; then return; fi
    as_root dpkg --configure -a >>"$BUILD/setup.log" 2>&1 </dev/null || true
    say "asking for fresh package lists"
    apt update || say "some package source of this machine does not answer; going on without it"
    if apt install --no-install-recommends "$@"; then return; fi
    write_debian_sources deb "$BUILD/deps/apt-deb"
    mapfile -t only < <(debian_only "$BUILD/deps/apt-deb")
    say "trying with Debian's own package sources alone"
    apt "${only[@]}" update && apt "${only[@]}" install --no-install-recommends "$@"
}

must_install() {
    say "installing Debian packages: $*"
    install_packages "$@" || {
        tail -n 15 "$BUILD/setup.log" >&2
        die "apt-get could not install: $* (log: build/setup.log)"
    }
}

# Python first: what it needs can come from its index while apt-get installs the rest.
get_packages() {
    local python=()
    has_apt || return 0
    mapfile -t python < <(comm -12 <(printf '%s\n' "${MISSING[@]}") <(printf 'python3\npython3-venv\n'))
    if [ "${#python[@]}" -gt 0 ]; then must_install "${python[@]}"; fi
    start_python
    mapfile -t MISSING < <(not_installed "${MISSING[@]}")
    if [ "${#MISSING[@]}" -gt 0 ]; then must_install "${MISSING[@]}"; fi
    say "Debian packages: in place"
    if [ "${#LATER[@]}" -gt 0 ]; then get_later "${LATER[@]}"; fi
}

known_to_apt() {
    local package
    for package in "$@"; do
        if apt-cache show "$package" >/dev/null 2>&1; then echo "$package"; fi
    done
}

get_later() {
    local known
    if may_try_later && [ "$APT_ANSWERS" = yes ]; then
        mapfile -t known < <(known_to_apt "$@")
        if [ "${#known[@]}" -lt $# ]; then apt update || true; mapfile -t known < <(known_to_apt "$@"); fi
        say "installing packages that only some tests need: ${known[*]:-none of them is known here}"
        if [ "${#known[@]}" -eq $# ] && install_packages "$@"; then return; fi
        install_packages "${known[@]}" || true
        note_tried packages "$*"
    fi
    mapfile -t known < <(not_installed "$@")
    say "not all here, so the tests that need them will be skipped: ${known[*]}"
}
