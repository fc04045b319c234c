#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs what is missing, builds, and runs every test that a machine without a GPU can run.
set -euo pipefail
source "$(dirname "$0")/lib.sh"

usage() {
  cat <<END
usage: scripts/test.sh [CTEST ARGUMENTS...]
Installs what is missing, builds into build/cpu, and runs the tests but those labelled cuda and long.
  scripts/test.sh -L quick      the quick ones only
  scripts/test.sh -R geometry   those whose name matches
Environment: APVI_JOBS (compilers and tests at once), APVI_WERROR=ON (warnings are errors),
APVI_TEST_DATA (a folder of real recordings; tests that need them skip without).
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
status=0
ctest --preset cpu --parallel "${APVI_JOBS:-$(nproc)}" --output-junit tests.xml "$@" || status=$?

# The counts of the <testsuite> line; what is skipped needed a recording or a device that is not here.
count() { grep -oP "^\s*$1=\"\K\d+" build/cpu/tests.xml | head -n 1; }
if [[ -f build/cpu/tests.xml ]]; then
  skipped="$(($(count skipped) + $(count disabled)))"
  echo "$(($(count tests) - $(count failures) - skipped)) passed, $(count failures) failed, $skipped skipped"
fi
exit "$status"
