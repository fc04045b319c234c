// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <optional>

#include "runs/run.hpp"
#include "runs/run_config.hpp"

/// Mapping functions of `apvi run`; a build without LibTorch has none.
namespace apvi::cli {

struct MappingRequest {
  std::filesystem::path folder;
  bool overwrite = false;
  bool resume = false;
  std::function<bool()> interrupted;
  const runs::LiveHooks* live = nullptr;
};

/// Runs localization and mapping together and logs the map's result. Returns nothing when a map was
/// only refined further.
std::optional<runs::RunResult> localize_and_map(const runs::RunConfig& config,
                                                io::SequenceReader& recording,
                                                const MappingRequest& request);
/// Builds a map with given poses and logs the result. Throws InputError in a build without mapping.
void make_map(const runs::RunConfig& config, const MappingRequest& request);

}  // namespace apvi::cli
