#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs missing packages and creates the LPIPS weight files; does nothing if all exist.
set -euo pipefail

scripts="$(cd "$(dirname "$0")" && pwd)"
list="$scripts/packages.txt"

usage() {
  cat <<END
usage: scripts/setup.sh [--check | --cuda]
Installs missing packages of scripts/packages.txt (apt, with sudo unless root) and creates missing LPIPS
weight files (scripts/make_lpips_weights.py; skipped with APVI_LPIPS=none).
  --check   installs nothing: lists what is missing; exit status 1 if a package is missing
  --cuda    also installs a LibTorch with CUDA into build/torch-cuda (pip; or into APVI_CUDA_TORCH) and
            prints how to build with it; building needs the CUDA toolkit (nvcc), but no GPU
END
}

wanted_packages() { sed -e 's/#.*//' -e '/^[[:space:]]*$/d' "$list"; }

missing_packages() {
  local installed
  installed="$(dpkg-query --show --showformat='${db:Status-Status} ${Package}\n' 2>/dev/null |
    sed -n 's/^installed //p')"
  wanted_packages | grep -vxF "$installed" || true
}

release() { sed -n 's/^PRETTY_NAME="\(.*\)"$/\1/p' /etc/os-release; }

# available_packages NAME...: those that this release has. Others are reported, not fatal: some are optional, and
# CMake names a library that it needs.
available_packages() {
  local name lacking=()
  for name in "$@"; do
    if apt-cache show "$name" >/dev/null 2>&1; then
      echo "$name"
    else
      lacking+=("$name")
    fi
  done
  ((${#lacking[@]} == 0)) ||
    echo "setup: $(release) has no package ${lacking[*]}; see docs/installation.md" >&2
}

as_root() {
  if [[ "$(id -u)" == 0 ]]; then
    "$@"
  else
    sudo "$@"
  fi
}

install_packages() {
  as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends "$@"
}

# Optional: only the LPIPS metric needs the weights.
lpips_weights() {
  [[ "${APVI_LPIPS:-}" != none ]] || return 0
  python3 "$scripts/make_lpips_weights.py" "$@" ||
    echo "setup: no LPIPS weights; the LPIPS metric will be unavailable"
}

# Installs LibTorch with CUDA from the Python package torch, with only those dependencies that the CUDA toolkit does
# not provide.
cuda_torch() {
  local root venv packages
  root="$(cd "$scripts/.." && pwd)"
  venv="${APVI_CUDA_TORCH:-$root/build/torch-cuda}"
  packages=(torch==2.11.0 nvidia-cusparselt-cu13==0.8.0 nvidia-nvshmem-cu13==3.4.5 nvidia-cufile==1.15.1.6)
  command -v nvcc >/dev/null || echo "setup: nvcc is not on the PATH: install the CUDA toolkit, version 13"
  [[ -x "$venv/bin/python" ]] || python3 -m venv "$venv"
  "$venv/bin/pip" install -q --no-deps "${packages[@]}"
  local torch
  torch="$(echo "$venv"/lib/python3*/site-packages/torch)"
  [[ -d "$torch" ]] || { echo "error: pip did not install torch into $venv" >&2; exit 1; }
  cat <<END
setup: LibTorch with CUDA is in $torch
  cmake --preset cuda -DCMAKE_PREFIX_PATH="$torch" -DCMAKE_CUDA_ARCHITECTURES=90
  cmake --build --preset cuda
END
}

case "${1:-}" in
  "" | --check | --cuda) ;;
  -h | --help)
    usage
    exit 0
    ;;
  *)
    usage >&2
    exit 2
    ;;
esac

if ! command -v dpkg-query >/dev/null || ! command -v apt-get >/dev/null; then
  echo "error: not a Debian-based system: install the packages of scripts/packages.txt by other means" >&2
  exit 1
fi

mapfile -t missing < <(missing_packages)
if ((${#missing[@]} == 0)); then
  echo "setup: all packages are installed"
  if [[ "${1:-}" == --check ]]; then
    lpips_weights --check
  else
    lpips_weights
  fi
  [[ "${1:-}" != --cuda ]] || cuda_torch
  exit 0
fi
echo "setup: missing: ${missing[*]}"
if [[ "${1:-}" == --check ]]; then
  exit 1
fi
if [[ "$(id -u)" != 0 ]] && ! command -v sudo >/dev/null; then
  echo "error: run as root: apt-get install --no-install-recommends ${missing[*]}" >&2
  exit 1
fi

if ! apt-cache show "${missing[@]}" >/dev/null 2>&1; then
  echo "setup: updating the package lists"
  as_root apt-get update -q
fi
mapfile -t missing < <(available_packages "${missing[@]}")
if ((${#missing[@]} > 0)); then
  echo "setup: installing ${#missing[@]} packages"
  install_packages "${missing[@]}" || {
    echo "setup: retrying with updated package lists"
    as_root apt-get update -q
    install_packages "${missing[@]}"
  }
fi
lpips_weights
[[ "${1:-}" != --cuda ]] || cuda_torch
echo "setup: done"
