#!/bin/bash
# SPDX-License-Identifier: MIT
# Prints what hard_cases.csv holds as a table, the newest measurement of each observable: `table.sh [FILE]`, or
# for a page, with a column for each backend, `table.sh --markdown [FILE...]`. Fails if one of them missed its limit,
# or one of the cases H1 to H25 is missing of a backend that has others.
style=plain
if [ "$1" = --markdown ]; then style=markdown && shift; fi
[ $# -gt 0 ] || set -- hard_cases.csv
for file in "$@"; do
    if [ ! -f "$file" ]; then echo "no hard case was measured: there is no $file" && exit 0; fi
done
awk -F, -v style=$style '
    $1 == "case" { next }
    {
        key = $1 FS $2 FS $3 FS substr($5, 1, 2); newest[key] = $0; observable[key] = $3
        if (!(key in place)) { place[key] = ++count; of[count] = key }
        if (!($2 in known)) { known[$2] = 1; backend[++backends] = $2 }
        measured[$2, $1] = 1
    }
    END {
        if (style == "markdown") {
            head = "| case | observable |"; line = "|---|---|"
            for (b = 1; b <= backends; ++b) { head = head " " backend[b] " |"; line = line "---|" }
            print head " limit |\n" line "---|"
        }
        for (number = 1; number <= 25; ++number)
            for (i = 1; i <= count; ++i) {
                split(newest[of[i]], f, ",")
                if (f[1] != "H" number) continue
                if (f[6] != "passed") ++failed
                if (style == "markdown") {
                    alike = f[1] FS f[3] FS f[5] # of another backend
                    if (alike in told) continue
                    told[alike] = 1
                    gsub(/[|]/, "\\|", f[3])
                    row = "| " f[1] " | " f[3] " |"
                    for (b = 1; b <= backends; ++b) {
                        split(newest[f[1] FS backend[b] FS observable[of[i]] FS substr(f[5], 1, 2)], g, ",")
                        row = row " " g[4] (g[6] == "" || g[6] == "passed" ? "" : " (" g[6] ")") " |"
                    }
                    print row " " f[5] " |"
                }
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
    }' "$@"
