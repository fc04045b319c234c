// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/mapping/options.hpp"
#include "gaussians/render/tone_curve.hpp"
#include "runs/maps/posed_images.hpp"
#include "runs/run_config.hpp"

namespace apvi::runs {

/// Options for more training of a run's finished map, whose tone curve is known: full images, and
/// positions that begin in the middle of their schedule.
mapping::TrainerOptions refine_options(const RunConfig& config, const PosedImages& images,
                                       const gaussians::ToneCurve& curve, int iterations);

}  // namespace apvi::runs
