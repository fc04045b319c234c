// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/mapper.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <filesystem>
#include <limits>

#include "apvi/core/error.hpp"
#include "mapping/evaluation.hpp"
#include "mapping/mapper_scene.hpp"
#include "support/posed_scene.hpp"
#include "support/tmp_dir.hpp"
#include "support/torch_reference.hpp"

namespace apvi::mapping {
namespace {

using test::bitwise_equal;
using test::camera_at;
using test::gaussian_wall;
using torch::Tensor;

MapperOptions quick_options() {
  MapperOptions options = small_map_options();
  options.trainer.final_iterations = 200;
  options.trainer.learning_rates.means = 1e-3;
  options.trainer.learning_rates.sh_dc = 1e-2;
  options.trainer.densify.interval = 20;
  options.online.max_densify_interval = 20;
  options.online.medium_min_keyframes = 3;
  return options;
}

MapperInput input_of(const gaussians::Gaussians& world, double x, double y, std::int64_t number,
                     bool held_out = false) {
  MapperInput input;
  input.keyframe = test::render_keyframe(world, camera_at(x, y), number, held_out);
  if (!held_out) input.points = points_of(world);
  return input;
}

/// Adds keyframes along the wall, every third of them held out.
void swim(Mapper& mapper, const gaussians::Gaussians& world, int keyframes, int steps) {
  for (int i = 0; i < keyframes; ++i) {
    mapper.add(input_of(world, 0.1 * i - 0.4, 0.05 * (i % 3), i, i % 3 == 1));
    for (int k = 0; k < steps && mapper.ready(); ++k) mapper.step();
  }
}

TEST(Mapper, ReconstructsAWorldIncrementally) {
  const gaussians::Gaussians world = gaussian_wall();
  Mapper mapper(quick_options());
  swim(mapper, world, 9, 40);
  const auto psnr = [&] {
    return *mean_psnr(mapper.snapshot(), mapper.keyframes(), mapper.keyframes().held_out());
  };
  const double online = psnr();
  EXPECT_GT(online, 19.0);
  mapper.begin_final();
  while (!mapper.final_done()) mapper.step();
  EXPECT_DOUBLE_EQ(mapper.progress(), 1.0);
  EXPECT_GT(psnr(), online + 0.5);
}

TEST(Mapper, RejectsInvalidKeyframes) {
  const gaussians::Gaussians world = gaussian_wall();
  Mapper mapper(quick_options());
  EXPECT_EQ(mapper.add({}), KeyframeDecision::no_image);
  EXPECT_FALSE(mapper.ready());
  EXPECT_EQ(mapper.add(input_of(world, 0.0, 0.0, 0)), KeyframeDecision::accepted);
  const gaussians::Gaussians before = mapper.snapshot().gaussians;
  MapperInput nan = input_of(world, 0.1, 0.0, 1);
  nan.keyframe.T_camera_world = nan.keyframe.T_camera_world.clone();
  nan.keyframe.T_camera_world[0][3] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(mapper.add(nan), KeyframeDecision::bad_pose);
  MapperInput stretched = input_of(world, 0.1, 0.0, 1);
  stretched.keyframe.T_camera_world = 2.0 * stretched.keyframe.T_camera_world;
  EXPECT_EQ(mapper.add(stretched), KeyframeDecision::bad_pose);
  MapperInput black = input_of(world, 0.1, 0.0, 1);
  black.keyframe.image = torch::ones_like(black.keyframe.image);
  EXPECT_EQ(mapper.add(black), KeyframeDecision::black);
  MapperInput small = input_of(world, 0.1, 0.0, 1);
  small.keyframe.image = small.keyframe.image.slice(0, 0, 8).contiguous();
  EXPECT_EQ(mapper.add(small), KeyframeDecision::bad_image);
  EXPECT_EQ(mapper.add(input_of(world, 0.3, 0.0, 0)), KeyframeDecision::duplicate);
  MapperInput low_visibility = input_of(world, 0.1, 0.0, 1);
  low_visibility.low_visibility = true;
  EXPECT_EQ(mapper.add(low_visibility), KeyframeDecision::low_visibility);
  EXPECT_EQ(mapper.keyframes().size(), 1U);
  EXPECT_TRUE(bitwise_equal(mapper.snapshot().gaussians, before));
}

TEST(Mapper, IgnoresInvalidPoints) {
  const gaussians::Gaussians world = gaussian_wall(40);
  Mapper mapper(quick_options());
  MapperInput input = input_of(world, 0.0, 0.0, 0);
  input.points.positions[0].fill_(std::numeric_limits<double>::quiet_NaN());
  input.points.positions[1][2] = -3.0;   // behind the camera
  input.points.sigmas[2] = 1e3;          // unknown distance
  input.points.positions[3][0] = 100.0;  // outside the image
  input.points.positions.slice(0, 4) = torch::tensor({0.0, 0.0, 3.0}, torch::kFloat64);
  EXPECT_EQ(mapper.add(input), KeyframeDecision::accepted);
  EXPECT_EQ(mapper.size(), 36);
  EXPECT_TRUE(torch::isfinite(mapper.snapshot().gaussians.log_scales).all().item<bool>());
}

TEST(Mapper, InsertsEachPointOnce) {
  const gaussians::Gaussians world = gaussian_wall(60);
  Mapper mapper(quick_options());
  mapper.add(input_of(world, 0.0, 0.0, 0));
  const std::int64_t first = mapper.size();
  EXPECT_GT(first, 10);
  mapper.add(input_of(world, 0.0, 0.0, 1));
  EXPECT_EQ(mapper.size(), first);
  MapperInput others = input_of(world, 0.0, 0.0, 2);
  others.points = points_of(world, 1000);
  mapper.add(others);
  EXPECT_EQ(mapper.size(), 2 * first);
}

TEST(Mapper, InsertsVisibleRangeSamples) {
  const gaussians::Gaussians world = gaussian_wall(60);
  Mapper mapper(quick_options());
  MapperInput input = input_of(world, 0.0, 0.0, 0);
  input.points = {};
  input.depth_samples =
      torch::tensor({{0.2, 0.1, 2.5}, {0.0, 0.0, -2.0}, {50.0, 0.0, 2.0}}, torch::kFloat64);
  mapper.add(input);
  ASSERT_EQ(mapper.size(), 1);
  EXPECT_TRUE(test::tensors_near(mapper.snapshot().gaussians.means[0],
                                 torch::tensor({0.2F, 0.1F, 2.5F}), 1e-5));
}

TEST(Mapper, GaussiansMoveWithTheirKeyframe) {
  const gaussians::Gaussians world = gaussian_wall();
  MapperOptions options = quick_options();
  options.trainer.densify.kind = Densification::gradient;
  options.trainer.densify.gradient_threshold = 1e-6;
  options.trainer.densify.max_gaussians = 5000;
  Mapper mapper(options);
  for (int i = 0; i < 4; ++i) {
    MapperInput input = input_of(world, 0.15 * i - 0.3, 0.0, i);
    input.points = points_of(world, std::int64_t{1000} * i);
    mapper.add(input);
    for (int k = 0; k < 25; ++k) mapper.step();
  }
  const Tensor own = mapper.optimizer().anchors() == 2;
  ASSERT_GT(own.sum().item<std::int64_t>(), 10);
  const gaussians::Gaussians before = mapper.snapshot().gaussians;
  const Tensor old_pose = mapper.keyframes()[2].T_camera_world;
  Tensor turn = torch::eye(4, torch::kFloat64);
  turn.slice(0, 0, 2).slice(1, 0, 2).copy_(
      torch::tensor({{0.8, -0.6}, {0.6, 0.8}}, torch::kFloat64));
  turn[2][3] = 0.2;
  MapperInput news;
  news.moved.push_back({mapper.keyframes()[2].stamp_ns, turn.mm(old_pose)});
  mapper.add(news);

  const gaussians::Gaussians after = mapper.snapshot().gaussians;
  const Tensor others = own.logical_not();
  EXPECT_TRUE(torch::equal(after.means.index({others}), before.means.index({others})));
  EXPECT_TRUE(torch::equal(after.log_scales, before.log_scales));
  const auto in_camera = [&](const gaussians::Gaussians& map, const Tensor& pose) {
    const Tensor points = map.means.index({own}).to(torch::kCPU, torch::kFloat64);
    return points.mm(pose.slice(0, 0, 3).slice(1, 0, 3).t()) + pose.slice(0, 0, 3).select(1, 3);
  };
  EXPECT_TRUE(test::tensors_near(in_camera(after, mapper.keyframes()[2].T_camera_world),
                                 in_camera(before, old_pose), 1e-5));
  // Its own part of the map looks the same.
  const auto image = [&](const gaussians::Gaussians& map, const Tensor& pose) {
    gaussians::Gaussians part;
    for (std::size_t k = 0; k < map.tensors().size(); ++k) {
      *part.tensors()[k] = map.tensors()[k]->index({own});
    }
    gaussians::View view;
    view.intrinsics = test::small_camera();
    view.T_camera_world = pose;
    return gaussians::render(part, view, {}).color;
  };
  EXPECT_TRUE(test::tensors_near(image(after, turn.mm(old_pose)), image(before, old_pose), 1e-4));
}

TEST(Mapper, HeldOutImagesMoveWithTheirLeadingKeyframe) {
  const gaussians::Gaussians world = gaussian_wall();
  Mapper mapper(quick_options());
  mapper.add(input_of(world, 0.0, 0.0, 0));
  MapperInput held_out = input_of(world, 0.1, 0.0, 1, true);
  held_out.follows_ns = mapper.keyframes()[0].stamp_ns;
  EXPECT_EQ(mapper.add(held_out), KeyframeDecision::held_out);
  const Tensor between =
      mapper.keyframes()[1].T_camera_world.mm(rigid_inverse(mapper.keyframes()[0].T_camera_world));
  MapperInput news;
  news.moved.push_back({mapper.keyframes()[0].stamp_ns, camera_at(0.5, -0.2)});
  mapper.add(news);
  EXPECT_TRUE(test::tensors_near(
      mapper.keyframes()[1].T_camera_world.mm(rigid_inverse(camera_at(0.5, -0.2))), between, 1e-9));
}

TEST(Mapper, RespectsBudgetsOverThousandsOfInsertions) {
  const gaussians::Gaussians world = gaussian_wall();
  MapperOptions options = quick_options();
  options.trainer.densify.kind = Densification::random;
  options.trainer.densify.gradient_threshold = 1e-7;
  options.trainer.densify.random_per_round = 100;
  options.trainer.densify.max_gaussians = 300;
  options.online.keyframe_budget_fraction = 0.05;
  options.online.recent_keyframes = 3;
  options.online.image_memory_mib = 20.0 * 48 * 32 * 3 / (1024.0 * 1024.0);
  options.online.max_heldout_views = 8;
  Mapper mapper(options);
  for (int i = 0; i < 150; ++i) {
    MapperInput input = input_of(world, 0.01 * i - 0.7, 0.05 * (i % 3), i, i % 4 == 0);
    input.keyframe.number = i / 4;
    if (!input.keyframe.held_out) input.points = points_of(world, std::int64_t{1000} * i);
    mapper.add(input);
    ASSERT_LE(mapper.size(), 300);
    ASSERT_LE(mapper.keyframes().training().size(), 20U);
    ASSERT_LE(mapper.keyframes().held_out().size(), 8U);
    for (int k = 0; k < 3 && mapper.ready(); ++k) mapper.step();
    ASSERT_LE(mapper.size(), 300);
  }
  EXPECT_GT(mapper.size(), 200);
  EXPECT_EQ(mapper.keyframes().training().back(), 149U);
  // A full map still inserts new Gaussians.
  EXPECT_GT((mapper.optimizer().anchors() >= 110).sum().item<std::int64_t>(), 10);
  const auto& held_out = mapper.keyframes().held_out();
  EXPECT_LT(held_out.front(), 40U);
  EXPECT_GT(held_out.back(), 110U);
}

TEST(Mapper, ThinningOfHeldOutImagesIsIndependentOfLostFrames) {
  const gaussians::Gaussians world = gaussian_wall();
  MapperOptions options = quick_options();
  options.online.max_heldout_views = 4;
  for (const int first : {0, 1, 2, 3}) {
    Mapper mapper(options);
    for (int number = first; number < 12; ++number) {
      MapperInput input = input_of(world, 0.01 * number, 0.0, number, true);
      input.keyframe.number = number;
      EXPECT_EQ(mapper.add(input), KeyframeDecision::held_out);
    }
    const auto& kept = mapper.keyframes().held_out();
    EXPECT_GE(kept.size(), 2U);
    for (const std::size_t i : kept) EXPECT_EQ(mapper.keyframes()[i].number % 2, 0) << first;
  }
}

TEST(Mapper, DensificationLeavesRoomForLaterKeyframes) {
  const gaussians::Gaussians world = gaussian_wall();
  MapperOptions options = quick_options();
  options.trainer.densify.kind = Densification::gradient;
  options.trainer.densify.gradient_threshold = 1e-9;
  options.trainer.densify.max_gaussians = 20000;
  Mapper mapper(options);
  std::int64_t inserted = 0;
  constexpr int kKeyframes = 4;
  for (int i = 0; i < kKeyframes; ++i) {
    const std::int64_t before = mapper.size();
    mapper.add(input_of(world, 0.1 * i - 0.2, 0.0, i));
    inserted += mapper.size() - before;
    for (int k = 0; k < 60; ++k) mapper.step();
  }
  const double share = options.online.densify_budget_fraction * kKeyframes * 20000.0;
  EXPECT_GT(static_cast<double>(mapper.size() - inserted), 0.3 * share);
  EXPECT_LE(static_cast<double>(mapper.size() - inserted), share);
}

TEST(Mapper, AFullMapKeepsItsQuality) {
  const gaussians::Gaussians world = gaussian_wall();
  MapperOptions options = quick_options();
  options.trainer.densify.max_gaussians = 260;
  options.online.keyframe_budget_fraction = 0.1;
  options.online.recent_keyframes = 3;
  Mapper mapper(options);
  const auto pass = [&](int first, int last) {
    for (int i = first; i < last; ++i) {
      MapperInput input = input_of(world, 0.05 * i - 1.0, 0.0, i, i % 5 == 2);
      if (!input.keyframe.held_out) input.points = points_of(world, 1000 * std::int64_t{i});
      mapper.add(input);
      for (int k = 0; k < 20 && mapper.ready(); ++k) mapper.step();
    }
  };
  pass(0, 15);
  ASSERT_GT(mapper.size(), 250);
  const std::vector<std::size_t> early = mapper.keyframes().held_out();
  const double before = *mean_psnr(mapper.snapshot(), mapper.keyframes(), early);
  pass(15, 40);
  const std::int64_t newer = (mapper.optimizer().anchors() >= 15).sum().item<std::int64_t>();
  EXPECT_GT(newer, 50);
  // Pruning by opacity instead lost 4.8 dB.
  EXPECT_GT(*mean_psnr(mapper.snapshot(), mapper.keyframes(), early), before - 2.0);
}

/// Passes the wall twice, the second time with drifted poses and points.
Mapper revisit(const gaussians::Gaussians& world, bool align, double drift_m) {
  MapperOptions options = quick_options();
  options.online.drift_m_s = 0.02;
  options.trainer.densify.max_gaussians = 1200;
  Mapper mapper(options);
  for (int i = 0; i < 52; ++i) {
    const bool again = i >= 26;
    const double x = 0.06 * (i % 26) - 0.8;
    MapperInput input = input_of(world, x, 0.0, i, !again && i % 5 == 2);
    input.align = align;
    if (!again) input.points = points_of(world);
    if (again) {
      input.keyframe.T_camera_world = camera_at(x, drift_m);
      input.points.positions.select(1, 1) += drift_m;
    }
    mapper.add(input);
    for (int k = 0; k < 40 && mapper.ready(); ++k) mapper.step();
  }
  return mapper;
}

TEST(Mapper, AlignsRevisitedAreasInSpiteOfDrift) {
  const gaussians::Gaussians world = gaussian_wall(1200);
  const double drift_m = 0.15;
  const auto psnr = [](const Mapper& mapper) {
    return *mean_psnr(mapper.snapshot(), mapper.keyframes(), mapper.keyframes().held_out());
  };
  const Mapper aligned = revisit(world, true, drift_m);
  const Mapper drifted = revisit(world, false, drift_m);
  EXPECT_GT(psnr(aligned), psnr(drifted) + 1.0);
  for (const std::size_t i : {std::size_t{40}, std::size_t{51}}) {
    const Tensor center = camera_center(aligned.pose(i));
    EXPECT_LT(std::abs(center[1].item<double>()), 0.2 * drift_m);
    EXPECT_NEAR(camera_center(drifted.pose(i))[1].item<double>(), drift_m, 1e-9);
  }
}

TEST(Mapper, NeverTrainsOnHeldOutImages) {
  const gaussians::Gaussians world = gaussian_wall();
  MapperOptions options = quick_options();
  options.trainer.densify.kind = Densification::random;
  Mapper first(options);
  Mapper second(options);
  for (int i = 0; i < 8; ++i) {
    MapperInput input = input_of(world, 0.1 * i - 0.4, 0.0, i, i % 3 == 1);
    first.add(input);
    if (input.keyframe.held_out) input.keyframe.image = 255 - input.keyframe.image;
    second.add(input);
    for (int k = 0; k < 15 && first.ready(); ++k) {
      first.step();
      second.step();
    }
  }
  EXPECT_EQ(first.keyframes().held_out().size(), 3U);
  EXPECT_TRUE(bitwise_equal(first.snapshot().gaussians, second.snapshot().gaussians));
}

TEST(Mapper, ResumesBitIdentically) {
  const gaussians::Gaussians world = gaussian_wall();
  MapperOptions options = quick_options();
  options.medium = true;
  options.trainer.medium_estimation = MediumEstimationMethod::gradient;
  options.trainer.exposure_correction.enabled = true;
  const test::TmpDir dir;
  Mapper whole(options);
  swim(whole, world, 6, 10);
  whole.save(dir.path() / "checkpoint.pt");
  Mapper resumed(options);
  resumed.resume(dir.path() / "checkpoint.pt");
  EXPECT_EQ(resumed.iteration(), whole.iteration());
  EXPECT_EQ(resumed.keyframes().size(), 6U);
  for (Mapper* mapper : {&whole, &resumed}) {
    mapper->begin_final();
    for (int k = 0; k < 20; ++k) mapper->step();
  }
  EXPECT_TRUE(bitwise_equal(whole.snapshot().gaussians, resumed.snapshot().gaussians));
  EXPECT_TRUE(torch::equal(whole.snapshot().medium->beta_d, resumed.snapshot().medium->beta_d));
  EXPECT_THROW(resumed.resume(dir.write("damaged.pt", "nonsense")), InputError);
}

TEST(Mapper, DoublesTheMediumRateWhileVioFails) {
  const gaussians::Gaussians world = gaussian_wall();
  MapperOptions options = quick_options();
  options.medium = true;
  options.trainer.medium_estimation = MediumEstimationMethod::gradient;
  Mapper mapper(options);
  swim(mapper, world, 5, 5);
  const double usual = *mapper.optimizer().medium_rate();
  MapperInput news;
  news.vio_failing = true;
  mapper.add(news);
  EXPECT_DOUBLE_EQ(*mapper.optimizer().medium_rate(), 2.0 * usual);
  mapper.add(MapperInput{});
  EXPECT_DOUBLE_EQ(*mapper.optimizer().medium_rate(), usual);
}

TEST(Mapper, ToleratesAKeyframeWithAWrongPose) {
  const gaussians::Gaussians world = gaussian_wall();
  const auto psnr_with = [&](bool wrong) {
    Mapper mapper(quick_options());
    for (int i = 0; i < 9; ++i) {
      MapperInput input = input_of(world, 0.1 * i - 0.4, 0.0, i, i % 3 == 1);
      if (wrong && i == 5) input.keyframe.T_camera_world = camera_at(3.0, 1.0);
      mapper.add(input);
      for (int k = 0; k < 30 && mapper.ready(); ++k) mapper.step();
    }
    return *mean_psnr(mapper.snapshot(), mapper.keyframes(), mapper.keyframes().held_out());
  };
  EXPECT_GT(psnr_with(true), psnr_with(false) - 3.0);
}

TEST(Mapper, CompensatesExposureChanges) {
  const gaussians::Gaussians world = gaussian_wall();
  const auto psnr_with = [&](bool auto_gain) {
    MapperOptions options = quick_options();
    options.trainer.gain_compensation = auto_gain;
    Mapper mapper(options);
    for (int i = 0; i < 12; ++i) {
      MapperInput input = input_of(world, 0.1 * i - 0.4, 0.0, i, i % 3 == 1);
      const double gain = 0.75 + 0.25 * std::cos(0.4 * i);
      input.keyframe.image =
          (input.keyframe.image.to(torch::kFloat32) * gain + 0.5).to(torch::kUInt8);
      mapper.add(input);
      for (int k = 0; k < 30 && mapper.ready(); ++k) mapper.step();
    }
    return *mean_psnr(mapper.snapshot(), mapper.keyframes(), mapper.keyframes().held_out());
  };
  EXPECT_GT(psnr_with(true), psnr_with(false) + 1.0);
}

TEST(Mapper, SnapshotsAreIndependentCopies) {
  const gaussians::Gaussians world = gaussian_wall();
  Mapper mapper(quick_options());
  EXPECT_EQ(mapper.snapshot().gaussians.size(), 0);
  swim(mapper, world, 2, 5);
  const Map then = mapper.snapshot();
  const Tensor means = then.gaussians.means.clone();
  swim(mapper, world, 2, 5);
  for (int k = 0; k < 5; ++k) mapper.step();
  EXPECT_TRUE(torch::equal(then.gaussians.means, means));
  EXPECT_FALSE(torch::equal(mapper.snapshot().gaussians.means, means));
}

// With a medium: its coefficients have the inverse unit.
TEST(Mapper, ImagesOfTheMapDoNotChangeWithTheUnitOfLength) {
  const gaussians::Gaussians world = gaussian_wall();
  MapperOptions options = quick_options();
  options.medium = true;
  options.trainer.medium_estimation = MediumEstimationMethod::gradient;
  Mapper mapper(options);
  swim(mapper, world, 6, 20);
  ASSERT_TRUE(mapper.map().medium);
  const auto image = [&] {
    return render_map(mapper.map(), mapper.keyframes().view(0, 1)).color.clone();
  };
  const Tensor before = image();
  const Tensor position = mapper.keyframes()[2].T_camera_world.clone();
  mapper.change_scale({2.5, torch::tensor({0.3, -0.2, 0.1}, torch::kFloat64)});
  EXPECT_LT((image() - before).abs().max().item<double>(), 2e-3);
  EXPECT_FALSE(torch::allclose(mapper.keyframes()[2].T_camera_world, position));
  const double online =
      *mean_psnr(mapper.snapshot(), mapper.keyframes(), mapper.keyframes().held_out());
  for (int k = 0; k < 50; ++k) mapper.step();
  EXPECT_GT(*mean_psnr(mapper.snapshot(), mapper.keyframes(), mapper.keyframes().held_out()),
            online - 0.5);
}

}  // namespace
}  // namespace apvi::mapping
