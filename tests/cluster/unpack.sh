#!/bin/bash
# unpack.sh FOLDER PACKAGE...: Debian packages, and what they need and this system lacks, unpacked below FOLDER.
#
# Nothing is installed. FOLDER/bin has their commands, which find their libraries by FOLDER/environment, and whatever
# else is written there. Status 77 where they cannot be had: no apt, no network.
set -euo pipefail

folder=$1
shift
lacks() {
    echo "$1" >&2
    exit 77
}
command -v apt-get dpkg >/dev/null || lacks "no apt-get and dpkg: not Debian, and not one of its children"
mkdir -p "$folder/debs" "$folder/bin"
cd "$folder/debs"
wanted=$(LC_ALL=C apt-get --simulate --no-install-recommends install "$@" 2>&1) ||
    lacks "apt-get knows no package $* (apt-get update may help): $(tail -n 1 <<<"$wanted")"
needed=$(awk '/^Inst /{print $2}' <<<"$wanted")
# shellcheck disable=SC2086 # names without blanks
told=$(timeout 60 apt-get download "$@" $needed 2>&1) || lacks "cannot be downloaded: $(tail -n 1 <<<"$told")"
for package in *.deb; do dpkg -x "$package" "$folder"; done
rm -r "$folder/debs"

libraries=$(find "$folder/usr/lib" -name '*.so*' -printf '%h\n' 2>/dev/null | sort -u | paste -sd:)
echo "LD_LIBRARY_PATH=$libraries; export LD_LIBRARY_PATH" >"$folder/environment"
for program in "$folder"/usr/bin/* "$folder"/usr/sbin/*; do
    [ -x "$program" ] && [ ! -d "$program" ] || continue
    name=$(basename "$program")
    printf '#!/bin/sh\n. "%s/environment"\nexec "%s" "$@"\n' "$folder" "$program" >"$folder/bin/$name"
    chmod +x "$folder/bin/$name"
done
