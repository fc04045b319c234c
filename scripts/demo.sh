#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs what is missing, builds, makes a simulated dive, and localizes the vehicle in it.
set -euo pipefail
source "$(dirname "$0")/lib.sh"

usage() {
  cat <<END
usage: scripts/demo.sh [-o FOLDER] [APVI RUN ARGUMENTS...]
Installs what is missing, builds into build/cpu, simulates a dive with IMU, DVL and pressure sensor,
runs the localization on it, prints the metrics against the simulated truth, and draws the report.
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

# The input: a dive of the simulator, made once.
make_demo_data() {
  local dataset="$1"
  if [[ -f "$dataset/rig.yaml" ]]; then
    echo "demo: $dataset is there already"
    return
  fi
  # No images: this version localizes without a camera.
  apvi sim "$APVI_ROOT/configs/scenes/seabed_easy.yaml" -o "$dataset" --no-images
}

run_demo() {
  local dataset="$1" run="$2"
  shift 2
  apvi run "$APVI_ROOT/configs/default.yaml" --set dataset.path="$(realpath "$dataset")" "$@" -o "$run" --overwrite
}

cd "$APVI_ROOT"
build_cpu
say "Simulating a dive into $output/dataset"
mkdir -p "$output"
make_demo_data "$output/dataset"
say "Localizing the vehicle"
run_demo "$output/dataset" "$output/run" "$@"
say "Drawing the report"
/usr/bin/python3 scripts/report.py "$output/run"
say "The report is $output/run/report.html, the trajectory $output/run/trajectory.tum"
