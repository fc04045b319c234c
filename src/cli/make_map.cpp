// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>

#include "apvi/core/log.hpp"
#include "cli/mapping_support.hpp"
#include "runs/mapping_run.hpp"
#include "runs/online_run.hpp"

namespace apvi::cli {

namespace {

runs::MappingRunOptions options_of(const MappingRequest& request) {
  return {.folder = request.folder,
          .overwrite = request.overwrite,
          .resume = request.resume,
          .interrupted = request.interrupted,
          .live = request.live};
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

}  // namespace

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
