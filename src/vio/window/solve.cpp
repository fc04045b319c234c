// SPDX-License-Identifier: BSD-3-Clause
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <algorithm>
#include <cstddef>
#include <memory>
#include <unordered_map>
#include <utility>
#include <vector>

#include "vio/window/graph.hpp"

namespace apvi::vio {
namespace {

ceres::Problem::Options problem_options() {
  ceres::Problem::Options options;
  options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.disable_all_safety_checks = true;
  return options;
}

// Copies of all parameters in one array, in window order, for Ceres. Ceres orders equal blocks by
// address, and the order affects rounding: with heap addresses, runs would not be reproducible.
class ParameterCopies {
 public:
  ParameterCopies(Window& window, const CalibrationConfig& config) {
    for (const auto& frame : window.frames) {
      add(frame->state.pose.data(), kPoseSize);
      add(frame->state.motion.data(), kMotionSize);
    }
    for (const CalibrationBlock& part : blocks(window.calibration, config)) {
      add(part.block.data, part.block.size);
    }
    if (window.depth_zero_m) add(&*window.depth_zero_m, 1);
    for (auto& [id, landmark] : window.landmarks) add(&landmark.inverse_depth, 1);
  }

  double* of(const double* original) { return numbers_.data() + at_.at(original); }

  void write_back() const {
    const double* from = numbers_.data();
    for (const Block& block : blocks_) {
      std::copy_n(from, block.size, block.data);
      from += block.size;
    }
  }

 private:
  void add(double* data, int size) {
    at_.emplace(data, numbers_.size());
    blocks_.push_back({data, size});
    numbers_.insert(numbers_.end(), data, data + size);
  }

  std::vector<Block> blocks_;
  std::vector<double> numbers_;  // values of the blocks, contiguous
  std::unordered_map<const double*, std::size_t> at_;
};

void add_states(ceres::Problem& problem, Window& window, const Config& config,
                ParameterCopies& copies, PoseManifold& manifold) {
  for (const auto& frame : window.frames) {
    double* pose = copies.of(frame->state.pose.data());
    double* motion = copies.of(frame->state.motion.data());
    problem.AddParameterBlock(pose, kPoseSize, &manifold);
    problem.AddParameterBlock(motion, kMotionSize);
    if (!frame->frozen) continue;
    problem.SetParameterBlockConstant(pose);
    problem.SetParameterBlockConstant(motion);
  }
  for (const CalibrationBlock& part : blocks(window.calibration, config.calibration)) {
    double* data = copies.of(part.block.data);
    const bool is_pose = part.block.size == kPoseSize;
    problem.AddParameterBlock(data, part.block.size, is_pose ? &manifold : nullptr);
    if (!part.estimate) problem.SetParameterBlockConstant(data);
  }
  if (window.depth_zero_m) problem.AddParameterBlock(copies.of(&*window.depth_zero_m), 1);
}

ceres::Solver::Options solver_options(const Config& config) {
  ceres::Solver::Options options;
  options.trust_region_strategy_type = ceres::LEVENBERG_MARQUARDT;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.max_solver_time_in_seconds = config.window.max_solve_s;
  options.function_tolerance = 1e-3;
  options.num_threads = 1;  // the other core runs the front end
  options.logging_type = ceres::SILENT;
  return options;
}

}  // namespace

void solve(const Graph& graph, Window& window, const Config& config, int iterations) {
  ParameterCopies copies(window, config.calibration);
  PoseManifold manifold;
  ceres::Problem problem(problem_options());
  add_states(problem, window, config, copies, manifold);
  // Landmarks are eliminated first; the rest is one dense system.
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  std::vector<double*> blocks;
  problem.GetParameterBlocks(&blocks);
  for (double* block : blocks) ordering->AddElementToGroup(block, 1);
  for (const Term& term : graph.terms()) {
    blocks.clear();
    for (const Block& block : term.blocks) blocks.push_back(copies.of(block.data));
    problem.AddResidualBlock(const_cast<ceres::CostFunction*>(term.cost),
                             const_cast<ceres::LossFunction*>(term.loss), blocks);
  }
  for (const auto& [id, landmark] : window.landmarks) {
    double* inverse_depth = copies.of(&landmark.inverse_depth);
    if (!problem.HasParameterBlock(inverse_depth)) continue;
    ordering->AddElementToGroup(inverse_depth, 0);
    if (landmark.frozen) problem.SetParameterBlockConstant(inverse_depth);
  }
  ceres::Solver::Options options = solver_options(config);
  options.max_num_iterations = iterations;
  options.linear_solver_ordering = std::move(ordering);
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  copies.write_back();
}

}  // namespace apvi::vio
