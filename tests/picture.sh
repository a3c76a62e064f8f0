#!/bin/sh
# The picture in the README: the first screen of a report.  sh tests/picture.sh IN.html OUT.png
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
chromium --headless --no-sandbox --disable-gpu --disable-quic --no-first-run \
    --disable-background-networking --disable-component-update --disable-sync \
    --user-data-dir="$folder" --hide-scrollbars --window-size=1000,880 \
    --screenshot="$2" "file://$(realpath "$1")" >/dev/null 2>&1
test -s "$2"
