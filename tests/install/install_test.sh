#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs the given build into a temporary folder, runs the program there, and builds the consumer against it.
set -euo pipefail

build="$1"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT

cmake --install "$build" --prefix "$work/prefix" >"$work/install.log" || {
  cat "$work/install.log" >&2
  exit 1
}
if grep -rl --include='*.cmake' "$build" "$work/prefix"; then
  echo "the installed CMake files refer to the build folder" >&2
  exit 1
fi
cmake -S "$(dirname "$0")" -B "$work/build" -G Ninja -DCMAKE_PREFIX_PATH="$work/prefix" \
  -DAPVI_EXAMPLES="$(realpath "$(dirname "$0")/../../examples")" -DCMAKE_BUILD_TYPE=Release --log-level=WARNING
cmake --build "$work/build"
ctest --test-dir "$work/build" --output-on-failure

"$(dirname "$0")/program_test.sh" "$work/prefix/bin/apvi"
[[ -f "$work/prefix/share/man/man1/apvi.1.gz" ]] || { echo "no man page is installed" >&2; exit 1; }
