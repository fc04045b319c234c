#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Checks that need no compiler: formatting, module boundaries, headers, words, lengths.
set -uo pipefail
cd "$(dirname "$0")/.."

case "${1:-}" in
  "") ;;
  -h | --help)
    echo "usage: scripts/check_style.sh    (all files that git tracks or would track)"
    exit 0
    ;;
  *)
    echo "usage: scripts/check_style.sh" >&2
    exit 2
    ;;
esac

failures=0
fail() {
  echo "style: $*" >&2
  failures=$((failures + 1))
}

# files PATTERN...: names of files of ours, NUL-separated.
files() { git ls-files -z --cached --others --exclude-standard -- "$@" | existing; }
existing() { while IFS= read -r -d '' name; do [[ -f "$name" ]] && printf '%s\0' "$name"; done; }

# forbid WHY REGEX PATTERN...: no such file may have a line that matches.
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
    echo "style: clang-format $version is here, 14 decides: formatting is not checked"
    return
  fi
  files '*.hpp' '*.cpp' '*.cu' '*.cuh' | xargs -0 -r clang-format --dry-run -Werror ||
    fail "clang-format -i the files above"
}

check_spdx() {
  local name
  while IFS= read -r -d '' name; do
    head -n 2 "$name" | grep -q 'SPDX-License-Identifier: BSD-3-Clause' ||
      fail "$name: the first line names no licence (SPDX-License-Identifier: BSD-3-Clause)"
  done < <(files '*.hpp' '*.cpp' '*.cu' '*.cuh' '*.py' '*.sh' '*.cmake')
}

check_format
check_spdx
python3 scripts/check_layers.py || fail "a module includes what it must not know"
python3 scripts/size_gate.py || fail "split what is too long"
forbid "no 'using namespace' in headers" '^\s*using\s+namespace\b' '*.hpp' '*.cuh'
forbid "headers start with #pragma once" '^#ifndef \w+_(H|HPP)_?$' '*.hpp' '*.cuh'
forbid "errors are exceptions: nothing exits or aborts" \
  '(?<![.\w])(std::)?(exit|abort|quick_exit|_Exit)\(' \
  'src/*.cpp' 'src/*.hpp' 'include/*.hpp' 'kernels/*' 'cpu_fallback/*'
forbid "finish it, or leave it out" '\b(TODO|FIXME|XXX|HACK)\b|\b[Ss]tub(s|bed)?\b' \
  '*' ':!scripts/check_style.sh'
forbid "paths of one machine" '(?<![\w.])/(home|root|work|Users|mnt)/\w' '*' ':!scripts/check_style.sh'
forbid "no tabs, no spaces at the end of a line" '\t| +$' '*.hpp' '*.cpp' '*.cu' '*.py' '*.sh' '*.cmake' '*.txt' \
  '*.yaml' '*.md'

if ((failures > 0)); then
  echo "style: $failures kinds of complaint" >&2
  exit 1
fi
echo "style: clean"
