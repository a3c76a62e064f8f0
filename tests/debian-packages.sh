#!/bin/sh
# The tests look at pages in a real browser, and run the logger's firmware on emulated chips. Installs
# what that takes where it is allowed, says so where not.
set -eu
wanted=""
want() { # want PACKAGE UNLESS-THIS-FILE-OR-COMMAND-IS-THERE
    command -v "$2" >/dev/null 2>&1 || [ -e "$2" ] || wanted="$wanted $1"
}
want chromium chromium
want chromium-driver chromedriver
want make make
want g++ g++
want gcc-avr avr-gcc
want avr-libc /usr/lib/avr/include/avr/io.h
want libsimavr-dev /usr/include/simavr/sim_avr.h
want libelf-dev /usr/include/libelf.h
[ -n "$wanted" ] || exit 0
if ! command -v apt-get >/dev/null 2>&1; then
    echo "Not a Debian system: install$wanted by hand; without them the tests that need them are skipped." >&2
    exit 0
fi
if [ "$(id -u)" -ne 0 ]; then
    echo "Not root: run 'sudo apt-get install$wanted'; without them the tests that need them are skipped." >&2
    exit 0
fi
export DEBIAN_FRONTEND=noninteractive
apt-get update -qq
# shellcheck disable=SC2086 # a list of packages
apt-get install -y -qq --no-install-recommends $wanted >/dev/null
