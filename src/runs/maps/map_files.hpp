// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "eval/metrics_file.hpp"
#include "gaussians/device.hpp"
#include "map_io/origin.hpp"
#include "mapping/evaluation.hpp"
#include "mapping/rendering.hpp"
#include "runs/run_config.hpp"
#include "runs/run_folder.hpp"

namespace apvi::runs {

/// Creates the folder of the rendered held-out images. Throws RunError on failure.
std::filesystem::path make_renders_folder(const std::filesystem::path& run);

/// Throws RunError for device out of memory, naming the settings to lower.
[[noreturn]] void fail_out_of_memory(const RunConfig& config, const std::filesystem::path& folder);

/// Returns `work()`; turns a device out-of-memory error into fail_out_of_memory.
template <typename Work>
auto with_oom_message(const RunConfig& config, const std::filesystem::path& folder,
                      const Work& work) {
  try {
    return work();
  } catch (const c10::Error& error) {
    if (!gaussians::is_out_of_memory(error)) throw;
    fail_out_of_memory(config, folder);
  }
}

/// Saves while another error is being handled: a failure to save is only logged.
void save_or_log(const std::function<void()>& save);

/// Writes map.ply, medium.json with a medium, and origin.json with an origin that is not zero.
/// Throws RunError when they cannot be written.
void write_map(const std::filesystem::path& folder, const mapping::Map& map,
               const map_io::Origin& origin = {});

/// PSNR of the held-out images and medium parameters over time: mapping.csv.
class MappingLog {
 public:
  /// `every_s` 0: only the header is written. `append`: appends to an existing file.
  MappingLog(std::filesystem::path file, double every_s, bool append);

  /// Whether a line is due at this time [s].
  bool due(double seconds) const { return every_s_ > 0.0 && seconds - reported_s_ >= every_s_; }
  void write(double seconds, std::int64_t iteration, const mapping::Map& map,
             const mapping::KeyframeStore& keyframes);
  /// Throws RunError when something could not be written (disk full).
  void close();
  /// Time from which the next interval is counted.
  void start_at(double seconds) { reported_s_ = seconds; }

 private:
  std::filesystem::path file_;
  double every_s_;
  double reported_s_ = 0.0;
  std::ofstream out_;
};

/// The Gaussian limit of a mapper or trainer, if memory reduced it below the configured one.
std::optional<std::int64_t> reduced_limit(std::int64_t most, const RunConfig& config);

/// Figures of a map for metrics.json.
struct MapMetrics {
  eval::Json held_out;  ///< from report_held_out
  std::int64_t gaussians = 0;
  std::optional<std::int64_t> reduced_max_gaussians = std::nullopt;  ///< see reduced_limit
  std::int64_t iterations = 0;
  double training_s = 0.0;  ///< in optimization steps
  double wall_s = 0.0;
  bool wants_medium = false;  ///< whether a medium was to be estimated
  std::optional<medium::Medium> medium;
  std::optional<medium::Medium> true_medium;
  std::optional<std::size_t> dropped_keyframes = std::nullopt;
  std::optional<std::size_t> closed_loops = std::nullopt;
  std::map<std::string, std::size_t> not_mapped = {};  ///< rejected keyframes by reason
  std::map<std::string, double> times = {};            ///< of the mapping thread by activity [s]
};

/// Merges the figures into metrics.json; the sections of localization stay.
void write_map_metrics(const std::filesystem::path& file, const MapMetrics& figures);

}  // namespace apvi::runs
