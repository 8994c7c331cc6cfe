#!/usr/bin/env bash
# The README's commands in an empty Debian 13: Python 3.13, make and no compiler. Needs root, debootstrap and disk space.
#
#   scripts/release_check.sh [TARGET...]     targets of the Makefile, default: demo test
#
# MIRROR       the Debian mirror; default: the one that apt uses here
# EXTRA_PATHS  files and folders that pip needs there too (pip.conf, a local index, a cache); the certificates of this
#              system and every variable PIP_* are taken along
# TREE         the folder for the Debian tree; default: a temporary one, removed at the end
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
targets=("$@")
[ $# -gt 0 ] || targets=(demo test)
limit=60  # s after the installation, for the first line of the demo's result

mirror=${MIRROR:-$(grep -rhoE 'https?://[^ ]+/debian/?( |$)' /etc/apt --include='*.list' --include='*.sources' | head -n 1)}
[ -n "$mirror" ] || { echo "no Debian mirror in apt's sources: set MIRROR" >&2; exit 2; }
tree=${TREE:-$(mktemp -d)}
cleanup() {
    for folder in dev proc; do
        while mountpoint -q "$tree/$folder"; do umount -l "$tree/$folder"; done
    done
    [ -n "${TREE:-}" ] || rm -rf --one-file-system "$tree"
}
trap cleanup EXIT

[ -x "$tree/usr/bin/make" ] ||
    debootstrap --variant=minbase --include=make,python3,python3-venv,ca-certificates trixie "$tree" "$mirror"
mountpoint -q "$tree/proc" || mount -t proc proc "$tree/proc"
mount --rbind /dev "$tree/dev" && mount --make-rslave "$tree/dev"
for path in /etc/resolv.conf /etc/hosts /etc/ssl/certs ${EXTRA_PATHS:-}; do
    mkdir -p "$tree$(dirname "$path")"
    cp -RLT --remove-destination "$path" "$tree$path"
done
rm -rf "$tree/project"
git clone --quiet . "$tree/project"

inside() {
    chroot "$tree" /usr/bin/env -i PATH=/usr/bin:/bin HOME=/root LANG=C.UTF-8 "${pip_options[@]}" "$@"
}
mapfile -t pip_options < <(env | grep '^PIP_' || true)
if inside sh -c 'command -v cc || command -v gcc || command -v clang'; then
    echo "there is a compiler in $tree" >&2
    exit 1
fi
echo "Debian $(cat "$tree/etc/debian_version"), $(inside python3 --version)"
SECONDS=0
inside make -C /project install
echo "install: $SECONDS s"

for target in "${targets[@]}"; do
    SECONDS=0
    first="" last=""
    while IFS= read -r line; do
        printf '%s\n' "$line"
        last=$line
        case $line in "1 of 5"*) first=$SECONDS ;; esac
    done < <(inside make -C /project "$target" 2>&1 && echo "$target passed" || echo "$target FAILED")
    echo "$target: $SECONDS s"
    [[ $last == "$target passed" ]] || exit 1
    if [ "$target" = demo ]; then
        echo "first line of the demo's result after ${first:-?} s (limit: $limit s)"
        [ -n "$first" ] && [ "$first" -le "$limit" ] || exit 1
    fi
done
