// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/training/robust_weights.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <cstdint>
#include <sstream>

#include "gaussians/metrics/metrics.hpp"
#include "mapping/training/map_optimizer.hpp"
#include "support/posed_scene.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::int64_t kHeight = 60;
constexpr std::int64_t kWidth = 80;
constexpr int kUsesUntilWeighted = 6;

// A textured surface, and the same as a blurred and noisy map shows it.
struct Images {
  Tensor image;
  Tensor rendered;
  Tensor alpha = torch::ones({kHeight, kWidth});

  RobustWeights::Comparison seen() const {
    return {.rendered = rendered, .alpha = alpha, .image = image};
  }
};

Images fitted_surface() {
  torch::manual_seed(3);
  const Tensor x = torch::arange(kWidth, torch::kFloat32).view({1, kWidth, 1});
  const Tensor y = torch::arange(kHeight, torch::kFloat32).view({kHeight, 1, 1});
  const Tensor surface = 0.4 + 0.15 * (0.2 * x).sin() * (0.15 * y).cos() + torch::zeros({1, 1, 3});
  return {.image = surface, .rendered = surface + 0.02 * torch::randn_like(surface)};
}

Tensor with_body(const Tensor& image, std::int64_t top, std::int64_t left) {
  Tensor changed = image.clone();
  changed.narrow(0, top, 12).narrow(1, left, 24) += 0.2;
  return changed;
}

Tensor weights_of(RobustWeights& weights, const Images& images, int uses = kUsesUntilWeighted) {
  Tensor last;
  for (int k = 0; k < uses; ++k) last = weights.weigh(0, images.seen());
  return last;
}

double mean_in_body(const Tensor& pixels, std::int64_t top, std::int64_t left) {
  return pixels.narrow(0, top, 12).narrow(1, left, 24).mean().item<double>();
}

TEST(RobustWeights, LowerTheWeightOfABodyOnly) {
  Images images = fitted_surface();
  images.image = with_body(images.image, 20, 32);
  RobustWeights weights(1);
  const Tensor w = weights_of(weights, images);
  ASSERT_EQ(w.sizes(), (torch::IntArrayRef{kHeight, kWidth}));
  EXPECT_LT(mean_in_body(w, 20, 32), 0.1);
  const double body = 12.0 * 24.0;
  const double lowered = (w < 0.5).sum().item<double>();
  EXPECT_LT(lowered - body, 0.03 * static_cast<double>(kHeight * kWidth));
  EXPECT_TRUE(torch::equal(weights.lowered(0, kHeight, kWidth), w < 0.5));
}

TEST(RobustWeights, FirstUsesOfAViewCountFully) {
  Images images = fitted_surface();
  images.image = with_body(images.image, 20, 32);
  RobustWeights weights(1);
  EXPECT_FALSE(weights_of(weights, images, 1).defined());
  EXPECT_FALSE(weights.lowered(0, kHeight, kWidth).any().item<bool>());
}

TEST(RobustWeights, KeepAViewThatDoesNotFitYet) {
  Images images = fitted_surface();
  RobustWeights weights(2);
  for (int k = 0; k < 20; ++k) weights.weigh(1, images.seen());
  images.image = images.image.clone();
  images.image.narrow(1, 0, kWidth / 2) += 0.3;  // half of it is new
  const Tensor w = weights_of(weights, images);
  EXPECT_TRUE(torch::equal(w, torch::ones_like(w)));
}

TEST(RobustWeights, KeepWhatTheMapDoesNotCover) {
  Images images = fitted_surface();
  images.image = with_body(images.image, 20, 32);
  images.alpha.narrow(0, 20, 12).narrow(1, 32, 24).fill_(0.2F);
  RobustWeights weights(1);
  const Tensor w = weights_of(weights, images);
  EXPECT_GT(mean_in_body(w, 20, 32), 0.99);
}

TEST(RobustWeights, KeepASurfaceInAnotherLight) {
  Images images = fitted_surface();
  images.image = images.image.clone();
  images.image.narrow(0, 20, 12).narrow(1, 32, 24) *= 0.9;  // a shadow
  RobustWeights weights(1);
  const Tensor w = weights_of(weights, images);
  EXPECT_EQ(w.min().item<float>(), 1.0F);
}

TEST(RobustWeights, KeepAFittedSurface) {
  RobustWeights weights(1);
  const Tensor w = weights_of(weights, fitted_surface());
  EXPECT_EQ(w.min().item<float>(), 1.0F);
}

