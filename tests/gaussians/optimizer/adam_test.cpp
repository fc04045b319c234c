// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/optimizer/adam.hpp"

#include <ATen/Parallel.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include "support/torch_reference.hpp"

namespace apvi::gaussians {
namespace {

using test::tensors_near;
using torch::Tensor;

AdamGroup make_group(at::IntArrayRef shape, torch::ScalarType type, double rate) {
  const Tensor parameter = torch::randn(shape, torch::kFloat64).to(type);
  return {.parameter = parameter,
          .gradient = {},
          .first = torch::zeros_like(parameter),
          .second = torch::zeros_like(parameter),
          .rate = rate};
}

TEST(Adam, MatchesLibTorch) {
  torch::manual_seed(3);
  for (const auto type : {torch::kFloat64, torch::kFloat32}) {
    AdamGroup ours = make_group({37, 5}, type, 0.01);
    const Tensor theirs = ours.parameter.clone().requires_grad_(true);
    torch::optim::Adam reference({theirs}, torch::optim::AdamOptions(0.01).eps(1e-15));
    for (std::int64_t step = 1; step <= 30; ++step) {
      ours.gradient = torch::randn({37, 5}, ours.parameter.options());
      theirs.mutable_grad() = ours.gradient.clone();
      adam_step({ours}, step);
      reference.step();
    }
    EXPECT_TRUE(tensors_near(ours.parameter, theirs, type == torch::kFloat64 ? 1e-13 : 1e-6));
  }
}

TEST(Adam, FirstStepEqualsLearningRateOfEachGroup) {
  std::vector<AdamGroup> groups = {make_group({4}, torch::kFloat64, 1e-1),
                                   make_group({4, 3}, torch::kFloat64, 1e-4)};
  std::vector<Tensor> before;
  for (AdamGroup& group : groups) {
    before.push_back(group.parameter.clone());
    group.gradient = torch::full_like(group.parameter, -1e-6);
  }
  adam_step(groups, 1);
  for (std::size_t i = 0; i < groups.size(); ++i) {
    const Tensor moved = groups[i].parameter - before[i];
    EXPECT_TRUE(tensors_near(moved / groups[i].rate, torch::ones_like(moved), 1e-8));
  }
}

TEST(Adam, UpdatesOnlyVisibleRowsWhenMaskIsGiven) {
  torch::manual_seed(4);
  AdamGroup group = make_group({50, 3}, torch::kFloat32, 0.1);
  group.gradient = torch::randn({50, 3});
  group.first.fill_(0.5);
  group.second.fill_(0.25);
  AdamGroup whole = group;
  whole.parameter = group.parameter.clone();
  whole.first = group.first.clone();
  whole.second = group.second.clone();
  const Tensor before = group.parameter.clone();
  const Tensor visible = torch::rand({50}) > 0.5;
  adam_step({group}, 7, {}, visible);
  adam_step({whole}, 7);
  EXPECT_TRUE(torch::equal(group.parameter.index({~visible}), before.index({~visible})));
  EXPECT_EQ(group.first.index({~visible}).ne(0.5).sum().item<std::int64_t>(), 0);
  EXPECT_TRUE(
      tensors_near(group.parameter.index({visible}), whole.parameter.index({visible}), 1e-6));
  EXPECT_TRUE(tensors_near(group.second.index({visible}), whole.second.index({visible}), 1e-6));
}

TEST(Adam, IsIndependentOfThreadCount) {
  torch::manual_seed(5);
  const AdamGroup start = make_group({50001}, torch::kFloat32, 0.01);
  const Tensor gradient = torch::randn({50001});
  const auto run = [&](int threads) {
    at::set_num_threads(threads);
    AdamGroup group = {.parameter = start.parameter.clone(),
                       .gradient = gradient,
                       .first = torch::zeros({50001}),
                       .second = torch::zeros({50001}),
                       .rate = 0.01};
    for (std::int64_t step = 1; step <= 3; ++step) adam_step({group}, step);
    return group.parameter;
  };
  const int threads = at::get_num_threads();
  const Tensor single_threaded = run(1);
  const Tensor multi_threaded = run(3);
  at::set_num_threads(threads);
  EXPECT_TRUE(torch::equal(single_threaded, multi_threaded));
}

TEST(Adam, SkipsGroupsWithoutGradient) {
  AdamGroup group = make_group({4}, torch::kFloat32, 0.1);
  group.first.fill_(1.0);
  const Tensor before = group.parameter.clone();
  adam_step({group}, 1);
  EXPECT_TRUE(torch::equal(group.parameter, before));
}

TEST(Adam, RejectsInvalidArguments) {
  AdamGroup group = make_group({4, 3}, torch::kFloat32, 0.1);
  group.gradient = torch::zeros({3, 4});
  EXPECT_THROW(adam_step({group}, 1), c10::Error);
  group.gradient = torch::zeros({4, 3});
  EXPECT_THROW(adam_step({group}, 0), c10::Error);
  EXPECT_THROW(adam_step({group}, 1, {}, torch::ones({3}, torch::kBool)), c10::Error);
  group.first = torch::zeros({4, 3}, torch::kFloat64);
  EXPECT_THROW(adam_step({group}, 1), c10::Error);
}

}  // namespace
}  // namespace apvi::gaussians
