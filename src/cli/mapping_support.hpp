// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>

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
  runs::RunObserver* observer = nullptr;
};

/// Options `--view` of the commands that run.
struct ViewOptions {
  std::optional<int> port;  ///< empty: no page is served
  std::string address = "127.0.0.1";
};
/// The page that shows a run while it is made; null when `options` ask for none. Throws InputError
/// in a build without mapping.
std::unique_ptr<runs::RunObserver> open_view(const std::filesystem::path& run,
                                             const ViewOptions& options);

/// Runs localization and mapping together and logs the map's result. Returns nothing when a map was
/// only refined further.
std::optional<runs::RunResult> localize_and_map(const runs::RunConfig& config,
                                                io::SequenceReader& recording,
                                                const MappingRequest& request);
/// Compares the colors of patches in the images of a run with known ones, adds the result to its
/// metrics.json and returns it as JSON, or as a table. Throws InputError in a build without
/// mapping.
std::string eval_patches(const std::filesystem::path& run, const std::filesystem::path& patches,
                         bool json);
/// Builds a map with given poses and logs the result. Throws InputError in a build without mapping.
void make_map(const runs::RunConfig& config, const MappingRequest& request);

}  // namespace apvi::cli
