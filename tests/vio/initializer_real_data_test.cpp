// SPDX-License-Identifier: BSD-3-Clause
// Initialization on real images and IMU, from many start times of a recording in motion, against
// ground truth.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <variant>

#include "apvi/geometry/so3.hpp"
#include "apvi/io/sequence.hpp"
#include "imu/sample_buffer.hpp"
#include "support/test_data.hpp"
#include "vio/frontend/tracker.hpp"
#include "vio/initialization/initializer.hpp"

namespace apvi::vio {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kSpan_s = 3.0;  // span of frames used for initialization [s]

struct Recording {
  Rig rig;
  std::vector<ImageFrame> images;
  imu::SampleBuffer imu{Duration::from_seconds(1e6)};
  Trajectory reference;
};

Recording read(const std::filesystem::path& folder) {
  io::DatasetConfig dataset;
  dataset.path = folder.string();
  const auto reader = io::open_sequence(dataset, {"camera", "imu"});
  Recording recording;
  recording.rig = make_rig(reader->rig());
  while (const auto event = reader->next()) {
    if (const auto* image = std::get_if<ImageFrame>(&*event)) recording.images.push_back(*image);
    if (const auto* sample = std::get_if<ImuSample>(&*event)) recording.imu.add(*sample);
  }
  recording.reference = reader->reference().value();
  return recording;
}

Quaterniond turn(const std::vector<ImuSample>& samples) {
  Quaterniond R = Quaterniond::Identity();
  for (std::size_t i = 0; i + 1 < samples.size(); ++i) {
    const Vector3d rate = 0.5 * (samples[i].gyro + samples[i + 1].gyro);
    R = R * so3::exp(rate * seconds_between(samples[i].stamp, samples[i + 1].stamp));
  }
  return R;
}

struct Attempt {
  double waited_s = 0.0;
  std::vector<InitFrame> frames;
  InitResult result;
};

// Adds frames until initialization succeeds.
Attempt start_from(const Recording& recording, double from_s) {
  const ImuCalibration& imu = *recording.rig.imu;
  const imu::Noise noise{imu.gyro_noise_density, imu.accel_noise_density, imu.gyro_random_walk,
                         imu.accel_random_walk};
  const Stamp begin = recording.images.front().stamp + Duration::from_seconds(from_s - 1e-6);
  const CameraCalibration& first_camera = recording.rig.cameras.front();
  const InitCamera camera{first_camera.T_body_camera, first_camera.model.parameters().fx};
  Tracker tracker({}, recording.rig.cameras);
  Attempt attempt;
  std::optional<Stamp> first;
  for (const ImageFrame& image : recording.images) {
    if (image.stamp < begin) continue;
    if (!first) first = image.stamp;
    InitFrame frame;
    std::optional<Quaterniond> R_before_now;
    if (!attempt.frames.empty()) {
      frame.imu = recording.imu.between(attempt.frames.back().tracked.stamp, image.stamp);
      R_before_now = turn(frame.imu);
    }
    frame.tracked = tracker.process({image.decode()}, image.stamp, R_before_now);
    attempt.frames.push_back(std::move(frame));
    std::erase_if(attempt.frames, [&](const InitFrame& f) {
      return seconds_between(f.tracked.stamp, image.stamp) > kSpan_s;
    });
    attempt.waited_s = seconds_between(*first, image.stamp);
    attempt.result = initialize(attempt.frames, camera, noise, 9.81, {});
    if (attempt.result.status == InitStatus::success) break;
  }
  return attempt;
}

struct Errors {
  double scale = 0.0;  ///< scale of the path, minus one
  double tilt_deg = 0.0;
};

Errors compare(const Attempt& attempt, const Trajectory& reference) {
  std::vector<Vector3d> estimate, truth;
  Errors errors;
  for (std::size_t k = attempt.result.first; k < attempt.frames.size(); ++k) {
    const auto pose = reference.at(attempt.frames[k].tracked.stamp, Duration::from_seconds(0.1));
    if (!pose) continue;
    const imu::NavState& state = attempt.result.states[k];
    estimate.push_back(state.p_world);
    truth.push_back(pose->translation);
    const Vector3d up = state.R_world_body.conjugate() * Vector3d::UnitZ();
    const Vector3d true_up = pose->rotation.conjugate() * Vector3d::UnitZ();
    const double tilt = std::acos(std::min(1.0, up.dot(true_up)));
    errors.tilt_deg = std::max(errors.tilt_deg, tilt * 180.0 / 3.14159265358979);
  }
  const auto size = [](const std::vector<Vector3d>& points) {
    Vector3d center = Vector3d::Zero();
    for (const Vector3d& p : points) center += p / static_cast<double>(points.size());
    double sum = 0.0;
    for (const Vector3d& p : points) sum += (p - center).squaredNorm();
    return std::sqrt(sum);
  };
  errors.scale = size(estimate) / size(truth) - 1.0;
  return errors;
}

TEST(InitializerOnRealData, AcceptedStartsAreAccurateFromTwentyOneStartTimes) {
  APVI_NEEDS_DATA(folder, "euroc_mh01_apvi");
  const Recording recording = read(folder);
  for (int n = 0; n <= 20; ++n) {
    const double from_s = 0.5 * n;
    const Attempt attempt = start_from(recording, from_s);
    ASSERT_EQ(attempt.result.status, InitStatus::success)
        << from_s << " s: " << to_string(attempt.result.status) << " " << attempt.result.detail;
    const Errors errors = compare(attempt, recording.reference);
    EXPECT_LT(std::abs(errors.scale), 0.12) << from_s << " s, " << attempt.result.detail;
    EXPECT_LT(errors.tilt_deg, 2.0) << from_s << " s";
    EXPECT_LE(attempt.waited_s, n == 0 ? 1.0 : 2.5) << from_s << " s";
  }
}

}  // namespace
}  // namespace apvi::vio
