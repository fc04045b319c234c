// SPDX-License-Identifier: BSD-3-Clause
#include "vio/initialization/start_problem.hpp"

#include <algorithm>
#include <map>

namespace apvi::vio {

std::vector<std::size_t> choose_keyframes(std::size_t first, std::size_t count, int max_count) {
  const std::size_t n = std::min(count, static_cast<std::size_t>(max_count));
  std::vector<std::size_t> chosen;
  for (std::size_t k = 0; k < n; ++k) chosen.push_back(first + k * (count - 1) / (n - 1));
  return chosen;
}

std::vector<ImuSample> join(const std::vector<InitFrame>& frames, std::size_t after,
                            std::size_t until) {
  std::vector<ImuSample> samples;
  for (std::size_t i = after + 1; i <= until; ++i) {
    for (const ImuSample& sample : frames[i].imu) {
      if (samples.empty() || sample.stamp > samples.back().stamp) samples.push_back(sample);
    }
  }
  return samples;
}

int common_tracks(const TrackedFrame& a, const TrackedFrame& b) {
  int common = 0;
  visit_common_tracks(a, b, [&](const auto&, const auto&) { ++common; });
  return common;
}

StartProblem make_start_problem(const std::vector<InitFrame>& frames, std::size_t first,
                                int keyframes) {
  StartProblem problem;
  problem.frames = choose_keyframes(first, frames.size() - first, keyframes);
  problem.imu.resize(problem.frames.size());
  std::map<std::int64_t, StartProblem::Track> by_id;
  for (int k = 0; k < problem.keyframes(); ++k) {
    const auto index = static_cast<std::size_t>(k);
    if (k > 0) {
      problem.imu[index] = join(frames, problem.frames[index - 1], problem.frames[index]);
    }
    for (const FeatureObservation& seen : frames[problem.frames[index]].tracked.observations) {
      if (seen.camera == 0) by_id[seen.id].views.push_back({k, seen.point});
    }
  }
  for (auto& [id, track] : by_id) {
    if (track.views.size() >= 3) problem.tracks.push_back(std::move(track));
  }
  return problem;
}

}  // namespace apvi::vio
