#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# pairs.sh FOLDER [FILE]: whether every pair of policies (models, spaces, kernels, transfers) meets in a scene of the tests
# that are always built (not those in More<...>), FILE of tests/ left out. Prints those that do not, and exits with 1.
set -euo pipefail
cd "$1/tests"
perl -e '
    # the lists of the library, from all.hpp of each folder
    sub text { open my $in, "<", $_[0] or die "$_[0]: $!"; local $/; <$in> }
    my @models = grep { !/Models$/ } text("../include/firn/models/all.hpp") =~ /(\w+)<Space>/g;
    my ($kernels) = text("../include/firn/interpolation/all.hpp") =~ /AllKernels = std::tuple<([^>]*)>/;
    my ($transfers) = text("../include/firn/transfer/all.hpp") =~ /AllTransfers = std::tuple<([^>]*)>/;
    my @sets = ([@models], [qw(Plane PlaneFloat Solid SolidFloat)], [$kernels =~ /\w+/g], [$transfers =~ /\w+/g]);
    die "a list in all.hpp was not found" if @models < 2 || @{$sets[2]} < 2 || @{$sets[3]} < 2;
    my $left_out = shift;
    my %meet;
    for my $file (grep { $_ ne $left_out } @ARGV) {
        open my $in, "<", $file or die "$file: $!";
        my $code = do { local $/; <$in> };
        $code =~ s{//[^\n]*}{}g;
        $code =~ s/\bMore(<(?:[^<>]++|(?1))*>)//g;
        # of a scene of several materials each meets the other policies
        while ($code =~ /\bScene<\s*(?:Materials<((?:\s*\w+<\s*\w+\s*>,?)+)>|(\w+<\s*\w+\s*>)),\s*(\w+),\s*(\w+)/g) {
            my ($materials, $kernel, $transfer) = ($1 // $2, $3, $4);
            while ($materials =~ /(\w+)<\s*(\w+)\s*>/g) {
                my @policies = ($1, $2, $kernel, $transfer);
                for my $i (0 .. 3) { $meet{"$policies[$i], $policies[$_]"} = 1 for $i + 1 .. 3 }
            }
        }
    }
    my $missing = 0;
    for my $i (0 .. 3) {
        for my $j ($i + 1 .. 3) {
            for my $one (@{$sets[$i]}) {
                for my $other (@{$sets[$j]}) {
                    next if $meet{"$one, $other"};
                    print "no test has a scene with $one and $other.\n";
                    ++$missing;
                }
            }
        }
    }
    exit($missing > 0);' "${2:-}" physics/*.cpp models/*.cpp limits/*.cpp refusal/*.cpp
