// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <sstream>

#include "medium/medium.hpp"
#include "medium/medium_initialization.hpp"
#include "medium/medium_optimizer.hpp"
#include "support/torch_reference.hpp"

namespace apvi::medium {
namespace {

using test::tensors_near;
using torch::Tensor;

const auto kF64 = torch::dtype(torch::kFloat64);

Medium make_medium(std::vector<double> beta_d, std::vector<double> beta_b,
                   std::vector<double> b_inf) {
  return {.beta_d = torch::tensor(beta_d, kF64),
          .beta_b = torch::tensor(beta_b, kF64),
          .b_inf = torch::tensor(b_inf, kF64)};
}

const Medium& green_coast() {
  static const Medium medium =
      make_medium({0.45, 0.18, 0.22}, {0.35, 0.16, 0.20}, {0.06, 0.33, 0.28});
  return medium;
}

struct Image {
  Tensor color, range;
};

/// A textured sea bed receding from the camera, with open water above, as an 8-bit image with
/// noise.
Image image(const Medium& medium, std::uint64_t seed, bool open_water = true) {
  torch::manual_seed(seed);
  constexpr std::int64_t kHeight = 60;
  constexpr std::int64_t kWidth = 80;
  const Tensor grains = torch::rand({1, 3, kHeight + 4, kWidth + 4}, kF64) - 0.5;
  const Tensor patches = torch::avg_pool2d(grains, 5, 1).squeeze(0).permute({1, 2, 0});
  const Tensor clear =
      (0.45 + 2.0 * patches + 0.1 * torch::rand({kHeight, kWidth, 3}, kF64)).clamp(0.02, 1.0);
  const Tensor row = torch::linspace(9.0, 0.8, kHeight, kF64).reshape({kHeight, 1});
  Tensor range = row.expand({kHeight, kWidth}).contiguous();
  Tensor alpha = torch::ones_like(range);
  if (open_water) {
    alpha.slice(0, 0, 8).zero_();
    range = range * alpha;
  }
  const Tensor seen = apply_medium(clear * alpha.unsqueeze(-1), range, alpha, medium) +
                      0.005 * torch::randn({kHeight, kWidth, 3}, kF64);
  return {torch::round(seen.clamp(0.0, 1.0) * 255.0) / 255.0, range};
}

Medium estimate(const Medium& truth, bool open_water) {
  std::vector<Tensor> colors;
  std::vector<Tensor> ranges;
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    const Image p = image(truth, seed, open_water);
    colors.push_back(p.color);
    ranges.push_back(p.range);
  }
  return initialize_medium(colors, ranges);
}

double worst_relative_error(const Tensor& got, const Tensor& truth) {
  return ((got - truth).abs() / truth).max().item<double>();
}

TEST(InitializeMedium, IsWithinTwentyPercentOfTruth) {
  for (const bool open_water : {true, false}) {
    const Medium got = estimate(green_coast(), open_water);
    const double tolerance = open_water ? 0.15 : 0.25;
    EXPECT_LT(worst_relative_error(got.beta_d, green_coast().beta_d), 0.15) << open_water;
    // Red backscatter is too weak for its coefficient to be well observable.
    EXPECT_LT(worst_relative_error(got.beta_b.slice(0, 1), green_coast().beta_b.slice(0, 1)),
              tolerance + 0.05)
        << open_water;
    EXPECT_LT(worst_relative_error(got.beta_b, green_coast().beta_b), 0.6) << open_water;
    EXPECT_LT(worst_relative_error(got.b_inf, green_coast().b_inf), tolerance) << open_water;
  }
}

TEST(InitializeMedium, DistinguishesTurbidFromClearWater) {
  const Medium clear = make_medium({0.12, 0.05, 0.04}, {0.10, 0.05, 0.04}, {0.05, 0.2, 0.3});
  const Medium turbid = make_medium({0.9, 0.5, 0.6}, {0.8, 0.5, 0.6}, {0.15, 0.35, 0.25});
  const Medium from_clear = estimate(clear, true);
  const Medium from_turbid = estimate(turbid, true);
  EXPECT_LT(worst_relative_error(from_clear.beta_d, clear.beta_d), 0.5);
  EXPECT_LT(worst_relative_error(from_turbid.beta_d, turbid.beta_d), 0.2);
  EXPECT_LT(worst_relative_error(from_turbid.b_inf, turbid.b_inf), 0.1);
}

TEST(InitializeMedium, ReturnsCoastalWaterForUninformativeImages) {
  const Medium got = initialize_medium({torch::full({20, 20, 3}, 0.5)}, {torch::ones({20, 20})});
  EXPECT_TRUE(tensors_near(got.beta_d, coastal_medium().beta_d, 1e-12));
  const Medium tiny = initialize_medium({torch::rand({2, 2, 3})}, {torch::ones({2, 2})});
  EXPECT_TRUE(tensors_near(tiny.beta_d, coastal_medium().beta_d, 1e-12));
  const Medium blind = initialize_medium({torch::rand({20, 20, 3})}, {torch::zeros({20, 20})});
  EXPECT_TRUE(tensors_near(blind.b_inf, coastal_medium().b_inf, 1e-12));
}

TEST(InitializeMedium, DoesNotMistakeUnknownRangesForOpenWater) {
  const Image p = image(green_coast(), 3, false);
  Tensor range = p.range.clone();
  range.index_put_({torch::rand({60, 80}, kF64) < 0.3}, 0.0);
  const Medium got = initialize_medium({p.color}, {range});
  EXPECT_LT(worst_relative_error(got.b_inf, green_coast().b_inf), 0.3);
}

TEST(InitializeMedium, RejectsMismatchedShapes) {
  EXPECT_THROW(initialize_medium({}, {}), c10::Error);
  EXPECT_THROW(initialize_medium({torch::rand({4, 5, 3})}, {torch::rand({5, 4})}), c10::Error);
}

TEST(MediumOptimizer, DoublesStepsWhileOdometryFails) {
  const auto first_step = [](bool failing) {
    MediumOptimizer optimizer(green_coast(), 0.01);
    optimizer.set_vio_failing(failing);
    const Tensor before = optimizer.parameters().raw_beta_d.detach().clone();
    const Medium medium = optimizer.medium();
    (medium.beta_d.sum() + medium.beta_b.sum() + medium.b_inf.sum()).backward();
    optimizer.step();
    return before - optimizer.parameters().raw_beta_d.detach();
  };
  EXPECT_TRUE(tensors_near(first_step(false), torch::full({3}, 0.01, kF64), 1e-9));
  EXPECT_TRUE(tensors_near(first_step(true), torch::full({3}, 0.02, kF64), 1e-9));
}

TEST(MediumOptimizer, RestoresRateWhenOdometryRecovers) {
  MediumOptimizer optimizer(green_coast(), 0.01);
  optimizer.set_vio_failing(true);
  optimizer.set_vio_failing(true);
  EXPECT_EQ(optimizer.rate(), 0.02);
  optimizer.set_vio_failing(false);
  EXPECT_EQ(optimizer.rate(), 0.01);
}

TEST(MediumOptimizer, RecoversMediumFromImage) {
  const Image p = image(green_coast(), 1);
  torch::manual_seed(1);
  const Tensor alpha = (p.range > 0.0).to(torch::kFloat64);
  const Tensor clear = torch::rand({60, 80, 3}, kF64) * alpha.unsqueeze(-1);
  const Tensor truth = apply_medium(clear, p.range, alpha, green_coast());
  MediumOptimizer optimizer(coastal_medium(), 0.03);
  for (int i = 0; i < 800; ++i) {
    (apply_medium(clear, p.range, alpha, optimizer.medium()) - truth).square().sum().backward();
    optimizer.step();
  }
  EXPECT_LT(worst_relative_error(optimizer.medium().beta_d, green_coast().beta_d), 0.01);
  EXPECT_LT(worst_relative_error(optimizer.medium().beta_b, green_coast().beta_b), 0.01);
  EXPECT_LT(worst_relative_error(optimizer.medium().b_inf, green_coast().b_inf), 0.01);
}

TEST(MediumOptimizer, CheckpointIsBitExact) {
  const auto take_step = [](MediumOptimizer& optimizer) {
    (optimizer.medium().beta_d.square().sum() + optimizer.medium().b_inf.sum()).backward();
    optimizer.step();
  };
  MediumOptimizer optimizer(green_coast());
  take_step(optimizer);
  torch::serialize::OutputArchive out;
  optimizer.save(out);
  std::stringstream stream;
  out.save_to(stream);
  torch::serialize::InputArchive in;
  in.load_from(stream);
  MediumOptimizer restored(coastal_medium());
  restored.load(in);
  take_step(optimizer);
  take_step(restored);
  EXPECT_TRUE(torch::equal(restored.parameters().raw_beta_d, optimizer.parameters().raw_beta_d));
  EXPECT_TRUE(torch::equal(restored.parameters().raw_beta_b, optimizer.parameters().raw_beta_b));
  EXPECT_TRUE(torch::equal(restored.parameters().raw_b_inf, optimizer.parameters().raw_b_inf));
}

TEST(MediumOptimizer, StepsFollowResolutionMatrixOfPrior) {
  MediumOptimizer optimizer(coastal_medium(), 0.02);
  Tensor resolution = torch::zeros({3, 3, 3}, kF64);
  resolution[1][0][0] = 1.0;  // beta_d of green alone
  optimizer.set_prior(green_coast(), resolution);
  EXPECT_TRUE(tensors_near(optimizer.medium().b_inf, green_coast().b_inf, 1e-12));
  for (int i = 0; i < 20; ++i) {
    const Medium medium = optimizer.medium();
    (medium.beta_d.sum() + medium.beta_b.sum() + medium.b_inf.sum()).backward();
    optimizer.step();
  }
  const Medium after = optimizer.medium();
  EXPECT_TRUE(tensors_near(after.beta_b, green_coast().beta_b, 1e-12));
  EXPECT_TRUE(tensors_near(after.b_inf, green_coast().b_inf, 1e-12));
  EXPECT_NEAR(after.beta_d[0].item<double>(), green_coast().beta_d[0].item<double>(), 1e-12);
  EXPECT_LT(after.beta_d[1].item<double>(), green_coast().beta_d[1].item<double>() - 1e-3);
}

TEST(MediumOptimizer, StaysNearPrior) {
  MediumOptimizer optimizer(coastal_medium(), 0.02);
  optimizer.set_prior(green_coast(), torch::eye(3, kF64).repeat({3, 1, 1}));
  for (int i = 0; i < 1500; ++i) {
    optimizer.medium().b_inf.sum().backward();
    optimizer.step();
  }
  EXPECT_LT(worst_relative_error(optimizer.medium().b_inf, green_coast().b_inf), 0.15);
}

TEST(MediumOptimizer, RejectsInvalidMedium) {
  EXPECT_THROW(MediumOptimizer(green_coast(), 0.0), c10::Error);
  EXPECT_THROW(MediumOptimizer(make_medium({0.0, 0.1, 0.1}, {0.1, 0.1, 0.1}, {0.1, 0.1, 0.1})),
               c10::Error);
}

}  // namespace
}  // namespace apvi::medium
