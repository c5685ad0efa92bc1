#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# includes.sh FOLDER: whether each header includes, itself or by way of Firn's own headers, what declares each name that it
# uses: of Firn, of the standard library and of Eigen. Prints what lacks an include, and exits with 1. can_fail as a second
# argument: takes includes out of a copy, and asks whether that is seen. With FIRN_TESTS_ALL compilers say the same.
set -euo pipefail
self=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)/includes.sh
cd "$1"

# Names of others, and the headers of which one is enough.
names_of_others() {
    cat <<'END'
algorithm: adjacent_find all_of any_of clamp copy copy_n count equal fill fill_n find find_if find_if_not inplace_merge
algorithm: lexicographical_compare lower_bound max max_element min minmax nth_element partition partition_point ranges::all_of ranges::any_of
algorithm: ranges::copy ranges::count_if ranges::equal ranges::find ranges::lower_bound ranges::max ranges::min ranges::none_of ranges::sort
algorithm: ranges::set_difference ranges::stable_sort ranges::upper_bound sort stable_sort transform unique upper_bound
array: array
array,tuple,utility: get tuple_element_t tuple_size_v
array,vector,string,span: begin data size
atomic: atomic atomic_flag atomic_thread_fence memory_order_acq_rel memory_order_acquire memory_order_relaxed
atomic: memory_order_release memory_order_seq_cst
bit: bit_cast bit_ceil countr_zero endian popcount
cctype: isalnum isdigit tolower
charconv: from_chars to_chars
chrono: chrono
cmath: atan2 cbrt ceil cos exp floor fma fmax ilogb isfinite isnan isnormal ldexp log log10 lrint nan nextafter pow sin sqrt tan tanh
cmath,cstdlib: abs
condition_variable: condition_variable
concepts: constructible_from convertible_to copy_constructible derived_from floating_point integral invocable movable same_as
cstddef: byte ptrdiff_t
cstdio: snprintf
cstddef,cstring,cstdlib: size_t
cstdint: int32_t int64_t uint16_t uint32_t uint64_t uint8_t uintmax_t uintptr_t
cstdlib: getenv
cstring: memcmp memcpy memset
exception: current_exception exception exception_ptr rethrow_exception uncaught_exceptions
filesystem: filesystem
fstream: ifstream ofstream
functional: equal_to function less
initializer_list,array,vector,string: initializer_list
iterator: back_inserter input_iterator_tag istreambuf_iterator prev
fstream,istream,sstream: istream
fstream,istream,ostream,sstream: ios streamsize
limits: numeric_limits
map: map
mutex: lock_guard mutex timed_mutex unique_lock
memory: construct_at make_shared make_unique shared_ptr unique_ptr weak_ptr
new: align_val_t bad_alloc
numbers: numbers
numeric: accumulate exclusive_scan iota partial_sum
optional: nullopt optional
fstream,ostream,sstream: ostream
random: mt19937_64
set: set
span: as_bytes as_writable_bytes span
sstream: istringstream ostringstream
stdexcept: runtime_error
string: getline stoull string to_string
string_view,string: string_view string_view_literals
system_error: errc error_code
thread: this_thread thread
typeinfo: type_info
tuple: apply tie tuple tuple_cat
type_traits: conditional_t decay_t integral_constant is_aggregate_v is_arithmetic_v is_base_of_v is_class_v is_const_v
type_traits: is_default_constructible_v is_enum_v is_final_v is_floating_point_v is_invocable_r_v is_invocable_v is_same_v is_signed_v
type_traits: is_standard_layout_v
type_traits: is_trivially_copyable_v is_trivially_destructible_v remove_const_t remove_cv_t remove_cvref_t
type_traits: remove_pointer_t remove_reference_t type_identity type_identity_t
unordered_map: unordered_map
utility: as_const declval exchange forward in_range index_sequence integer_sequence make_index_sequence
utility: make_integer_sequence move pair swap
variant: get_if variant visit
vector: vector
vector,string,map,unordered_map: erase_if
END
}

