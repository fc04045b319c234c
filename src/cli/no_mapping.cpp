// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/core/error.hpp"
#include "cli/commands.hpp"
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

std::string eval_patches(const std::filesystem::path&, const std::filesystem::path&, bool) {
  fail_input("--patches: this build has no mapping (APVI_MAPPING=OFF)");
}

std::unique_ptr<runs::RunObserver> open_view(const std::filesystem::path&,
                                             const ViewOptions& options) {
  if (options.port) fail_input("--view: this build has no mapping (APVI_MAPPING=OFF)");
  return nullptr;
}

void add_view(CLI::App& app) {
  CLI::App* command = app.add_subcommand("view", "show a map in a browser (not in this build)");
  command->allow_extras();
  command->callback([] {
    fail_input("view: this build has no mapping (APVI_MAPPING=OFF); build with APVI_MAPPING=ON");
  });
}

}  // namespace apvi::cli
