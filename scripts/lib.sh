# SPDX-License-Identifier: BSD-3-Clause
# What the scripts share; sourced, never run.

APVI_ROOT="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"

say() { printf '\n== %s\n' "$*"; }
die() {
  printf 'error: %s\n' "$*" >&2
  exit 1
}

# How many compilers at once: as many as there are processors, unless APVI_JOBS says otherwise; at
# most one for each 1.5 GiB of free memory, which is what a file that includes LibTorch takes.
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

# Installs what is missing, configures the preset `cpu`, and builds it.
build_cpu() {
  "$APVI_ROOT/scripts/setup.sh"
  say "Configuring build/cpu (preset cpu)"
  (cd "$APVI_ROOT" && cmake --preset cpu -DAPVI_WERROR="${APVI_WERROR:-OFF}" --log-level=WARNING)
  local jobs
  jobs="$(jobs_for_build)"
  say "Building with $jobs at once"
  cmake --build "$APVI_ROOT/build/cpu" --parallel "$jobs" "$@"
}
