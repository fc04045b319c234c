// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/loss_function.h>

#include <deque>
#include <memory>
#include <vector>

#include "apvi/sensors/rig.hpp"
#include "apvi/vio/config.hpp"
#include "apvi/vio/factors.hpp"
#include "apvi/vio/marginalization.hpp"
#include "apvi/vio/window.hpp"

namespace apvi::vio {

/// A term of the window's cost, with whom it belongs to.
struct Term {
  const ceres::CostFunction* cost = nullptr;
  const ceres::LossFunction* loss = nullptr;
  std::vector<Block> blocks;
  const Frame* frame = nullptr;        ///< of an inertial, DVL or depth term: the (first) frame
  const Landmark* landmark = nullptr;  ///< of a visual term
};

/// All terms of a window as it is now: built once a frame, used by the solve, by the information of
/// the newest pose and by marginalization. The window must stay where it is as long.
class Graph {
 public:
  Graph(Window& window, const Config& config, const Rig& rig);

  const std::vector<Term>& terms() const { return terms_; }
  /// Landmarks that take part.
  int landmarks() const { return landmarks_; }
  int sightings() const { return static_cast<int>(reprojections_.size() + crosses_.size()); }

 private:
  void add_prior(const std::shared_ptr<const Prior>& prior, const Frame* frame);
  void add_inertial();
  void add_dvl(Frame& frame);
  void add_depth(Frame& frame);
  void add_landmark(Landmark& landmark);
  void add_sighting(Landmark& landmark, const Landmark::Sighting& seen);
  double weight(const Landmark::Sighting& sighting) const;
  const FirstEstimate* first(const Frame& frame) const;

  Window& window_;
  const Config& config_;
  const Rig& rig_;
  ceres::HuberLoss vision_loss_;
  ceres::HuberLoss sensor_loss_;
  std::vector<Term> terms_;
  int landmarks_ = 0;
  // Deques keep the addresses of what they hold.
  std::deque<PriorFactor> priors_;
  std::deque<ReprojectionFactor> reprojections_;
  std::deque<CrossCameraFactor> crosses_;
  std::deque<StereoFactor> stereos_;
  std::deque<ImuFactor> inertial_;
  std::deque<DvlVelocityFactor> velocities_;
  std::deque<DepthFactor> depths_;
};

/// Moves the window to a minimum of the graph's cost.
void solve(const Graph& graph, Window& window, const Config& config, int iterations);

}  // namespace apvi::vio
