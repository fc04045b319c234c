// SPDX-License-Identifier: BSD-3-Clause
#include "runs/maps/map_files.hpp"

#include <fmt/format.h>
#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <system_error>
#include <utility>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/version.hpp"
#include "core/memory.hpp"
#include "gaussians/device.hpp"
#include "map_io/map_file.hpp"
#include "map_io/ply.hpp"
#include "mapping/density/gaussian_limit.hpp"

namespace apvi::runs {
namespace {

constexpr const char* kHeader =
    "#time [s],iteration,gaussians,psnr_heldout [dB],beta_d_r [m^-1],beta_d_g [m^-1],"
    "beta_d_b [m^-1],beta_b_r [m^-1],beta_b_g [m^-1],beta_b_b [m^-1],b_inf_r,b_inf_g,b_inf_b\n";

std::vector<double> numbers(const torch::Tensor& values) {
  const torch::Tensor v = values.detach().to(torch::kCPU, torch::kFloat64).contiguous();
  return {v.data_ptr<double>(), v.data_ptr<double>() + v.numel()};
}

// The nine medium parameters as csv cells, empty without a medium.
std::string medium_cells(const std::optional<medium::Medium>& medium) {
  if (!medium) return std::string(9, ',');
  std::string cells;
  for (const torch::Tensor& values : {medium->beta_d, medium->beta_b, medium->b_inf}) {
    for (const double value : numbers(values)) cells += fmt::format(",{:.5g}", value);
  }
  return cells;
}

// Mean relative error of the nine medium parameters [%].
double error_percent(const medium::Medium& medium, const medium::Medium& truth) {
  double sum = 0.0;
  for (const auto& [estimate, expected] :
       {std::pair(medium.beta_d, truth.beta_d), std::pair(medium.beta_b, truth.beta_b),
        std::pair(medium.b_inf, truth.b_inf)}) {
    const std::vector<double> a = numbers(estimate);
    const std::vector<double> b = numbers(expected);
    for (std::size_t c = 0; c < 3; ++c) sum += std::abs(a[c] - b[c]) / std::max(1e-9, b[c]);
  }
  return 100.0 * sum / 9.0;
}

}  // namespace

std::filesystem::path make_renders_folder(const std::filesystem::path& run) {
  std::filesystem::path folder = run / "renders";
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) fail_run("{}: cannot create folder: {}", run.string(), error.message());
  return folder;
}

void fail_out_of_memory(const RunConfig& config, const std::filesystem::path& folder) {
  const auto memory = gaussians::device_memory();
  const std::string free =
      memory && memory->total_mib > 0.0
          ? fmt::format(" ({:.0f} of {:.0f} MiB free)", memory->free_mib, memory->total_mib)
          : "";
  const char* const saved =
      std::filesystem::exists(folder / "map.ply") ? "; the map so far is saved" : "";
  fail_run(
      "{}: out of memory on the device{}{}: lower mapping.max_gaussians (now {}) or "
      "mapping.image_scale",
      folder.string(), free, saved, mapping::gaussian_limit(config.mapping.trainer.densify));
}

std::optional<std::int64_t> reduced_limit(std::int64_t most, const RunConfig& config) {
  return most < mapping::gaussian_limit(config.mapping.trainer.densify) ? std::optional(most)
                                                                        : std::nullopt;
}

void save_or_log(const std::function<void()>& save) {
  try {
    save();
  } catch (const std::exception& error) {
    log::error("cannot save the map: {}", error.what());
  }
}

void write_map(const std::filesystem::path& folder, const mapping::Map& map,
               const map_io::Origin& origin) {
  map_io::write_ply(folder / "map.ply", map.gaussians, map.medium, origin,
                    {.tone_curve = map.tone_curve, .vignetting = map.vignetting});
  map_io::write_origin_json(folder / "origin.json", origin);
  if (map.medium) map_io::write_medium_json(folder / "medium.json", *map.medium);
}

MappingLog::MappingLog(std::filesystem::path file, double every_s, bool append)
    : file_(std::move(file)),
      every_s_(every_s),
      out_(file_, append ? std::ios::app : std::ios::out) {
  if (out_.tellp() == 0) out_ << kHeader;
}

void MappingLog::write(double seconds, std::int64_t iteration, const mapping::Map& map,
                       const mapping::KeyframeStore& keyframes) {
  reported_s_ = seconds;
  const auto psnr = mapping::mean_psnr(map, keyframes, keyframes.held_out());
  if (!psnr) return;
  out_ << fmt::format("{:.2f},{},{},{:.4f}{}\n", seconds, iteration, map.gaussians.size(), *psnr,
                      medium_cells(map.medium));
  out_.flush();
  log::debug("{:.0f} s: {:.2f} dB on held-out images", seconds, *psnr);
}

void MappingLog::close() {
  out_.flush();
  if (!out_) fail_run("{}: cannot be written; is the disk full?", file_.string());
}

void write_map_metrics(const std::filesystem::path& file, const MapMetrics& figures) {
  eval::Json sections = eval::read_metrics(file);
  sections["mapping"] = figures.held_out;
  sections["mapping"]["gaussians"] = figures.gaussians;
  sections["mapping"]["iterations"] = figures.iterations;
  if (figures.reduced_max_gaussians)
    sections["mapping"]["reduced_max_gaussians"] = *figures.reduced_max_gaussians;
  eval::Json& speed = sections["speed"];
  speed["wall_s"] = figures.wall_s;
  speed["training_s"] = figures.training_s;
  speed["iterations_per_s"] =
      static_cast<double>(figures.iterations) / std::max(1e-9, figures.training_s);
  if (!figures.times.empty()) speed["mapper_s"] = figures.times;
  speed["rss_peak_mib"] = peak_memory_mib();
  if (const auto memory = gaussians::device_memory()) speed["gpu_peak_mib"] = memory->peak_mib;
  if (speed.contains("sequence_s")) {
    speed["realtime_factor"] = speed["sequence_s"].get<double>() / std::max(1e-9, figures.wall_s);
  }
  sections["build"] = {{"backend", kBackend},
                       {"device", gaussians::active_device().str()},
                       {"git", kGitRevision},
                       {"torch", TORCH_VERSION}};
  if (figures.medium) {
    eval::Json& medium = sections["medium"];
    medium = {{"beta_d", numbers(figures.medium->beta_d)},
              {"beta_b", numbers(figures.medium->beta_b)},
              {"b_inf", numbers(figures.medium->b_inf)}};
    if (figures.true_medium) {
      medium["error_percent"] = error_percent(*figures.medium, *figures.true_medium);
    }
  }
  if (figures.wants_medium && !figures.medium) {
    sections["mapping"]["medium_off"] = "the images do not show that there is water";
  }
  if (figures.closed_loops) sections["mapping"]["closed_loops"] = *figures.closed_loops;
  if (figures.dropped_keyframes) sections["dropped"]["keyframes"] = *figures.dropped_keyframes;
  for (const auto& [why, count] : figures.not_mapped) sections["not_mapped"][why] = count;
  eval::merge_metrics(file, sections);
}

}  // namespace apvi::runs
