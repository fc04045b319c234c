// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "apvi/config/fields.hpp"

namespace apvi::loop_closure {

/// How places are stored and recognized.
struct PlaceOptions {
  double min_age_s = 20.0;   ///< minimum time between the keyframes of a loop [s]
  int max_features = 800;    ///< per image
  int max_places = 1000;     ///< stored places; beyond this number they are thinned out in space
  int min_inliers = 25;      ///< minimum number of PnP inliers
  double pixel_sigma = 1.0;  ///< of a feature, including the error of its match [px]

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("min_age_s", min_age_s, Range{10.0, 1e6}, "minimum time between the keyframes of a loop [s]");
    v("max_features", max_features, Range{50, 100000}, "maximum features per image");
    v("max_places", max_places, Range{2, 1000000},
      "maximum stored keyframes; beyond it, those whose view others have are removed");
    v("min_inliers", min_inliers, Range{6, 100000}, "minimum inliers of a relative pose");
    v("pixel_sigma", pixel_sigma, Range{0.01, 100.0}, "standard deviation of a feature [px]");
  }
};

/// Loop closure of a map whose trajectory has no pose graph.
struct LoopOptions : PlaceOptions {
  /// Odometry drift per square root of a second, one sigma.
  double drift_m_sqrt_s = 0.004;
  double drift_deg_sqrt_s = 0.1;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    PlaceOptions::visit(v);
    v("drift_m_sqrt_s", drift_m_sqrt_s, Range{1e-6, 10.0},
      "position drift of odometry, one sigma [m/sqrt(s)]");
    v("drift_deg_sqrt_s", drift_deg_sqrt_s, Range{1e-6, 180.0},
      "heading drift of odometry, one sigma [deg/sqrt(s)]");
  }
};

/// Loop closure of the trajectory: the pose graph beside the odometry.
struct SmoothingOptions : PlaceOptions {
  bool enabled = true;
  double node_step_s = 1.0;   ///< time between the nodes of the graph [s]
  double drift_factor = 5.0;  ///< estimators are overconfident, see docs/localization.md
  int max_nodes = 500;        ///< during the dive; beyond this number every second one is dropped
  std::string known_map;      ///< run folder of an earlier dive to be found in; empty: none
  double gate = 16.25;        ///< squared Mahalanobis distance of a loop, 4 degrees of freedom
  bool bundle_adjustment = true;  ///< of all places, at the end of the dive

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("enabled", enabled,
      "correct the trajectory by loop closures, in trajectory_smoothed.tum; needs a camera and an "
      "IMU");
    PlaceOptions::visit(v);
    v("node_step_s", node_step_s, Range{0.1, 10.0}, "time between the nodes of the graph [s]");
    v("max_nodes", max_nodes, Range{10, 1000000},
      "maximum nodes of the graph during the dive; beyond it every second one is removed, until "
      "the end");
    v("drift_factor", drift_factor, Range{0.01, 100.0},
      "factor on the standard deviation of the odometry's drift");
    v("known_map", known_map,
      "run folder of an earlier dive, in whose map this dive is found (relocalization); empty: "
      "none");
    v("gate", gate, Range{0.1, 1e9},
      "largest squared Mahalanobis distance of a loop closure or anchor from the graph; 16.25 "
      "rejects 0.27 % of the true ones (4 degrees of freedom)");
    v("bundle_adjustment", bundle_adjustment,
      "at the end of the dive, adjust all poses to the features of all places");
  }
};

}  // namespace apvi::loop_closure
