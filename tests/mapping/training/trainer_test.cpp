// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/training/trainer.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <filesystem>
#include <string>

#include "apvi/core/error.hpp"
#include "mapping/density/initial_map.hpp"
#include "mapping/evaluation.hpp"
#include "support/posed_scene.hpp"
#include "support/tmp_dir.hpp"
#include "support/torch_reference.hpp"

namespace apvi::mapping {
namespace {

using test::bitwise_equal;
using test::gaussian_wall;
using test::render_keyframes;
using torch::Tensor;

TrainerOptions quick_options(int iterations) {
  TrainerOptions options;
  options.iterations = iterations;
  options.sh_degree = 1;
  options.sh_degree_interval = 20;
  options.initial_downscale = 2;
  options.densify.interval = 20;
  options.densify.max_gaussians = 900;
  options.learning_rates.means = 2e-3;
  options.learning_rates.sh_dc = 1e-2;
  return options;
}

gaussians::Gaussians rough_map() {
  const gaussians::Gaussians world = gaussian_wall();
  torch::manual_seed(1);
  const gaussians::PointCloud points = {
      .positions = world.means + 0.05 * torch::randn_like(world.means),
      .colors = torch::full({world.size(), 3}, 0.5F)};
  return initial_map(points, {.sh_degree = 1});
}

void run(Trainer& trainer, int steps) {
  for (int i = 0; i < steps; ++i) trainer.step();
}

double held_out_psnr(const Trainer& trainer, const KeyframeStore& keyframes) {
  return *mean_psnr({.gaussians = trainer.map(), .medium = trainer.medium()}, keyframes,
                    keyframes.held_out());
}

TEST(Trainer, RendersHeldOutViews) {
  KeyframeStore keyframes = render_keyframes(gaussian_wall());
  Trainer trainer(keyframes, rough_map(), quick_options(1500));
  const double before = held_out_psnr(trainer, keyframes);
  while (!trainer.done()) trainer.step();
  EXPECT_EQ(trainer.iteration(), 1500);
  EXPECT_DOUBLE_EQ(trainer.progress(), 1.0);
  EXPECT_GT(held_out_psnr(trainer, keyframes), std::max(22.0, before + 6.0));
}

TEST(Trainer, IsDeterministicForASeed) {
  KeyframeStore keyframes = render_keyframes(gaussian_wall());
  TrainerOptions options = quick_options(60);
  Trainer first(keyframes, rough_map(), options);
  Trainer second(keyframes, rough_map(), options);
  options.seed = 1;
  Trainer third(keyframes, rough_map(), options);
  for (Trainer* trainer : {&first, &second, &third}) run(*trainer, 60);
  EXPECT_TRUE(bitwise_equal(first.map(), second.map()));
  EXPECT_FALSE(bitwise_equal(first.map(), third.map()));
}

TEST(Trainer, ResumesBitIdentically) {
  KeyframeStore keyframes = render_keyframes(gaussian_wall());
  TrainerOptions options = quick_options(100);
  options.pose_refinement.enabled = options.exposure_correction.enabled = true;
  options.robust_weights = true;
  const medium::Medium water = {.beta_d = torch::full({3}, 0.1F),
                                .beta_b = torch::full({3}, 0.1F),
                                .b_inf = torch::full({3}, 0.3F)};
  const test::TmpDir dir;
  Trainer whole(keyframes, rough_map(), options, water);
  run(whole, 47);
  whole.save(dir.path() / "checkpoint.pt");
  run(whole, 33);
  Trainer resumed(keyframes, rough_map(), options, water);
  resumed.resume(dir.path() / "checkpoint.pt");
  EXPECT_EQ(resumed.iteration(), 47);
  run(resumed, 33);
  EXPECT_TRUE(bitwise_equal(whole.map(), resumed.map()));
  EXPECT_TRUE(torch::equal(whole.corrections().poses(), resumed.corrections().poses()));
  EXPECT_TRUE(torch::equal(whole.medium()->beta_d, resumed.medium()->beta_d));
}

TEST(Trainer, OptimizesTheMediumByGradientAlone) {
  KeyframeStore keyframes = render_keyframes(gaussian_wall());
  TrainerOptions options = quick_options(40);
  options.medium_estimation = MediumEstimationMethod::gradient;
  const medium::Medium water = {.beta_d = torch::full({3}, 0.3F),
                                .beta_b = torch::full({3}, 0.3F),
                                .b_inf = torch::full({3}, 0.5F)};
  Trainer trainer(keyframes, rough_map(), options, water);
  double before = 0.5;
  while (!trainer.done()) {
    trainer.step();
    const double now = trainer.medium()->b_inf[0].item<double>();
    ASSERT_NE(now, before) << "iteration " << trainer.iteration();
    ASSERT_LT(std::abs(now - before), 0.01) << "iteration " << trainer.iteration();  // no fit
    before = now;
  }
}

TEST(Trainer, NeverTrainsOnHeldOutImages) {
  const gaussians::Gaussians world = gaussian_wall();
  KeyframeStore keyframes = render_keyframes(world);
  KeyframeStore spoilt;
  for (std::size_t i = 0; i < keyframes.size(); ++i) {
    Keyframe keyframe = keyframes[i];
    if (keyframe.held_out) keyframe.image = torch::full_like(keyframe.image, 200);
    spoilt.add(keyframe);
  }
  TrainerOptions options = quick_options(40);
  options.densify.kind = Densification::random;
  Trainer first(keyframes, rough_map(), options);
  Trainer second(spoilt, rough_map(), options);
  run(first, 40);
  run(second, 40);
  EXPECT_TRUE(bitwise_equal(first.map(), second.map()));
}

TEST(Trainer, RespectsTheGaussianLimit) {
  KeyframeStore keyframes = render_keyframes(gaussian_wall());
  for (const Densification kind : {Densification::gradient, Densification::random}) {
    TrainerOptions options = quick_options(200);
    options.densify.kind = kind;
    options.densify.gradient_threshold = 1e-7;
    options.densify.max_gaussians = 500;
    Trainer trainer(keyframes, rough_map(), options);
    for (int i = 0; i < 150; ++i) {
      trainer.step();
      ASSERT_LE(trainer.size(), 500);
    }
    EXPECT_GT(trainer.size(), 400);
  }
}

TEST(Trainer, StopsAtTheTimeBudget) {
  KeyframeStore keyframes = render_keyframes(gaussian_wall());
  TrainerOptions options = quick_options(1000000);
  options.time_budget_s = 0.3;
  Trainer trainer(keyframes, rough_map(), options);
  while (!trainer.done()) trainer.step();
  EXPECT_GE(trainer.seconds(), 0.3);
  EXPECT_LT(trainer.seconds(), 5.0);
  EXPECT_DOUBLE_EQ(trainer.progress(), 1.0);
}

TEST(Trainer, CorrectsAWrongKeyframePose) {
  const gaussians::Gaussians world = gaussian_wall();
  KeyframeStore keyframes = render_keyframes(world);
  Keyframe misplaced = test::render_keyframe(world, test::camera_at(0.1, 0.1), 9);
  misplaced.T_camera_world = test::camera_at(0.13, 0.09);
  keyframes.add(misplaced);
  TrainerOptions options = quick_options(2000);
  options.initial_downscale = 1;
  options.pose_refinement = {.enabled = true,
                             .start_fraction = 0.2,
                             .learning_rate = 1e-3,
                             .prior_sigma_m = 0.1,
                             .prior_sigma_deg = 2.0};
  Trainer trainer(keyframes, rough_map(), options);
  while (!trainer.done()) trainer.step();
  const Tensor pose =
      corrected_pose(misplaced.T_camera_world, trainer.corrections().pose_delta(9, false));
  const Tensor center = camera_center(pose);
  EXPECT_NEAR(center[0].item<double>(), 0.10, 0.015);
  EXPECT_NEAR(center[1].item<double>(), 0.10, 0.015);
}

TEST(Trainer, RejectsDamagedCheckpoints) {
  KeyframeStore keyframes = render_keyframes(gaussian_wall());
  const test::TmpDir dir;
  Trainer trainer(keyframes, rough_map(), quick_options(10));
  EXPECT_THROW(trainer.resume(dir.write("checkpoint.pt", "nonsense")), InputError);
  EXPECT_THROW(trainer.resume(dir.path() / "missing.pt"), InputError);
  KeyframeStore fewer;
  fewer.add(keyframes[0]);
  Trainer other(fewer, rough_map(), quick_options(10));
  other.save(dir.path() / "other.pt");
  EXPECT_THROW(trainer.resume(dir.path() / "other.pt"), InputError);
}

TEST(Trainer, RejectsEmptyInput) {
  KeyframeStore none;
  EXPECT_THROW(Trainer(none, rough_map(), quick_options(10)), c10::Error);
  KeyframeStore keyframes = render_keyframes(gaussian_wall());
  EXPECT_THROW(
      Trainer(keyframes, gaussians::Gaussians::empty(0, torch::kFloat32), quick_options(10)),
      c10::Error);
}

TEST(RatesAt, UsesTheConfiguredRateOfEachParameter) {
  const LearningRates rates = {.means = 1e-2,
                               .means_final = 1e-4,
                               .log_scales = 2e-3,
                               .quaternions = 3e-3,
                               .logit_opacities = 4e-3,
                               .sh_dc = 5e-3,
                               .sh_rest = 6e-3,
                               .final_factor = 0.5};
  const gaussians::GaussianLearningRates first = rates_at(rates, 2.0, 0.0);
  EXPECT_NEAR(first.means, 2e-2, 1e-12);
  EXPECT_DOUBLE_EQ(first.log_scales, 2e-3);
  EXPECT_DOUBLE_EQ(first.quaternions, 3e-3);
  EXPECT_DOUBLE_EQ(first.logit_opacities, 4e-3);
  EXPECT_DOUBLE_EQ(first.sh_dc, 5e-3);
  EXPECT_DOUBLE_EQ(first.sh_rest, 6e-3);
  const gaussians::GaussianLearningRates last = rates_at(rates, 2.0, 1.0);
  EXPECT_NEAR(last.means, 2e-4, 1e-12);
  EXPECT_DOUBLE_EQ(last.logit_opacities, 2e-3);
}

TEST(CorrectedPose, MatchesTheRenderersPoseDelta) {
  const gaussians::Gaussians world = gaussian_wall();
  const Tensor delta = torch::tensor({0.05, -0.02, 0.1, 0.03, 0.02, -0.04}, torch::kFloat64);
  gaussians::View with_delta;
  with_delta.intrinsics = test::small_camera();
  with_delta.T_camera_world = test::camera_at(0.1, 0.0);
  gaussians::View moved = with_delta;
  with_delta.pose_delta = delta;
  moved.T_camera_world = corrected_pose(moved.T_camera_world, delta);
  EXPECT_TRUE(test::tensors_near(gaussians::render(world, moved, {}).color,
                                 gaussians::render(world, with_delta, {}).color, 1e-5));
}

}  // namespace
}  // namespace apvi::mapping
