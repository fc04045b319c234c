// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/core/error.hpp"
#include "cli/mapping_support.hpp"

namespace apvi::cli {

std::optional<runs::RunResult> localize_and_map(const runs::RunConfig&, io::SequenceReader&,
                                                const MappingRequest&) {
  return std::nullopt;
}

void make_map(const runs::RunConfig&, const MappingRequest&) {
  fail_input(
      "localization.enabled: false: mapping with given poses is not available in this build "
      "(APVI_MAPPING=OFF)");
}

}  // namespace apvi::cli
