#!/bin/bash
# SPDX-License-Identifier: MIT
# Prints what hard_cases.csv holds as a table, the newest measurement of each observable: `table.sh [FILE]`, or
# for a README `table.sh --markdown [FILE]`. Fails if one of them missed its limit, or one of the cases H1 to H25 is
# missing of a backend that has others.
style=plain
if [ "$1" = --markdown ]; then style=markdown && shift; fi
file=${1:-hard_cases.csv}
if [ ! -f "$file" ]; then echo "no hard case was measured: there is no $file" && exit 0; fi
awk -F, -v style=$style '
    $1 == "case" { next }
    {
        key = $1 FS $2 FS $3 FS substr($5, 1, 2); newest[key] = $0
        if (!(key in place)) { place[key] = ++count; of[count] = key }
        if (!($2 in known)) { known[$2] = 1; backend[++backends] = $2 }
        measured[$2, $1] = 1
    }
    END {
        if (style == "markdown") print "| case | backend | observable | measured | limit | verdict |\n|---|---|---|---|---|---|"
        for (number = 1; number <= 25; ++number)
            for (i = 1; i <= count; ++i) {
                split(newest[of[i]], f, ",")
                if (f[1] != "H" number) continue
                if (f[6] != "passed") ++failed
                if (style == "markdown") gsub(/[|]/, "\\|", f[3])
                if (style == "markdown")
                    printf "| %s | %s | %s | %s | %s | %s |\n", f[1], f[2], f[3], f[4], f[5], f[6]
                else
                    printf "%-4s %-7s %-84s %11s %12s %s\n", f[1], f[2], f[3], f[4], f[5], f[6]
            }
        for (b = 1; b <= backends; ++b) {
            missing = ""
            for (number = 1; number <= 25; ++number)
                if (!((backend[b], "H" number) in measured)) missing = missing " H" number
            if (missing) { print "missing of " backend[b] ":" missing " (were all of them run?)"; lacks = 1 }
        }
        if (failed) print failed " missed their limits"
        if (count == 0) { print "no hard case was measured"; lacks = 1 }
        exit failed || lacks
    }' "$file"
