// SPDX-License-Identifier: BSD-3-Clause
// Cost of evaluating the factors of the sliding window and of marginalizing states: eleven frames,
// ten observations of each landmark.
#include <benchmark/benchmark.h>

#include <memory>
#include <utility>
#include <vector>

#include "vio/camera_window.hpp"

namespace apvi::vio {
namespace {

using test::CameraWindow;

constexpr std::size_t kFrames = 11;

/// Parameter blocks of a factor and storage for its Jacobians; constant blocks have no storage.
struct Workspace {
  std::vector<const double*> parameters;
  std::vector<std::vector<double>> jacobian_storage;
  std::vector<double*> jacobians;
  std::vector<double> residual;

  Workspace(const ceres::CostFunction& cost, const std::vector<Block>& blocks,
            std::size_t differentiated)
      : residual(static_cast<std::size_t>(cost.num_residuals())) {
    for (const Block& block : blocks) {
      parameters.push_back(block.data);
      jacobian_storage.emplace_back(static_cast<std::size_t>(block.size) * residual.size());
      const bool has_jacobian = jacobian_storage.size() <= differentiated;
      jacobians.push_back(has_jacobian ? jacobian_storage.back().data() : nullptr);
    }
  }
  void evaluate(const ceres::CostFunction& cost, bool with_jacobians) {
    cost.Evaluate(parameters.data(), residual.data(), with_jacobians ? jacobians.data() : nullptr);
    benchmark::DoNotOptimize(residual.data());
    benchmark::ClobberMemory();
  }
};

// 0: the residual alone; 1: with Jacobians; 2: with Jacobians at first estimates.
enum Kind { kResidual, kJacobians, kFirstEstimates };

void set_first_estimates(CameraWindow& window) {
  for (std::size_t k = 0; k < window.frames.size(); ++k) {
    window.first[k] = {.pose = window.frames[k].pose, .motion = window.frames[k].motion};
  }
}

void reprojection(benchmark::State& state) {
  CameraWindow window(kFrames, 1, 0.25, 1);
  if (state.range(0) == kFirstEstimates) set_first_estimates(window);
  const auto factor = window.view_of(window.landmarks[0], 5, true);
  std::vector<Block> blocks = window.view_blocks(window.landmarks[0], 5);
  std::swap(blocks[2], blocks[3]);  // both poses and the landmark first: these have Jacobians
  Workspace work(*factor, blocks, 3);
  std::swap(work.parameters[2], work.parameters[3]);
  std::swap(work.jacobians[2], work.jacobians[3]);
  for ([[maybe_unused]] auto _ : state) work.evaluate(*factor, state.range(0) != kResidual);
}
BENCHMARK(reprojection)->ArgName("kind")->DenseRange(kResidual, kFirstEstimates);

void inertial(benchmark::State& state) {
  CameraWindow window(kFrames, 1, 0.25, 1);
  if (state.range(0) == kFirstEstimates) set_first_estimates(window);
  const auto factor = window.inertial(3, true);
  Workspace work(*factor, window.inertial_blocks(3), 4);
  for ([[maybe_unused]] auto _ : state) work.evaluate(*factor, state.range(0) != kResidual);
}
BENCHMARK(inertial)->ArgName("kind")->DenseRange(kResidual, kFirstEstimates);

void dvl_velocity(benchmark::State& state) {
  CameraWindow window(kFrames, 1, 0.25, 1);
  const DvlPing ping{.since_frame = window.between[3], .gyro = {0.1, 0.2, 0.3}};
  const DvlVelocityFactor factor(ping, SE3::identity(), window.gravity, nullptr);
  Workspace work(factor, {window.inertial_blocks(3)[0], window.inertial_blocks(3)[1]}, 2);
  for ([[maybe_unused]] auto _ : state) work.evaluate(factor, state.range(0) != kResidual);
}
BENCHMARK(dvl_velocity)->ArgName("kind")->DenseRange(kResidual, kJacobians);

/// A full window: prior, inertial factors and all observations.
struct FullWindow {
  CameraWindow window;
  std::vector<std::unique_ptr<ceres::CostFunction>> costs;
  std::vector<std::vector<Block>> blocks;
  std::vector<double*> oldest;

