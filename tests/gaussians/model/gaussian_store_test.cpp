// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/model/gaussian_store.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <sstream>

#include "support/out_of_memory.hpp"
#include "support/torch_reference.hpp"

namespace apvi::gaussians {
namespace {

using test::tensors_near;
using torch::Tensor;

Gaussians make_gaussians(std::int64_t count, int degree = 1, std::uint64_t seed = 7,
                         torch::ScalarType type = torch::kFloat32) {
  torch::manual_seed(seed);
  const auto options = torch::dtype(type);
  return {.means = torch::randn({count, 3}, options),
          .log_scales = torch::randn({count, 3}, options) - 2.0,
          .quaternions = torch::randn({count, 4}, options),
          .logit_opacities = torch::randn({count}, options) * 3.0,
          .sh_dc = torch::randn({count, 3}, options),
          .sh_rest = torch::randn({count, sh_rest_count(degree), 3}, options)};
}

/// Backpropagates a loss with a different gradient for every value.
void give_gradients(const Gaussians& view, std::uint64_t seed = 9) {
  torch::manual_seed(seed);
  Tensor loss = torch::zeros({}, view.means.options());
  for (const Tensor* t : view.tensors()) {
    loss = loss + (torch::randn(t->sizes(), t->options().requires_grad(false)) * *t).sum();
  }
  loss.backward();
}

std::vector<Tensor> copies(const Gaussians& gaussians) {
  std::vector<Tensor> out;
  for (const Tensor* t : gaussians.tensors()) out.push_back(t->detach().clone());
  return out;
}

void expect_equal(const Gaussians& a, const Gaussians& b) {
  for (std::size_t k = 0; k < 6; ++k) {
    EXPECT_TRUE(torch::equal(a.tensors()[k]->detach(), b.tensors()[k]->detach())) << "tensor " << k;
  }
}

Gaussians rows(const Gaussians& gaussians, const Tensor& which) {
  Gaussians out;
  for (std::size_t k = 0; k < 6; ++k) {
    *out.tensors()[k] = gaussians.tensors()[k]->detach().index({which});
  }
  return out;
}

GaussianStore save_and_load(const GaussianStore& store) {
  torch::serialize::OutputArchive out;
  store.save(out);
  std::stringstream stream;
  out.save_to(stream);
  torch::serialize::InputArchive in;
  in.load_from(stream);
  return GaussianStore::load(in);
}

TEST(GaussianStore, OutOfMemoryLeavesStoreConsistent) {
  const Gaussians start = make_gaussians(3000);
  const Gaussians more = make_gaussians(3000, 1, 8);
  const Tensor remove = torch::arange(3000) % 3 == 0;
  const auto kept = [&](const GaussianStore& store, bool pruned) {
    return rows(store.view(), torch::arange(store.size()) < (pruned ? 2000 : 3000));
  };
  for (int at = 0; at < 60; ++at) {
    SCOPED_TRACE("request " + std::to_string(at));
    GaussianStore store(start);
    bool pruned = true;
    {
      test::OutOfMemoryAllocator memory;
      memory.fail_after(at);
      try {
        store.prune(remove);
      } catch (const c10::OutOfMemoryError&) {
        pruned = false;
      }
    }
    ASSERT_EQ(store.size(), pruned ? 2000 : 3000);
    expect_equal(kept(store, pruned), pruned ? rows(start, ~remove) : start);
    {
      test::OutOfMemoryAllocator memory;
      memory.fail_after(at);
      try {
        store.insert(more);
      } catch (const c10::OutOfMemoryError&) {
        expect_equal(kept(store, pruned), pruned ? rows(start, ~remove) : start);
        store.insert(more);
      }
    }
    ASSERT_EQ(store.size(), pruned ? 5000 : 6000);
    expect_equal(rows(store.view(), torch::arange(store.size()) >= store.size() - 3000), more);
    give_gradients(store.view());
    store.step({});
  }
}

TEST(GaussianStore, ToDeviceKeepsMomentsAndDropsSpareCapacity) {
  GaussianStore store(make_gaussians(10));
  give_gradients(store.view());
  store.step({});
  store.prune(torch::arange(10) < 4);
  const std::vector<Tensor> before = copies(store.view());
  GaussianStore moved = store;
  moved.to(torch::kCPU);
  EXPECT_EQ(moved.size(), 6);
  EXPECT_EQ(moved.capacity(), 6);
  for (GaussianStore* one : {&store, &moved}) {  // moments too
    give_gradients(one->view());
    one->step({});
  }
  expect_equal(store.view(), moved.view());
  EXPECT_FALSE(torch::equal(moved.view().means.detach(), before[0]));
}

TEST(GaussianStore, ReturnsInsertedGaussians) {
  const Gaussians start = make_gaussians(10);
  const Gaussians more = make_gaussians(5, 1, 8);
  GaussianStore store(start);
  store.insert(more);
  ASSERT_EQ(store.size(), 15);
  const Tensor first = torch::arange(15) < 10;
  expect_equal(rows(store.view(), first), start);
  expect_equal(rows(store.view(), ~first), more);
  EXPECT_TRUE(store.view().means.is_leaf());
  EXPECT_TRUE(store.view().means.requires_grad());
}

TEST(GaussianStore, StartsEmpty) {
  GaussianStore store(Gaussians::empty(2, torch::dtype(torch::kFloat32)));
  EXPECT_EQ(store.view().size(), 0);
  store.insert(make_gaussians(3, 2));
  EXPECT_EQ(store.view().size(), 3);
  store.prune(torch::ones({3}, torch::kBool));
  EXPECT_EQ(store.view().size(), 0);
}

TEST(GaussianStore, GrowsGeometrically) {
  GaussianStore store(make_gaussians(100));
  int moves = 0;
  std::int64_t capacity = store.capacity();
  for (std::uint64_t i = 0; i < 100; ++i) {
    store.insert(make_gaussians(10, 1, i));
    if (store.capacity() != capacity) ++moves;
    capacity = store.capacity();
  }
  EXPECT_EQ(store.size(), 1100);
  EXPECT_LE(moves, 6);  // log(11) / log(1.5)
}

TEST(GaussianStore, StepsInPlaceAtRateOfEachGroup) {
  GaussianStore store(make_gaussians(20, 1, 7, torch::kFloat64));
  const GaussianLearningRates rates = {.means = 1e-1,
                                       .log_scales = 2e-2,
                                       .quaternions = 3e-3,
                                       .logit_opacities = 4e-4,
                                       .sh_dc = 5e-5,
                                       .sh_rest = 6e-6};
  const auto before = copies(store.view());
  give_gradients(store.view());
  store.step(rates);
  for (std::size_t k = 0; k < 6; ++k) {
    const Tensor moved = (*store.view().tensors()[k] - before[k]).abs() / rates.values()[k];
    EXPECT_TRUE(tensors_near(moved, torch::ones_like(moved), 1e-6)) << "tensor " << k;
    EXPECT_FALSE(store.view().tensors()[k]->grad().defined());
  }
}

TEST(GaussianStore, PruneKeepsMomentsOfRemainingGaussians) {
  const Gaussians start = make_gaussians(30);
  const Tensor remove = torch::arange(30).remainder(3).eq(1);
  GaussianStore pruned(start);
  GaussianStore whole(start);
  for (GaussianStore* store : {&pruned, &whole}) {
    give_gradients(store->view());
    store->step({});
  }
  pruned.prune(remove);
  expect_equal(pruned.view(), rows(whole.view(), ~remove));
  // With a zero gradient only momentum moves a value.
  for (GaussianStore* store : {&pruned, &whole}) {
    Tensor loss = torch::zeros({});
    for (const Tensor* t : store->view().tensors()) loss = loss + (0.0 * *t).sum();
    loss.backward();
    store->step({});
  }
  expect_equal(pruned.view(), rows(whole.view(), ~remove));
}

TEST(GaussianStore, InsertedGaussiansStartWithZeroMoments) {
  const Gaussians start = make_gaussians(12);
  const Gaussians more = make_gaussians(7, 1, 8);
  GaussianStore grown(start);
  GaussianStore alone(start);
  for (GaussianStore* store : {&grown, &alone}) {
    give_gradients(store->view());
    store->step({});
  }
  grown.prune(torch::arange(12) >= 10);  // leaves moments behind where the new ones will be
  grown.insert(more);
  for (GaussianStore* store : {&grown, &alone}) {
    Tensor loss = torch::zeros({});
    for (const Tensor* t : store->view().tensors()) loss = loss + (0.0 * *t).sum();
    loss.backward();
    store->step({});
  }
  expect_equal(rows(grown.view(), torch::arange(17) < 10),
               rows(alone.view(), torch::arange(12) < 10));
  expect_equal(rows(grown.view(), torch::arange(17) >= 10), more);
}

TEST(GaussianStore, TakenGaussiansReturnWithMomentsAndAnchors) {
  GaussianStore store(make_gaussians(6));
  GaussianStore untouched(make_gaussians(6));
  for (GaussianStore* one : {&store, &untouched}) {
    give_gradients(one->view());
    one->step({});
  }
  const Tensor which = torch::tensor({false, false, false, true, true, true});
  const GaussianRows taken = store.take(which);
  EXPECT_EQ(store.size(), 3);
  EXPECT_EQ(taken.size(), 3);
  EXPECT_GT(taken.bytes(), 3 * 23 * 3 * 2);
  store.put(taken);
  for (GaussianStore* one : {&store, &untouched}) {
    give_gradients(one->view());
    one->step({});
  }
  expect_equal(store.view(), untouched.view());
  EXPECT_TRUE(torch::equal(store.anchors(), untouched.anchors()));
}

TEST(GaussianStore, ReorderMovesMomentsAndAnchors) {
  const Gaussians start = make_gaussians(12);
  GaussianStore moved(Gaussians::empty(1, torch::dtype(torch::kFloat32)));
  moved.insert(start, torch::arange(12));
  GaussianStore whole(start);
  for (GaussianStore* store : {&moved, &whole}) {
    give_gradients(store->view());
    store->step({});
  }
  const Tensor order = torch::randperm(12, torch::kInt64);
  moved.reorder(order);
  EXPECT_TRUE(torch::equal(moved.anchors(), order));
  for (GaussianStore* store : {&moved, &whole}) {
    Tensor loss = torch::zeros({});
    for (const Tensor* t : store->view().tensors()) loss = loss + (0.0 * *t).sum();
    loss.backward();
    store->step({});
  }
  expect_equal(moved.view(), rows(whole.view(), order));
  EXPECT_THROW(moved.reorder(torch::arange(11)), c10::Error);
}

TEST(GaussianStore, ResetMomentumZeroesSelectedGaussians) {
  GaussianStore store(make_gaussians(6));
  give_gradients(store.view());
  store.step({});
  const Tensor which = torch::tensor({true, false, true, false, false, false});
  store.reset_momentum(which);
  const Tensor before = store.view().means.detach().clone();
  (0.0 * store.view().means).sum().backward();
  store.step({});
  const Tensor moved = (store.view().means.detach() - before).abs().sum(1) > 0.0;
  EXPECT_TRUE(torch::equal(moved, ~which));
}

TEST(GaussianStore, ResetOpacityClampsOpacity) {
  GaussianStore store(make_gaussians(200));
  const Tensor before = torch::sigmoid(store.view().logit_opacities.detach()).clone();
  ASSERT_GT(before.max().item<double>(), 0.5);
  store.reset_opacity(0.01);
  const Tensor after = torch::sigmoid(store.view().logit_opacities.detach());
  EXPECT_TRUE(tensors_near(after, before.clamp_max(0.01), 1e-6));
  EXPECT_THROW(store.reset_opacity(1.0), c10::Error);
}

TEST(GaussianStore, TransformMovesOnlySelectedGaussians) {
  const Gaussians start = make_gaussians(9);
  GaussianStore store(start);
  const Tensor which = torch::arange(9) < 4;
  const SimilarityTransforms similarity = {
      .scales = torch::full({1}, 2.0, torch::kFloat64),
      .R = torch::tensor({0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0}, torch::kFloat64)
               .reshape({1, 3, 3}),
      .t = torch::tensor({{1.0, 2.0, 3.0}}, torch::kFloat64)};
  store.transform(similarity, which.to(torch::kInt64) - 1);
  expect_equal(rows(store.view(), ~which), rows(start, ~which));
  expect_equal(rows(store.view(), which), transformed(rows(start, which), similarity));
  EXPECT_THROW(store.transform(similarity, which), c10::Error);
}

TEST(GaussianStore, CheckpointIsBitwiseExactAndOptimizationContinuesIdentically) {
  GaussianStore store(make_gaussians(40, 3));
  for (std::uint64_t i = 0; i < 3; ++i) {
    give_gradients(store.view(), i);
    store.step({});
  }
  store.insert(make_gaussians(5, 3, 2));
  GaussianStore again = save_and_load(store);
  EXPECT_EQ(again.steps(), store.steps());
  expect_equal(again.view(), store.view());
  for (GaussianStore* s : {&store, &again}) {
    give_gradients(s->view(), 77);
    s->step({});
  }
  expect_equal(again.view(), store.view());
}

TEST(GaussianStore, RejectsForeignArchive) {
  torch::serialize::OutputArchive out;
  out.write("steps", c10::IValue(std::int64_t{3}));
  out.write("means", torch::zeros({4, 3}));
  std::stringstream stream;
  out.save_to(stream);
  torch::serialize::InputArchive in;
  in.load_from(stream);
  EXPECT_THROW(GaussianStore::load(in), c10::Error);
}

TEST(GaussianStore, RejectsInvalidArguments) {
  GaussianStore store(make_gaussians(4));
  EXPECT_THROW(store.insert(make_gaussians(4, 2)), c10::Error);
  EXPECT_THROW(store.prune(torch::ones({3}, torch::kBool)), c10::Error);
  EXPECT_THROW(store.prune(torch::ones({4})), c10::Error);
  Gaussians broken = make_gaussians(4);
  broken.log_scales = torch::zeros({3, 3});
  EXPECT_THROW(GaussianStore{broken}, c10::Error);
}

}  // namespace
}  // namespace apvi::gaussians
