// SPDX-License-Identifier: BSD-3-Clause
#include "vio/frontend/rigidity_check.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include "vio/frontend/epipolar_check.hpp"

namespace apvi::vio {
namespace {

using Eigen::Quaterniond;

// Ages of the frames to compare with, besides the last one.
constexpr std::array<double, 2> kAges_s = {0.2, 0.5};
// A frame that is younger by this fraction will do: stamps jitter.
constexpr double kAgeTolerance = 0.1;

// Calls f(index in `now`, pair) for every inlier track that was in the earlier frame.
template <typename F>
void for_each_pair(const std::vector<TrackPoint>& earlier, const std::vector<TrackPoint>& now,
                   const std::vector<char>& is_inlier, F&& f) {
  auto before = earlier.begin();
  for (std::size_t i = 0; i < now.size(); ++i) {
    while (before != earlier.end() && before->id < now[i].id) ++before;
    if (before == earlier.end()) return;
    if (is_inlier[i] != 0 && before->id == now[i].id) f(i, PointPair{before->point, now[i].point});
  }
}

std::optional<Quaterniond> chained(const std::optional<Quaterniond>& a,
                                   const std::optional<Quaterniond>& b) {
  if (!a || !b) return std::nullopt;
  return (*a * *b).normalized();
}

}  // namespace

std::optional<Quaterniond> RigidityCheck::compare(const Frame& earlier,
                                                  const std::vector<TrackPoint>& now,
                                                  const std::optional<Quaterniond>& R_now_last,
                                                  std::vector<char>& is_inlier) const {
  std::vector<PointPair> pairs;
  for_each_pair(earlier.points, now, is_inlier,
                [&](std::size_t, const PointPair& pair) { pairs.push_back(pair); });
  auto R_now_earlier = chained(R_now_last, earlier.R_last_frame);
  const auto motion = best_motion(pairs, R_now_earlier, threshold_);
  if (!motion) return R_now_earlier;
  const Eigen::Matrix3d essential = motion->essential();
  for_each_pair(earlier.points, now, is_inlier, [&](std::size_t i, const PointPair& pair) {
    if (epipolar_distance(essential, pair) > threshold_) is_inlier[i] = 0;
  });
  return motion->R_now_before;
}

// The last frame first: its rotation is propagated to the others.
std::vector<const RigidityCheck::Frame*> RigidityCheck::to_compare(Stamp stamp) const {
  std::vector<const Frame*> chosen;
  if (!frames_.empty()) chosen.push_back(&frames_.back());
  for (const double age_s : kAges_s) {
    const auto found = std::find_if(frames_.rbegin(), frames_.rend(), [&](const Frame& frame) {
      return seconds_between(frame.stamp, stamp) >= (1.0 - kAgeTolerance) * age_s;
    });
    if (found != frames_.rend() && &*found != chosen.back()) chosen.push_back(&*found);
  }
  return chosen;
}

std::vector<char> RigidityCheck::check(Stamp stamp, const std::vector<TrackPoint>& now,
                                       const std::optional<Quaterniond>& R_now_last) {
  std::vector<char> is_inlier(now.size(), 1);
  R_now_last_ = R_now_last;
  for (const Frame* earlier : to_compare(stamp)) {
    const auto R = compare(*earlier, now, R_now_last_, is_inlier);
    // More accurate than the gyro, whose bias would accumulate over longer gaps.
    if (earlier == &frames_.back()) R_now_last_ = R;
  }
  return is_inlier;
}

void RigidityCheck::add(Stamp stamp, const std::vector<TrackPoint>& points) {
  for (Frame& frame : frames_) frame.R_last_frame = chained(R_now_last_, frame.R_last_frame);
  frames_.push_back({stamp, points, Quaterniond::Identity()});
  while (frames_.size() > 1 && seconds_between(frames_[1].stamp, stamp) >= kAges_s.back()) {
    frames_.pop_front();
  }
  R_now_last_.reset();
}

void RigidityCheck::clear() {
  frames_.clear();
  R_now_last_.reset();
}

}  // namespace apvi::vio
