// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic_dive.hpp"

#include <unistd.h>

#include <algorithm>
#include <fstream>

#include "support/spline_imu.hpp"

namespace apvi::bench {
namespace {

constexpr double kGravity = 9.80665;
constexpr double kDepth = 30.0;  // of the world origin [m]
constexpr Duration kDvlLatency{100'000'000};

Rig make_rig(const Rates& rates) {
  Rig rig;
  rig.imu.emplace().rate_hz = rates.imu;
  DvlCalibration& dvl = rig.dvl.emplace();
  dvl.velocity_noise = 0.005;
  dvl.beams = default_dvl_beams();
  rig.pressure.emplace();
  return rig;
}

}  // namespace

SyntheticDive::SyntheticDive(const Rates& rates, double duration_s, std::uint64_t seed,
                             double motion_scale)
    : rates_(rates),
      rig_(make_rig(rates)),
      random_(seed),
      spline_(test::wavy_spline(seed, duration_s + 1.0, motion_scale)),
      end_(spline_.start() + Duration::from_seconds(duration_s)),
      next_imu_(spline_.start()),
      next_dvl_(spline_.start() + kDvlLatency),
      next_pressure_(spline_.start()) {}

Eigen::Vector3d SyntheticDive::position_at(Stamp stamp) const {
  return spline_.at(stamp).T_world_body.translation - kDepth * Eigen::Vector3d::UnitZ();
}

std::vector<SensorEvent> SyntheticDive::next(Duration length) {
  std::vector<SensorEvent> events;
  const Stamp until = std::min(next_imu_ + length, end_);
  for (; next_imu_ < until; next_imu_ = next_imu_ + Duration::from_seconds(1.0 / rates_.imu)) {
    for (; next_dvl_ <= next_imu_;
         next_dvl_ = next_dvl_ + Duration::from_seconds(1.0 / rates_.dvl)) {
      events.emplace_back(dvl_at(next_dvl_));
    }
    for (; next_pressure_ <= next_imu_;
         next_pressure_ = next_pressure_ + Duration::from_seconds(1.0 / rates_.pressure)) {
      events.emplace_back(pressure_at(next_pressure_));
    }
    events.emplace_back(imu_at(next_imu_));
  }
  return events;
}

ImuSample SyntheticDive::imu_at(Stamp stamp) {
  const double root_rate = std::sqrt(rates_.imu);
  ImuSample sample = test::imu_at(spline_, {0.0, 0.0, -kGravity}, stamp);
  sample.gyro += test::normal_vector(random_, rig_.imu->gyro_noise_density * root_rate);
  sample.accel += test::normal_vector(random_, rig_.imu->accel_noise_density * root_rate);
  return sample;
}

DvlSample SyntheticDive::dvl_at(Stamp stamp) {
  const Motion motion = spline_.at(stamp - kDvlLatency);
  const double noise = rig_.dvl->velocity_noise;
  const Eigen::Vector3d velocity = motion.T_world_body.rotation.conjugate() * motion.velocity_world;
  DvlSample sample;
  sample.stamp = stamp;
  sample.valid = true;
  sample.figure_of_merit = noise;
  sample.altitude = 5.0;
  sample.velocity = velocity + test::normal_vector(random_, noise);
  for (std::size_t i = 0; i < kDvlBeams; ++i) {
    sample.beams[i] =
        DvlBeam{.velocity = rig_.dvl->beams[i].dot(velocity) + random_.normal(0.0, noise),
                .range = 5.4,
                .valid = true};
  }
  return sample;
}

PressureSample SyntheticDive::pressure_at(Stamp stamp) {
  const PressureCalibration& sensor = *rig_.pressure;
  const double depth = -position_at(stamp).z() + random_.normal(0.0, sensor.noise_m);
  return {stamp, sensor.atmospheric_pressure_pa + sensor.water_density * sensor.gravity * depth};
}

double resident_mib() {
  std::ifstream statm("/proc/self/statm");
  double total = 0.0;
  double resident = 0.0;
  statm >> total >> resident;
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE)) / (1024.0 * 1024.0);
}

}  // namespace apvi::bench
