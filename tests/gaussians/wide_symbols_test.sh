#!/bin/sh
# SPDX-License-Identifier: BSD-3-Clause
# Usage: wide_symbols_test.sh LIBRARY
# Fails when a rasterizer object compiled for AVX2 or AVX-512 defines a weak function that another file
# may define too: the linker keeps one of them, and a processor without these instructions would
# execute it.
set -eu
symbols=$(nm -C "$1")
echo "$symbols" | grep -q '^raster_avx2' || { echo "no AVX2 object in $1"; exit 1; }
shared=$(echo "$symbols" | awk '/^raster_avx/ { wide = 1 } /^$/ { wide = 0 }
                                wide && $2 == "W" && !/simd::Float/')
[ -z "$shared" ] || { echo "weak functions shared with other objects:"; echo "$shared"; exit 1; }
