// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>

#include "apvi/bridge/mapping_run.hpp"
#include "apvi/core/log.hpp"
#include "mapping_half.hpp"

namespace apvi::apps {

void make_map(const RunConfig& config, const MapRequest& request) {
  const bridge::MappingRunResult result =
      bridge::run_mapping(config, {.folder = request.folder,
                                   .overwrite = request.overwrite,
                                   .resume = request.resume,
                                   .interrupted = request.interrupted});
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

}  // namespace apvi::apps
