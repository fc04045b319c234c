#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Runs the examples that read a recording on a short simulated dive.
#   examples_test.sh APVI FOLDER_OF_THE_EXAMPLES
set -euo pipefail
apvi="$1" examples="$2"
source_dir="$(realpath "$(dirname "$0")/../..")"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
cd "$work"

"$apvi" -q sim "$source_dir/configs/scenes/seabed_easy.yaml" -o dive --set duration_s=6 \
  --set 'rig.cam0.resolution=[320, 240]' --set 'rig.cam0.intrinsics=[210, 210, 159.5, 119.5]'

fail() {
  echo "error: $*" >&2
  exit 1
}

"$examples/01_localize_folder" dive >poses.tum
(($(wc -l <poses.tum) > 80)) || fail "01_localize_folder printed $(wc -l <poses.tum) poses"

"$examples/02_map_folder" dive | tee map.txt
grep -qE '^[1-9][0-9]* Gaussians, [1-9]' map.txt || fail "02_map_folder made no map"
grep -q '^attenuation' map.txt || fail "02_map_folder found no water"

"$examples/03_live_source" dive 4 >live.tum
(($(wc -l <live.tum) > 20)) || fail "03_live_source printed $(wc -l <live.tum) poses"

"$examples/04_render_while_mapping" dive
[[ -s render_000.ppm ]] || fail "04_render_while_mapping wrote no image"

"$examples/06_map_given_poses" dive poses.tum | grep -qE '^[1-9][0-9]* Gaussians, [1-9]' ||
  fail "06_map_given_poses made no map"
