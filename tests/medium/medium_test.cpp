// SPDX-License-Identifier: BSD-3-Clause
#include "medium/medium.hpp"

#include <ATen/Parallel.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <limits>
#include <vector>

#include "gaussians/devices.hpp"
#include "support/torch_reference.hpp"

namespace apvi::medium {
namespace {

using test::numeric_gradient;
using test::reference_medium;
using test::tensors_near;
using torch::Tensor;

constexpr double kDoubleTolerance = 1e-12;
constexpr double kFloatTolerance = 2e-5;  // gradients are sums over all pixels

/// A rendered image with empty, half-covered and covered pixels, in coastal water.
struct Scene {
  Tensor color, range, alpha;
  Medium medium;

  std::vector<Tensor> leaves() const {
    return {color, range, alpha, medium.beta_d, medium.beta_b, medium.b_inf};
  }
  Tensor through_water() const { return apply_medium(color, range, alpha, medium); }
  Tensor reference() const {
    return reference_medium(color, range, alpha, medium.beta_d, medium.beta_b, medium.b_inf);
  }
};

Scene make_scene(const torch::TensorOptions& options, std::int64_t height = 5,
                 std::int64_t width = 7) {
  torch::manual_seed(1);
  const auto f64 = torch::dtype(torch::kFloat64);
  const Tensor alpha = (torch::rand({height, width}, f64) * 1.4 - 0.2).clamp(0.0, 1.0);
  const auto leaf = [&](const Tensor& t) { return t.to(options).requires_grad_(true); };
  return {.color = leaf(torch::rand({height, width, 3}, f64) * alpha.unsqueeze(-1)),
          .range = leaf(torch::rand({height, width}, f64) * 9.0 + 0.5),
          .alpha = leaf(alpha),
          .medium = {.beta_d = leaf(torch::tensor({0.40, 0.12, 0.08}, f64)),
                     .beta_b = leaf(torch::tensor({0.30, 0.15, 0.10}, f64)),
                     .b_inf = leaf(torch::tensor({0.05, 0.30, 0.40}, f64))}};
}

/// Gradients of the image summed with fixed random weights, with respect to every leaf.
std::vector<Tensor> gradients(const Scene& scene, const Tensor& image) {
  torch::manual_seed(2);
  const Tensor weights = torch::randn(image.sizes(), torch::kFloat64).to(image.options());
  return torch::autograd::grad({(weights * image).sum()}, scene.leaves());
}

/// View data of such an image: rays of a wide-angle lens, and a lamp backscatter table.
MediumViewData make_view_data(const Tensor& range) {
  torch::manual_seed(4);
  const auto options = range.options().requires_grad(false);
  const auto random = [&](at::IntArrayRef sizes) {
    return torch::rand(sizes, torch::kFloat64).to(options);
  };
  return {.ray_lengths = 1.0 + random(range.sizes()), .lamp_backscatter = random({1, 3, 9, 6, 6})};
}

/// Reference with LibTorch's interpolation.
Tensor reference_lamp_backscatter(const Scene& scene, const MediumViewData& view_data) {
  const auto options = scene.range.options().requires_grad(false);
  const auto places = [&](std::int64_t count) {
    return (torch::arange(count, options) + 0.5) * (2.0 / static_cast<double>(count)) - 1.0;
  };
  const std::int64_t h = scene.range.size(0);
  const std::int64_t w = scene.range.size(1);
  const Tensor end = (scene.range * view_data.ray_lengths)
                         .detach()
                         .masked_fill(scene.alpha.detach() < 0.5, kLampMaxRange_m);
  const Tensor step = 2.0 * (end / kLampMaxRange_m).clamp(0.0, 1.0).sqrt() - 1.0;
  const Tensor at =
      torch::stack({places(w).expand({h, w}), places(h).unsqueeze(1).expand({h, w}), step}, 2);
  constexpr std::int64_t kLinear = 0;
  constexpr std::int64_t kBorder = 1;
  return torch::grid_sampler(view_data.lamp_backscatter, at.view({1, 1, h, w, 3}), kLinear, kBorder,
                             true)
      .view({3, h, w})
      .permute({1, 2, 0});
}

class MediumOnEveryDevice : public testing::TestWithParam<torch::Device> {};

TEST_P(MediumOnEveryDevice, MatchesTorchReferenceInFloat) {
  const Scene scene = make_scene(torch::dtype(torch::kFloat32).device(GetParam()), 61, 83);
  const Tensor image = scene.through_water();
  EXPECT_TRUE(tensors_near(image, scene.reference(), 1e-6));
  const Scene exact = make_scene(torch::dtype(torch::kFloat64), 61, 83);
  const auto expected = gradients(exact, exact.reference());
  const auto got = gradients(scene, image);
  for (std::size_t i = 0; i < got.size(); ++i) {
    EXPECT_TRUE(tensors_near(got[i], expected[i], kFloatTolerance)) << "input " << i;
  }
}

TEST_P(MediumOnEveryDevice, IsDeterministic) {
  const Scene scene = make_scene(torch::dtype(torch::kFloat32).device(GetParam()), 61, 83);
  const auto first = gradients(scene, scene.through_water());
  const auto second = gradients(scene, scene.through_water());
  for (std::size_t i = 0; i < first.size(); ++i) {
    EXPECT_TRUE(torch::equal(first[i], second[i])) << "input " << i;
  }
}

TEST_P(MediumOnEveryDevice, EmptyPixelsShowOpenWater) {
  const auto options = torch::dtype(torch::kFloat32).device(GetParam());
  const Scene scene = make_scene(options);
  const Tensor nothing = torch::zeros({5, 7}, options);
  const Tensor image =
      apply_medium(torch::zeros({5, 7, 3}, options), nothing, nothing, scene.medium);
  EXPECT_TRUE(tensors_near(image, scene.medium.b_inf.expand({5, 7, 3}), 1e-7));
}

TEST_P(MediumOnEveryDevice, AddsLampBackscatterUpToSurface) {
  const auto options = torch::dtype(torch::kFloat32).device(GetParam());
  const Scene scene = make_scene(options, 61, 83);
  const MediumViewData view_data = make_view_data(scene.range);
  const Medium& m = scene.medium;
  const Tensor image = apply_medium(scene.color, scene.range, scene.alpha, m, view_data);
  const Tensor range = scene.range * view_data.ray_lengths;
  const Tensor reference =
      reference_medium(scene.color, range, scene.alpha, m.beta_d, m.beta_b, m.b_inf) +
      reference_lamp_backscatter(scene, view_data);
  EXPECT_TRUE(tensors_near(image, reference, 1e-5));
  const auto expected = gradients(scene, reference);
  const auto got = gradients(scene, image);
  for (std::size_t i = 0; i < got.size(); ++i) {
    EXPECT_TRUE(tensors_near(got[i], expected[i], kFloatTolerance)) << "input " << i;
  }
}

TEST_P(MediumOnEveryDevice, SkipsMediumGradientsWhenNotRequired) {
  Scene scene = make_scene(torch::dtype(torch::kFloat32).device(GetParam()));
  const auto expected = gradients(scene, scene.through_water());
  for (Tensor* t : {&scene.medium.beta_d, &scene.medium.beta_b, &scene.medium.b_inf}) {
    *t = t->detach();
  }
  torch::manual_seed(2);
  const Tensor image = scene.through_water();
  const Tensor weights = torch::randn(image.sizes(), torch::kFloat64).to(image.options());
  const auto got =
      torch::autograd::grad({(weights * image).sum()}, {scene.color, scene.range, scene.alpha});
  for (std::size_t i = 0; i < got.size(); ++i) {
    EXPECT_TRUE(torch::equal(got[i], expected[i])) << "input " << i;
  }
}

INSTANTIATE_TEST_SUITE_P(Devices, MediumOnEveryDevice, testing::ValuesIn(test::available_devices()),
                         [](const auto& device) {
                           return device.param.is_cuda() ? "cuda" : "cpu";
                         });

TEST(Medium, GradientsMatchFiniteDifferences) {
  const Scene scene = make_scene(torch::dtype(torch::kFloat64));
  torch::manual_seed(2);
  const Tensor weights = torch::randn({5, 7, 3}, torch::kFloat64);
  const auto loss = [&] { return (weights * scene.through_water()).sum(); };
  const auto got = torch::autograd::grad({loss()}, scene.leaves());
  for (std::size_t i = 0; i < got.size(); ++i) {
    EXPECT_TRUE(tensors_near(got[i], numeric_gradient(loss, scene.leaves()[i]), 1e-8))
        << "input " << i;
  }
}

TEST(Medium, MatchesTorchReferenceInDouble) {
  const Scene scene = make_scene(torch::dtype(torch::kFloat64));
  const Tensor image = scene.through_water();
  EXPECT_TRUE(tensors_near(image, scene.reference(), kDoubleTolerance));
  const auto expected = gradients(scene, scene.reference());
  const auto got = gradients(scene, image);
  for (std::size_t i = 0; i < got.size(); ++i) {
    EXPECT_TRUE(tensors_near(got[i], expected[i], kDoubleTolerance)) << "input " << i;
  }
}

TEST(Medium, SingleRedPixelMatchesFormula) {
  const auto f64 = torch::dtype(torch::kFloat64);
  const Medium medium = {.beta_d = torch::full({3}, 0.5, f64),
                         .beta_b = torch::full({3}, 0.25, f64),
                         .b_inf = torch::full({3}, 0.2, f64)};
  const Tensor image =
      apply_medium(torch::tensor({0.8, 0.0, 0.0}, f64).reshape({1, 1, 3}),
                   torch::full({1, 1}, 2.0, f64), torch::ones({1, 1}, f64), medium);
  // 0.8 exp(-1) + 0.2 (1 - exp(-0.5)), and the second term alone.
  EXPECT_NEAR(image[0][0][0].item<double>(), 0.372997421, 1e-9);
  EXPECT_NEAR(image[0][0][1].item<double>(), 0.078693868, 1e-9);
}

TEST(Medium, DistantSurfacesConvergeToVeilingLight) {
  const auto f64 = torch::dtype(torch::kFloat64);
  const Scene scene = make_scene(f64);
  const Tensor image = apply_medium(scene.color, torch::full({5, 7}, 1e4, f64),
                                    torch::ones({5, 7}, f64), scene.medium);
  EXPECT_TRUE(tensors_near(image, scene.medium.b_inf.expand({5, 7, 3}), kDoubleTolerance));
}

TEST(Medium, GradientsDoNotDependOnTheNumberOfThreads) {
  const Scene scene = make_scene(torch::dtype(torch::kFloat32), 120, 90);
  const int threads = at::get_num_threads();
  at::set_num_threads(1);
  const auto alone = gradients(scene, scene.through_water());
  at::set_num_threads(3);
  const auto together = gradients(scene, scene.through_water());
  at::set_num_threads(threads);
  for (std::size_t i = 0; i < alone.size(); ++i) {
    EXPECT_TRUE(torch::equal(alone[i], together[i])) << "input " << i;
  }
}

TEST(Medium, AcceptsNonContiguousInputs) {
  const Scene scene = make_scene(torch::dtype(torch::kFloat64));
  const Tensor planes = scene.color.detach().permute({2, 0, 1}).contiguous();
  const Tensor image = apply_medium(planes.permute({1, 2, 0}), scene.range.t().contiguous().t(),
                                    scene.alpha, scene.medium);
  EXPECT_TRUE(tensors_near(image, scene.reference(), kDoubleTolerance));
}

TEST(Medium, RejectsMismatchedShapesAndTypes) {
  const Scene scene = make_scene(torch::dtype(torch::kFloat32));
  EXPECT_THROW(apply_medium(scene.color, scene.range.t(), scene.alpha, scene.medium), c10::Error);
  EXPECT_THROW(apply_medium(scene.range, scene.range, scene.alpha, scene.medium), c10::Error);
  EXPECT_THROW(
      apply_medium(scene.color, scene.range.to(torch::kFloat64), scene.alpha, scene.medium),
      c10::Error);
}

TEST(Medium, RejectsInvalidBackscatterTableAndAcceptsNonFiniteRanges) {
  const Scene scene = make_scene(torch::dtype(torch::kFloat32));
  MediumViewData view_data = make_view_data(scene.range);
  const auto seen = [&](const Tensor& range) {
    return apply_medium(scene.color, range, scene.alpha, scene.medium, view_data);
  };
  Tensor broken = scene.range.detach().clone();
  broken[2][3] = std::numeric_limits<float>::quiet_NaN();
  const Tensor image = seen(broken);
  EXPECT_TRUE(torch::equal(image[1], seen(scene.range)[1]));
  view_data.lamp_backscatter = view_data.lamp_backscatter[0];
  EXPECT_THROW(seen(scene.range), c10::Error);
}

TEST(MediumParameters, RoundTrip) {
  const Medium medium = make_scene(torch::dtype(torch::kFloat64)).medium;
  const Medium again = MediumParameters::from(medium).medium();
  EXPECT_TRUE(tensors_near(again.beta_d, medium.beta_d, kDoubleTolerance));
  EXPECT_TRUE(tensors_near(again.beta_b, medium.beta_b, kDoubleTolerance));
  EXPECT_TRUE(tensors_near(again.b_inf, medium.b_inf, kDoubleTolerance));
}

TEST(MediumParameters, StayInValidRangeUnderOptimization) {
  const auto f64 = torch::dtype(torch::kFloat64);
  for (const double raw : {-30.0, -1.0, 0.0, 30.0}) {
    const Medium medium = MediumParameters{.raw_beta_d = torch::full({3}, raw, f64),
                                           .raw_beta_b = torch::full({3}, raw, f64),
                                           .raw_b_inf = torch::full({3}, raw, f64)}
                              .medium();
    EXPECT_GT(medium.beta_d.min().item<double>(), 0.0);
    EXPECT_GT(medium.b_inf.min().item<double>(), 0.0);
    EXPECT_LT(medium.b_inf.max().item<double>(), 1.0);
  }
}

TEST(MediumParameters, RejectInvalidMedium) {
  Medium medium = make_scene(torch::dtype(torch::kFloat64)).medium;
  medium.beta_d = torch::zeros({3}, torch::kFloat64);
  EXPECT_THROW(MediumParameters::from(medium), c10::Error);
  medium = make_scene(torch::dtype(torch::kFloat64)).medium;
  medium.b_inf = torch::ones({3}, torch::kFloat64);
  EXPECT_THROW(MediumParameters::from(medium), c10::Error);
}

TEST(MediumParameters, AreRecoveredFromImageAndRange) {
  const Scene scene = make_scene(torch::dtype(torch::kFloat64), 24, 32);
  const Tensor truth = scene.through_water().detach();
  const auto f64 = torch::dtype(torch::kFloat64);
  const MediumParameters raw = MediumParameters::from({.beta_d = torch::full({3}, 0.2, f64),
                                                       .beta_b = torch::full({3}, 0.2, f64),
                                                       .b_inf = torch::full({3}, 0.5, f64)});
  torch::optim::LBFGS optimizer({raw.raw_beta_d.requires_grad_(), raw.raw_beta_b.requires_grad_(),
                                 raw.raw_b_inf.requires_grad_()},
                                torch::optim::LBFGSOptions(1.0)
                                    .max_iter(300)
                                    .tolerance_grad(1e-14)
                                    .tolerance_change(1e-16)
                                    .line_search_fn("strong_wolfe"));
  optimizer.step([&] {
    optimizer.zero_grad();
    const Tensor image = apply_medium(scene.color.detach(), scene.range.detach(),
                                      scene.alpha.detach(), raw.medium());
    Tensor loss = (image - truth).square().sum();
    loss.backward();
    return loss;
  });
  EXPECT_TRUE(tensors_near(raw.medium().beta_d, scene.medium.beta_d, 1e-5));
  EXPECT_TRUE(tensors_near(raw.medium().beta_b, scene.medium.beta_b, 1e-5));
  EXPECT_TRUE(tensors_near(raw.medium().b_inf, scene.medium.b_inf, 1e-5));
}

}  // namespace
}  // namespace apvi::medium
