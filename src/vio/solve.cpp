// SPDX-License-Identifier: BSD-3-Clause
#include <ceres/problem.h>
#include <ceres/solver.h>

#include "graph.hpp"

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

void add_states(ceres::Problem& problem, Window& window, const Config& config,
                PoseManifold& manifold) {
  for (const auto& frame : window.frames) {
    problem.AddParameterBlock(frame->state.pose.data(), kPoseSize, &manifold);
    problem.AddParameterBlock(frame->state.motion.data(), kMotionSize);
    if (!frame->frozen) continue;
    problem.SetParameterBlockConstant(frame->state.pose.data());
    problem.SetParameterBlockConstant(frame->state.motion.data());
  }
  for (PoseBlock& extrinsics : window.T_body_camera) {
    problem.AddParameterBlock(extrinsics.data(), kPoseSize, &manifold);
    if (!config.vision.estimate_extrinsics) problem.SetParameterBlockConstant(extrinsics.data());
  }
  if (window.depth_zero_m) problem.AddParameterBlock(&*window.depth_zero_m, 1);
  problem.AddParameterBlock(&window.time_offset_s, 1);
  if (!config.vision.estimate_time_offset) problem.SetParameterBlockConstant(&window.time_offset_s);
}

// Landmarks are eliminated first, everything else is one dense system.
ceres::Solver::Options solver_options(const Config& config, const Window& window) {
  ceres::Solver::Options options;
  options.trust_region_strategy_type = ceres::LEVENBERG_MARQUARDT;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.max_solver_time_in_seconds = config.window.max_solve_s;
  options.function_tolerance = 1e-3;
  options.num_threads = 1;  // the other core belongs to the front end
  options.logging_type = ceres::SILENT;
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (const auto& frame : window.frames) {
    ordering->AddElementToGroup(const_cast<double*>(frame->state.pose.data()), 1);
    ordering->AddElementToGroup(const_cast<double*>(frame->state.motion.data()), 1);
  }
  for (const PoseBlock& extrinsics : window.T_body_camera) {
    ordering->AddElementToGroup(const_cast<double*>(extrinsics.data()), 1);
  }
  ordering->AddElementToGroup(const_cast<double*>(&window.time_offset_s), 1);
  if (window.depth_zero_m) {
    ordering->AddElementToGroup(const_cast<double*>(&*window.depth_zero_m), 1);
  }
  options.linear_solver_ordering = ordering;
  return options;
}

}  // namespace

void solve(const Graph& graph, Window& window, const Config& config, int iterations) {
  PoseManifold manifold;
  ceres::Problem problem(problem_options());
  add_states(problem, window, config, manifold);
  ceres::Solver::Options options = solver_options(config, window);
  options.max_num_iterations = iterations;
  std::vector<double*> blocks;
  for (const Term& term : graph.terms()) {
    blocks.clear();
    for (const Block& block : term.blocks) blocks.push_back(block.data);
    problem.AddResidualBlock(const_cast<ceres::CostFunction*>(term.cost),
                             const_cast<ceres::LossFunction*>(term.loss), blocks);
  }
  for (auto& [id, landmark] : window.landmarks) {
    if (!problem.HasParameterBlock(&landmark.inverse_depth)) continue;
    options.linear_solver_ordering->AddElementToGroup(&landmark.inverse_depth, 0);
    if (landmark.frozen) problem.SetParameterBlockConstant(&landmark.inverse_depth);
  }
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
}

}  // namespace apvi::vio
