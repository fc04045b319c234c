#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs the Debian packages the project needs and this machine lacks, and makes the weights of LPIPS;
# does nothing when all are there.
set -euo pipefail

scripts="$(cd "$(dirname "$0")" && pwd)"
list="$scripts/packages.txt"

usage() {
  cat <<END
usage: scripts/setup.sh [--check | --cuda]
Installs the packages of scripts/packages.txt that are missing (apt, with sudo unless root), and makes
the weights of LPIPS (scripts/make_lpips_weights.py) where they are not made; APVI_LPIPS=none: does not.
  --check   installs and makes nothing: names what is missing and ends with status 1 if a package is
  --cuda    besides, puts a LibTorch with CUDA into build/torch-cuda (pip; APVI_CUDA_TORCH=FOLDER: there) and
            says how to build with it; needs the CUDA toolkit (nvcc) to build, no GPU
END
}

wanted_packages() { sed -e 's/#.*//' -e '/^[[:space:]]*$/d' "$list"; }

missing_packages() {
  local installed
  installed="$(dpkg-query --show --showformat='${db:Status-Status} ${Package}\n' 2>/dev/null |
    sed -n 's/^installed //p')"
  wanted_packages | grep -vxF "$installed" || true
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

# Judging renderings by LPIPS is all that needs them: without, and without a network, the rest goes on.
lpips_weights() {
  [[ "${APVI_LPIPS:-}" != none ]] || return 0
  python3 "$scripts/make_lpips_weights.py" "$@" ||
    echo "setup: without the weights of LPIPS, that metric will be n/a"
}

# A LibTorch with CUDA, of Python's torch package. What only its other parts need stays out when the toolkit
# has the libraries already.
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
  [[ -d "$torch" ]] || { echo "error: pip left no torch in $venv" >&2; exit 1; }
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
  echo "error: this is no Debian system: install what scripts/packages.txt names by other means" >&2
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
  echo "setup: fetching the package lists"
  as_root apt-get update -q
fi
echo "setup: installing ${#missing[@]} packages"
install_packages "${missing[@]}" || {
  echo "setup: trying again with fresh package lists"
  as_root apt-get update -q
  install_packages "${missing[@]}"
}
lpips_weights
[[ "${1:-}" != --cuda ]] || cuda_torch
echo "setup: done"
