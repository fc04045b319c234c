#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Runs an installed program as a user would, in a new folder: program_test.sh PROGRAM [FOLDER]. With a FOLDER, the
# dive has a camera and a map, and dive and run stay there.
set -euo pipefail

apvi="$1"
folder="${2:-}"
prefix="$(realpath "$(dirname "$apvi")/..")"
if [[ -z "$folder" ]]; then
  folder="$(mktemp -d)"
  trap 'rm -rf "$folder"' EXIT
fi
mkdir -p "$folder"
cd "$folder"

fail() {
  echo "$*" >&2
  exit 1
}

"$apvi" --version
# The installed configurations are found from any folder, by a command and by a file of the user.
echo 'inherit: default.yaml' >own.yaml
echo 'inherit: configs/datasets/akit.yaml' >own_akit.yaml
"$apvi" config --check own.yaml own_akit.yaml configs/localization.yaml scenes/dam_easy.yaml sweeps/seeds.yaml

# Man page and licenses are there; the page describes every command.
man="$prefix/share/man/man1/apvi.1.gz"
if [[ -f "$man" ]]; then
  for command in run live eval doctor import sim sweep calibrate 'camera fit' config; do
    zgrep -qxF ".SS apvi $command" "$man" || fail "$man does not describe $command"
  done
fi
grep -q '^BSD 3-Clause License' "$prefix/share/doc/apvi/copyright"
grep -q '^Third-party notices' "$prefix/share/doc/apvi/copyright"

# A dive: simulated, diagnosed, localized, mapped if it has a camera, with a report.
if (($# > 1)); then
  "$apvi" -q sim scenes/seabed_easy.yaml -o dive --set duration_s=15 \
    --set "rig.cam0.resolution=[320, 240]" --set "rig.cam0.intrinsics=[210, 210, 159.5, 119.5]"
  configuration=default.yaml
else
  "$apvi" -q sim scenes/seabed_easy.yaml -o dive --set duration_s=4 --set rig.cam0=null
  configuration=localization.yaml
fi
"$apvi" -q doctor dive
"$apvi" -q run "$configuration" --set dataset.path=dive -o run
[[ -s run/trajectory.tum ]] || fail "the run has no trajectory"
(($# == 1)) || [[ -s run/map.ply ]] || fail "the run has no map"
if /usr/bin/python3 -c 'import jinja2, matplotlib, numpy' 2>/dev/null; then
  grep -q '</html>' run/report.html || fail "the run has no report"
  [[ -z "$(find "$prefix/share/apvi" -name __pycache__)" ]] || fail "the report leaves files in the installation"
fi
