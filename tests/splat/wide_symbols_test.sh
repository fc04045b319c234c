#!/bin/sh
# SPDX-License-Identifier: BSD-3-Clause
# Usage: wide_symbols_test.sh LIBRARY
# Fails when an object of the rasterizer that is compiled for AVX2 or AVX-512 defines a function that
# another file may define too: the linker keeps one of them, and a processor without these
# instructions would run into it.
set -eu
symbols=$(nm -C "$1")
echo "$symbols" | grep -q '^raster_avx2' || { echo "no AVX2 object in $1"; exit 1; }
shared=$(echo "$symbols" | awk '/^raster_avx/ { wide = 1 } /^$/ { wide = 0 }
                                wide && $2 == "W" && !/simd::Float/')
[ -z "$shared" ] || { echo "functions that others share:"; echo "$shared"; exit 1; }
