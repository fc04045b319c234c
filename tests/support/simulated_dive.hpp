// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <map>
#include <optional>
#include <vector>

#include "apvi/sensors/rig.hpp"
#include "core/random.hpp"
#include "support/spline_imu.hpp"
#include "vio/state_prior.hpp"
#include "vio/window/observation.hpp"
#include "vio/window/window.hpp"

/// Simulated vehicle with camera, IMU, DVL and depth sensor in a cloud of points: noisy feature
/// tracks and sensor data, without images.
namespace apvi::test {

struct SimulatedDiveOptions {
  std::uint64_t seed = 1;
  double duration_s = 20.0;
  double pixel_sigma = 0.5;
  double outliers = 0.0;  ///< fraction of points with their own motion
  Eigen::Vector3d gyro_bias{0.02, -0.03, 0.05};
  Eigen::Vector3d accel_bias{0.03, -0.02, 0.04};
};

class SimulatedDive {
 public:
  static constexpr double kFrameRate = 20.0;
  static constexpr double kImuRate = 200.0;
  static constexpr double kPingRate = 5.0;
  static constexpr double kFocal = 400.0;

  explicit SimulatedDive(const SimulatedDiveOptions& options)
      : options_(options),
        random_(options.seed),
        spline_(wavy_spline(options.seed, options.duration_s)) {
    scatter_points();
  }

  static Rig rig() {
    Rig rig;
    rig.imu = ImuCalibration{.rate_hz = kImuRate,
                             .gyro_noise_density = 2e-4,
                             .gyro_random_walk = 2e-5,
                             .accel_noise_density = 2e-3,
                             .accel_random_walk = 2e-4};
    CameraCalibration camera;
    camera.model = CameraModel(CameraModel::Parameters{
        .fx = kFocal, .fy = kFocal, .cx = 320.0, .cy = 240.0, .width = 640, .height = 480});
    Eigen::Matrix3d forward;  // x right, y down, z forward, on a body with x forward, z up
    forward << 0, 0, 1, -1, 0, 0, 0, -1, 0;
    camera.T_body_camera = {Eigen::Quaterniond(forward), {0.1, 0.0, 0.05}};
    rig.cameras.push_back(camera);
    DvlCalibration dvl;
    dvl.T_body_dvl = {so3::exp({3.14159265, 0.0, 0.0}), {-0.1, 0.05, -0.1}};
    dvl.velocity_noise = 0.005;
    dvl.beams = default_dvl_beams();
    rig.dvl = dvl;
    rig.depth = PressureDepthCalibration{.p_body_sensor = {0.0, 0.0, 0.1}, .noise_m = 0.01};
    return rig;
  }

  Stamp frame_stamp(int k) const {
    return spline_.start() + Duration::from_seconds(0.1 + k / kFrameRate);
  }
  int frames() const { return static_cast<int>((options_.duration_s - 0.5) * kFrameRate); }
  imu::NavState truth(int k) const {
    imu::NavState state = nav_state_at(spline_, frame_stamp(k));
    state.gyro_bias = options_.gyro_bias;
    state.accel_bias = options_.accel_bias;
    return state;
  }

  /// Noisy samples since the last call, up to the first one that covers the frame.
  std::vector<ImuSample> imu_until(int k) {
    std::vector<ImuSample> samples;
    const Rig vehicle = rig();
    const double gyro = vehicle.imu->gyro_noise_density * std::sqrt(kImuRate);
    const double accel = vehicle.imu->accel_noise_density * std::sqrt(kImuRate);
    while (next_imu_ <= frame_stamp(k) + Duration{1}) {
      ImuSample sample = imu_at(spline_, vehicle.gravity(9.80665), next_imu_);
      sample.gyro += options_.gyro_bias + normal_vector(random_, gyro);
      sample.accel += options_.accel_bias + normal_vector(random_, accel);
      samples.push_back(sample);
      next_imu_ = next_imu_ + Duration::from_seconds(1.0 / kImuRate);
    }
    return samples;
  }

  vio::DvlMeasurement ping(Stamp stamp) {
    const Rig vehicle = rig();
    const imu::NavState state = nav_state_at(spline_, stamp);
    const Eigen::Vector3d rate = spline_.at(stamp).angular_velocity_body;
    const SE3& mount = vehicle.dvl->T_body_dvl;
    const Eigen::Vector3d v = state.v_body + rate.cross(mount.translation);
    const double sigma = vehicle.dvl->velocity_noise;
    return {stamp, mount.rotation.conjugate() * v + normal_vector(random_, sigma),
            sigma * sigma * Eigen::Matrix3d::Identity()};
  }

