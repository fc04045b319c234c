#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Simulates the benchmark set: {seabed, ship, dam} x {easy, hard}, with all sensors and ground truth.
#
#   scripts/make_benchmark.sh [FOLDER] [option of `apvi sim`]...
#
# FOLDER defaults to data/benchmark. Stopped, it goes on when called again; what is complete is left
# alone. APVI names the program, build/cpu/src/apps/apvi when it is not set.
set -euo pipefail
cd "$(dirname "$0")/.."

folder=data/benchmark
if [[ $# -gt 0 && $1 != -* ]]; then
  folder=$1
  shift
fi
apvi=${APVI:-build/cpu/src/apps/apvi}
if [[ ! -x $apvi ]]; then
  echo "$apvi: no such program; build it, or name it in APVI" >&2
  exit 2
fi

scenes=()
for place in seabed ship dam; do
  for grade in easy hard; do
    scenes+=("configs/scenes/${place}_${grade}.yaml")
  done
done
exec "$apvi" sim "${scenes[@]}" -o "$folder" "$@"
