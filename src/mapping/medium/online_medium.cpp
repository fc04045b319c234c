// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/medium/online_medium.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <vector>

#include "apvi/core/log.hpp"
#include "mapping/density/seed_stream.hpp"
#include "mapping/medium/initial_medium.hpp"
#include "mapping/medium/medium_estimation.hpp"

namespace apvi::mapping {
namespace {

constexpr std::int64_t kOutage_ns = 2'000'000'000;
constexpr double kViewSpacing = 0.1;  // of the extent, between keyframes used for estimation

}  // namespace

OnlineMedium::OnlineMedium(const MapperOptions& options)
    : options_(options),
      schedule_(static_cast<std::size_t>(std::max(1, options.online.medium_min_keyframes))) {}

void OnlineMedium::observe(std::int64_t stamp_ns, const KeyframeStore& keyframes,
                           std::size_t accepted) {
  const std::vector<std::size_t>& views = keyframes.training();
  if (views.empty() || stamp_ns - keyframes[views.back()].stamp_ns < kOutage_ns) return;
  schedule_.images_resumed(accepted);
}

bool OnlineMedium::is_estimated(const MapOptimizer& optimizer) const {
  return options_.medium && optimizer.size() > 0;
}

bool OnlineMedium::take_due(std::size_t accepted, bool busy, const MapOptimizer& optimizer) {
  if (!is_estimated(optimizer) || (busy && optimizer.medium())) return false;
  if (!schedule_.is_due(accepted)) return false;
  schedule_.mark_estimated(accepted);
  return true;
}

bool OnlineMedium::estimate(std::int64_t iteration, double extent, KeyframeStore& keyframes,
                            MapOptimizer& optimizer) const {
  const torch::NoGradGuard no_grad;
  if (options_.trainer.medium_estimation == MediumEstimationMethod::fit) {
    return fit(iteration, extent, keyframes, optimizer);
  }
  if (optimizer.medium()) return false;
  optimizer.start_medium(initial_medium(optimizer.map(), keyframes), keyframes);
  return true;
}

bool OnlineMedium::fit(std::int64_t iteration, double extent, KeyframeStore& keyframes,
                       MapOptimizer& optimizer) const {
  const medium::MediumPrior prior =
      medium::default_medium_prior(options_.trainer.lamps, optimizer.medium_posterior());
  const auto estimation =
      estimate_medium(optimizer.full_map(), keyframes, kViewSpacing * extent, prior,
                      derive_seed(options_.trainer.seed, Stream::medium, iteration), options_.depth,
                      optimizer.tone_curve_evidence());
  if (!estimation) return false;
  log::debug("medium estimated after {} keyframes from {} of them{}, relative sigma {:.0f} %",
             keyframes.training().size(), estimation->views.size(),
             estimation->sees_open_water ? " and open water" : "",
             100.0 * estimation->fit.sigmas.mean().item<double>());
  optimizer.apply_medium(*estimation, keyframes);
  keyframes.set_tone_curve(optimizer.tone_curve());
  return true;
}

void OnlineMedium::save(torch::serialize::OutputArchive& archive) const {
  torch::serialize::OutputArchive schedule;
  schedule_.save(schedule);
  archive.write("medium_schedule", schedule);
}

void OnlineMedium::load(torch::serialize::InputArchive& archive) {
  torch::serialize::InputArchive schedule;
  archive.read("medium_schedule", schedule);
  schedule_.load(schedule);
}

}  // namespace apvi::mapping
