#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs missing packages, builds, simulates a dive over a reef, and computes trajectory, map and report.
set -euo pipefail
source "$(dirname "$0")/lib.sh"

usage() {
  cat <<END
usage: scripts/demo.sh [-o FOLDER] [APVI RUN ARGUMENTS...]
Installs missing packages, builds into build/cpu, simulates 20 s of a dive over a reef (camera, IMU, DVL,
pressure) with a camera outage of three seconds, runs localization and mapping, compares both with the
ground truth, and creates the report.
  -o FOLDER   output folder for the dataset and the run (default: runs/demo)
Further arguments are passed to \`apvi run\`, for example --set run.seed=2. Environment: APVI_JOBS.
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

apvi() { "$APVI_ROOT/build/cpu/bin/apvi" "$@"; }

# Simulates the dataset unless it exists; small images, so that two cores are fast enough.
make_demo_data() {
  local dataset="$1"
  if [[ -f "$dataset/rig.yaml" ]]; then
    echo "demo: $dataset exists already"
    return
  fi
  apvi sim "$APVI_ROOT/configs/scenes/seabed_easy.yaml" -o "$dataset" --set duration_s=20 \
    --set "rig.cam0.resolution=[320, 240]" --set "rig.cam0.intrinsics=[210, 210, 159.5, 119.5]"
}

run_demo() {
  local dataset="$1" run="$2"
  shift 2
  apvi run "$dataset" --set "dataset.blackout_s=[[10, 13]]" --set mapping.report_every_s=15 "$@" \
    -o "$run" --overwrite
}

cd "$APVI_ROOT"
build_cpu --target apvi
say "Simulating a dive into $output/dataset"
mkdir -p "$output"
make_demo_data "$output/dataset"
say "Running localization and mapping; the camera is dark from 10 to 13 s"
run_demo "$output/dataset" "$output/run" "$@"
say "Results"
/usr/bin/python3 scripts/explain_run.py "$output/run"
cat <<END

Output:
  $output/run/report.html     report with figures, for any browser
  $output/run/map.ply         the map, for any Gaussian splatting viewer
  $output/run/trajectory.tum  the poses: time, position, quaternion
  $output/run/renders/        held-out views: camera image, map, map without water, depth
END
