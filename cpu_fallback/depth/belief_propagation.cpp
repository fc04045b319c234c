// SPDX-License-Identifier: BSD-3-Clause
#include <ATen/Parallel.h>
#include <torch/torch.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "cpu_fallback/depth/depth_sweep.hpp"

namespace apvi::depth::cpu {
namespace {

using torch::Tensor;

constexpr std::int64_t kNodesPerTask = 256;

struct Graph {
  const float* cost;
  const std::int32_t* offsets;
  const std::int32_t* neighbors;
  const std::int32_t* reverse;
  const float* weights;
  std::int64_t labels;
  float step;
  float limit;

  explicit Graph(const BeliefPropagationInput& in)
      : cost(in.cost.data_ptr<float>()),
        offsets(in.offsets.data_ptr<std::int32_t>()),
        neighbors(in.neighbors.data_ptr<std::int32_t>()),
        reverse(in.reverse.data_ptr<std::int32_t>()),
        weights(in.weights.data_ptr<float>()),
        labels(in.cost.size(1)),
        step(static_cast<float>(in.step)),
        limit(static_cast<float>(in.limit)) {}
};

/// Sum of the node's cost and all incoming messages.
void sum_up(const Graph& g, std::int64_t node, const float* messages, float* sum) {
  std::copy_n(g.cost + node * g.labels, g.labels, sum);
  for (std::int32_t e = g.offsets[node]; e < g.offsets[node + 1]; ++e) {
    const float* const m = messages + e * g.labels;
    for (std::int64_t l = 0; l < g.labels; ++l) sum[l] += m[l];
  }
}

/// Truncated linear min-convolution in two passes over the labels, normalized to a minimum of zero.
void truncated_linear(float* h, std::int64_t labels, float step, float limit) {
  const float min_value = *std::min_element(h, h + labels);
  for (std::int64_t l = 0; l < labels; ++l) h[l] = std::min(h[l] - min_value, limit);
  for (std::int64_t l = 1; l < labels; ++l) h[l] = std::min(h[l], h[l - 1] + step);
  for (std::int64_t l = labels - 1; l-- > 0;) h[l] = std::min(h[l], h[l + 1] + step);
}

/// Outgoing messages of the node; each excludes the recipient's own message.
void send(const Graph& g, std::int64_t node, const float* messages, float* sum, float* out) {
  sum_up(g, node, messages, sum);
  for (std::int32_t e = g.offsets[node]; e < g.offsets[node + 1]; ++e) {
    const float* const in = messages + e * g.labels;
    float* const message = out + g.reverse[e] * g.labels;
    for (std::int64_t l = 0; l < g.labels; ++l) message[l] = sum[l] - in[l];
    truncated_linear(message, g.labels, g.weights[e] * g.step, g.weights[e] * g.limit);
  }
}

}  // namespace

Tensor propagate(const BeliefPropagationInput& input) {
  const Graph graph(input);
  const std::int64_t nodes = input.cost.size(0);
  Tensor now = torch::zeros({input.neighbors.size(0), graph.labels}, torch::kFloat32);
  Tensor next = torch::zeros_like(now);
  for (int i = 0; i < input.iterations; ++i) {
    const auto* const messages = now.data_ptr<float>();
    auto* const out = next.data_ptr<float>();
    at::parallel_for(0, nodes, kNodesPerTask, [&](std::int64_t begin, std::int64_t end) {
      std::vector<float> sum(static_cast<std::size_t>(graph.labels));
      for (std::int64_t node = begin; node < end; ++node) {
        send(graph, node, messages, sum.data(), out);
      }
    });
    std::swap(now, next);
  }
  // With synchronous updates on a grid, odd and even iterations propagate on two disjoint halves of
  // the nodes, like the fields of a chessboard. Averaging both removes the pattern.
  const Tensor mean = (now + next).mul_(0.5);
  Tensor belief = torch::empty_like(input.cost);
  auto* const sums = belief.data_ptr<float>();
  const auto* const messages = mean.data_ptr<float>();
  at::parallel_for(0, nodes, kNodesPerTask, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t node = begin; node < end; ++node) {
      sum_up(graph, node, messages, sums + node * graph.labels);
    }
  });
  return belief;
}

}  // namespace apvi::depth::cpu
