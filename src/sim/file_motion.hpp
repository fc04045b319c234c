// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/sim/motion.hpp"

namespace apvi::sim {

/// The curve through the configured trajectory file, moved to the context's start; see
/// `plan_motion`.
Se3Spline fly_file(const MotionConfig& config, const MotionContext& context);

}  // namespace apvi::sim
