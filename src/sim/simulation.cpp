// SPDX-License-Identifier: BSD-3-Clause
#include "sim/simulation.hpp"

#include <array>
#include <cmath>

#include "apvi/core/error.hpp"
#include "core/random.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector3d;

constexpr std::uint64_t kFramesStream = 61;
constexpr double kMaxRange_m = 500.0;

std::array<Vector3d, 14> probe_directions() {
  std::array<Vector3d, 14> directions;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const Vector3d unit = Vector3d::Unit(static_cast<Eigen::Index>(axis));
    directions[2 * axis] = unit;
    directions[2 * axis + 1] = -unit;
  }
  for (std::size_t i = 0; i < 8; ++i) {
    directions[6 + i] =
        Vector3d((i & 1) != 0 ? 1.0 : -1.0, (i & 2) != 0 ? 1.0 : -1.0, (i & 4) != 0 ? 1.0 : -1.0)
            .normalized();
  }
  return directions;
}

std::string position_text(const Vector3d& p, double t) {
  return fmt::format("at {:.1f} s, x {:.2f}, y {:.2f}, z {:.2f} m", t, p.x(), p.y(), p.z());
}

void check_start(const Vector3d& p, const RayCaster& world) {
  const bool ground_below = world.cast(p, -Vector3d::UnitZ(), kMaxRange_m).has_value();
  if (!ground_below && world.cast(p, Vector3d::UnitZ(), kMaxRange_m)) {
    fail_input("motion: the path starts below the ground {}; raise it", position_text(p, 0.0));
  }
}

void check_step(const Vector3d& from, const Vector3d& to, double t, const RayCaster& world,
                double clearance_m) {
  const Vector3d step = to - from;
  if (step.norm() > 1e-9 && world.cast(from, step.normalized(), step.norm())) {
    fail_input("motion: the path goes through the terrain {}; move or raise it",
               position_text(to, t));
  }
  static const std::array<Vector3d, 14> directions = probe_directions();
  for (const Vector3d& direction : directions) {
    const auto hit = world.cast(to, direction, clearance_m);
    if (!hit) continue;
    fail_input(
        "motion: the path comes within {:.2f} m of a surface {}; move it or lower "
        "motion.clearance_m ({:.2f} m)",
        hit->range, position_text(to, t), clearance_m);
  }
}

std::vector<FrameTime> frame_times(const Scene& scene, const EventSchedule& events) {
  std::vector<FrameTime> frames;
  if (scene.rig.cameras.empty()) return frames;
  const CameraCalibration& camera = scene.rig.cameras.front();
  const Random random = Random(scene.seed()).fork(kFramesStream);
  const auto count =
      static_cast<std::int64_t>(std::floor(scene.config.duration_s * camera.rate_hz + 1e-6)) + 1;
  for (std::int64_t i = 0; i < count; ++i) {
    const double t = static_cast<double>(i) / camera.rate_hz;
    const auto index = static_cast<std::uint64_t>(i);
    Random draw = random.fork(index);
    if (draw.uniform() < events.strength(EventKind::dropped_frames, t)) continue;
    const Stamp truth = kSimulationStart + Duration::from_seconds(t);
    frames.push_back({truth + Duration::from_seconds(camera.time_offset_s), truth, index});
  }
  return frames;
}

void simulate_depth(const Scene& scene, const EventSchedule& events, Recording& recording) {
  const SceneConfig& config = scene.config;
  if (!scene.rig.pressure && !scene.rig.depth) return;
  PressureCalibration calibration = scene.rig.pressure.value_or(PressureCalibration{});
  if (!scene.rig.pressure) calibration.p_body_sensor = scene.rig.depth->p_body_sensor;
  const WaveField waves = make_waves(config.motion.waves, scene.seed(), config.gravity_m_s2);
  recording.pressure =
      simulate_pressure(recording.spline, waves, calibration, config.pressure, events,
                        kSimulationStart, config.duration_s, scene.sensor_seed());
  if (scene.rig.pressure) return;
  for (const PressureSample& sample : recording.pressure) {
    recording.depth.push_back({sample.stamp, calibration.depth(sample.pressure_pa)});
  }
  recording.pressure.clear();
}

}  // namespace

HeightFunction terrain_height(const RayCaster& world) {
  return [&world](double x, double y) -> std::optional<double> {
    constexpr double kRayOrigin_m = 5.0;
    const auto hit = world.cast({x, y, kRayOrigin_m}, -Vector3d::UnitZ(), kMaxRange_m);
    if (!hit) return std::nullopt;
    return kRayOrigin_m - hit->range;
  };
}

void check_path(const Se3Spline& spline, const RayCaster& world, double duration_s,
                double clearance_m) {
  constexpr double kStep = 0.05;
  Vector3d before = spline.at(kSimulationStart).T_world_body.translation;
  check_start(before, world);
  const auto count = static_cast<int>(std::floor(duration_s / kStep));
  for (int i = 0; i <= count; ++i) {
    const double t = i * kStep;
    const Vector3d p =
        spline.at(kSimulationStart + Duration::from_seconds(t)).T_world_body.translation;
    if (p.z() > 0.0) {
      fail_input("motion: the vehicle is out of the water {}; the surface is at z = 0",
                 position_text(p, t));
    }
    check_step(before, p, t, world, clearance_m);
    before = p;
  }
}

Recording simulate_sensors(const Scene& scene, const EventSchedule& events,
                           const RayCaster& world) {
  const SceneConfig& config = scene.config;
  Recording recording{.spline = plan_motion(config.motion, {.start = kSimulationStart,
                                                            .duration_s = config.duration_s,
                                                            .gravity = config.gravity_m_s2,
                                                            .seed = scene.seed(),
                                                            .height = terrain_height(world)}),
                      .imu = {},
                      .dvl = {},
                      .pressure = {},
                      .depth = {},
                      .frames = frame_times(scene, events)};
  check_path(recording.spline, world, config.duration_s, config.motion.clearance_m);
  recording.imu = simulate_imu(recording.spline, config.imu, events, kSimulationStart,
                               config.duration_s, config.gravity_m_s2, scene.sensor_seed());
  if (scene.rig.dvl) {
    recording.dvl = simulate_dvl(recording.spline, world, *scene.rig.dvl, config.dvl, events,
                                 kSimulationStart, config.duration_s, scene.sensor_seed());
  }
  simulate_depth(scene, events, recording);
  return recording;
}

}  // namespace apvi::sim
