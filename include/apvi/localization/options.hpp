// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <string>
#include <string_view>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/core/constants.hpp"
#include "apvi/dipo/config.hpp"
#include "apvi/fusion/config.hpp"
#include "apvi/loop_closure/options.hpp"
#include "apvi/vio/config.hpp"

namespace apvi::localization {

/// How samples pass through the stages: one thread, in time order; threads that wait for each
/// other, with the same result; or threads at recording speed that drop late images.
enum class RunMode { sequential, replay, realtime };

struct SensorOptions {
  std::vector<std::string> use = {"camera", "imu", "dvl", "pressure"};

  bool includes(std::string_view name) const {
    return std::find(use.begin(), use.end(), name) != use.end();
  }

  template <typename V>
  void visit(V& v) {
    v("use", use, "sensors to use if recorded: any of camera, imu, dvl, pressure");
  }
};

struct ExecutionOptions {
  RunMode mode = RunMode::sequential;
  double playback_rate = 1.0;
  int seed = 0;
  int threads = 2;
  template <typename V>
  void visit(V& v) {
    using config::Choices;
    using config::Range;
    v("mode", mode,
      Choices<RunMode>{{"sequential", RunMode::sequential},
                       {"replay", RunMode::replay},
                       {"realtime", RunMode::realtime}},
      "sequential: one thread, in time order; replay: threads, nothing dropped; realtime: threads "
      "at recording speed, late images dropped");
    v("playback_rate", playback_rate, Range{0.01, 1000.0},
      "realtime: playback speed relative to the recording speed");
    v("seed", seed, Range{0, 2147483647}, "random seed");
    v("threads", threads, Range{1, 1024}, "maximum number of threads");
  }
};

/// Everything that localization needs to know besides the rig.
struct Options {
  SensorOptions sensors;
  ExecutionOptions run;
  dipo::Config dipo;
  vio::Config vio;
  fusion::Config fusion;
  fusion::FreezeConfig freeze;
  loop_closure::SmoothingOptions smoothing;
  double gravity = kStandardGravity;  ///< [m/s²]
  int heldout_every = 8;              ///< every N-th image is withheld from the map; 0: none

  /// Throws InputError for contradictory values.
  void check() const;
};

}  // namespace apvi::localization
