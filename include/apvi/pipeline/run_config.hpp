// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/dipo/config.hpp"
#include "apvi/eval/trajectory_metrics.hpp"
#include "apvi/fusion/config.hpp"
#include "apvi/io/sequence.hpp"
#include "apvi/vio/config.hpp"

namespace apvi::pipeline {

enum class RunMode { sequential, replay, realtime };

struct SensorsSection {
  std::vector<std::string> use = {"camera", "imu", "dvl", "pressure"};

  bool includes(std::string_view name) const {
    return std::find(use.begin(), use.end(), name) != use.end();
  }

  template <typename V>
  void visit(V& v) {
    v("use", use, "which sensors, where the recording has them: any of camera, imu, dvl, pressure");
  }
};

struct RunSection {
  RunMode mode = RunMode::sequential;
  double pace = 1.0;
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
      "one thread in order of time; threads that wait for each other; threads that drop");
    v("pace", pace, Range{0.01, 1000.0},
      "realtime: how fast the recording is played, over how fast it was made");
    v("seed", seed, Range{0, 2147483647}, "of everything random");
    v("threads", threads, Range{1, 1024}, "at most so many at once");
  }
};

struct LocalizationSection {
  bool enabled = true;
  std::string poses;
  template <typename V>
  void visit(V& v) {
    v("enabled", enabled, "whether poses are estimated; false: they are given");
    v("poses", poses,
      "given poses of the body: a TUM or EuRoC file; empty: the recording's reference");
  }
};

/// Everything about a run, as in a configuration file.
struct RunConfig {
  io::DatasetConfig dataset;
  config::Node rig;
  SensorsSection sensors;
  RunSection run;
  LocalizationSection localization;
  dipo::Config dipo;
  vio::Config vio;
  fusion::Config fusion;
  fusion::FreezeConfig freeze;
  eval::EvalOptions eval;

  template <typename V>
  void visit(V& v) {
    v("dataset", dataset, "the recording");
    v("rig", rig, "keys laid over the recording's rig.yaml");
    v("sensors", sensors, "which of its sensors are used");
    v("run", run, "how it is run");
    v("localization", localization, "where poses come from");
    v("dipo", dipo, "DVL, IMU and pressure odometry");
    v("vio", vio, "visual-inertial odometry");
    v("fusion", fusion, "the judge of both, and how they are fused");
    v("freeze", freeze, "what happens to the window while vision is gone");
    v("eval", eval, "comparison with the reference");
  }
};

/// Reads a configuration file with what it inherits, then the overrides "key=value" in order, and
/// checks what single keys cannot say. Throws InputError.
RunConfig load_run_config(const std::filesystem::path& file,
                          const std::vector<std::string>& overrides);
/// Throws InputError for values that contradict each other or need what is not built.
void check(const RunConfig& config);

/// The same for a configuration that holds this one and more.
template <typename Config>
Config read_run_config(const std::filesystem::path& file,
                       const std::vector<std::string>& overrides) {
  config::Node node = config::load_with_inheritance(file);
  for (const std::string& assignment : overrides) config::apply_override(node, assignment);
  Config config;
  config::read(node, config);
  pipeline::check(config);
  return config;
}

/// The configuration as it is written down: with the rig as used, and paths that hold wherever the
/// program is started from.
RunConfig resolved(const RunConfig& config, const config::Node& rig);
/// An absolute path; empty stays empty.
std::string absolute_path(const std::string& path);

/// The rig of a run: the recording's own, or `dataset.rig`, with the configuration's `rig` laid
/// over. Throws InputError when there is none at all.
config::Node rig_of(const RunConfig& config, const config::Node& recorded);

}  // namespace apvi::pipeline
