// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "support/spline_imu.hpp"
#include "vio/initialization/initializer.hpp"

/// A camera and an IMU moving through a point cloud: input and ground truth for the initializer.
namespace apvi::test {

struct StartScene {
  std::uint64_t seed = 1;
  int frames = 25;
  int points = 150;
  double pixel_noise = 0.5;  ///< [px] at a focal length of 460
  double outliers = 0.0;     ///< fraction of tracks that move independently
  Eigen::Vector3d gyro_bias = Eigen::Vector3d(-0.02, 0.03, 0.1);
  Eigen::Vector3d accel_bias = Eigen::Vector3d(-0.05, 0.1, 0.05);
  imu::Noise noise{1.7e-4, 2e-3, 2e-5, 3e-4};
};

inline const Eigen::Vector3d kStartGravity(0.0, 0.0, -9.81);
constexpr double kStartFocal_px = 460.0;

/// The camera looks along body x.
inline SE3 start_T_body_camera() {
  Eigen::Matrix3d R;
  R << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  return {Eigen::Quaterniond(R), Eigen::Vector3d(0.1, 0.02, -0.05)};
}

inline vio::InitCamera start_camera() {
  return {start_T_body_camera(), kStartFocal_px};
}

/// Handheld motion: oscillation of `reach` [m] and `turn` [rad] with a period of 0.3 s, on top of a
/// constant velocity.
inline Se3Spline shaken_spline(std::uint64_t seed, double reach, double turn,
                               const Eigen::Vector3d& velocity) {
  Random random(seed);
  std::vector<SE3> control;
  for (int k = 0; k < 30; ++k) {
    control.push_back(
        {so3::exp(random_vector(random, turn)), 0.3 * k * velocity + random_vector(random, reach)});
  }
  return Se3Spline(Stamp{1'000'000'000}, Duration::from_seconds(0.3), std::move(control));
}

class StartRecording {
 public:
  StartRecording(const StartScene& scene, Se3Spline spline)
      : scene_(scene), spline_(std::move(spline)), random_(scene.seed) {
    for (int p = 0; p < scene.points; ++p) {
      const double depth = random_.uniform(1.5, 6.0);
      points_.emplace_back(depth, depth * random_.uniform(-0.8, 0.8),
                           depth * random_.uniform(-0.5, 0.5));
      drift_.push_back(random_.uniform() < scene.outliers ? random_vector(random_, 0.15).head<2>()
                                                          : Eigen::Vector2d(0.0, 0.0));
    }
    for (int k = 0; k < scene.frames; ++k) add_frame(k);
  }

  const std::vector<vio::InitFrame>& frames() const { return frames_; }
  imu::NavState truth(std::size_t frame) const {
    return nav_state_at(spline_, frames_[frame].tracked.stamp);
  }
  vio::InitResult start(const vio::InitConfig& config) const {
    return vio::initialize(frames_, start_camera(), scene_.noise, 9.81, config);
  }

 private:
  static constexpr double kImu_s = 0.005, kFrame_s = 0.05;

  ImuSample measure(Stamp stamp) {
    ImuSample sample = imu_at(spline_, kStartGravity, stamp);
    sample.gyro += scene_.gyro_bias + normal_vector(random_, scene_.noise.gyro / std::sqrt(kImu_s));
    sample.accel +=
        scene_.accel_bias + normal_vector(random_, scene_.noise.accel / std::sqrt(kImu_s));
    return sample;
  }

  void add_frame(int k) {
    vio::InitFrame frame;
    const Stamp stamp = spline_.start() + Duration::from_seconds(0.5 + k * kFrame_s);
    frame.tracked.stamp = stamp;
    if (k == 0) {
      last_ = measure(stamp);
    } else {
      frame.imu.push_back(last_);
      for (int i = 1; i <= 10; ++i) {
        last_ = measure(stamp - Duration::from_seconds(kFrame_s - i * kImu_s));
        frame.imu.push_back(last_);
      }
    }
    const SE3 T_camera_world = (spline_.at(stamp).T_world_body * start_T_body_camera()).inverse();
    for (std::size_t p = 0; p < points_.size(); ++p) {
      const Eigen::Vector3d seen = T_camera_world * points_[p];
      if (seen.z() < 0.3) continue;
      vio::FeatureObservation observation;
      observation.id = static_cast<std::int64_t>(p);
      observation.point = seen.head<2>() / seen.z() + k * kFrame_s * drift_[p];
      if (std::abs(observation.point.x()) > 0.9 || std::abs(observation.point.y()) > 0.6) continue;
      observation.point += normal_vector(random_, scene_.pixel_noise / kStartFocal_px).head<2>();
      frame.tracked.observations.push_back(observation);
    }
    frames_.push_back(std::move(frame));
  }

  StartScene scene_;
  Se3Spline spline_;
  Random random_;
  std::vector<Eigen::Vector3d> points_;
  std::vector<Eigen::Vector2d> drift_;  // drift of outliers on the plane z = 1 [1/s]
  ImuSample last_;
  std::vector<vio::InitFrame> frames_;
};

/// Ratio of the estimated to the true path size.
inline double scale_of(const vio::InitResult& start, const StartRecording& recording) {
  const auto n = static_cast<double>(start.states.size());
  Eigen::Vector3d center = Eigen::Vector3d::Zero(), true_center = Eigen::Vector3d::Zero();
  for (std::size_t k = 0; k < start.states.size(); ++k) {
    center += start.states[k].p_world / n;
    true_center += recording.truth(k).p_world / n;
  }
  double size = 0.0, true_size = 0.0;
  for (std::size_t k = 0; k < start.states.size(); ++k) {
    size += (start.states[k].p_world - center).squaredNorm();
    true_size += (recording.truth(k).p_world - true_center).squaredNorm();
  }
  return std::sqrt(size / true_size);
}

/// Angle between the estimated and the true vertical, in the body frame [rad].
inline double tilt_error(const imu::NavState& estimate, const imu::NavState& truth) {
  const Eigen::Vector3d up = estimate.R_world_body.conjugate() * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d true_up = truth.R_world_body.conjugate() * Eigen::Vector3d::UnitZ();
  return std::acos(std::min(1.0, up.dot(true_up)));
}

}  // namespace apvi::test