TEST(RobustWeights, KeepSinglePixelsThatDoNotFit) {
  Images images = fitted_surface();
  images.image = images.image.clone();
  images.image.slice(0, 8, kHeight, 20).slice(1, 8, kWidth, 20) += 0.5;  // marine snow
  RobustWeights weights(1);
  const Tensor w = weights_of(weights, images);
  EXPECT_EQ(w.min().item<float>(), 1.0F);
}

TEST(RobustWeights, RecoverOnceTheMapFits) {
  Images images = fitted_surface();
  const Tensor rendered_before = images.rendered;
  images.image = with_body(images.image, 20, 32);
  RobustWeights weights(1);
  ASSERT_LT(mean_in_body(weights_of(weights, images), 20, 32), 0.1);
  images.rendered = with_body(rendered_before, 20, 32);
  const Tensor w = weights.weigh(0, images.seen());
  EXPECT_EQ(w.min().item<float>(), 1.0F);
}

TEST(RobustWeights, ReducedImagesHaveTheSameBodies) {
  Images images = fitted_surface();
  images.image = with_body(images.image, 20, 32);
  const auto reduced = [](const Tensor& image) {
    return image.view({kHeight / 2, 2, kWidth / 2, 2, 3}).mean({1, 3});
  };
  RobustWeights weights(1);
  Tensor w;
  for (int k = 0; k < kUsesUntilWeighted; ++k) {
    w = weights.weigh(0, {.rendered = reduced(images.rendered),
                          .alpha = torch::ones({kHeight / 2, kWidth / 2}),
                          .image = reduced(images.image)});
  }
  ASSERT_EQ(w.sizes(), (torch::IntArrayRef{kHeight / 2, kWidth / 2}));
  EXPECT_LT(
      mean_in_body(weights.lowered(0, kHeight, kWidth).logical_not().to(torch::kFloat32), 20, 32),
      0.1);
}

TEST(RobustWeights, ContinueFromAnArchive) {
  Images images = fitted_surface();
  images.image = with_body(images.image, 20, 32);
  RobustWeights first(1);
  weights_of(first, images);
  torch::serialize::OutputArchive out;
  first.save(out);
  std::stringstream bytes;
  out.save_to(bytes);
  torch::serialize::InputArchive in;
  in.load_from(bytes);
  RobustWeights second(0);
  second.load(in);
  EXPECT_TRUE(torch::equal(second.lowered(0, kHeight, kWidth), first.lowered(0, kHeight, kWidth)));
  EXPECT_TRUE(torch::equal(second.weigh(0, images.seen()), first.weigh(0, images.seen())));
}

// A wall in whose images a body is at another place each time.
double static_psnr(bool robust) {
  const gaussians::Gaussians wall = test::gaussian_wall();
  const KeyframeStore clean = test::render_keyframes(wall);
  KeyframeStore keyframes;
  for (std::size_t i = 0; i < clean.size(); ++i) {
    Keyframe keyframe = clean[i];
    keyframe.image = keyframe.image.clone();
    const std::int64_t height = keyframe.image.size(0);
    const std::int64_t width = keyframe.image.size(1);
    const auto place = static_cast<std::int64_t>(i);
    keyframe.image.narrow(0, 7 * place % (height - 12), 12)
        .narrow(1, 17 * place % (width - 16), 16)
        .fill_(255);
    keyframes.add(keyframe);
  }
  gaussians::Gaussians start = wall;
  start.sh_dc = wall.sh_dc * 0.5;
  TrainerOptions options;
  options.robust_weights = robust;
  options.gain_compensation = false;
  MapOptimizer optimizer(start, options, keyframes.size());
  gaussians::GaussianLearningRates rates;
  rates.sh_dc = 0.01;
  for (int k = 0; k < 400; ++k) {
    const auto& views = keyframes.training();
    optimizer.step(keyframes, views[static_cast<std::size_t>(k) % views.size()], {.rates = rates});
  }
  double sum = 0.0;
  for (const std::size_t i : clean.training()) {
    const Tensor color = render_map(optimizer.full_map(), clean.view(i, 1)).color.cpu();
    sum += gaussians::psnr(color.clamp(0.0, 1.0), clean[i].image.cpu() / 255.0);
  }
  return sum / static_cast<double>(clean.training().size());
}

TEST(RobustWeights, KeepMovingBodiesOutOfTheMap) {
  EXPECT_GT(static_psnr(true), static_psnr(false) + 1.0);
}

}  // namespace
}  // namespace apvi::mapping
