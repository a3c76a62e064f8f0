#!/bin/sh
# Prints flash and RAM of each program and fails when one leaves too little RAM for its stack.
# usage: size.sh FLASH RAM RAM_FREE ELF...
set -eu
flash=$1 ram=$2 least=$3
shift 3
status=0
printf '%-10s %14s %22s %10s\n' program "flash of $flash" "RAM for data of $ram" "RAM left"
for elf in "$@"; do
    avr-size "$elf" | awk -v name="$(basename "$elf" .elf)" -v flash="$flash" -v ram="$ram" -v least="$least" '
        NR == 2 {
            used = $1 + $2; data = $2 + $3; left = ram - data
            printf "%-10s %14d %22d %10d\n", name, used, data, left
            if (left < least) { printf "%s leaves %d bytes of RAM, %d are needed\n", name, left, least; bad = 1 }
            if (used > flash) { printf "%s needs %d bytes of flash\n", name, used; bad = 1 }
        }
        END { exit bad }' || status=1
done
exit $status
