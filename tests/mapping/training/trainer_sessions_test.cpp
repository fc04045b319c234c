// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <torch/torch.h>

#include "gaussians/model/point_cloud.hpp"
#include "mapping/density/initial_map.hpp"
#include "mapping/evaluation.hpp"
#include "mapping/training/trainer.hpp"
#include "support/posed_scene.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

const Tensor& second_light() {
  static const Tensor light = torch::tensor({0.9F, 0.6F, 0.3F});
  return light;
}

gaussians::Gaussians in_light(gaussians::Gaussians map, const Tensor& light) {
  map.sh_dc = gaussians::color_to_sh_dc(gaussians::sh_dc_to_color(map.sh_dc) * light);
  return map;
}

TrainerOptions options_of(int iterations) {
  TrainerOptions options;
  options.iterations = iterations;
  options.sh_degree = 0;
  options.densify.kind = Densification::none;
  options.learning_rates.means = 2e-3;
  options.learning_rates.sh_dc = 1e-2;
  options.gain_compensation = false;  // the gains of all views would be the light
  return options;
}

gaussians::Gaussians gray_map() {
  const gaussians::Gaussians world = test::gaussian_wall();
  return initial_map({.positions = world.means, .colors = torch::full({world.size(), 3}, 0.5F)},
                     {.sh_degree = 0});
}

/// Two sessions over the same wall, in different light.
struct Sessions {
  KeyframeStore first = test::render_keyframes(test::gaussian_wall());
  KeyframeStore second = test::render_keyframes(in_light(test::gaussian_wall(), second_light()));

  Trainer trainer(int iterations, const Tensor& light) {
    const TrainerOptions options = options_of(iterations);
    return Trainer({{.keyframes = &first, .options = options},
                    {.keyframes = &second, .options = options, .light = light}},
                   gray_map());
  }
};

TEST(TrainerSessions, ShareAMapInDifferentLight) {
  Sessions sessions;
  Trainer trainer = sessions.trainer(3000, second_light() * torch::tensor({0.8F, 1.2F, 1.1F}));
  while (!trainer.done()) trainer.step();
  EXPECT_TRUE(torch::allclose(trainer.full_map(1).light, second_light(), 0.05))
      << trainer.full_map(1).light;
  EXPECT_FALSE(trainer.full_map(0).light.defined());
  EXPECT_GT(*mean_psnr(trainer.full_map(0), sessions.first, sessions.first.held_out()), 22.0);
  EXPECT_GT(*mean_psnr(trainer.full_map(1), sessions.second, sessions.second.held_out()), 22.0);
}

TEST(TrainerSessions, RestoredColorsAreThoseOfTheFirstSession) {
  Sessions sessions;
  Trainer trainer = sessions.trainer(200, second_light());
  while (!trainer.done()) trainer.step();
  const gaussians::View view = sessions.second.view(4, 1);
  const MapRendering first = render_map(trainer.full_map(0), view);
  const MapRendering second = render_map(trainer.full_map(1), view);
  EXPECT_TRUE(torch::equal(first.restored, second.restored));
  EXPECT_TRUE(torch::allclose(second.color, second.restored * trainer.full_map(1).light));
  EXPECT_TRUE(torch::equal(first.color, first.restored));
}

TEST(TrainerSessions, ResumeBitIdentically) {
  const test::TmpDir dir;
  Sessions sessions;
  Trainer whole = sessions.trainer(60, second_light());
  for (int i = 0; i < 30; ++i) whole.step();
  whole.save(dir.path() / "checkpoint.pt");
  for (int i = 0; i < 30; ++i) whole.step();
  Trainer resumed = sessions.trainer(60, torch::ones({3}));
  resumed.resume(dir.path() / "checkpoint.pt");
  for (int i = 0; i < 30; ++i) resumed.step();
  EXPECT_TRUE(test::bitwise_equal(whole.map(), resumed.map()));
  EXPECT_TRUE(torch::equal(whole.full_map(1).light, resumed.full_map(1).light));
}

TEST(TrainerSessions, RefiningAFinishedMapKeepsIt) {
  Sessions sessions;
  const gaussians::Gaussians world = test::gaussian_wall();
  TrainerOptions options = options_of(40);
  options.refine = true;
  options.learning_rates.means = 1e-5;
  Trainer trainer({{.keyframes = &sessions.first, .options = options},
                   {.keyframes = &sessions.second, .options = options, .light = second_light()}},
                  world);
  const auto psnr = [&] {
    return *mean_psnr(trainer.full_map(1), sessions.second, sessions.second.held_out());
  };
  const double before = psnr();
  while (!trainer.done()) trainer.step();
  EXPECT_GT(before, 40.0);
  EXPECT_GT(psnr(), before - 6.0);
}

TEST(TrainerSessions, ALightThatIsNotPositiveIsAnError) {
  Sessions sessions;
  EXPECT_THROW(sessions.trainer(10, torch::tensor({1.0F, 0.0F, 1.0F})), c10::Error);
  EXPECT_THROW(sessions.trainer(10, torch::ones({4})), c10::Error);
}

}  // namespace
}  // namespace apvi::mapping
