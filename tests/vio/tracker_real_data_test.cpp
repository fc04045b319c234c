// SPDX-License-Identifier: BSD-3-Clause
// Tracker on real images: track lengths and epipolar errors.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <variant>

#include "apvi/geometry/so3.hpp"
#include "apvi/io/sequence.hpp"
#include "imu/sample_buffer.hpp"
#include "support/test_data.hpp"
#include "vio/frontend/epipolar_check.hpp"
#include "vio/frontend/tracker.hpp"

namespace apvi::vio {
namespace {

using Eigen::Quaterniond;

constexpr int kFrames = 120;

std::optional<Quaterniond> turn(const imu::SampleBuffer& buffer, Stamp from, Stamp to) {
  const auto samples = buffer.between(from, to);
  if (samples.size() < 2) return std::nullopt;
  Quaterniond R = Quaterniond::Identity();
  for (std::size_t i = 0; i + 1 < samples.size(); ++i) {
    const Eigen::Vector3d rate = 0.5 * (samples[i].gyro + samples[i + 1].gyro);
    R = R * so3::exp(rate * seconds_between(samples[i].stamp, samples[i + 1].stamp));
  }
  return R;
}

std::vector<TrackedFrame> track(const std::filesystem::path& folder) {
  io::DatasetConfig dataset;
  dataset.path = folder.string();
  const auto reader = io::open_sequence(dataset, {"camera", "imu"});
  Tracker tracker({}, make_rig(reader->rig()).cameras);
  imu::SampleBuffer buffer(Duration::from_seconds(2.0));
  std::vector<TrackedFrame> frames;
  std::vector<ImageFrame> waiting;  // frames waiting for inertial samples up to their stamp
  while (frames.size() < kFrames) {
    const auto event = reader->next();
    if (!event) break;
    if (const auto* image = std::get_if<ImageFrame>(&*event)) waiting.push_back(*image);
    if (const auto* sample = std::get_if<ImuSample>(&*event)) buffer.add(*sample);
    if (waiting.empty() || !buffer.newest() || *buffer.newest() < waiting[0].stamp) continue;
    const Stamp stamp = waiting[0].stamp;
    std::optional<Quaterniond> R_before_now;
    if (!frames.empty()) R_before_now = turn(buffer, frames.back().stamp, stamp);
    frames.push_back(tracker.process({waiting[0].decode()}, stamp, R_before_now));
    waiting.erase(waiting.begin());
  }
  return frames;
}

std::vector<PointPair> pairs_between(const TrackedFrame& before, const TrackedFrame& now) {
  std::map<std::int64_t, Eigen::Vector2d> points;
  for (const FeatureObservation& o : before.observations) points[o.id] = o.point;
  std::vector<PointPair> pairs;
  for (const FeatureObservation& o : now.observations) {
    if (points.count(o.id) != 0) pairs.push_back({points[o.id], o.point});
  }
  return pairs;
}

TEST(TrackerOnRealData, KeepsEnoughTracksWithSmallEpipolarError) {
  APVI_NEEDS_DATA(folder, "euroc_mh01_apvi");
  const std::vector<TrackedFrame> frames = track(folder);
  ASSERT_EQ(frames.size(), static_cast<std::size_t>(kFrames));
  std::vector<double> distances;  // over five frames [px]
  std::vector<int> tracked;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    EXPECT_EQ(frames[k].statistics.quality, FrameQuality::good);
    if (k > 0) tracked.push_back(frames[k].statistics.tracked);
    if (k < 5) continue;
    constexpr double kFocal = 458.0;
    const auto pairs = pairs_between(frames[k - 5], frames[k]);
    const auto motion = best_motion(pairs, std::nullopt, 1.0 / kFocal);
    ASSERT_TRUE(motion);
    for (const PointPair& pair : pairs) {
      distances.push_back(kFocal * epipolar_distance(motion->essential(), pair));
    }
  }
  std::sort(distances.begin(), distances.end());
  std::sort(tracked.begin(), tracked.end());
  EXPECT_GT(tracked[tracked.size() / 2], 110);
  EXPECT_GT(tracked.front(), 60);
  EXPECT_LT(distances[distances.size() / 2], 0.3);
  EXPECT_LT(distances[distances.size() * 9 / 10], 1.0);
}

}  // namespace
}  // namespace apvi::vio
