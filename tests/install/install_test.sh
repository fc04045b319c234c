#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs the given build into a temporary folder, builds the consumer against it, and runs it.
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

# The installed configurations are found from any folder, by a command and by a file of the user.
# A LibTorch outside the system's folders is not in the run path of an installed program.
torch="$(sed -n 's|^Torch_DIR:[A-Z]*=\(.*\)/share/cmake/Torch$|\1/lib|p' "$build/CMakeCache.txt")"
[[ -z $torch ]] || export LD_LIBRARY_PATH="$torch${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}"
apvi="$work/prefix/bin/apvi"
mkdir "$work/empty"
cd "$work/empty"
echo 'inherit: default.yaml' >own.yaml
echo 'inherit: configs/datasets/akit.yaml' >own_akit.yaml
"$apvi" config --check own.yaml own_akit.yaml configs/localization.yaml scenes/dam_easy.yaml sweeps/seeds.yaml
