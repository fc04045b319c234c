#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs missing packages and creates the LPIPS weight files; does nothing if all exist.
set -euo pipefail

scripts="$(cd "$(dirname "$0")" && pwd)"
root="$(cd "$scripts/.." && pwd)"
list="$scripts/packages.txt"

usage() {
  cat <<END
usage: scripts/setup.sh [--check | --cuda | --torch pip]
Installs missing packages of scripts/packages.txt (apt, with sudo unless root) and creates missing LPIPS
weight files (scripts/make_lpips_weights.py; skipped with APVI_LPIPS=none).
  --check      installs nothing: lists what is missing; exit status 1 if a package is missing
  --cuda       also installs a LibTorch with CUDA into build/torch-cuda (pip; or into APVI_CUDA_TORCH), for
               the version of nvcc found, and prints how to build with it; building needs no GPU
  --torch pip  instead of the package libtorch-dev, installs the Python package torch into build/torch-pip
               (1.3 GB, or into APVI_PIP_TORCH) for the preset cpu, and prints how to build with it
END
}

system_id() { sed -n "s/^$1=\"\?\([^\"]*\)\"\?\$/\1/p" /etc/os-release; }

# Names of the packages for this release.
wanted_packages() {
  local name release except
  release="$(system_id ID)-$(system_id VERSION_ID)"
  while read -r name except; do
    [[ -z "$name" || "$name" == '#'* ]] && continue
    [[ "$name" == libtorch-dev && "$torch_from" == pip ]] && continue
    [[ " $except " == *" $release "* ]] || echo "$name"
  done <"$list"
}

missing_packages() {
  local installed
  installed="$(dpkg-query --show --showformat='${db:Status-Status} ${Package}\n' 2>/dev/null |
    sed -n 's/^installed //p')"
  wanted_packages | grep -vxF "$installed" || true
}

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
    echo "setup: $(system_id PRETTY_NAME) has no package ${lacking[*]}; see docs/installation.md" >&2
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

# install_torch VENV PACKAGE...: prints the folder of torch. Without dependencies: only the named packages are needed.
install_torch() {
  local venv="$1" torch
  shift
  [[ -x "$venv/bin/python" ]] || python3 -m venv "$venv" >&2
  "$venv/bin/pip" install -q --no-deps "$@" >&2
  torch="$(echo "$venv"/lib/python3*/site-packages/torch)"
  [[ -d "$torch" ]] || { echo "error: pip did not install torch into $venv" >&2; exit 1; }
  echo "$torch"
}

# Major version of the CUDA toolkit; 13 without one.
cuda_version() {
  local version
  version="$(nvcc --version 2>/dev/null | sed -n 's/.*release \([0-9]*\)\..*/\1/p')"
  [[ -n "$version" ]] || echo "setup: nvcc is not on the PATH: install the CUDA toolkit, version 12 or 13" >&2
  echo "${version:-13}"
}

# LibTorch with CUDA, and those of its dependencies that the CUDA toolkit does not provide.
cuda_torch() {
  local packages torch version
  version="$(cuda_version)"
  case "$version" in
    12) packages=(torch==2.10.0 nvidia-cusparselt-cu12==0.7.1 nvidia-nvshmem-cu12==3.4.5 nvidia-cufile-cu12==1.13.1.3
                  nvidia-cudnn-cu12==9.10.2.21 nvidia-nccl-cu12==2.27.5) ;;
    13) packages=(torch==2.11.0 nvidia-cusparselt-cu13==0.8.0 nvidia-nvshmem-cu13==3.4.5 nvidia-cufile==1.15.1.6) ;;
    *)
      echo "error: nvcc has version $version; the Python package torch needs 12 or 13" >&2
      exit 1
      ;;
  esac
  torch="$(install_torch "${APVI_CUDA_TORCH:-$root/build/torch-cuda}" "${packages[@]}")"
  cat <<END
setup: LibTorch for CUDA $version is in $torch
  cmake --preset cuda -DCMAKE_PREFIX_PATH="$torch"
  cmake --build --preset cuda
END
}

# LibTorch for the CPU: the package has CUDA code, which is not used; its CPU part needs two small libraries of CUDA.
cpu_torch() {
  local torch
  torch="$(install_torch "${APVI_PIP_TORCH:-$root/build/torch-pip}" \
    torch==2.11.0 nvidia-cuda-runtime==13.0.96 nvidia-cuda-cupti==13.0.85)"
  cat <<END
setup: LibTorch is in $torch
  cmake --preset cpu -DCMAKE_PREFIX_PATH="$torch"
  cmake --build --preset cpu
END
}

# Steps after the installation of packages.
finish() {
  lpips_weights
  case "$torch_from" in
    cuda) cuda_torch ;;
    pip) cpu_torch ;;
  esac
}

torch_from=system
case "$*" in
  "" | --check) ;;
  --cuda) torch_from=cuda ;;
  "--torch pip") torch_from=pip ;;
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
    finish
  fi
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
finish
echo "setup: done"
