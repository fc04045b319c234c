# SPDX-License-Identifier: BSD-3-Clause
# Minimal systems of Debian releases in folders, for tests on a clean machine; to be sourced. They need root.

systems="${APVI_SYSTEMS:-${XDG_CACHE_HOME:-$HOME/.cache}/apvi/systems}"

# Prints why no system can be made here; fails if one can.
why_no_systems() {
  if [[ "$(id -u)" != 0 ]]; then
    echo "needs root"
  elif ! command -v debootstrap >/dev/null; then
    echo "debootstrap is not installed"
  elif ! unshare --mount true 2>/dev/null; then
    echo "no mount namespaces here"
  else
    return 1
  fi
}

# minimal_system RELEASE: makes $systems/RELEASE unless it exists: Debian's minimal packages, nothing else.
minimal_system() {
  local folder="$systems/$1"
  [[ ! -d "$folder" ]] || return 0
  mkdir -p "$systems" && rm -rf --one-file-system "$folder.part" &&
    debootstrap --variant=minbase "$1" "$folder.part" >"$folder.log" 2>&1 && mv "$folder.part" "$folder" ||
    { tail -n 5 "$folder.log"; return 1; }
}

# in_system FOLDER COMMAND...: runs a command as root of that system, with this repository at /src, read-only.
in_system() {
  mkdir -p "$1/src"
  # shellcheck disable=SC2016  # expanded by the inner shell
  unshare --mount bash -c 'set -e
    system="$1"; shift
    mount -t proc proc "$system/proc"
    mount --rbind /dev "$system/dev"
    mount --bind "$PWD" "$system/src"
    mount -o remount,bind,ro "$system/src"
    exec chroot "$system" /usr/bin/env -i HOME=/root LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive \
      PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin "$@"' - "$@"
}
