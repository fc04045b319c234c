// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <string>

#include "localization/acoustic_odometry.hpp"
#include "localization/fusion_stage.hpp"

namespace apvi::runs {

/// What a run on a live sequence does besides: samples come at their own pace, so that
/// `run.mode: realtime` does not wait for their time.
struct LiveHooks {
  std::function<void()> begin;                                  ///< before the first sample
  std::function<void(const localization::PingOutput&)> ping;    ///< in runs without a camera
  std::function<void(const localization::FrameOutput&)> frame;  ///< from the last stage's thread
  std::function<std::string()> status;                          ///< for the status line
};

}  // namespace apvi::runs
