// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <optional>

#include "apvi/pipeline/run.hpp"

#if APVI_WITH_MAPPING
#include "apvi/bridge/run_config.hpp"
#else
#include "apvi/pipeline/run_config.hpp"
#endif

/// What `apvi run` and `apvi config` do of mapping; in a build without it they know no such keys.
namespace apvi::apps {

#if APVI_WITH_MAPPING
using bridge::load_run_config;
using bridge::RunConfig;
#else
using pipeline::load_run_config;
using pipeline::RunConfig;
#endif

struct MapRequest {
  std::filesystem::path folder;
  bool overwrite = false;
  bool resume = false;
  std::function<bool()> interrupted;
};

/// Whether the configuration asks for a map.
bool wants_map(const RunConfig& config);
/// Localization and mapping together; logs how the map went. Nothing when a map was only refined
/// further.
std::optional<pipeline::RunResult> localize_and_map(const RunConfig& config,
                                                    const MapRequest& request);
/// Makes a map with given poses and logs how it went. Throws InputError in a build without mapping.
void make_map(const RunConfig& config, const MapRequest& request);

}  // namespace apvi::apps
