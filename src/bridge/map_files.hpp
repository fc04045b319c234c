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

#include "apvi/bridge/run_config.hpp"
#include "apvi/eval/metrics_file.hpp"
#include "apvi/mapping/evaluation.hpp"
#include "apvi/mapping/rendering.hpp"
#include "apvi/splat/device.hpp"

namespace apvi::bridge {

/// What a run with a map goes on from, in its folder.
inline constexpr const char* kCheckpoint = "checkpoint.pt";

/// Makes the folder of the held-out images. Throws RunError when it cannot be made.
std::filesystem::path make_renders_folder(const std::filesystem::path& run);

/// Says what to lower when the device's memory has ended: throws RunError.
[[noreturn]] void fail_memory(const RunConfig& config, const std::filesystem::path& folder);

/// What `work` returns; where the device's memory ends in it, what to lower is said.
template <typename Work>
auto within_memory(const RunConfig& config, const std::filesystem::path& folder, const Work& work) {
  try {
    return work();
  } catch (const c10::Error& error) {
    if (!splat::is_out_of_memory(error)) throw;
    fail_memory(config, folder);
  }
}

/// Saves what there is when something is to be complained of already: that it cannot be saved
/// either is only logged.
void rescue(const std::function<void()>& save);

/// Writes map.ply and, with water, medium.json. Throws RunError when they cannot be written.
void write_map(const std::filesystem::path& folder, const mapping::Map& map);

/// The held-out images' PSNR, and the water as it is learnt, over time: mapping.csv.
class MapCurve {
 public:
  /// `every_s` 0: nothing but the header is ever written. `append`: goes on with what is there.
  MapCurve(std::filesystem::path file, double every_s, bool append);

  /// Whether a line is due after so much time [s].
  bool due(double seconds) const { return every_s_ > 0.0 && seconds - reported_s_ >= every_s_; }
  void write(double seconds, std::int64_t iteration, const mapping::Map& map,
             const mapping::KeyframeStore& keyframes);
  /// Throws RunError when something could not be written (disk full).
  void close();
  /// What was before counts as reported.
  void start_at(double seconds) { reported_s_ = seconds; }

 private:
  std::filesystem::path file_;
  double every_s_;
  double reported_s_ = 0.0;
  std::ofstream out_;
};

/// What `most_gaussians` of a mapper or trainer is, where memory has made it less than configured.
std::optional<std::int64_t> set_by_memory(std::int64_t most, const RunConfig& config);

/// What a run with a map says of it in metrics.json.
struct MapFigures {
  eval::Json held_out;  ///< from report_held_out
  std::int64_t gaussians = 0;
  std::optional<std::int64_t> most_gaussians = std::nullopt;  ///< see set_by_memory
  std::int64_t iterations = 0;
  double training_s = 0.0;  ///< in optimisation steps
  double wall_s = 0.0;
  std::optional<splat::Medium> medium;
  std::optional<splat::Medium> true_medium;
  std::optional<std::size_t> dropped_keyframes = std::nullopt;
  std::optional<std::size_t> closed_loops = std::nullopt;
  std::map<std::string, std::size_t> not_mapped = {};  ///< keyframes, by why
  std::map<std::string, double> times = {};            ///< of the mapper's thread [s], by activity
};

/// Lays the figures over metrics.json; what localization has written there stays.
void write_map_metrics(const std::filesystem::path& file, const MapFigures& figures);

}  // namespace apvi::bridge
