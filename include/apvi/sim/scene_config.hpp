// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/core/stamp.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/sim/camera_effects.hpp"
#include "apvi/sim/dvl_sim.hpp"
#include "apvi/sim/events.hpp"
#include "apvi/sim/imu_sim.hpp"
#include "apvi/sim/light.hpp"
#include "apvi/sim/motion.hpp"
#include "apvi/sim/pressure_sim.hpp"
#include "apvi/sim/water.hpp"
#include "apvi/sim/world.hpp"

namespace apvi::sim {

/// When every simulated recording begins [s since 1970].
inline constexpr Stamp kSimulationStart{1'700'000'000'000'000'000};

/// The `camera` section: whether images are made, and the effects of the camera on them.
struct CameraSimConfig {
  bool enabled = true;
  CameraEffectsConfig effects;

  template <typename V>
  void visit(V& v) {
    v("enabled", enabled, "whether images are made; false leaves the other sensors");
    effects.visit(v);
  }
};

/// Which truth is stored beside what the sensors say.
struct TruthConfig {
  int image_every = 16;
  bool mesh = true;

  template <typename V>
  void visit(V& v) {
    v("image_every", image_every, config::Range{0, 1000000},
      "depth map and water-free image of every n-th frame of cam0; 0: of none");
    v("mesh", mesh, "the world as mesh.ply");
  }
};

/// How wrong the rig.yaml is that goes with the data; truth/rig.yaml is always right.
struct RigErrorConfig {
  double rotation_deg = 0.0;
  double translation_m = 0.0;
  double focal_percent = 0.0;
  bool hide_dvl_latency = false;
  bool hide_dvl_scale = false;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("rotation_deg", rotation_deg, Range{0.0, 180.0},
      "of every mounting, one sigma of an axis [deg]");
    v("translation_m", translation_m, Range{0.0, 10.0},
      "of every lever arm, one sigma of an axis [m]");
    v("focal_percent", focal_percent, Range{0.0, 50.0}, "of the focal lengths, one sigma [%]");
    v("hide_dvl_latency", hide_dvl_latency, "do not tell the DVL's time offset");
    v("hide_dvl_scale", hide_dvl_scale, "do not tell the true speed of sound");
  }
};

/// A scene file: everything that a simulated recording depends on.
struct SceneConfig {
  int seed = 1;
  std::optional<int> sensor_seed;
  double duration_s = 60.0;
  double gravity_m_s2 = 9.80665;
  WorldConfig world;
  WaterConfig water;
  LightConfig light;
  CameraSimConfig camera;
  MotionConfig motion;
  ImuSimConfig imu;
  DvlSimConfig dvl;
  PressureSimConfig pressure;
  std::vector<EventConfig> events;
  config::Node rig;
  RigErrorConfig rig_error;
  TruthConfig truth;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("seed", seed, Range{0, 2147483647}, "the same seed gives the same bytes");
    v("sensor_seed", sensor_seed, Range{0, 2147483647},
      "of the noise and biases of IMU, DVL and pressure sensor and of the errors in rig.yaml, so "
      "that one rendering serves many recordings; null: as `seed`");
    v("duration_s", duration_s, Range{1.0, 36000.0}, "length of the recording [s]");
    v("gravity_m_s2", gravity_m_s2, Range{9.0, 10.5}, "[m/s²]");
    v("world", world, "what there is to see");
    v("water", water, "what is in between");
    v("light", light, "sun and lamp");
    v("camera", camera, "exposure, noise, shutter; optics and mounting are the rig's");
    v("motion", motion, "how the vehicle moves");
    v("imu", imu, "inertial sensor");
    v("dvl", dvl, "Doppler velocity log");
    v("pressure", pressure, "pressure sensor");
    v("events", events, "what goes wrong when");
    v("rig", rig, "a rig file, or keys laid over the built-in survey vehicle");
    v("rig_error", rig_error, "how wrong the calibration in rig.yaml is");
    v("truth", truth, "which truth is stored");
  }
};

/// A scene with its rig: `rig_node` is rig.yaml as it is true, with the numbers of the sensors'
/// noise.
struct Scene {
  SceneConfig config;
  config::Node rig_node;
  Rig rig;

  std::uint64_t seed() const { return static_cast<std::uint64_t>(config.seed); }
  std::uint64_t sensor_seed() const {
    return static_cast<std::uint64_t>(config.sensor_seed.value_or(config.seed));
  }
};

/// Reads a scene file with what it inherits and "key=value" overrides on top. Names of files in it
/// (rig, motion.file) are relative to the file that has them. Throws InputError with file and line.
Scene load_scene(const std::filesystem::path& path, const std::vector<std::string>& overrides = {});
/// The same from a node, for programs that make their scenes.
Scene make_scene(const config::Node& node);

/// Every key of a scene file as a Markdown table.
std::string scene_documentation();

/// The true rig made wrong as `rig_error` says.
config::Node perturbed_rig(const Scene& scene);
/// Events against the scene's duration and water. Throws InputError.
EventSchedule make_schedule(const SceneConfig& scene);

}  // namespace apvi::sim
