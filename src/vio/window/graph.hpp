// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/loss_function.h>

#include <deque>
#include <memory>
#include <vector>

#include "apvi/sensors/rig.hpp"
#include "apvi/vio/config.hpp"
#include "vio/factors/factors.hpp"
#include "vio/marginalization/marginalization.hpp"
#include "vio/window/window.hpp"

namespace apvi::vio {

/// A term of the cost function and the frame or landmark it belongs to.
struct Term {
  const ceres::CostFunction* cost = nullptr;
  const ceres::LossFunction* loss = nullptr;
  std::vector<Block> blocks;
  const Frame* frame = nullptr;        ///< first frame of an inertial, DVL or depth term
  const Landmark* landmark = nullptr;  ///< of a visual term
  bool is_hold = false;                ///< of CalibrationHold: no measurement
};

/// All terms of a window at its current state: built once per frame and used by the solver, the
/// pose information and marginalization. The window must not be moved meanwhile.
class Graph {
 public:
  Graph(Window& window, const Config& config, const Rig& rig);

  const std::vector<Term>& terms() const { return terms_; }
  /// Number of landmarks in the graph.
  int landmarks() const { return landmarks_; }
  int observations() const {
    return static_cast<int>(reprojections_.size() + cross_camera_.size());
  }

 private:
  void add_prior(const std::shared_ptr<const Prior>& prior, const Frame* frame);
  void add_inertial();
  void add_dvl(Frame& frame);
  void add_pressure_depth(Frame& frame);
  void add_landmark(Landmark& landmark);
  void add_observation(Landmark& landmark, const Landmark::Observation& seen);
  double weight(const Landmark::Observation& observation) const;
  const FirstEstimate* first(const Frame& frame) const;

  Window& window_;
  const Config& config_;
  const Rig& rig_;
  ceres::HuberLoss vision_loss_;
  ceres::HuberLoss sensor_loss_;
  std::vector<Term> terms_;
  int landmarks_ = 0;
  // Deques keep the addresses of their elements valid.
  std::deque<PriorFactor> priors_;
  std::deque<ReprojectionFactor> reprojections_;
  std::deque<CrossCameraFactor> cross_camera_;
  std::deque<StereoFactor> stereos_;
  std::deque<ImuFactor> inertial_;
  std::deque<DvlVelocityFactor> velocities_;
  std::deque<PressureDepthFactor> depths_;
};

/// Minimizes the cost of the graph.
void solve(const Graph& graph, Window& window, const Config& config, int iterations);

}  // namespace apvi::vio
