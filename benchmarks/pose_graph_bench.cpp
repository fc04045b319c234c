// SPDX-License-Identifier: BSD-3-Clause
// Work of the pose graph for one keyframe at the end of a survey: lines crossed by lines at right
// angles, with a loop at every crossing.
#include <benchmark/benchmark.h>

#include <cmath>

#include "apvi/geometry/so3.hpp"
#include "loop_closure/keyframe_graph.hpp"

namespace apvi::bench {
namespace {

using loop_closure::KeyframeGraph;
using loop_closure::Loop;

constexpr double kStep_m = 0.4;         // between keyframes, one a second
constexpr double kSpacing_m = 2.0;      // between lines
constexpr double kHeadingDrift = 1e-4;  // [rad] a keyframe

/// Keyframe `i` of a survey of two sets of lines, each of half of the keyframes.
Eigen::Vector3d position(std::size_t i, std::size_t count) {
  const double side = std::sqrt(0.5 * static_cast<double>(count) * kStep_m * kSpacing_m);
  const std::size_t half = count / 2;
  const double way = kStep_m * static_cast<double>(i % half);
  const double line = std::floor(way / side);
  const double along = std::fmod(line, 2.0) == 0.0 ? way - line * side : (line + 1.0) * side - way;
  const Eigen::Vector3d first(along, line * kSpacing_m, 0.0);
  return i < half ? first : Eigen::Vector3d(first.y(), first.x(), 0.0);
}

SE3 truth(std::size_t i, std::size_t count) {
  return {Eigen::Quaterniond::Identity(), position(i, count)};
}

SE3 drifted(std::size_t i, std::size_t count) {
  const SE3 drift{so3::exp({0.0, 0.0, kHeadingDrift * static_cast<double>(i)}),
                  Eigen::Vector3d::Zero()};
  return drift * truth(i, count);
}

KeyframeGraph survey(std::size_t count) {
  KeyframeGraph graph({.node_step_s = 1.0, .max_nodes = 500});
  for (std::size_t i = 0; i < count; ++i) {
    graph.add({.stamp = Stamp{static_cast<std::int64_t>(i) * 1'000'000'000},
               .T_world_camera = drifted(i, count),
               .drift = {.heading = 1e-8, .horizontal = 1e-5, .vertical = 1e-6},
               .height_sigma_m = 0.01});
    for (std::size_t k = 0; i >= count / 2 && k < count / 2; ++k) {
      if ((position(i, count) - position(k, count)).norm() > 0.5 * kStep_m) continue;
      graph.add(Loop{k, i, truth(k, count).inverse() * truth(i, count)});
    }
  }
  graph.optimize();
  return graph;
}

Loop newest_loop(const KeyframeGraph& graph, std::size_t count) {
  const std::size_t newest = graph.newest();
  return {10, newest, truth(10, count).inverse() * truth(newest, count)};
}

void check_loops(benchmark::State& state) {
  const auto count = static_cast<std::size_t>(state.range(0));
  KeyframeGraph graph = survey(count);
  const Loop loop = newest_loop(graph, count);
  for (auto _ : state) {
    graph.update_pose(graph[graph.newest()].stamp, drifted(graph.newest(), count));
    for (int k = 0; k < 3; ++k) benchmark::DoNotOptimize(graph.check(loop));
  }
  state.counters["nodes"] = static_cast<double>(graph.nodes());
}
BENCHMARK(check_loops)->Arg(500)->Arg(3600)->Arg(36000)->Unit(benchmark::kMillisecond);

void optimize(benchmark::State& state) {
  const auto count = static_cast<std::size_t>(state.range(0));
  KeyframeGraph graph = survey(count);
  for (auto _ : state) {
    graph.add(newest_loop(graph, count));
    graph.optimize();
  }
  state.counters["nodes"] = static_cast<double>(graph.nodes());
}
BENCHMARK(optimize)->Arg(500)->Arg(3600)->Arg(36000)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace apvi::bench
