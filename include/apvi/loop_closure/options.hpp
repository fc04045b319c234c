// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/config/fields.hpp"

namespace apvi::loop_closure {

struct LoopOptions {
  double min_age_s = 20.0;   ///< minimum time between the keyframes of a loop [s]
  int max_features = 800;    ///< per image
  int max_places = 1000;     ///< stored places; beyond this number every second one is dropped
  int min_inliers = 25;      ///< minimum number of PnP inliers
  double pixel_sigma = 1.0;  ///< of a feature, including the error of its match [px]
  /// Odometry drift per square root of a second, one sigma.
  double drift_m_sqrt_s = 0.004;
  double drift_deg_sqrt_s = 0.1;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("min_age_s", min_age_s, Range{10.0, 1e6},
      "pose_graph: minimum time between the keyframes of a loop [s]");
    v("max_features", max_features, Range{50, 100000}, "pose_graph: maximum features per image");
    v("max_places", max_places, Range{2, 1000000},
      "pose_graph: maximum stored keyframes; beyond it every second one is removed");
    v("min_inliers", min_inliers, Range{6, 100000},
      "pose_graph: minimum inliers of a relative pose");
    v("pixel_sigma", pixel_sigma, Range{0.01, 100.0},
      "pose_graph: standard deviation of a feature [px]");
    v("drift_m_sqrt_s", drift_m_sqrt_s, Range{1e-6, 10.0},
      "pose_graph: position drift of odometry, one sigma [m/sqrt(s)]");
    v("drift_deg_sqrt_s", drift_deg_sqrt_s, Range{1e-6, 180.0},
      "pose_graph: heading drift of odometry, one sigma [deg/sqrt(s)]");
  }
};

}  // namespace apvi::loop_closure
