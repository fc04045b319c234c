// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <filesystem>
#include <memory>
#include <string>

#include "apvi/core/log.hpp"
#include "cli/mapping_support.hpp"
#include "runs/live/live_view.hpp"
#include "runs/maps/mapping_run.hpp"
#include "runs/maps/online_run.hpp"

namespace apvi::cli {

namespace {

runs::MappingRunOptions options_of(const MappingRequest& request) {
  return {.folder = request.folder,
          .overwrite = request.overwrite,
          .resume = request.resume,
          .interrupted = request.interrupted,
          .live = request.live,
          .observer = request.observer};
}

void report(const runs::MappingRunResult& result) {
  if (result.interrupted) {
    log::warning("interrupted; results so far are saved, --resume continues from them");
  }
  log::info("{} Gaussians after {} iterations, {:.0f} s in total", result.gaussians,
            result.iterations, result.wall_s);
  if (!std::isnan(result.psnr_db)) {
    log::info("{:.2f} dB PSNR on held-out images", result.psnr_db);
  }
}

// Of the time of one thread, so that the run goes on.
constexpr double kRenderShare = 0.18;

}  // namespace

std::unique_ptr<runs::RunObserver> open_view(const std::filesystem::path& run,
                                             const ViewOptions& options) {
  if (!options.port) return nullptr;
  const std::string name = std::filesystem::absolute(run).lexically_normal().filename().string();
  return std::make_unique<runs::LiveView>(name,
                                          viewer::ServerOptions{.address = options.address,
                                                                .port = *options.port,
                                                                .token = "",
                                                                .render_share = kRenderShare});
}

std::optional<runs::RunResult> localize_and_map(const runs::RunConfig& config,
                                                io::SequenceReader& recording,
                                                const MappingRequest& request) {
  const runs::OnlineRunResult result = runs::run_online(config, recording, options_of(request));
  report(result.map);
  return result.localization;
}

void make_map(const runs::RunConfig& config, const MappingRequest& request) {
  report(runs::run_mapping(config, options_of(request)));
}

}  // namespace apvi::cli
