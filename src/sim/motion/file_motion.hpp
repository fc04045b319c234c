// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "sim/motion/motion.hpp"

namespace apvi::sim {

/// Spline through the configured trajectory file, shifted in time to the context's start; see
/// `plan_motion`.
Se3Spline motion_from_file(const MotionConfig& config, const MotionContext& context);

}  // namespace apvi::sim
