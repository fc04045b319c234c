#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Checks without a compiler: formatting, license headers, module dependencies, lengths, language, prose, forbidden code.
set -uo pipefail
cd "$(dirname "$0")/.."

all=(format license layers lengths language prose code)

usage() {
  cat <<END
usage: scripts/check_style.sh [PART...]
Checks all files that git does not ignore. Parts: ${all[*]} (default: all)
END
}

failures=0
fail() {
  echo "style: $*" >&2
  failures=$((failures + 1))
}

# files PATTERN...: names of files that are not ignored by git, NUL-separated.
files() { git ls-files -z --cached --others --exclude-standard -- "$@" | existing; }
existing() { while IFS= read -r -d '' name; do [[ -f "$name" ]] && printf '%s\0' "$name"; done; }

# forbid WHY REGEX PATTERN...: fails if a line of these files matches.
forbid() {
  local why="$1" regex="$2"
  shift 2
  if files "$@" | xargs -0 -r grep -nHP -- "$regex" >&2; then
    fail "$why"
  fi
}

check_format() {
  local version
  version="$(clang-format --version | grep -oP 'version \K\d+')"
  if [[ "$version" != 14 ]]; then
    echo "style: formatting is not checked: clang-format 14 is required, found $version"
    return
  fi
  files '*.hpp' '*.cpp' '*.cu' '*.cuh' | xargs -0 -r clang-format --dry-run -Werror ||
    fail "run clang-format -i on the files above"
}

check_license() {
  local name
  while IFS= read -r -d '' name; do
    head -n 2 "$name" | grep -q 'SPDX-License-Identifier: BSD-3-Clause' ||
      fail "$name: license header missing (SPDX-License-Identifier: BSD-3-Clause)"
  done < <(files '*.hpp' '*.cpp' '*.cu' '*.cuh' '*.py' '*.sh' '*.cmake')
}

check_layers() { python3 scripts/check_layers.py || fail "forbidden includes, see above"; }

check_lengths() { python3 scripts/size_gate.py || fail "split the functions or files above"; }

check_language() { python3 scripts/check_language.py || fail "words to replace, see above"; }

check_prose() { python3 scripts/check_prose.py || fail "wrap the lines above at 100 characters"; }

check_code() {
  forbid "no 'using namespace' in headers" '^\s*using\s+namespace\b' '*.hpp' '*.cuh'
  forbid "headers use #pragma once" '^#ifndef \w+_(H|HPP)_?$' '*.hpp' '*.cuh'
  forbid "errors are exceptions: no exit or abort" \
    '(?<![.\w])(std::)?(exit|abort|quick_exit|_Exit)\(' \
    'src/*.cpp' 'src/*.hpp' 'include/*.hpp' 'kernels/*' 'cpu_fallback/*'
  forbid "no TODOs or stubs" '\b(TODO|FIXME|XXX|HACK)\b|\b[Ss]tub(s|bed)?\b' \
    '*' ':!scripts/check_style.sh'
  forbid "no machine-specific paths" '(?<![\w.])/(home|root|work|Users|mnt)/\w' '*' ':!scripts/check_style.sh'
  forbid "no tabs, no trailing whitespace" '\t| +$' '*.hpp' '*.cpp' '*.cu' '*.py' '*.sh' '*.cmake' '*.txt' \
    '*.yaml' '*.md'
}

case "${1:-}" in
  -h | --help)
    usage
    exit 0
    ;;
esac
parts=("${all[@]}")
(($# > 0)) && parts=("$@")
for part in "${parts[@]}"; do
  declare -F "check_$part" >/dev/null || { usage >&2; exit 2; }
done
for part in "${parts[@]}"; do
  "check_$part"
done

if ((failures > 0)); then
  echo "style: $failures checks failed" >&2
  exit 1
fi
echo "style: clean"
