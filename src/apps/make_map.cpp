// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>

#include "apvi/bridge/mapping_run.hpp"
#include "apvi/bridge/online_run.hpp"
#include "apvi/core/log.hpp"
#include "mapping_half.hpp"

namespace apvi::apps {

namespace {

bridge::MappingRunOptions options_of(const MapRequest& request) {
  return {.folder = request.folder,
          .overwrite = request.overwrite,
          .resume = request.resume,
          .interrupted = request.interrupted};
}

void report(const bridge::MappingRunResult& result, const MapRequest& request) {
  if (result.interrupted) {
    log::warning("interrupted; what was computed is kept, --resume goes on from it");
  }
  log::info("{} Gaussians after {} iterations, {:.0f} s in all", result.gaussians,
            result.iterations, result.wall_s);
  if (!std::isnan(result.psnr_db)) {
    log::info("{:.2f} dB PSNR on held-out images", result.psnr_db);
  }
  log::info("results in {}", request.folder.string());
}

}  // namespace

bool wants_map(const RunConfig& config) {
  return config.mapping.enabled;
}

std::optional<pipeline::RunResult> localize_and_map(const RunConfig& config,
                                                    const MapRequest& request) {
  const bridge::OnlineRunResult result = bridge::run_online(config, options_of(request));
  report(result.map, request);
  return result.localization;
}

void make_map(const RunConfig& config, const MapRequest& request) {
  report(bridge::run_mapping(config, options_of(request)), request);
}

}  // namespace apvi::apps
