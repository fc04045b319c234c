#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs what is missing, builds, and makes a dive over a reef, its trajectory, its map and a report.
set -euo pipefail
source "$(dirname "$0")/lib.sh"

usage() {
  cat <<END
usage: scripts/demo.sh [-o FOLDER] [APVI RUN ARGUMENTS...]
Installs what is missing, builds into build/cpu, simulates 20 s of a dive over a reef (camera, IMU, DVL,
pressure), localizes the vehicle and builds the map from it, the camera dark for three seconds, compares
both with the simulated truth, and draws the report.
  -o FOLDER   where the data set and the run go (default: runs/demo)
Further arguments go to \`apvi run\`, for example --set run.seed=2. Environment: APVI_JOBS.
END
}

output="runs/demo"
case "${1:-}" in
  -h | --help)
    usage
    exit 0
    ;;
  -o)
    (($# >= 2)) || die "-o needs a folder"
    output="$2"
    shift 2
    ;;
esac

apvi() { "$APVI_ROOT/build/cpu/src/apps/apvi" "$@"; }

# The input: a dive of the simulator, made once; small, so that two cores are quick with it.
make_demo_data() {
  local dataset="$1"
  if [[ -f "$dataset/rig.yaml" ]]; then
    echo "demo: $dataset is there already"
    return
  fi
  apvi sim "$APVI_ROOT/configs/scenes/seabed_easy.yaml" -o "$dataset" --set duration_s=20 \
    --set "rig.cam0.resolution=[320, 240]" --set "rig.cam0.intrinsics=[210, 210, 159.5, 119.5]"
}

run_demo() {
  local dataset="$1" run="$2"
  shift 2
  apvi run "$APVI_ROOT/configs/experiments/seabed_online.yaml" --set dataset.path="$(realpath "$dataset")" \
    --set "dataset.blackout_s=[[10, 13]]" --set mapping.report_every_s=15 "$@" -o "$run" --overwrite
}

cd "$APVI_ROOT"
build_cpu --target apvi
say "Simulating a dive into $output/dataset"
mkdir -p "$output"
make_demo_data "$output/dataset"
say "Localizing the vehicle and building the map; the camera is dark from 10 to 13 s"
run_demo "$output/dataset" "$output/run" "$@"
say "Drawing the report"
/usr/bin/python3 scripts/report.py "$output/run"
say "What came of it"
/usr/bin/python3 scripts/explain_run.py "$output/run"
cat <<END

Look at
  $output/run/report.html     all of it as pictures; opens in any browser, also on a phone
  $output/run/map.ply         the map, for any viewer of Gaussian splats
  $output/run/trajectory.tum  the poses: time, position, quaternion
  $output/run/renders/        held-out views: what the camera saw, the map, the map without water, depth
END
