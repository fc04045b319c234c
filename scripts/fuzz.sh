#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Builds the fuzz targets with clang and runs each one: scripts/fuzz.sh [SECONDS_PER_TARGET] [TARGET...]
# Fails on a finding; the crashing input is kept below build/fuzz/findings. The corpus in build/fuzz/corpus
# is extended by every run.
set -euo pipefail
cd "$(dirname "$0")/.."

seconds="${1:-60}"
shift || true
build="${APVI_FUZZ_BUILD:-build/fuzz}"
targets=("$@")
if [ "${#targets[@]}" -eq 0 ]; then
  targets=(fuzz_colmap fuzz_config fuzz_dataset fuzz_db3 fuzz_gpmf fuzz_mavlink fuzz_mcap fuzz_metashape fuzz_mp4
           fuzz_photo fuzz_ply fuzz_raw_image fuzz_ros_message fuzz_sensor_yaml fuzz_spz fuzz_trajectory
           fuzz_vehicle_log fuzz_waterlinked)
fi
command -v clang++ >/dev/null || { echo "fuzz.sh: requires clang++ and libclang-rt-dev" >&2; exit 2; }

cmake -S . -B "$build" -G Ninja -DCMAKE_CXX_COMPILER=clang++ -DCMAKE_BUILD_TYPE=RelWithDebInfo \
  -DAPVI_BUILD_FUZZERS=ON -DAPVI_BUILD_TESTS=OFF -DAPVI_MAPPING=OFF -DAPVI_WITH_ROSBAG=OFF \
  -DAPVI_SANITIZE=fuzzer-no-link,address,undefined >"$build.log" 2>&1 || { tail -20 "$build.log" >&2; exit 2; }
cmake --build "$build" --target apvi_fuzzers >>"$build.log" 2>&1 || { tail -40 "$build.log" >&2; exit 2; }

"$build/tests/fuzz/make_corpus" "$build/corpus"
mkdir -p "$build/findings"
export UBSAN_OPTIONS="halt_on_error=1:print_stacktrace=1"
failed=0
for target in "${targets[@]}"; do
  echo "== $target, $seconds s"
  if ! "$build/tests/fuzz/$target" -max_total_time="$seconds" -timeout=10 -rss_limit_mb=2048 -max_len=8192 \
      -print_final_stats=1 -artifact_prefix="$build/findings/$target-" "$build/corpus/$target" \
      >"$build/$target.log" 2>&1; then
    echo "fuzz.sh: $target failed: see $build/$target.log" >&2
    grep -E "ERROR|SUMMARY|runtime error|broken promise|artifact" "$build/$target.log" >&2 || true
    failed=1
  fi
  grep -E "number_of_executed_units|new_units_added" "$build/$target.log" || true
done
exit "$failed"
