// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/core/error.hpp"
#include "mapping_half.hpp"

namespace apvi::apps {

bool wants_map(const RunConfig&) {
  return false;
}

std::optional<pipeline::RunResult> localize_and_map(const RunConfig&, const MapRequest&) {
  return std::nullopt;
}

void make_map(const RunConfig&, const MapRequest&) {
  fail_input(
      "localization.enabled: false: maps with given poses need the mapping half, which this build "
      "leaves out (APVI_MAPPING=OFF)");
}

}  // namespace apvi::apps
