# SPDX-License-Identifier: MIT
"""Whether errors have grown: `gate.py TABLE.csv [--write]`.

Compares the errors of P1 and P2 in a table of speed_against_error with those in gate.csv, which lies beside this file:
one that is up by more than 2 %, or that fails where it did not, is told, and the exit is 1. The tent on P2 is told and
does not fail: there rounding decides, and float is up to 1.6 times as far off as double. `--write` makes the table the
new one.
"""

import argparse
import csv
import pathlib
import sys

KEYS = "problem,kernel,transfer,precision,cfl_fraction,cells,ppc".split(",")
KNOWN = pathlib.Path(__file__).parent / "gate.csv"


def read(path):
    """(status, error) by what was chosen."""
    if not path.is_file():
        sys.exit(f"stop: there is no {path}.")
    with path.open(newline="") as lines:
        return {
            tuple(row[key] for key in KEYS): ("ok" if row["status"] == "ok" else "failed", row["error"])
            for row in csv.DictReader(lines)
            if row["problem"] in ("P1", "P2") and not row.get("acts_on")
        }


def is_up_to_rounding(key):
    chosen = dict(zip(KEYS, key))
    return chosen["problem"] == "P2" and chosen["kernel"] == "linear"


def main():
    arguments = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    arguments.add_argument("table", type=pathlib.Path)
    arguments.add_argument("--write", action="store_true")
    options = arguments.parse_args()
    found = read(options.table)
    if options.write:
        with KNOWN.open("w", newline="") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(KEYS + ["status", "error"])
            table.writerows(key + row for key, row in found.items())
        print(f"{len(found)} settings in {KNOWN}")
        return
    known = read(KNOWN)
    gated, told, better = [], [], [] # settings with more error: that fail, and that do not; and with less
    for key, (status, error) in known.items():
        name = " ".join(key)
        worse = told if is_up_to_rounding(key) else gated
        if key not in found:
            gated.append(f"{name}: not measured")
        elif status == "ok" and found[key][0] != "ok":
            worse.append(f"{name}: failed, was {error}")
        elif status == "ok":
            ratio = float(found[key][1]) / float(error)
            if ratio > 1.02:
                worse.append(f"{name}: {found[key][1]}, was {error}, {ratio:.3f} times as much")
            elif ratio < 0.98:
                better.append(f"{name}: {found[key][1]}, was {error}")
    for line in better:
        print("less error:", line)
    for line in told:
        print("more error, where rounding decides:", line)
    for line in gated:
        print("more error:", line)
    print(f"{len(known)} settings: {len(gated)} worse by more than 2 %, {len(better)} better")
    sys.exit(1 if gated else 0)


if __name__ == "__main__":
    main()
