#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs missing packages, builds, and runs all tests that need no GPU.
set -euo pipefail
source "$(dirname "$0")/lib.sh"

usage() {
  cat <<END
usage: scripts/test.sh [CTEST ARGUMENTS...]
Installs missing packages, builds into build/cpu, and runs all tests that need no GPU.
  scripts/test.sh -L quick      only the quick tests
  scripts/test.sh -R geometry   only tests with matching names
Environment: APVI_JOBS (parallel compilers and tests), APVI_WERROR=ON (warnings are errors),
APVI_TEST_DATA (folder with real recordings; default: shared/data beside the repository, if it exists;
tests that need them are skipped without it).
END
}

case "${1:-}" in
  -h | --help)
    usage
    exit 0
    ;;
esac

build_cpu
say "Testing"
cd "$APVI_ROOT"
recordings="$(dirname "$APVI_ROOT")/shared/data"
[[ -n "${APVI_TEST_DATA:-}" || ! -d "$recordings" ]] || export APVI_TEST_DATA="$recordings"

# The ten tests that took longest [s], from the lines <testcase name="..." time="...">.
slowest() {
  sed -nE 's/^\s*<testcase name="([^"]*)".* time="([0-9.]+)".*/\2 \1/p' build/cpu/tests.xml | sort -rn | head -n 10
}

status=0
ctest --preset cpu --parallel "${APVI_JOBS:-$(nproc)}" --output-junit tests.xml "$@" || status=$?

# Counts from the <testsuite> line; skipped tests need a recording or a device that is not available.
count() { grep -oP "^\s*$1=\"\K\d+" build/cpu/tests.xml | head -n 1; }
if [[ -f build/cpu/tests.xml ]]; then
  printf '\nslowest tests [s]:\n%s\n\n' "$(slowest)"
  skipped="$(($(count skipped) + $(count disabled)))"
  echo "$(($(count tests) - $(count failures) - skipped)) passed, $(count failures) failed, $skipped skipped"
fi
exit "$status"
