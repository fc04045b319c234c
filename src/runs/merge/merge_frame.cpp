// SPDX-License-Identifier: BSD-3-Clause
#include "runs/merge/merge_frame.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/geometry/so3.hpp"
#include "apvi/io/tum.hpp"
#include "apvi/sensors/rig.hpp"
#include "loop_closure/merge_sessions.hpp"
#include "runs/smoothed.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

constexpr double kHalfWindow_s = 2.0;  // of the mean change
constexpr double kMaxPoseGap_s = 1.0;  // of the smoothed trajectory

/// Change of a pose: rotation vector in the world, and shift.
struct Change {
  Stamp stamp;
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();
};

std::vector<Change> changes_of(const Trajectory& poses, const Trajectory& corrected) {
  std::vector<Change> changes;
  for (const StampedPose& pose : poses.poses) {
    const auto target = corrected.at(pose.stamp, Duration::from_seconds(kMaxPoseGap_s));
    if (!target) continue;
    const SE3& T = pose.T_world_body;
    changes.push_back({.stamp = pose.stamp,
                       .rotation = so3::log(target->rotation * T.rotation.inverse()),
                       .shift = target->translation - T.translation});
  }
  return changes;
}

/// The mean of those near a stamp, or the nearest one.
Change mean_near(const std::vector<Change>& changes, Stamp stamp) {
  const auto before = [](const Change& change, Stamp s) { return change.stamp < s; };
  const Duration half = Duration::from_seconds(kHalfWindow_s);
  auto first = std::lower_bound(changes.begin(), changes.end(), stamp - half, before);
  auto last = std::lower_bound(first, changes.end(), stamp + half, before);
  if (first == last) {
    if (first == changes.end()) --first;
    last = first + 1;
  }
  Change mean{.stamp = stamp};
  for (auto change = first; change != last; ++change) {
    mean.rotation += change->rotation;
    mean.shift += change->shift;
  }
  const auto count = static_cast<double>(last - first);
  mean.rotation /= count;
  mean.shift /= count;
  return mean;
}

loop_closure::Session session_of(const MergeSession& session) {
  const fs::path smoothed = session.run / kSmoothedFile;
  if (!fs::exists(smoothed)) {
    fail_input("{}: missing; a run without smoothing can be merged with --same-frame only",
               smoothed.string());
  }
  return {.places = loop_closure::load_place_map(loop_closure::find_place_map(session.run)),
          .trajectory = io::read_trajectory(smoothed),
          .camera = make_rig(session.config.rig).cameras.at(0).model,
          .pixel_sigma = session.config.smoothing.pixel_sigma};
}

}  // namespace

Trajectory moved_like(const Trajectory& poses, const Trajectory& corrected) {
  const std::vector<Change> changes = changes_of(poses, corrected);
  Trajectory moved = poses;
  if (changes.empty()) return moved;
  for (StampedPose& pose : moved.poses) {
    const Change change = mean_near(changes, pose.stamp);
    SE3& T = pose.T_world_body;
    T.rotation = (so3::exp(change.rotation) * T.rotation).normalized();
    T.translation += change.shift;
  }
  return moved;
}

std::vector<eval::Json> join_frames(std::vector<MergeSession>& sessions) {
  std::vector<loop_closure::Session> inputs;
  for (const MergeSession& session : sessions) inputs.push_back(session_of(session));
  log::info("looking for common places");
  const std::vector<loop_closure::MergedSession> merged = loop_closure::merge_sessions(inputs);
  std::vector<eval::Json> graphs;
  for (std::size_t i = 0; i < sessions.size(); ++i) {
    const std::string run = sessions[i].run.string();
    const loop_closure::MergedSession& found = merged[i];
    if (!found.found) {
      fail_input("{}: shares no places with the runs before it; nothing was merged", run);
    }
    if (i > 0) {
      log::info("{}: {} of its {} places are in the others, {:.3f} m apart (RMS)", run, found.edges,
                inputs[i].places.places.size(), found.rms_m);
    }
    move_session(sessions[i],
                 moved_like(sessions[i].poses, found.path.corrected(inputs[i].trajectory)));
    graphs.push_back({{"places", inputs[i].places.places.size()},
                      {"edges", found.edges},
                      {"rejected", found.rejected},
                      {"rms_placed_m", found.rms_placed_m},
                      {"rms_m", found.rms_m}});
  }
  return graphs;
}

}  // namespace apvi::runs
