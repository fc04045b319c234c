// SPDX-License-Identifier: BSD-3-Clause
#include "runs/refine/refine_options.hpp"

#include <cmath>

#include "apvi/sensors/rig.hpp"
#include "slam/mapper_options.hpp"

namespace apvi::runs {
namespace {

mapping::ToneCurveOptions options_of(const gaussians::ToneCurve& curve) {
  if (curve.is_linear()) return {.kind = mapping::ToneCurveKind::linear};
  if (curve == gaussians::kSrgb) return {.kind = mapping::ToneCurveKind::srgb};
  return {.kind = mapping::ToneCurveKind::power, .gamma = curve.gamma};
}

}  // namespace

mapping::TrainerOptions refine_options(const RunConfig& config, const PosedImages& images,
                                       const gaussians::ToneCurve& curve, int iterations) {
  mapping::TrainerOptions options =
      slam::trainer_options(config.mapping, config.run.seed, make_rig(images.rig));
  options.iterations = iterations;
  options.final_iterations = 0;
  options.time_budget_s = 0.0;
  options.refine = true;
  options.tone_curve = options_of(curve);
  options.learning_rates.means =
      std::sqrt(options.learning_rates.means * options.learning_rates.means_final);
  return options;
}

}  // namespace apvi::runs
