// SPDX-License-Identifier: BSD-3-Clause
// Feeds samples of your own sensors: a calibration written in code, and an IMU, a DVL and a
// pressure sensor that are simulated here by a vehicle moving straight ahead at 0.5 m/s, 5 m deep.
//
//   05_own_sensor
#include <cmath>
#include <cstdint>
#include <cstdio>

#include "apvi/apvi.hpp"
#include "apvi/core/constants.hpp"

namespace {

constexpr double kSpeed = 0.5;   // mean [m/s]
constexpr double kSurge = 0.05;  // amplitude of the speed, at 1 rad/s [m/s]
constexpr double kDepth_m = 5.0;
constexpr std::int64_t kPeriod_ns = 5'000'000;  // of the IMU, 200 Hz
constexpr int kSamplesPerPing = 25;
constexpr double kDuration_s = 20.0;

apvi::Rig make_rig() {
  apvi::Rig rig;
  rig.imu.emplace();       // defines the body frame
  rig.dvl.emplace();       // at the body's origin, axes aligned with the body's
  rig.pressure.emplace();  // the same
  return rig;
}

double run() {
  apvi::localization::SystemCallbacks callbacks;
  double x = 0.0;
  callbacks.pose = [&x](const apvi::StampedPose& pose) { x = pose.T_world_body.translation.x(); };
  apvi::localization::Options options;
  options.sensors.use = {"imu", "dvl", "pressure"};
  apvi::localization::System system(options, make_rig(), callbacks);

  const int count = static_cast<int>(kDuration_s * 1e9 / static_cast<double>(kPeriod_ns));
  for (int k = 0; k < count; ++k) {
    const apvi::Stamp stamp{k * kPeriod_ns};
    const double t = 1e-9 * static_cast<double>(stamp.ns);
    system.process(apvi::ImuSample{
        stamp, {0.0, 0.0, 0.0}, {kSurge * std::cos(t), 0.0, apvi::kStandardGravity}});
    if (k % kSamplesPerPing != 0) continue;
    apvi::DvlSample ping;
    ping.stamp = stamp;
    ping.velocity = {kSpeed + kSurge * std::sin(t), 0.0, 0.0};
    ping.valid = true;
    system.process(ping);
    system.process(
        apvi::PressureSample{stamp, 101325.0 + 1025.0 * apvi::kStandardGravity * kDepth_m});
  }
  system.finish();
  return x;
}

}  // namespace

int main() {
  try {
    const double x = run();
    std::printf("%.2f m ahead\n", x);
    return std::abs(x - kSpeed * kDuration_s) < 0.5 ? 0 : 1;
  } catch (const std::exception& error) {
    apvi::log::error("{}", error.what());
    return 1;
  }
}
