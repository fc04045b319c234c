// SPDX-License-Identifier: BSD-3-Clause
#include "slam/mapping_scheduler.hpp"

#include <algorithm>
#include <cmath>

namespace apvi::slam {

bool MappingScheduler::may_step(int steps_done, std::size_t queued) const {
  if (!options_.realtime) return steps_done < options_.steps_per_keyframe;
  if (finishing_ && since_finish_.seconds() > options_.max_final_s) return false;
  const bool others_wait = finishing_ || queued > 0;
  return !others_wait || training_s_ <= options_.training_fraction * busy_s();
}

int MappingScheduler::outage_steps(double outage_s, double mapped_s, double keyframes) const {
  if (options_.realtime || mapped_s <= 0.0) return 0;
  return static_cast<int>(
      std::lround(options_.steps_per_keyframe * keyframes * outage_s / mapped_s));
}

bool MappingScheduler::should_skip_depth(std::size_t queued, double depth_s) const {
  if (options_.realtime && finishing_) return true;
  return queued > 0 && depth_s > options_.max_depth_fraction * busy_s();
}

int MappingScheduler::flush_steps(int keyframes, double accepted, double iterations,
                                  double depth_s) const {
  const double each_s = depth_s / std::max(1.0, accepted) + options_.steps_per_flushed_keyframe *
                                                                training_s_ /
                                                                std::max(1.0, iterations);
  const bool late = since_finish_.seconds() + keyframes * each_s > options_.max_final_s;
  if (options_.realtime && late) return 0;
  return keyframes * options_.steps_per_flushed_keyframe;
}

}  // namespace apvi::slam
