// SPDX-License-Identifier: BSD-3-Clause
#include "runs/playback_clock.hpp"

#include <algorithm>
#include <chrono>
#include <thread>

#include "apvi/core/log.hpp"

namespace apvi::runs {

void PlaybackClock::wait(Stamp stamp, const std::function<bool()>& interrupted) {
  if (!origin_) origin_ = last_ = stamp;
  const Duration step = stamp - last_;
  if (step.seconds() > max_step_s_) {
    if (++skipped_ == 1) {
      log::info("real time: pauses of the recording are not waited for, the first has {:.1f} s",
                step.seconds());
    }
    origin_ = *origin_ + step;
  }
  last_ = std::max(last_, stamp);
  const double due_s = seconds_between(*origin_, stamp) / rate_;
  constexpr double kPoll_s = 0.05;
  for (double ahead = due_s - watch_.seconds(); ahead > 0.0; ahead = due_s - watch_.seconds()) {
    std::this_thread::sleep_for(std::chrono::duration<double>(std::min(ahead, kPoll_s)));
    if (ahead > kPoll_s && interrupted()) return;
  }
}

}  // namespace apvi::runs
