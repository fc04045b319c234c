// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "geometry/spline.hpp"
#include "sim/render/ray_caster.hpp"
#include "sim/scene_config.hpp"
#include "sim/sensors/imu_sim.hpp"

namespace apvi::sim {

/// A camera frame to render.
struct FrameTime {
  Stamp stamp;              ///< reported by the camera
  Stamp truth;              ///< true mid-exposure time
  std::uint64_t index = 0;  ///< includes dropped frames
};

/// A recording without its images.
struct Recording {
  Se3Spline spline;
  ImuRecord
      imu;  ///< simulated even when the vehicle has no IMU: defines the rate of the ground truth
  std::vector<DvlSample> dvl;
  std::vector<PressureSample> pressure;
  std::vector<PressureDepthSample> depth;
  std::vector<FrameTime> frames;  ///< of every camera
};

/// Height of the topmost surface; nullopt outside the world.
HeightFunction terrain_height(const RayCaster& world);

/// Throws InputError, with time and position, when the body leaves the water, starts below the
/// ground, passes through a surface or comes closer than `clearance_m` to one.
void check_path(const Se3Spline& spline, const RayCaster& world, double duration_s,
                double clearance_m);

/// Plans and checks the motion, and simulates all sensors except the cameras. Takes about one
/// second per minute of recording.
Recording simulate_sensors(const Scene& scene, const EventSchedule& events, const RayCaster& world);

}  // namespace apvi::sim
