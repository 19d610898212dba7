#!/bin/sh
# tools/chromium.sh FOLDER: prints the program of a Chromium and the folders of its libraries, one line.
# The system's own where there is one, else Debian's packages, unpacked into FOLDER without root.
set -eu
folder=$1
system=$(command -v chromium || command -v chromium-browser || true)
if [ -n "$system" ]; then
    printf '%s\n' "$system"
    exit 0
fi
if [ ! -e "$folder/.complete" ]; then
    command -v apt-get >/dev/null 2>&1 && command -v dpkg >/dev/null 2>&1 || exit 1
    rm -rf "$folder"
    mkdir -p "$folder/packages"
    wanted() {
        apt-get install --simulate --no-install-recommends chromium 2>/dev/null | sed -n 's/^Inst \([^ ]*\).*/\1/p'
    }
    packages=$(wanted)
    if [ -z "$packages" ]; then # no list of packages yet: only root can get one
        apt-get update >/dev/null 2>&1 || exit 1
        packages=$(wanted)
    fi
    [ -n "$packages" ] || exit 1
    # shellcheck disable=SC2086
    (cd "$folder/packages" && apt-get download $packages >/dev/null 2>&1) || exit 1
    for package in "$folder"/packages/*.deb; do
        dpkg -x "$package" "$folder/root"
    done
    rm -rf "$folder/packages"
    : >"$folder/.complete"
fi
libraries=$(find "$folder/root" -name '*.so*' -not -path '*/chromium/*' -exec dirname {} + | sort -u | tr '\n' ':')
printf '%s %s\n' "$folder/root/usr/lib/chromium/chromium" "$libraries"
