// SPDX-License-Identifier: BSD-3-Clause
#include "vio/window/window_solution.hpp"

#include "core/stopwatch.hpp"
#include "vio/window/window_update.hpp"

namespace apvi::vio {

void solve_window(const Graph& graph, Window& window, const Config& config, const Rig& rig,
                  int iterations, Result& result) {
  Stopwatch watch;
  solve(graph, window, config, iterations);
  result.solve_s = watch.seconds();
  result.landmarks = graph.landmarks();
  result.observations = graph.observations();
  const Frame& newest = window.newest();
  if (!newest.vision_excluded) {
    reject_outliers(window, rig, outlier_limit_px(window, rig, config.vision.max_reprojection_px));
  }
  result.reprojection_rms_px = newest.vision_excluded ? 0.0 : newest_rms_px(window, rig);
  result.state = to_nav_state(newest.state);
  watch.reset();
  const PoseInformation informations = newest_pose_information(graph, window, config);
  result.information = informations.absolute;
  result.window_information = informations.over_window;
  result.window_s = seconds_between(window.frames.front()->stamp, newest.stamp);
  result.information_s = watch.seconds();
  result.keyframe = window.frames.size() == 1 || is_keyframe(window, config);
}

}  // namespace apvi::vio
