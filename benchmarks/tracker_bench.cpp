// SPDX-License-Identifier: BSD-3-Clause
// Speed of the visual front end on a recording, lifetime of its tracks, and their distances from
// the epipolar lines of the reference motion and of the best-fitting motion.
//
//   tracker_bench DATASET [gyro bias x y z, rad/s]
#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <map>
#include <string>
#include <variant>

#include "apvi/core/error.hpp"
#include "apvi/geometry/so3.hpp"
#include "apvi/io/sequence.hpp"
#include "core/stopwatch.hpp"
#include "imu/sample_buffer.hpp"
#include "vio/factors/projection.hpp"
#include "vio/frontend/epipolar_check.hpp"
#include "vio/frontend/tracker.hpp"

namespace apvi::bench {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

struct Recording {
  Rig rig;
  Trajectory reference;
  imu::SampleBuffer inertial{Duration::from_seconds(1e6)};
  std::vector<ImageFrame> images;
};

struct Outcome {
  std::vector<vio::TrackedFrame> frames;
  std::vector<double> milliseconds;
};

Recording read(const std::string& path) {
  io::DatasetConfig dataset;
  dataset.path = path;
  const auto reader = io::open_sequence(dataset, {"camera", "imu"});
  Recording recording;
  recording.rig = make_rig(reader->rig());
  if (recording.rig.cameras.empty()) fail_input("{}: the rig has no camera", path);
  recording.reference = reader->reference().value_or(Trajectory{});
  while (const auto event = reader->next()) {
    if (const auto* image = std::get_if<ImageFrame>(&*event)) {
      if (image->camera == 0) recording.images.push_back(*image);
    } else if (const auto* sample = std::get_if<ImuSample>(&*event)) {
      recording.inertial.add(*sample);
    }
  }
  return recording;
}

std::optional<Quaterniond> integrate_gyro(const imu::SampleBuffer& inertial, Stamp from, Stamp to,
                                          const Vector3d& bias) {
  const auto samples = inertial.between(from, to);
  if (samples.size() < 2) return std::nullopt;
  Quaterniond R = Quaterniond::Identity();
  for (std::size_t i = 0; i + 1 < samples.size(); ++i) {
    const Vector3d rate = 0.5 * (samples[i].gyro + samples[i + 1].gyro) - bias;
    R = R * so3::exp(rate * seconds_between(samples[i].stamp, samples[i + 1].stamp));
  }
  return R;
}

Outcome track(const Recording& recording, const Vector3d& bias) {
  vio::Tracker tracker({}, {recording.rig.cameras[0]});
  Outcome outcome;
  for (const ImageFrame& image : recording.images) {
    const cv::Mat pixels = image.decode();
    std::optional<Quaterniond> R_before_now;
    if (!outcome.frames.empty()) {
      R_before_now =
          integrate_gyro(recording.inertial, outcome.frames.back().stamp, image.stamp, bias);
    }
    const Stopwatch watch;
    outcome.frames.push_back(tracker.process({pixels}, image.stamp, R_before_now));
    outcome.milliseconds.push_back(1e3 * watch.seconds());
  }
  return outcome;
}

double quantile(std::vector<double> values, double q) {
  if (values.empty()) return 0.0;
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(q * static_cast<double>(values.size() - 1))];
}

void print_counts(const Outcome& outcome) {
  std::vector<double> tracked;
  std::vector<double> stable;
  std::map<std::int64_t, double> lifetimes;
  for (const vio::TrackedFrame& frame : outcome.frames) {
    tracked.push_back(frame.statistics.tracked);
    stable.push_back(frame.statistics.stable);
    for (const vio::FeatureObservation& o : frame.observations) lifetimes[o.id] = o.track_length;
  }
  std::vector<double> lifetimes_by_observation;
  for (const auto& [id, length] : lifetimes) {
    lifetimes_by_observation.insert(lifetimes_by_observation.end(),
                                    static_cast<std::size_t>(length), length);
  }
  fmt::print("frames {}, ms per frame: median {:.2f}, 90 % {:.2f}, 99 % {:.2f}\n",
             outcome.frames.size(), quantile(outcome.milliseconds, 0.5),
             quantile(outcome.milliseconds, 0.9), quantile(outcome.milliseconds, 0.99));
  fmt::print(
      "tracked {:.0f}, stable {:.0f} (medians); track lifetime (median over observations) {:.0f} "
      "frames\n",
      quantile(tracked, 0.5), quantile(stable, 0.5), quantile(lifetimes_by_observation, 0.5));
}

std::vector<vio::PointPair> pairs_between(const vio::TrackedFrame& before,
                                          const vio::TrackedFrame& now) {
  std::map<std::int64_t, Eigen::Vector2d> points;
  for (const vio::FeatureObservation& o : before.observations) points[o.id] = o.point;
  std::vector<vio::PointPair> pairs;
  for (const vio::FeatureObservation& o : now.observations) {
    if (points.count(o.id) != 0) pairs.push_back({points[o.id], o.point});
  }
  return pairs;
}

void print_epipolar(const Recording& recording, const Outcome& outcome, std::size_t gap) {
  const CameraCalibration& camera = recording.rig.cameras[0];
  const double focal = vio::focal_length(camera.model);
  std::vector<double> by_reference;
  std::vector<double> by_best;
  for (std::size_t k = gap; k < outcome.frames.size(); ++k) {
    const vio::TrackedFrame& a = outcome.frames[k - gap];
    const vio::TrackedFrame& b = outcome.frames[k];
    const auto pose_a = recording.reference.at(a.stamp, Duration::from_seconds(0.1));
    const auto pose_b = recording.reference.at(b.stamp, Duration::from_seconds(0.1));
    if (!pose_a || !pose_b) continue;
    const SE3 T_b_a = (*pose_b * camera.T_body_camera).inverse() * (*pose_a * camera.T_body_camera);
    const auto pairs = pairs_between(a, b);
    const auto best = vio::best_motion(pairs, T_b_a.rotation, 1.0 / focal);
    if (!best) continue;
    const Eigen::Matrix3d essential = vio::essential_matrix(T_b_a.rotation, T_b_a.translation);
    for (const vio::PointPair& pair : pairs) {
      by_reference.push_back(focal * vio::epipolar_distance(essential, pair));
      by_best.push_back(focal * vio::epipolar_distance(best->essential(), pair));
    }
  }
  fmt::print(
      "{} frames apart, epipolar distance [px]: reference motion {:.3f} (90 % {:.2f}), "
      "best-fitting "
      "motion {:.3f} (90 % {:.2f})\n",
      gap, quantile(by_reference, 0.5), quantile(by_reference, 0.9), quantile(by_best, 0.5),
      quantile(by_best, 0.9));
}

}  // namespace
}  // namespace apvi::bench

int main(int argc, char** argv) {
  namespace bench = apvi::bench;
  if (argc != 2 && argc != 5) {
    fmt::print(stderr, "usage: tracker_bench DATASET [gyro bias x y z]\n");
    return 2;
  }
  try {
    const auto recording = bench::read(argv[1]);
    Eigen::Vector3d bias = Eigen::Vector3d::Zero();
    for (int i = 2; i < argc; ++i) bias(i - 2) = std::atof(argv[i]);
    const auto outcome = bench::track(recording, bias);
    bench::print_counts(outcome);
    for (const std::size_t gap : {1, 5, 10, 20}) bench::print_epipolar(recording, outcome, gap);
  } catch (const std::exception& e) {
    fmt::print(stderr, "{}\n", e.what());
    return 1;
  }
  return 0;
}
