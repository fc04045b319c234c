#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# The default is the product: `apvi run FOLDER` localizes and maps with quadtree and medium, and writes a
# report, as configs/default.yaml does.
#   default_run_test.sh APVI
set -euo pipefail
apvi="$1"
source_dir="$(realpath "$(dirname "$0")/../..")"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
cd "$work"

fail() {
  echo "$*" >&2
  exit 1
}

"$apvi" -q sim "$source_dir/configs/scenes/seabed_easy.yaml" -o dive --set duration_s=8 \
  --set 'rig.cam0.resolution=[320, 240]' --set 'rig.cam0.intrinsics=[210, 210, 159.5, 119.5]'
"$apvi" -q run dive -o plain
"$apvi" -q run "$source_dir/configs/default.yaml" --set dataset.path=dive -o named --no-report

for file in trajectory.tum trajectory_smoothed.tum keyframes.tum map.ply medium.json; do
  cmp "plain/$file" "named/$file"
done
[[ -s plain/report.html ]] || fail "the run of a folder has no report"
for setting in 'densification: quadtree' 'medium: true'; do
  grep -q "^  $setting$" plain/resolved.yaml || fail "resolved.yaml has no line '$setting'"
done
python3 - <<'END'
import json

figures = json.load(open("plain/metrics.json"))["mapping"]
limits = {"psnr_db": (28.0, 60.0), "restored_psnr_db": (22.0, 60.0), "depth_abs_rel": (0.0, 0.05)}
wrong = {key: figures[key] for key, (low, high) in limits.items() if not low <= figures[key] <= high}
assert not wrong, f"not within {limits}: {wrong}"
END
