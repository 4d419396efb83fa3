#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Usage: tests/quality/bare_debian.sh FOLDER [DEMO ARGUMENT...]
#
# Runs tools/demo.sh of the committed project in a bare Debian 12 in FOLDER (debootstrap --variant=minbase; the folder is
# kept), with this machine's package sources, proxies and certificates. Prints the output of the demo, then lines `name: number`:
#   setup_seconds     first set-up, as tools/setup.sh counts it
#   debian_mb         installed size of its packages
#   python_mb         Python environment build/venv
#   disk_mb           growth of the system with build and results, without package lists
#   again_seconds     second set-up
# Needs root, debootstrap and a network. If one is missing, it prints the reason and exits with 77.
set -euo pipefail

ROOT=$(CDPATH='' cd -- "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
DEBIAN=bookworm
CARRIED=(/etc/resolv.conf /etc/hosts /etc/apt/sources.list /etc/apt/sources.list.d /etc/apt/apt.conf.d /etc/apt/auth.conf.d
    /etc/apt/keyrings /etc/apt/trusted.gpg /etc/apt/trusted.gpg.d /etc/pip.conf)
CERTIFICATES=/etc/ssl/certs/ca-certificates.crt # of this machine, in addition

absent() { echo "no bare Debian here: $*"; exit 77; }

check() {
    [ "$(id -u)" = 0 ] || absent "it needs root"
    command -v debootstrap >/dev/null || absent "debootstrap is not installed"
    # shellcheck disable=SC2016 # words of apt-get
    mirror=$(apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' "Codename: $DEBIAN" | head -n 1)
    [ -n "$mirror" ] || absent "this machine's package sources have no $DEBIAN"
}

make_system() {
    local file
    debootstrap --variant=minbase "$DEBIAN" "$bare" "$mirror" >"$folder/debootstrap.log" 2>&1 ||
        absent "debootstrap failed: $(tail -n 1 "$folder/debootstrap.log")"
    rm -f "$bare/etc/apt/sources.list"
    for file in "${CARRIED[@]}"; do
        [ ! -e "$file" ] || { mkdir -p "$bare$(dirname "$file")" && cp -a -T "$file" "$bare$file"; }
    done
    rm -f "$bare"/etc/apt/apt.conf.d/docker-* # settings of containers, which a bare Debian does not have
    if [ -e "$CERTIFICATES" ]; then cp "$CERTIFICATES" "$bare/etc/machine.crt"; fi
    git clone --quiet --no-hardlinks "$ROOT" "$bare/dahl"
}

inside() { # COMMAND...: in new namespaces, so that all mounts and processes end
    local carried=(HOME=/root LC_ALL=C.UTF-8 PATH=/usr/sbin:/usr/bin:/sbin:/bin) name
    for name in http_proxy https_proxy no_proxy PIP_INDEX_URL; do
        if [ -n "${!name:-}" ]; then carried+=("$name=${!name}"); fi
    done
    if [ -e "$bare/etc/machine.crt" ]; then carried+=(PIP_CERT=/etc/machine.crt SSL_CERT_FILE=/etc/machine.crt); fi
    unshare --mount --pid --fork --kill-child --mount-proc="$bare/proc" \
        env -i "${carried[@]}" chroot "$bare" /bin/bash -c 'cd /dahl && exec "$@"' bash "$@" </dev/null
}

# shellcheck disable=SC2016 # a word of dpkg-query
packages_kb() { chroot "$bare" dpkg-query -W -f '${Installed-Size}\n' | awk '{ sum += $1 } END { print sum }'; }

disk_kb() { du -skx --exclude=var/lib/apt/lists --exclude=var/cache/apt "$bare" | cut -f 1; }

seconds_of() { sed -n 's/^setup: done in \([0-9]*\) s$/\1/p' "$1"; }

PATH=$PATH:/usr/sbin:/sbin
[ $# -ge 1 ] || { echo 'error: bare_debian.sh needs a folder' >&2; exit 1; }
mkdir -p "$1"
folder=$(CDPATH='' cd -- "$1" && pwd)
bare=$folder/system
shift
check
make_system
debian=$(packages_kb) disk=$(disk_kb)
inside tools/demo.sh "$@" 2>&1 | tee "$folder/demo.log"
echo "setup_seconds: $(seconds_of "$folder/demo.log")"
echo "debian_mb: $((($(packages_kb) - debian) / 1000))"
echo "python_mb: $(du -sm "$bare/dahl/build/venv" | cut -f 1)"
echo "disk_mb: $((($(disk_kb) - disk) / 1000))"
inside tools/setup.sh demo >"$folder/again.log"
echo "again_seconds: $(seconds_of "$folder/again.log")"
