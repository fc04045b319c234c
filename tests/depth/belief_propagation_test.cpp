// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "core/random.hpp"
#include "depth/depth_backend.hpp"
#include "depth/quadtree.hpp"

namespace apvi::depth {
namespace {

using torch::Tensor;

using Edges = std::vector<std::pair<int, int>>;

Tensor random_costs(Random& random, int nodes, int labels) {
  Tensor cost = torch::empty({nodes, labels}, torch::kFloat32);
  for (std::int64_t i = 0; i < cost.numel(); ++i) {
    cost.data_ptr<float>()[i] = static_cast<float>(random.uniform());
  }
  return cost;
}

/// A graph of undirected edges with random weights.
BeliefPropagationInput make_input(Random& random, const Tensor& cost, const Edges& edges,
                                  int iterations) {
  struct Directed {
    int from, to;
    float weight;
  };
  std::vector<Directed> directed;
  for (const auto& [a, b] : edges) {
    const auto weight = static_cast<float>(random.uniform(0.3, 1.5));
    directed.push_back({a, b, weight});
    directed.push_back({b, a, weight});
  }
  std::sort(directed.begin(), directed.end(), [](const Directed& x, const Directed& y) {
    return std::pair{x.from, x.to} < std::pair{y.from, y.to};
  });
  std::vector<int> offsets(static_cast<std::size_t>(cost.size(0)) + 1, 0);
  std::vector<int> neighbors;
  std::vector<int> reverse;
  std::vector<float> weights;
  for (const Directed& e : directed) {
    ++offsets[static_cast<std::size_t>(e.from) + 1];
    neighbors.push_back(e.to);
    weights.push_back(e.weight);
    const auto back = std::find_if(directed.begin(), directed.end(), [&](const Directed& f) {
      return f.from == e.to && f.to == e.from;
    });
    reverse.push_back(static_cast<int>(back - directed.begin()));
  }
  for (std::size_t i = 1; i < offsets.size(); ++i) offsets[i] += offsets[i - 1];
  return {.cost = cost,
          .offsets = torch::tensor(offsets, torch::kInt32),
          .neighbors = torch::tensor(neighbors, torch::kInt32),
          .reverse = torch::tensor(reverse, torch::kInt32),
          .weights = torch::tensor(weights),
          .step = 0.11,
          .limit = 0.4,
          .iterations = iterations};
}

double pairwise(const BeliefPropagationInput& in, std::int64_t edge, int a, int b) {
  const double weight = in.weights[edge].item<double>();
  return weight * std::min(in.step * std::abs(a - b), in.limit);
}

/// Brute-force messages over all pairs of labels.
Tensor brute_force(const BeliefPropagationInput& in) {
  const std::int64_t labels = in.cost.size(1);
  const std::int64_t nodes = in.cost.size(0);
  const auto offset = in.offsets.accessor<int, 1>();
  const auto reverse = in.reverse.accessor<int, 1>();
  Tensor messages = torch::zeros({in.neighbors.size(0), labels}, torch::kFloat64);
  Tensor before = messages;
  const auto belief_of = [&](std::int64_t node) {
    return in.cost[node].to(torch::kFloat64) +
           messages.slice(0, offset[node], offset[node + 1]).sum(0);
  };
  for (int k = 0; k < in.iterations; ++k) {
    Tensor next = torch::zeros_like(messages);
    for (std::int64_t node = 0; node < nodes; ++node) {
      for (int e = offset[node]; e < offset[node + 1]; ++e) {
        const Tensor h = belief_of(node) - messages[e];
        for (int to = 0; to < labels; ++to) {
          double best = INFINITY;
          for (int from = 0; from < labels; ++from) {
            best = std::min(best, h[from].item<double>() + pairwise(in, e, from, to));
          }
          next[reverse[e]][to] = best - h.min().item<double>();
        }
      }
    }
    before = messages;
    messages = next;
  }
  messages = 0.5 * (messages + before);
  std::vector<Tensor> beliefs;
  for (std::int64_t node = 0; node < nodes; ++node) beliefs.push_back(belief_of(node));
  return torch::stack(beliefs);
}

TEST(BeliefPropagation, LinearTimeMessagesMatchBruteForce) {
  Random random(1);
  for (const int labels : {1, 2, 9, 16}) {
    const Edges loop = {{0, 1}, {1, 2}, {2, 3}, {3, 0}, {1, 3}, {3, 4}};
    const BeliefPropagationInput in = make_input(random, random_costs(random, 5, labels), loop, 4);
    const Tensor expected = brute_force(in);
    const Tensor found = cpu_depth_backend().propagate(in).to(torch::kFloat64);
    EXPECT_LT((found - expected).abs().max().item<double>(), 1e-5) << labels << " labels";
  }
}

TEST(BeliefPropagation, MatchesBruteForceOnQuadtreeGraph) {
  Random random(4);
  Tensor image = torch::full({32, 32}, 0.5, torch::kFloat32);
  image[3][3] = 0.0;
  image[20][25] = 0.0;
  const std::vector<Block> blocks = build_quadtree(image, QuadtreeOptions{});
  const BlockGraph graph = neighbor_graph(blocks, 32, 32);
  Edges edges;
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    for (auto e = graph.offsets[i]; e < graph.offsets[i + 1]; ++e) {
      const int other = graph.neighbors[static_cast<std::size_t>(e)];
      if (other > static_cast<int>(i)) edges.emplace_back(static_cast<int>(i), other);
    }
  }
  const Tensor cost = random_costs(random, static_cast<int>(blocks.size()), 6);
  BeliefPropagationInput in = make_input(random, cost, edges, 3);
  const Tensor expected = brute_force(in);
  in.offsets = torch::tensor(graph.offsets, torch::kInt32);
  in.neighbors = torch::tensor(graph.neighbors, torch::kInt32);
  in.reverse = torch::tensor(graph.reverse, torch::kInt32);
  const Tensor found = cpu_depth_backend().propagate(in).to(torch::kFloat64);
  EXPECT_LT((found - expected).abs().max().item<double>(), 1e-5);
}

/// Minimum energy over all labelings.
std::pair<double, std::vector<int>> exhaustive(const BeliefPropagationInput& in) {
  const auto nodes = static_cast<std::size_t>(in.cost.size(0));
  const int labels = static_cast<int>(in.cost.size(1));
  std::vector<int> label(nodes, 0);
  std::pair<double, std::vector<int>> best = {INFINITY, label};
  while (true) {
    double energy = 0.0;
    for (std::size_t i = 0; i < nodes; ++i) {
      const auto node = static_cast<std::int64_t>(i);
      energy += in.cost[node][label[i]].item<double>();
      for (int e = in.offsets[node].item<int>(); e < in.offsets[node + 1].item<int>(); ++e) {
        const auto other = in.neighbors[e].item<std::int64_t>();
        if (other > node)
          energy += pairwise(in, e, label[i], label[static_cast<std::size_t>(other)]);
      }
    }
    if (energy < best.first) best = {energy, label};
    std::size_t i = 0;
    for (; i < nodes && ++label[i] == labels; ++i) label[i] = 0;
    if (i == nodes) return best;
  }
}

TEST(BeliefPropagation, FindsMinimumEnergyOnTree) {
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    Random random(seed);
    const Edges tree = {{0, 1}, {1, 2}, {1, 3}, {3, 4}};
    const BeliefPropagationInput in = make_input(random, random_costs(random, 5, 5), tree, 5);
    const auto [energy, expected] = exhaustive(in);
    const Tensor found = std::get<1>(cpu_depth_backend().propagate(in).min(1));
    for (std::size_t i = 0; i < expected.size(); ++i) {
      EXPECT_EQ(found[static_cast<std::int64_t>(i)].item<int>(), expected[i]) << "seed " << seed;
    }
  }
}

TEST(BeliefPropagation, BeliefsEqualCostsWithoutIterations) {
  Random random(2);
  const BeliefPropagationInput in =
      make_input(random, random_costs(random, 3, 7), {{0, 1}, {1, 2}}, 0);
  EXPECT_TRUE(torch::equal(cpu_depth_backend().propagate(in), in.cost));
}

TEST(BeliefPropagation, UninformativeBlockAdoptsLabelOfNeighbors) {
  Random random(3);
  Tensor cost = torch::full({5, 20}, 0.7, torch::kFloat32);
  for (const int node : {0, 4}) cost[node][13] = 0.0;
  const BeliefPropagationInput in = make_input(random, cost, {{0, 1}, {1, 2}, {2, 3}, {3, 4}}, 6);
  const Tensor label = std::get<1>(cpu_depth_backend().propagate(in).min(1));
  EXPECT_TRUE((label == 13).all().item<bool>()) << label;
}

}  // namespace
}  // namespace apvi::depth
