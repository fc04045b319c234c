#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Simulates the benchmark datasets: {seabed, ship, dam} x {easy, hard}, with all sensors and ground truth, and for
# the mapping ablations 20 s of two of them at 320 x 240 px without outages: seabed_easy_small, seabed_hard_small.
#
#   scripts/make_benchmark.sh [FOLDER] [--seeds N] [option of `apvi sim`]...
#
# FOLDER defaults to data/benchmark. With N > 1, FOLDER/SCENE-2 to SCENE-N have the same motion and images with
# other noise in IMU, DVL and pressure. An interrupted call can be repeated: complete datasets are kept. APVI is
# the program, build/cpu/bin/apvi by default.
set -euo pipefail
cd "$(dirname "$0")/.."

folder=data/benchmark
seeds=1
if [[ $# -gt 0 && $1 != -* ]]; then
  folder=$1
  shift
fi
if [[ ${1:-} == --seeds ]]; then
  seeds=${2:?--seeds needs a number}
  shift 2
fi
apvi=${APVI:-build/cpu/bin/apvi}
if [[ ! -x $apvi ]]; then
  echo "$apvi: no such program; build it or set APVI to its path" >&2
  exit 2
fi

scenes=()
for place in seabed ship dam; do
  for grade in easy hard; do
    scenes+=("configs/scenes/${place}_${grade}.yaml")
  done
done
"$apvi" sim "${scenes[@]}" -o "$folder" "$@"

small=(--set duration_s=20 --set 'events=[]' --set 'rig.cam0.resolution=[320, 240]'
       --set 'rig.cam0.intrinsics=[210, 210, 159.5, 119.5]')
for name in seabed_easy seabed_hard; do
  "$apvi" sim "configs/scenes/$name.yaml" -o "$folder/${name}_small" "${small[@]}" "$@"
done

# The datasets of the other seeds link to the images of the first one.
for ((seed = 2; seed <= seeds; ++seed)); do
  for scene in "${scenes[@]}"; do
    name=$(basename "$scene" .yaml)
    copy=$folder/$name-$seed
    [[ ! -e $copy/mav0/cam0 ]] || continue
    "$apvi" sim "$scene" -o "$copy" --set "sensor_seed=$seed" --no-images "$@"
    cp "$folder/$name/rig.yaml" "$copy/rig.yaml"
    ln -s "../../$name/mav0/cam0" "$copy/mav0/cam0"
  done
done
