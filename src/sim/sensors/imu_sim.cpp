// SPDX-License-Identifier: BSD-3-Clause
#include "sim/sensors/imu_sim.hpp"

#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include "apvi/core/constants.hpp"
#include "core/random.hpp"

namespace apvi::sim {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kEarthRate = 7.292115e-5;  // [rad/s]
constexpr std::uint64_t kImuStream = 21;
constexpr double kGyroVibrationRatio = 0.03;  // gyro over accelerometer vibration, per range

Vector3d normal3(Random& random) {
  const double x = random.normal();
  const double y = random.normal();
  return {x, y, random.normal()};
}

// Identity + scale errors on the diagonal + small misalignment angles off the diagonal.
Matrix3d scale_misalignment(const ImuSimConfig& errors, Random& random) {
  Matrix3d matrix = Matrix3d::Identity();
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      const double sigma =
          row == column ? errors.scale_error : errors.misalignment_deg * kRadiansPerDegree;
      matrix(row, column) += sigma * random.normal();
    }
  }
  return matrix;
}

// One sensor triad: scale and misalignment, bias with random walk, white noise, clipping.
class Triad {
 public:
  Triad(double noise_density, double random_walk, double range, double rate_hz)
      : noise_(noise_density * std::sqrt(rate_hz)),
        step_(random_walk / std::sqrt(rate_hz)),
        range_(range) {}

  void start(double turn_on_bias, const ImuSimConfig& config, Random& random) {
    bias_ = turn_on_bias * normal3(random);
    scale_misalignment_ = scale_misalignment(config, random);
  }
  const Vector3d& bias() const { return bias_; }
  // `vibration` is in units of the range; the reading saturates.
  Vector3d read(const Vector3d& truth, const Vector3d& vibration, Random& random) {
    const Vector3d reading =
        scale_misalignment_ * truth + bias_ + noise_ * normal3(random) + range_ * vibration;
    bias_ += step_ * normal3(random);
    return reading.cwiseMax(-range_).cwiseMin(range_);
  }

 private:
  double noise_;
  double step_;
  double range_;
  Vector3d bias_ = Vector3d::Zero();
  Matrix3d scale_misalignment_ = Matrix3d::Identity();
};

Vector3d earth_rate(const ImuSimConfig& config) {
  if (!config.earth_rotation) return Vector3d::Zero();
  const double latitude = config.latitude_deg * kRadiansPerDegree;
  return kEarthRate * Vector3d(0.0, std::cos(latitude), std::sin(latitude));
}

// Ideal readings: angular rate and specific force, R^T (a + 2 w_earth x v - g).
std::pair<Vector3d, Vector3d> true_reading(const Motion& motion, const Vector3d& earth,
                                           double gravity) {
  const Eigen::Quaterniond R_body_world = motion.T_world_body.rotation.conjugate();
  const Vector3d coriolis = 2.0 * earth.cross(motion.velocity_world);
  const Vector3d g(0.0, 0.0, -gravity);
  return {motion.angular_velocity_body + R_body_world * earth,
          R_body_world * (motion.acceleration_world + coriolis - g)};
}

// Vibration of the frame at 37 Hz, with a different phase on each axis.
Vector3d structural_vibration(double strength, double t) {
  constexpr double kFrequency = 2.0 * std::numbers::pi * 37.0;
  const double angle = kFrequency * t;
  return strength * Vector3d(std::sin(angle), std::sin(angle + 2.1), std::sin(angle + 4.2));
}

}  // namespace

// Published noise densities of each class: data sheets of the HG4930 and STIM300 (tactical); the
// ADIS16448 of EuRoC (values of OpenVINS's simulation, accelerometer random walk from Allan fits of
// such units); phone-grade sensors.
void ImuSimConfig::use(ImuPreset other) {
  const auto set = [this](const std::array<double, 10>& n) {
    gyro_noise_density = n[0];
    gyro_random_walk = n[1];
    accel_noise_density = n[2];
    accel_random_walk = n[3];
    gyro_bias_sigma = n[4];
    accel_bias_sigma = n[5];
    scale_error = n[6];
    misalignment_deg = n[7];
    gyro_range = n[8];
    accel_range = n[9];
  };
  preset = other;
  switch (other) {
    case ImuPreset::ideal:
      set({0, 0, 0, 0, 0, 0, 0, 0, 1e6, 1e6});
      break;
    case ImuPreset::tactical:
      set({1.2e-5, 2e-7, 5.0e-4, 1.0e-5, 5e-6, 1.5e-2, 2e-4, 0.01, 7.0, 196.0});
      break;
    case ImuPreset::mems:
      set({1.6968e-4, 1.9393e-5, 2.0e-3, 3.0e-4, 7e-4, 4e-2, 1e-3, 0.05, 17.45, 176.0});
      break;
    case ImuPreset::consumer:
      set({5.0e-4, 5.0e-5, 5.0e-3, 1.0e-3, 1e-2, 0.25, 5e-3, 0.5, 8.73, 78.0});
      break;
  }
}

ImuRecord simulate_imu(const Se3Spline& spline, const ImuSimConfig& config,
                       const EventSchedule& events, Stamp start, double duration_s, double gravity,
                       std::uint64_t seed) {
  Random random = Random(seed).fork(kImuStream);
  Triad gyro(config.gyro_noise_density, config.gyro_random_walk, config.gyro_range, config.rate_hz);
  Triad accel(config.accel_noise_density, config.accel_random_walk, config.accel_range,
              config.rate_hz);
  gyro.start(config.gyro_bias_sigma, config, random);
  accel.start(config.accel_bias_sigma, config, random);
  const Vector3d earth = earth_rate(config);

  ImuRecord record;
  const auto count = static_cast<std::int64_t>(std::floor(duration_s * config.rate_hz + 1e-6)) + 1;
  for (std::int64_t i = 0; i < count; ++i) {
    const double t = static_cast<double>(i) / config.rate_hz;
    const Stamp stamp = start + Duration::from_seconds(t);
    const Motion motion = spline.at(stamp);
    const auto [rate, force] = true_reading(motion, earth, gravity);
    const Vector3d vibration =
        structural_vibration(events.strength(EventKind::imu_saturation, t), t);
    record.truth.push_back(motion);
    record.gyro_bias.push_back(gyro.bias());
    record.accel_bias.push_back(accel.bias());
    const Vector3d gyro_reading = gyro.read(rate, kGyroVibrationRatio * vibration, random);
    record.samples.push_back({stamp, gyro_reading, accel.read(force, vibration, random)});
  }
  return record;
}

}  // namespace apvi::sim
