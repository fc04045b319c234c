// SPDX-License-Identifier: BSD-3-Clause
#include "vio/frontend/rigidity_check.hpp"

#include <array>
#include <utility>

#include "vio/frontend/epipolar_check.hpp"

namespace apvi::vio {
namespace {

using Eigen::Quaterniond;

// Frame gaps to compare with. The first must be 1: its rotation is propagated to the others.
constexpr std::array<std::size_t, 3> kGaps = {1, 4, 10};

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
  const auto R_now_earlier = chained(R_now_last, earlier.R_last_frame);
  const auto motion = best_motion(pairs, R_now_earlier, threshold_);
  if (!motion) return R_now_earlier;
  const Eigen::Matrix3d essential = motion->essential();
  for_each_pair(earlier.points, now, is_inlier, [&](std::size_t i, const PointPair& pair) {
    if (epipolar_distance(essential, pair) > threshold_) is_inlier[i] = 0;
  });
  return motion->R_now_before;
}

std::vector<char> RigidityCheck::check(const std::vector<TrackPoint>& now,
                                       const std::optional<Quaterniond>& R_now_last) {
  std::vector<char> is_inlier(now.size(), 1);
  R_now_last_ = R_now_last;
  for (const std::size_t gap : kGaps) {
    if (gap > frames_.size()) break;
    const auto R = compare(frames_[frames_.size() - gap], now, R_now_last_, is_inlier);
    // More accurate than the gyro, whose bias would accumulate over longer gaps.
    if (gap == 1) R_now_last_ = R;
  }
  return is_inlier;
}

void RigidityCheck::add(const std::vector<TrackPoint>& points) {
  for (Frame& frame : frames_) frame.R_last_frame = chained(R_now_last_, frame.R_last_frame);
  frames_.push_back({points, Quaterniond::Identity()});
  if (frames_.size() > kGaps.back()) frames_.pop_front();
  R_now_last_.reset();
}

void RigidityCheck::clear() {
  frames_.clear();
  R_now_last_.reset();
}

}  // namespace apvi::vio
