// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/appearance/illumination.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>

#include "gaussians/model/archive.hpp"
#include "mapping/density/initial_map.hpp"
#include "mapping/evaluation.hpp"
#include "mapping/rendering.hpp"
#include "mapping/training/trainer.hpp"
#include "support/posed_scene.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr int kViews = 8;

// Bright stripes that wander across the image, [H,W,1].
Tensor stripes(int view, std::int64_t height, std::int64_t width) {
  const Tensor x = torch::arange(width, torch::kFloat32) / static_cast<double>(width);
  return (0.3 * torch::sin(12.0 * x + 0.8 * view)).exp().expand({height, width}).unsqueeze(2);
}

Illumination illumination_of(int views) {
  std::vector<std::size_t> training;
  for (int i = 0; i < views; ++i) training.push_back(static_cast<std::size_t>(i));
  return {static_cast<std::size_t>(views), training, test::small_camera(), torch::kCPU};
}

void learn(Illumination& illumination, int steps) {
  const Tensor clear = torch::full({32, 48, 3}, 0.4F);
  for (int k = 0; k < steps; ++k) {
    const int view = k % kViews;
    const Tensor image = illumination.apply(static_cast<std::size_t>(view), clear, 1.0);
    (image - clear * stripes(view, 32, 48)).abs().mean().backward();
    illumination.step(static_cast<std::size_t>(view));
  }
}

// The wall, in images with the given time between them under wandering stripes; every fourth is
// held out.
KeyframeStore striped_images(double interval_s) {
  const gaussians::Gaussians wall = test::gaussian_wall();
  KeyframeStore store;
  for (int i = 0; i < 24; ++i) {
    Keyframe keyframe = test::render_keyframe(wall, test::camera_at(0.02 * i, 0.0), i, i % 4 == 2);
    keyframe.stamp_ns = static_cast<std::int64_t>(1e9 * interval_s * (i + 1));
    const Tensor lit = keyframe.image.to(torch::kFloat32) * stripes(i, 32, 48) * 0.5;
    keyframe.image = lit.clamp(0.0, 255.0).to(torch::kUInt8);
    store.add(std::move(keyframe));
  }
  return store;
}

TEST(Illumination, LearnsLightThatMovesAndHasAMeanOfZero) {
  Illumination illumination = illumination_of(kViews);
  learn(illumination, 100 * kViews);
  EXPECT_LT(illumination.logs().mean(0).abs().max().item<double>(), 0.02);
  Tensor truth = torch::stack([] {
    std::vector<Tensor> all;
    for (int view = 0; view < kViews; ++view) all.push_back(stripes(view, 32, 48).log());
    return all;
  }());
  truth = truth - truth.mean(0, true);
  for (int view = 0; view < kViews; ++view) {
    const Tensor found = illumination_gain(illumination.logs()[view], 1.0, 32, 48).log();
    EXPECT_EQ(found.sizes(), at::IntArrayRef({32, 48, 3}));
    EXPECT_LT((found - truth[view]).abs().mean().item<double>(), 0.03) << view;
  }
}

TEST(Illumination, ContinuesFromItsArchiveWithTheSameBits) {
  Illumination whole = illumination_of(kViews);
  learn(whole, 70);
  torch::serialize::OutputArchive out;
  whole.save(out);
  const test::TmpDir dir;
  const std::string file = (dir.path() / "archive.pt").string();
  out.save_to(file);
  torch::serialize::InputArchive in;
  in.load_from(file);
  Illumination resumed = illumination_of(kViews);
  resumed.load(in);
  learn(whole, 40);
  learn(resumed, 40);
  EXPECT_TRUE(torch::equal(whole.logs(), resumed.logs()));
  Illumination other = illumination_of(kViews + 1);
  EXPECT_THROW(other.load(in), c10::Error);
}

TEST(Illumination, OnlyImagesCloseInTimeResolveMovingLight) {
  EXPECT_TRUE(resolves_moving_light(striped_images(0.033)));
  EXPECT_FALSE(resolves_moving_light(striped_images(0.5)));
}

TEST(Illumination, HeldOutImagesTakeTheMeanOfTheirNeighbors) {
  const KeyframeStore keyframes = striped_images(0.033);
  Map map;
  map.gaussians = test::gaussian_wall();
  map.illumination = torch::zeros({24, 3, 2, 3});
  map.illumination[1].fill_(0.2);
  map.illumination[2].fill_(9.0);  // held out: never its own
  map.illumination[3].fill_(0.4);
  const Tensor response = camera_response(map, keyframes, 2, 1);
  EXPECT_NEAR(response.log().mean().item<double>(), 0.3, 1e-5);
  EXPECT_NEAR(camera_response(map, keyframes, 3, 2).log().mean().item<double>(), 0.4, 1e-5);
}

TEST(Illumination, MovingLightCostsLessQualityWithIt) {
  const gaussians::Gaussians wall = test::gaussian_wall();
  const gaussians::Gaussians rough = initial_map(
      gaussians::PointCloud{.positions = wall.means, .colors = torch::full({wall.size(), 3}, 0.3F)},
      {.sh_degree = 0});
  TrainerOptions options;
  options.iterations = 600;
  options.sh_degree = 0;
  options.initial_downscale = 1;
  options.densify.kind = Densification::none;
  options.learning_rates.sh_dc = 1e-2;
  const auto psnr = [&](double interval_s) {
    KeyframeStore keyframes = striped_images(interval_s);
    Trainer trainer(keyframes, rough, options);
    while (!trainer.done()) trainer.step();
    return *mean_psnr(trainer.full_map(), keyframes, keyframes.held_out());
  };
  EXPECT_GT(psnr(0.033), psnr(0.5) + 2.0);
}

}  // namespace
}  // namespace apvi::mapping
