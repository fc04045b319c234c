#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs the Debian packages the project needs and this machine lacks, and makes the weights of LPIPS;
# does nothing when all are there.
set -euo pipefail

scripts="$(cd "$(dirname "$0")" && pwd)"
list="$scripts/packages.txt"

usage() {
  cat <<END
usage: scripts/setup.sh [--check]
Installs the packages of scripts/packages.txt that are missing (apt, with sudo unless root), and makes
the weights of LPIPS (scripts/make_lpips_weights.py) where they are not made; APVI_LPIPS=none: does not.
  --check   installs and makes nothing: names what is missing and ends with status 1 if a package is
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

case "${1:-}" in
  "" | --check) ;;
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
  lpips_weights "$@"
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
echo "setup: done"