  vio::PressureDepthMeasurement depth(Stamp stamp) {
    const Rig vehicle = rig();
    const imu::NavState state = nav_state_at(spline_, stamp);
    const Eigen::Vector3d p = state.p_world + state.R_world_body * vehicle.depth->p_body_sensor;
    return {stamp, 10.0 - p.z() + random_.normal(0.0, vehicle.depth->noise_m),
            vehicle.depth->noise_m};
  }

  /// From now on all points move with `velocity` [m/s], like suspended silt.
  void set_current(const Eigen::Vector3d& velocity) { current_ = velocity; }

  /// Feature tracks of a frame; `visible` false: a black image, all tracks are lost.
  vio::TrackedFrame frame(int k, bool visible = true) {
    vio::TrackedFrame tracked;
    tracked.stamp = frame_stamp(k);
    tracked.statistics.quality = visible ? vio::FrameQuality::good : vio::FrameQuality::featureless;
    if (!visible) tracks_.clear();
    if (!visible) return tracked;
    const CameraCalibration camera = rig().cameras.front();
    const imu::NavState state = truth(k);
    const SE3 T_camera_world = (state.pose() * camera.T_body_camera).inverse();
    displacement_ += current_ / kFrameRate;
    std::map<std::size_t, Track> seen;
    for (std::size_t n = 0; n < points_.size() && seen.size() < kMaxTracks; ++n) {
      const Eigen::Vector3d drift = displacement_ + points_[n].velocity * (k / kFrameRate);
      const Eigen::Vector3d p = T_camera_world * (points_[n].position + drift);
      if (p.z() < 0.5 || p.z() > 8.0) continue;
      const auto pixel = camera.model.project(p);
      if (!pixel || !camera.model.in_image(*pixel, 2.0)) continue;
      const auto before = tracks_.find(n);
      Track track = before == tracks_.end() ? Track{next_id_++, 0} : before->second;
      ++track.length;
      seen[n] = track;
      tracked.observations.push_back(observe(track, *pixel));
      ++(track.length > 1 ? tracked.statistics.tracked : tracked.statistics.detected);
      if (track.length >= 10) ++tracked.statistics.stable;
    }
    tracks_ = std::move(seen);
    std::ranges::sort(tracked.observations, {}, &vio::FeatureObservation::id);
    return tracked;
  }

 private:
  static constexpr std::size_t kMaxTracks = 100;
  struct Point {
    Eigen::Vector3d position;
    Eigen::Vector3d velocity;
  };
  struct Track {
    std::int64_t id = 0;
    int length = 0;
  };

  void scatter_points() {
    for (Stamp t = spline_.start(); t <= spline_.end(); t = t + Duration::from_seconds(0.25)) {
      const Eigen::Vector3d center = spline_.at(t).T_world_body.translation;
      for (int n = 0; n < 12; ++n) {
        Point point{center + random_vector(random_, 5.0), Eigen::Vector3d::Zero()};
        if (random_.uniform(0.0, 1.0) < options_.outliers) {
          point.velocity = random_vector(random_, 0.3);
        }
        points_.push_back(point);
      }
    }
  }

  vio::FeatureObservation observe(const Track& track, const Eigen::Vector2d& pixel) {
    const Eigen::Vector2d noisy =
        pixel + Eigen::Vector2d(random_.normal(0.0, options_.pixel_sigma),
                                random_.normal(0.0, options_.pixel_sigma));
    vio::FeatureObservation seen;
    seen.id = track.id;
    seen.pixel = noisy;
    seen.point = (noisy - Eigen::Vector2d(320.0, 240.0)) / kFocal;
    seen.track_length = track.length;
    return seen;
  }

  SimulatedDiveOptions options_;
  Random random_;
  Se3Spline spline_;
  std::vector<Point> points_;
  Eigen::Vector3d current_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d displacement_ = Eigen::Vector3d::Zero();
  std::map<std::size_t, Track> tracks_;
  std::int64_t next_id_ = 0;
  Stamp next_imu_ = spline_.start();
};

}  // namespace apvi::test
