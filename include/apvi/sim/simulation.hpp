// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "apvi/geometry/spline.hpp"
#include "apvi/sim/imu_sim.hpp"
#include "apvi/sim/ray_caster.hpp"
#include "apvi/sim/scene_config.hpp"

namespace apvi::sim {

/// A camera frame that is to be made.
struct FrameTime {
  Stamp stamp;              ///< as the camera says
  Stamp truth;              ///< mid-exposure
  std::uint64_t index = 0;  ///< counted with the dropped ones
};

/// Everything of a recording but its pictures.
struct Recording {
  Se3Spline spline;
  ImuRecord
      imu;  ///< samples are simulated even when the vehicle has no IMU: truth is at their rate
  std::vector<DvlSample> dvl;
  std::vector<PressureSample> pressure;
  std::vector<DepthSample> depth;
  std::vector<FrameTime> frames;  ///< of every camera
};

/// Height of the topmost surface; nothing beside the world.
HeightFunction height_above(const RayCaster& world);

/// Throws InputError when the body comes out of the water, starts below the ground, passes through
/// a surface or comes closer than `clearance_m` to one, telling when and where.
void check_path(const Se3Spline& spline, const RayCaster& world, double duration_s,
                double clearance_m);

/// Plans and checks the motion, and simulates all sensors but the cameras. Takes about a second for
/// a minute of recording.
Recording simulate_sensors(const Scene& scene, const EventSchedule& events, const RayCaster& world);

}  // namespace apvi::sim