if [ "${2:-}" = can_fail ]; then
    copy=$(mktemp -d)
    trap 'rm -rf "$copy"' EXIT
    broken=0
    for place in include/firn/particles/row_ids.hpp:numeric include/firn/io/write_particles.hpp:Eigen/Core \
        include/firn/time_stepping/step_log.hpp:firn/effects/actions.hpp backends/openmp/firn/openmp.hpp:firn/openmp/update_nodes.hpp; do
        file=${place%%:*} included=${place#*:}
        rm -rf "${copy:?}"/*
        cp -r include backends "$copy"
        grep -q "^#include <$included>" "$file" || { echo "$file does not include <$included>."; exit 1; }
        sed -i "\|^#include <$included>|d" "$copy/$file"
        if bash "$self" "$copy" >/dev/null; then echo "it is not seen that $file lacks <$included>."; broken=1; fi
    done
    exit $broken
fi

names_of_others | perl -e '
    my %needed; # of a name of the standard library: the headers
    while (<STDIN>) {
        my ($headers, $names) = /^(\S+): (.*)/ or die "not understood: $_";
        $needed{$_} = [split /,/, $headers] for split / /, $names;
    }
    my (%code, %root_of, %includes, %declares, %declared_in, %of_classes);
    for my $file (@ARGV) {
        open my $in, "<", $file or die "$file: $!";
        my $text = do { local $/; <$in> };
        my ($name) = $file =~ m{/(firn(?:/.*|\.hpp))$} or next;
        my $root = substr $file, 0, -1 - length $name;
        $text =~ s{R"\(.*?\)"|"(?:\\.|[^"\\\n])*"|\x27(?:\\.|[^\x27\\\n])\x27|//[^\n]*|/\*.*?\*/}{ substr($&, 0, 1) =~ /[\x27"R]/ ? "\"\"" : " " }gse;
        my @of = $text =~ /^\s*#\s*include\s*<([^>]*)>/gm;
        $includes{$file} = [map { -e "$root/$_" ? "$root/$_" : -e "include/$_" ? "include/$_" : $_ } @of];
        my %macro = map { $_ => 1 } $text =~ /^\s*#\s*define\s+(\w+)/gm;
        $text =~ s/^\s*#(?:\\\n|[^\n])*//gm;
        # what is declared in namespaces, by the statement before each brace or semicolon; and functions of classes
        my (@open, %own, $statement);
        for my $token ($text =~ /\w+|::|\S/g) {
            if ($token !~ /^[{;}]$/) { $statement .= "$token "; next }
            my $what = $statement;
            1 while $what =~ s/\b(?:template|requires) ?(<(?:[^<>]++|(?1))*>)//;
            if (!grep { $_ ne "namespace" } @open) {
                if ($what =~ /\b(?:struct|class|union|enum class|enum|concept|using) (\w+)/) { $own{$1} = 1 }
                elsif ($what =~ /(\w+) \(/ || $what =~ /\bconstexpr\b.*?(\w+) (?:=|$)/) { $own{$1} = 1 }
            }
            elsif ($open[-1] eq "class" && $what =~ /(\w+) \(/) { $of_classes{$1} = 1 }
            if ($token eq "{") { push @open, $what =~ /\bnamespace\b/ ? "namespace" : $what =~ /\b(?:struct|class) \w+[^()]*$/ ? "class" : "other" }
            elsif ($token eq "}") { pop @open }
            $statement = "";
        }
        $declares{$file} = {%own, %macro};
        $code{$file} = $text;
        $root_of{$file} = $root;
    }
    for my $file (keys %declares) { push @{$declared_in{$_}}, $file for keys %{$declares{$file}} }
    sub closure {
        my ($file, $seen) = @_;
        return if $seen->{$file}++;
        closure($_, $seen) for @{$includes{$file} // []};
    }
    my $missing = 0;
    sub lacks { print "$_[0]: $_[1]\n"; ++$missing }
    for my $file (sort keys %code) {
        my %seen;
        closure($file, \%seen);
        my $text = $code{$file};
        my %said;
        while ($text =~ /\bstd::((?:ranges::)?\w+)/g) {
            next if $said{"std::$1"}++;
            my $headers = $needed{$1} or do { lacks($file, "std::$1 is not in the table of includes.sh: add it there."); next };
            lacks($file, "std::$1 needs <" . join("> or <", @$headers) . ">.") unless grep { $seen{$_} } @$headers;
        }
        lacks($file, "a name of Eigen needs <Eigen/Core>.") if $text =~ /\bEigen::/ && !grep { m{^Eigen/} } keys %seen;
        lacks($file, "Eigen::$1 needs <Eigen/Geometry>.")
            if $text =~ /\bEigen::(Quaternion\w*|AlignedBox\w*|AngleAxis\w*)/ && !$seen{"Eigen/Geometry"};
        lacks($file, ".$1() needs <Eigen/LU>.") if $text =~ /\.(determinant|inverse)\(\)/ && !$seen{"Eigen/LU"};
        lacks($file, ".$1() needs <Eigen/Geometry>.") if $text =~ /\.(cross)\(/ && !$seen{"Eigen/Geometry"};
        # of Firn: macros, types and concepts, and functions that no class has, too, or that are called by their namespace
        while ($text =~ /(?<![\w.>:])((?:\w+::)*)(FIRN_\w+|[A-Z]\w+\b|[a-z]\w*(?=[(<]))/g) {
            my ($scope, $name) = ($1, $2);
            next if $scope =~ /^(?:std|Eigen|xsimd|CGAL|Assimp)::|[A-Z]\w*::$/ || $said{$name};
            my $named = $scope =~ /\b(?:firn|detail|openmp|cuda|reference)::$/;
            next if $name =~ /^[a-z]/ && $of_classes{$name} && !$named;
            my @declaring = grep { /^include/ || /^$root_of{$file}/ } @{$declared_in{$name} // []} or next;
            next if grep { $seen{$_} } @declaring;
            # its own: a parameter of a template, a member, a variable
            next if !$named && $text =~ /\b(?:class|typename|struct|using|auto|[A-Z]\w*)(?: |\.\.\. | const | const& )$name\b/;
            $said{$name} = 1;
            lacks($file, "$name is declared in <" . join("> or <", map { s{.*?/(firn[/.])}{$1}r } @declaring) . ">.");
        }
    }
    exit($missing > 0);' $(find include backends -name '*.hpp' | sort)
