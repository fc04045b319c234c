// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/core/constants.hpp"
#include "apvi/core/stamp.hpp"
#include "apvi/sensors/rig.hpp"
#include "sim/motion/events.hpp"
#include "sim/motion/motion.hpp"
#include "sim/motion/off_path.hpp"
#include "sim/render/camera_effects.hpp"
#include "sim/render/light.hpp"
#include "sim/render/water.hpp"
#include "sim/sensors/dvl_sim.hpp"
#include "sim/sensors/imu_sim.hpp"
#include "sim/sensors/pressure_sim.hpp"
#include "sim/spectral/spectral_config.hpp"
#include "sim/world/world.hpp"

namespace apvi::sim {

/// Start of every simulated recording (Unix time).
inline constexpr Stamp kSimulationStart{1'700'000'000'000'000'000};

/// The `camera` section: whether images are made, and the effects of the camera on them.
struct CameraSimConfig {
  bool enabled = true;
  CameraEffectsConfig effects;

  template <typename V>
  void visit(V& v) {
    v("enabled", enabled, "render images");
    effects.visit(v);
  }
};

/// Which ground truth is stored in addition to the sensor data.
struct TruthConfig {
  int image_every = 16;
  OffPathConfig off_path;
  bool mesh = true;

  template <typename V>
  void visit(V& v) {
    v("image_every", image_every, config::Range{0, 1000000},
      "write the depth map and water-free image of every N-th frame of cam0; 0: none");
    v("off_path", off_path, "images from beside the path, at the same frames");
    v("mesh", mesh, "write the scene as mesh.ply");
  }
};

/// Errors added to the rig.yaml of the recording; truth/rig.yaml holds the true calibration.
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
      "error of every mounting rotation, one sigma per axis [deg]");
    v("translation_m", translation_m, Range{0.0, 10.0},
      "error of every lever arm, one sigma per axis [m]");
    v("focal_percent", focal_percent, Range{0.0, 50.0},
      "error of the focal lengths, one sigma [%]");
    v("hide_dvl_latency", hide_dvl_latency, "omit the DVL's time offset from rig.yaml");
    v("hide_dvl_scale", hide_dvl_scale, "omit the true speed of sound from rig.yaml");
  }
};

/// A scene file: all inputs of a simulated recording.
struct SceneConfig {
  int seed = 1;
  std::optional<int> sensor_seed;
  double duration_s = 60.0;
  double gravity_m_s2 = kStandardGravity;
  Physics physics = Physics::paper;
  WorldConfig world;
  WaterConfig water;
  LightConfig light;
  CameraSimConfig camera;
  SpectralConfig spectral;
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
    v("seed", seed, Range{0, 2147483647}, "random seed; the same seed gives the same bytes");
    v("sensor_seed", sensor_seed, Range{0, 2147483647},
      "random seed of the noise and biases of IMU, DVL and pressure sensor and of the errors in "
      "rig.yaml, so that one rendering serves many recordings; null: seed");
    v("duration_s", duration_s, Range{1.0, 36000.0}, "length of the recording [s]");
    v("gravity_m_s2", gravity_m_s2, Range{9.0, 10.5}, "gravitational acceleration [m/s²]");
    v("physics", physics,
      config::Choices<Physics>{{"paper", Physics::paper}, {"spectral", Physics::spectral}},
      "light and water: the paper's image formation model, or spectral radiative transfer");
    v("world", world, "scene geometry");
    v("water", water, "water column");
    v("light", light, "sun and lamp");
    v("camera", camera, "exposure, noise and shutter; optics and mounting are in the rig");
    v("spectral", spectral, "sensor, image pipeline and lamps of spectral physics");
    v("motion", motion, "vehicle motion");
    v("imu", imu, "inertial sensor");
    v("dvl", dvl, "Doppler velocity log");
    v("pressure", pressure, "pressure sensor");
    v("events", events, "disturbances");
    v("rig", rig, "rig file, or keys that override the built-in survey vehicle");
    v("rig_error", rig_error, "calibration errors in rig.yaml");
    v("truth", truth, "ground truth");
  }
};

/// A scene with its rig: `rig_node` is the true rig.yaml, including the noise parameters of the
/// sensors.
struct Scene {
  SceneConfig config;
  config::Node rig_node;
  Rig rig;

  std::uint64_t seed() const { return static_cast<std::uint64_t>(config.seed); }
  std::uint64_t sensor_seed() const {
    return static_cast<std::uint64_t>(config.sensor_seed.value_or(config.seed));
  }
};

/// Reads a scene file with the files it inherits from, then applies "key=value" overrides. File
/// names in it (rig, motion.file) are relative to the file that contains them. `search`: see
/// config::load_with_inheritance. Throws InputError with file and line.
Scene load_scene(const std::filesystem::path& path, const std::vector<std::string>& overrides = {},
                 const std::vector<std::filesystem::path>& search = {});
/// As above from a node, for programs that build scenes themselves.
Scene make_scene(const config::Node& node);

/// Every key of a scene file as a Markdown table.
std::string scene_documentation();

/// The true rig with the errors of `rig_error` added.
config::Node perturbed_rig(const Scene& scene);
/// Event schedule, checked against the duration and the water of the scene. Throws InputError.
EventSchedule make_schedule(const SceneConfig& scene);

}  // namespace apvi::sim
