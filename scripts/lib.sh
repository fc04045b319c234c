# SPDX-License-Identifier: BSD-3-Clause
# Functions shared by the scripts; to be sourced.

APVI_ROOT="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"

say() { printf '\n== %s\n' "$*"; }
die() {
  printf 'error: %s\n' "$*" >&2
  exit 1
}

# Number of parallel compilers: APVI_JOBS if set, else the number of processors, but at most one per
# 1.5 GiB of free memory, which a file that includes LibTorch needs.
jobs_for_build() {
  if [[ -n "${APVI_JOBS:-}" ]]; then
    echo "$APVI_JOBS"
    return
  fi
  local processors by_memory
  processors="$(nproc)"
  by_memory="$(awk '/^MemAvailable:/ { print int($2 / 1572864) }' /proc/meminfo)"
  ((by_memory >= 1)) || by_memory=1
  echo $((processors < by_memory ? processors : by_memory))
}

# Installs missing packages, configures the preset `cpu`, and builds it.
build_cpu() {
  "$APVI_ROOT/scripts/setup.sh"
  say "Configuring build/cpu (preset cpu)"
  (cd "$APVI_ROOT" && cmake --preset cpu -DAPVI_WERROR="${APVI_WERROR:-OFF}" --log-level=WARNING)
  local jobs
  jobs="$(jobs_for_build)"
  say "Building with $jobs parallel jobs"
  cmake --build "$APVI_ROOT/build/cpu" --parallel "$jobs" "$@"
}