  explicit FullWindow(std::size_t landmarks) : window(kFrames, landmarks, 0.25, 1) {
    FrameState& frame = window.frames[0];
    blocks.push_back({{frame.pose.data(), 7}, {frame.motion.data(), 9}});
    auto prior = std::make_shared<Prior>();
    prior->kept = {{blocks[0][0], {frame.pose.begin(), frame.pose.end()}},
                   {blocks[0][1], {frame.motion.begin(), frame.motion.end()}}};
    prior->J = Eigen::MatrixXd::Identity(15, 15);
    prior->r = Eigen::VectorXd::Zero(15);
    costs.push_back(std::make_unique<PriorFactor>(prior));
    for (std::size_t k = 0; k + 1 < kFrames; ++k) {
      costs.push_back(window.inertial(k, false));
      blocks.push_back(window.inertial_blocks(k));
    }
    oldest = {frame.pose.data(), frame.motion.data()};
    for (auto& landmark : window.landmarks) {
      oldest.push_back(&landmark.inverse_depth);
      for (std::size_t k = 1; k < kFrames; ++k) {
        costs.push_back(window.view_of(landmark, k, false));
        blocks.push_back(window.view_blocks(landmark, k));
      }
    }
  }
  void linearize(Linearizer& to) const {
    static const ceres::HuberLoss huber(1.0);
    to.clear();
    to.hold_constant(window.camera.data());
    to.hold_constant(&window.offset_s);
    for (std::size_t i = 0; i < costs.size(); ++i) {
      to.add(*costs[i], blocks[i].size() == 5 ? &huber : nullptr, blocks[i]);
    }
  }
};

void linearize(benchmark::State& state) {
  const FullWindow full(static_cast<std::size_t>(state.range(0)));
  Linearizer linearizer;
  for ([[maybe_unused]] auto _ : state) full.linearize(linearizer);
}
BENCHMARK(linearize)->ArgName("landmarks")->Arg(150)->Unit(benchmark::kMillisecond);

// Marginalizes with all factors of the window: 150 parameters remain.
void marginalize_all(benchmark::State& state) {
  const FullWindow full(static_cast<std::size_t>(state.range(0)));
  Linearizer linearizer;
  full.linearize(linearizer);
  const auto method = static_cast<Linearizer::Method>(state.range(1));
  for ([[maybe_unused]] auto _ : state) {
    benchmark::DoNotOptimize(linearizer.marginalize(full.oldest, method));
  }
}
BENCHMARK(marginalize_all)
    ->ArgNames({"landmarks", "square_root"})
    ->ArgsProduct({{150}, {0, 1}})
    ->Unit(benchmark::kMillisecond);

// Marginalizes with the factors of the oldest frame only, as the estimator does: 69 parameters
// remain.
void marginalize_oldest(benchmark::State& state) {
  CameraWindow window(kFrames, static_cast<std::size_t>(state.range(0)), 0.25, 1);
  Linearizer linearizer;
  const std::vector<double*> drop = window.add_oldest(0, false, linearizer);
  const auto method = static_cast<Linearizer::Method>(state.range(1));
  for ([[maybe_unused]] auto _ : state) {
    benchmark::DoNotOptimize(linearizer.marginalize(drop, method));
  }
}
BENCHMARK(marginalize_oldest)
    ->ArgNames({"landmarks", "square_root"})
    ->ArgsProduct({{15, 150}, {0, 1}})
    ->Unit(benchmark::kMillisecond);

void marginal_information(benchmark::State& state) {
  const FullWindow full(static_cast<std::size_t>(state.range(0)));
  Linearizer linearizer;
  full.linearize(linearizer);
  const double* newest = full.window.frames.back().pose.data();
  for ([[maybe_unused]] auto _ : state) {
    benchmark::DoNotOptimize(linearizer.marginal_information(newest));
  }
}
BENCHMARK(marginal_information)->ArgName("landmarks")->Arg(150)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace apvi::vio
